"""Holders: what would float gets a stand below, a panel behind, a rod above or a ledge."""

import pytest

from sim.homes.furniture.families import Mounting
from sim.homes.plan import Furniture
from sim.homes.recovered.holders import holders

from .cell_plans import block, plan_of_cells
from .plans import piece

HOME = plan_of_cells(block(20, 20, 40, 40))
"""Floor from x = z = 1 m to 3 m and 0.2 m around it; the ceiling is at 2.5 m."""
MIRROR = (0.6, 0.9, 0.04)
VASE = (0.2, 0.4, 0.2)

Vec = tuple[float, float, float]


def held(mounting: Mounting, *pieces: tuple[str, Vec, Vec]) -> tuple[Furniture, ...]:
    """Holders of a home with these pieces, of which the first has this mounting and the others stand."""
    furniture = [piece(*one) for one in pieces]
    mountings: dict[str, Mounting] = {one.name: "floor" for one in furniture}
    mountings[furniture[0].name] = mounting
    assert HOME.cells is not None
    return holders(furniture, mountings, HOME.storeys, grid=HOME.cells)


def test_a_mirror_in_the_middle_of_a_room_hangs_on_a_panel_behind_it() -> None:
    (panel,) = held("wall", ("mirror_7", (2.0, 1.5, 2.0), MIRROR))
    assert (panel.name, panel.category, panel.role) == ("wall panel_8", "wall panel", "clutter")
    assert (panel.bottom_y, panel.top_y) == pytest.approx((1.05, 2.5))
    assert panel.rect.z1 == pytest.approx(2.0 - 0.02)  # its front faces +z
    assert panel.size[0] == MIRROR[0]


def test_a_low_thing_stands_on_a_cabinet_of_its_own_size_or_on_a_low_wall() -> None:
    (stand,) = held("wall", ("stool_7", (2.0, 0.6, 2.0), (0.4, 0.5, 0.4)))
    assert stand.category == "cabinet"
    assert (stand.bottom_y, stand.top_y) == pytest.approx((0.0, 0.35))
    assert stand.rect == piece("stool_7", (2.0, 0.6, 2.0), (0.4, 0.5, 0.4)).rect
    (low_wall,) = held("wall", ("towel_7", (2.0, 0.7, 2.0), (0.5, 0.75, 0.08)))
    assert low_wall.category == "wall panel"
    assert (low_wall.bottom_y, low_wall.top_y) == pytest.approx((0.0, 0.325))


def test_a_high_small_thing_lies_on_a_ledge_of_the_wall_or_of_a_panel() -> None:
    ledge, *_ = held("on", ("vase_2", (0.9, 1.5, 2.0), VASE))
    assert ledge.top_y == pytest.approx(1.3)
    assert len(held("on", ("vase_2", (0.9, 1.5, 2.0), VASE))) == 1
    assert len(held("on", ("vase_2", (2.0, 1.5, 2.0), VASE))) == 2


def test_a_lamp_below_the_ceiling_hangs_on_a_rod() -> None:
    (rod,) = held("ceiling", ("lamp_2", (2.0, 2.0, 2.0), (0.4, 0.6, 0.4)))
    assert (rod.bottom_y, rod.top_y) == pytest.approx((2.3, 2.5))
    assert rod.rect.grown(1e-6).holds(2.0, 2.0)
    assert rod.size[0] < 0.05


def test_what_a_wall_the_floor_or_a_thing_carries_has_no_holder() -> None:
    vase = ("vase_2", (2.0, 1.0, 2.0), VASE)
    assert len(held("on", vase)) == 1
    assert held("on", vase, ("table_3", (2.0, 0.39, 2.0), (1.1, 0.78, 0.7))) == ()
    assert len(held("on", vase, ("stairs_3", (2.0, 0.39, 2.0), (1.1, 0.78, 0.7)))) == 1
    assert len(held("on", vase, ("table_3", (2.0, 0.35, 2.0), (1.1, 0.7, 0.7)))) == 1
    assert held("floor", vase) == ()
    assert held("ceiling", ("lamp_2", (2.0, 2.15, 2.0), (0.4, 0.6, 0.4))) == ()
    assert held("on", ("vase_2", (2.0, 0.2, 2.0), VASE)) == ()
    assert held("wall", ("mirror_7", (2.0, 1.5, 0.8), MIRROR)) == (), "its back is to the wall at z = 0.8 m"
    assert len(held("wall", ("mirror_7", (2.0, 1.5, 3.1), MIRROR))) == 1, "its front is to the wall"
