"""Cords: things without a wall, a floor or another thing hang from the ceiling."""

import pytest

from sim.homes.furniture.families import Mounting
from sim.homes.recovered.cords import cords

from .cell_plans import block, plan_of_cells
from .plans import piece

HOME = plan_of_cells(block(20, 20, 40, 40))
"""Floor from x = z = 1 m to 3 m and 0.2 m around it; the ceiling is at 2.5 m."""
MIRROR = (0.6, 0.9, 0.04)


def carried(mounting: Mounting, *pieces: tuple[str, tuple[float, float, float], tuple[float, float, float]]) -> int:
    """Number of cords of a home with these pieces, of which the first has this mounting and the others stand."""
    furniture = [piece(*one) for one in pieces]
    mountings: dict[str, Mounting] = {one.name: "floor" for one in furniture}
    mountings[furniture[0].name] = mounting
    assert HOME.cells is not None
    return len(cords(furniture, mountings, HOME.storeys, grid=HOME.cells))


def test_a_mirror_in_the_middle_of_a_room_hangs_from_the_ceiling() -> None:
    assert HOME.cells is not None
    mirror = piece("mirror_7", (2.0, 1.5, 2.0), MIRROR)
    (cord,) = cords([mirror], {"mirror_7": "wall"}, HOME.storeys, grid=HOME.cells)
    assert cord.name == "hanging cord_8"
    assert cord.role == "clutter"
    assert (cord.centre[0], cord.centre[2]) == (2.0, 2.0)
    assert cord.bottom_y == pytest.approx(mirror.top_y)
    assert cord.top_y == pytest.approx(2.5)


def test_what_a_wall_the_floor_or_a_thing_carries_has_no_cord() -> None:
    vase = ("vase_2", (2.0, 1.0, 2.0), (0.2, 0.4, 0.2))
    assert carried("on", vase) == 1
    assert carried("on", vase, ("table_3", (2.0, 0.39, 2.0), (1.1, 0.78, 0.7))) == 0
    assert carried("on", vase, ("stairs_3", (2.0, 0.39, 2.0), (1.1, 0.78, 0.7))) == 1
    assert carried("on", vase, ("table_3", (2.0, 0.35, 2.0), (1.1, 0.7, 0.7))) == 1
    assert carried("floor", vase) == 0
    assert carried("ceiling", vase) == 0
    assert carried("on", ("vase_2", (2.0, 0.2, 2.0), (0.2, 0.4, 0.2))) == 0
    assert carried("wall", ("mirror_7", (2.0, 1.5, 0.8), MIRROR)) == 0, "its back is to the wall at z = 0.8 m"
    assert carried("wall", ("mirror_7", (2.0, 1.5, 3.1), MIRROR)) == 1, "its front is to the wall"
