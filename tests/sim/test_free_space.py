"""Whether a planned home is open: rooms that can be reached, and pieces that can be seen, judged by their boxes."""

import numpy as np
import pytest

from sim.homes.cells import CELL
from sim.homes.invented.free_space import unseen_pieces, walkable_floor
from sim.homes.plan import Furniture, HomePlan

from .plans import Vec, piece, two_rooms


def box(category: str, x: float, z: float, size: Vec, *, y: float = 0.0) -> Furniture:
    """A piece in the west room whose bottom is at height y."""
    return piece(f"{category}_1", (x, y + size[1] / 2, z), size, room="west")


def test_free_floor_keeps_the_robots_radius_from_walls() -> None:
    ground = walkable_floor(two_rooms())
    assert ground is not None
    places = ground[0].places()
    assert places[:, 0].min() == pytest.approx(0.06 + 0.22, abs=2 * CELL)
    assert places[:, 0].max() == pytest.approx(8 - 0.06 - 0.22, abs=2 * CELL)
    assert (np.hypot(*(places - [4.0, 2.0]).T) < CELL).any()  # through the door


@pytest.mark.parametrize(
    "plan",
    [
        two_rooms(door=None),
        two_rooms(box("wardrobe", 3.6, 2.0, (0.6, 2.0, 1.4))),  # in front of the door
    ],
)
def test_a_room_that_cannot_be_reached_is_noticed(plan: HomePlan) -> None:
    assert walkable_floor(plan) is None


def test_tall_furniture_hides_objects_and_a_rug_or_a_high_lamp_blocks_nothing() -> None:
    rug, lamp = box("rug", 3.6, 2.0, (0.6, 0.02, 1.4)), box("lamp", 3.6, 2.0, (0.6, 0.3, 1.4), y=1.8)
    assert walkable_floor(two_rooms(rug, lamp)) is not None
    vase = box("vase", 0.3, 0.3, (0.2, 0.3, 0.2))
    assert seen(vase) == {"vase"}
    # a wardrobe and a shelf close off the corner
    walls = (box("wardrobe", 0.8, 0.45, (0.4, 2.0, 0.78)), box("shelf", 0.53, 0.95, (0.94, 2.0, 0.2)))
    assert seen(vase, *walls) == {"wardrobe", "shelf"}
    assert seen(vase, walls[0]) == {"vase", "wardrobe"}


def seen(*pieces: Furniture) -> set[str]:
    plan = two_rooms(*pieces)
    ground = walkable_floor(plan)
    assert ground is not None
    hidden = unseen_pieces(plan, ground)
    return {piece.category for k, piece in enumerate(plan.furniture) if k not in hidden}


def test_objects_on_a_table_or_inside_a_couchs_box_are_seen_and_one_too_far_from_the_floor_is_not() -> None:
    table = box("table", 2.0, 0.5, (1.0, 0.7, 0.8))
    assert "bowl" in seen(table, box("bowl", 2.0, 0.5, (0.2, 0.1, 0.2), y=0.7))
    stage = box("stage", 1.3, 1.3, (2.4, 0.5, 2.4))
    assert seen(stage, box("bowl", 0.3, 0.3, (0.2, 0.1, 0.2), y=0.5)) == {"stage"}  # 2.5 m from the nearest floor
    couch = box("couch", 2.0, 0.5, (1.8, 0.8, 0.8))
    assert "cushion" in seen(couch, box("cushion", 2.0, 0.55, (0.4, 0.2, 0.3), y=0.4))
