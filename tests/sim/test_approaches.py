"""Ways to things that the real robot only came near to on top of them."""

import numpy as np
import pytest

from sim.homes.cells import CellGrid, Cells
from sim.homes.plan import Furniture
from sim.homes.recovered.approaches import APART, NEAR_ENOUGH, approaches, is_beside
from sim.homes.recovered.recorded import PathLength, Recorded
from sim.types import RELAXED_RADIUS, SUCCESS_RADIUS

from .plans import piece
from .recorded_worlds import objects_of, recorded_goal, recorded_of

GRID = CellGrid(origin_xz=(-4.0, -4.0), shape=(160, 160), walkable=())
BED = piece("bed_1", (0.0, 0.25, 0.0), (1.3, 0.5, 2.0))
FAR, TOP = (1.3, 0.0, 3.0), (0.0, 0.6, 0.3)
RECORD = PathLength("easy", "bed_1", FAR, TOP, 3.0)


def floor_of(x: float, z: float, *, width: float = 1.0, depth: float = 1.0) -> Cells:
    """Level floor from (x, z) on."""
    rc = np.argwhere(np.ones((round(depth / 0.05), round(width / 0.05)), bool)) + GRID.grid.rc_from_xz(
        np.array([x + 0.025, z + 0.025])
    )
    return Cells(rc, np.zeros(len(rc)), np.zeros(len(rc), bool))


def ways(cells: Cells, *solid: Furniture, seen_from: tuple[float, float, float] = TOP) -> list[Cells]:
    """Approaches to a bed that was seen from one place."""
    record: Recorded = recorded_of(recorded_goal("bed_1", BED.centre, [seen_from]))._replace(lengths=(RECORD,))
    return approaches(cells, record, solid, [0.0], grid=GRID)


def test_a_strip_leads_from_the_reached_floor_to_the_side_of_a_bed_that_was_seen_from_its_top() -> None:
    floor = floor_of(0.9, 2.5)
    (way,) = ways(floor, BED)
    places = np.insert(GRID.grid.xz_from_rc(way.rc), 1, way.y, axis=1)
    away = np.hypot(places[:, 0], places[:, 2])
    assert away.min() <= NEAR_ENOUGH
    assert away.max() >= np.hypot(*GRID.grid.xz_from_rc(floor.rc).T).min()
    assert way.guessed.all()
    assert np.abs(places[:, 0]).max() > 1.3 / 2 + APART - 0.05, "its end is beside the bed"


def test_floor_that_is_near_enough_needs_no_strip_and_enough_is_more_for_a_thing_that_nobody_came_near_to() -> None:
    assert ways(floor_of(0.9, 0.0, depth=4.0), BED) == []
    far = (0.0, 0.0, SUCCESS_RADIUS + 0.05)
    assert len(ways(floor_of(0.9, 1.0, depth=3.0), BED)) == 1
    assert ways(floor_of(0.9, 1.0, depth=3.0), BED, seen_from=far) == []
    (way,) = ways(floor_of(0.9, 2.5), BED, seen_from=far)
    assert NEAR_ENOUGH < np.hypot(*GRID.grid.xz_from_rc(way.rc).T).min() <= RELAXED_RADIUS


def test_a_strip_goes_round_no_furniture_so_a_bed_behind_others_gets_none() -> None:
    fence = [
        piece("table_2", (0.0, 0.4, 1.8), (7.0, 0.8, 0.6)),
        piece("table_3", (0.0, 0.4, -1.8), (7.0, 0.8, 0.6)),
    ]
    assert ways(floor_of(0.9, 2.5), BED, *fence) == []


def test_places_beside_a_piece_are_on_its_level() -> None:
    beside, above, away = (0.65 + APART - 0.01, 0.0, 0.0), (0.8, 1.0, 0.0), (0.65 + APART + 0.01, 0.0, 0.0)
    assert is_beside(np.array([beside, above, away]), [BED]).tolist() == [True, False, False]


@pytest.mark.parametrize(("seen_from", "is_narrow"), [((0.0, 0.5, 0.3), True), ((0.0, 0.0, 1.3), False)])
def test_a_bed_that_was_only_reached_from_its_top_is_narrow_enough_to_be_reached_from_its_side(
    seen_from: tuple[float, float, float], is_narrow: bool
) -> None:
    places = [seen_from, *((x, 0.0, 1.6) for x in (-0.4, 0.0, 0.4))]
    found = objects_of(recorded_of(recorded_goal("bed_1", (0.0, 0.3, 0.0), places)))["bed_1"].piece
    least = min(found.size[0], found.size[2])
    assert (least / 2 + APART + 0.05 <= NEAR_ENOUGH + 1e-9) == is_narrow, found.size
