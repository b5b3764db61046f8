"""Corridors that recorded path lengths require, in small worlds with known answers."""

import math

import numpy as np
import pytest

from sim.homes.cells import Cells
from sim.homes.recovered.corridors import PLAN_CLIMB, with_corridors
from sim.homes.recovered.recorded import PathLength
from sim.types import GridSpec
from sim.walk.floor_grid import FloorGrid

GRID = GridSpec((0.0, 0.0), 0.05, (80, 160))
"""4 m along z, 8 m along x."""
Rect = tuple[float, float, float, float]
WEST: Rect = (0.5, 0.5, 2.5, 3.5)
EAST: Rect = (5.5, 0.5, 7.5, 3.5)


def floor_of(*rects: Rect) -> Cells:
    """Level cells of rectangles (x0, z0, x1, z1)."""
    mask = np.zeros(GRID.shape, bool)
    for x0, z0, x1, z1 in rects:
        mask[round(z0 / 0.05) : round(z1 / 0.05), round(x0 / 0.05) : round(x1 / 0.05)] = True
    rc = np.argwhere(mask)
    return Cells(rc, np.zeros(len(rc)), np.zeros(len(rc), bool))


def unknown_beside(known: Cells) -> Cells:
    mask = np.ones(GRID.shape, bool)
    mask[known.rc[:, 0], known.rc[:, 1]] = False
    rc = np.argwhere(mask)
    return Cells(rc, np.zeros(len(rc)), np.ones(len(rc), bool))


def record(start: tuple[float, float], end: tuple[float, float], length: float) -> PathLength:
    return PathLength("easy", "table_1", (start[0], 0.0, start[1]), (end[0], 0.0, end[1]), length)


def walked(cells: Cells, of: PathLength) -> float:
    floor = FloorGrid.from_cells(cells.rc, cells.y, grid=GRID, max_climb=PLAN_CLIMB)
    return float(floor.distances(np.array([of.start]), np.array([of.end]))[0])


def test_nothing_is_guessed_without_records_or_if_they_fit_the_known_floor() -> None:
    known = floor_of(WEST, EAST)
    cells = with_corridors(known, unknown_beside(known), (), floors_y=[0.0], grid=GRID)
    assert not cells.guessed.any()
    assert len(cells.y) == len(known.y)
    u_shape = floor_of((0.5, 0.5, 1.5, 3.5), (0.5, 2.5, 7.5, 3.5), (6.5, 0.5, 7.5, 3.5))
    # around the inner corners at (1.5, 2.5) and (6.5, 2.5), which a body of 0.27 m makes round
    to_middle, turn = math.hypot(0.77, 1.23), math.atan2(1.23, 0.77) + math.asin(0.27 / math.hypot(0.77, 1.23))
    corner = math.sqrt(to_middle**2 - 0.27**2) + 0.27 * turn
    around = record((1.0, 1.0), (7.0, 1.0), 2 * corner + 4.46)
    cells = with_corridors(u_shape, unknown_beside(u_shape), (around,), floors_y=[0.0], grid=GRID)
    assert not cells.guessed.any()
    assert walked(cells, around) == pytest.approx(around.length, rel=0.02)


def test_a_path_between_islands_opens_a_corridor_of_the_recorded_length() -> None:
    known = floor_of(WEST, EAST)
    straight = record((2.0, 2.0), (6.0, 2.0), 4.0)
    cells = with_corridors(known, unknown_beside(known), (straight,), floors_y=[0.0], grid=GRID)
    assert walked(cells, straight) == pytest.approx(4.0, rel=0.03)
    x, z = GRID.xz_from_rc(cells.rc[cells.guessed]).T
    assert x.min() > 2.5
    assert x.max() < 5.5
    assert np.ptp(z[(x > 2.8) & (x < 5.2)]) <= 0.4  # as wide as a door for a body of 0.2 m
    assert np.ptp(z) <= 0.8, "0.3 m wider on each side where it meets a room, because the body makes corners round"
    assert (~cells.guessed).sum() == len(known.y)


def test_a_longer_record_gets_a_detour_and_the_same_records_give_the_same_cells() -> None:
    known = floor_of(WEST, EAST)
    detour = record((2.0, 2.0), (6.0, 2.0), 4.8)
    cells = with_corridors(known, unknown_beside(known), (detour,), floors_y=[0.0], grid=GRID)
    assert walked(cells, detour) == pytest.approx(4.8, rel=0.05)
    records = (record((2.0, 1.0), (6.0, 3.0), 4.7), record((1.0, 3.0), (7.0, 1.0), 6.6))
    one, two = (with_corridors(known, unknown_beside(known), records, floors_y=[0.0], grid=GRID) for _ in range(2))
    assert all(np.array_equal(a, b) for a, b in zip(one, two, strict=True))


def test_a_record_forbids_a_shortcut_for_the_corridor_of_another() -> None:
    # two rooms joined below by known floor: the length of `around` shows that there is a wall between them
    rooms = ((0.5, 0.5, 2.5, 3.5), (3.5, 0.5, 5.5, 3.5), (0.5, 3.0, 5.5, 3.5))
    around = record((2.0, 1.0), (4.0, 1.0), 2 * math.hypot(0.5, 2.0) + 1.0)
    beyond = record((2.0, 1.0), (7.0, 1.0), 2 * math.hypot(0.5, 2.0) + 1.0 + 2.9)
    known = floor_of(*rooms, (6.5, 0.5, 7.5, 3.5))
    cells = with_corridors(known, unknown_beside(known), (around, beyond), floors_y=[0.0], grid=GRID)
    assert walked(cells, around) == pytest.approx(around.length, rel=0.05)
    assert math.isfinite(walked(cells, beyond))
    x, z = GRID.xz_from_rc(cells.rc[cells.guessed]).T
    between_rooms = (x > 2.5) & (x < 3.5) & (z < 2.5)
    assert not between_rooms.any()


@pytest.mark.parametrize(
    "useless",
    [record((2.0, 2.0), (6.0, 2.0), 3.0), record((2.0, 2.0), (2.0, 2.0), 0.0), record((2.0, 2.0), (90.0, 2.0), 95.0)],
    ids=["below the straight line", "no length", "ends off the floor"],
)
def test_records_without_information_are_left_out(useless: PathLength) -> None:
    known = floor_of(WEST, EAST)
    cells = with_corridors(known, unknown_beside(known), (useless,), floors_y=[0.0], grid=GRID)
    assert not cells.guessed.any()
