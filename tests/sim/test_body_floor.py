"""Floor closed by the robot's body: gaps too narrow for a wall become floor."""

import numpy as np
import pytest

from sim.homes.cells import Cells
from sim.homes.recovered.body_floor import BodyFloor
from sim.types import GridSpec

GRID = GridSpec((0.0, 0.0), 0.05, (60, 80))


def all_cells(y: float = 0.0) -> Cells:
    rc = np.argwhere(np.ones(GRID.shape, bool))
    return Cells(rc, np.full(len(rc), y), np.zeros(len(rc), bool))


def floor_of(*rects: tuple[int, int, int, int]) -> np.ndarray:
    """Mask (N,) of the cells in rectangles (row, col, height, width)."""
    mask = np.zeros(GRID.shape, bool)
    for row, col, height, width in rects:
        mask[row : row + height, col : col + width] = True
    return mask.ravel()


@pytest.mark.parametrize(("gap", "is_closed"), [(1, True), (9, True), (13, False), (20, False)])
def test_a_gap_of_9_cells_between_two_floors_is_closed_and_one_of_13_stays(gap: int, is_closed: bool) -> None:
    floor = floor_of((10, 10, 40, 20), (10, 30 + gap, 40, 20))
    closed = BodyFloor(all_cells(), [0.0], grid=GRID).closed(floor).reshape(GRID.shape)
    # above and below the middle rows the gap is rounded, because the body is round
    assert closed[20:40, 30 : 30 + gap].all() == is_closed
    assert closed[20:40, 30 : 30 + gap].any() == is_closed
    assert not closed[:10].any()
    assert not closed[:, :10].any()


def test_floor_without_narrow_gaps_stays_and_closing_twice_changes_nothing() -> None:
    body = BodyFloor(all_cells(), [0.0], grid=GRID)
    room = floor_of((10, 10, 30, 50))
    assert np.array_equal(body.closed(room), room)
    rng = np.random.default_rng(0)
    for _ in range(20):
        corners = rng.integers(0, 45, (5, 2)).tolist()
        floor = floor_of(*((row, col, 3 + k, 12 - 2 * k) for k, (row, col) in enumerate(corners)))
        once = body.closed(floor)
        assert (once | floor == once).all()
        assert np.array_equal(body.closed(once), once)


def test_the_floor_that_some_new_nodes_add_is_what_closing_all_of_it_adds() -> None:
    body = BodyFloor(all_cells(), [0.0], grid=GRID)
    rng = np.random.default_rng(1)
    for _ in range(20):
        (r0, c0), (r1, c1) = rng.integers(5, 40, (2, 2)).tolist()
        old = body.closed(floor_of((r0, c0, 10, 12)))
        new = np.flatnonzero(floor_of((r1, c1, 4, 14)))
        both = old.copy()
        both[new] = True
        found = old.copy()
        found[body.added(both, new)] = True
        assert np.array_equal(found, body.closed(both))


def test_each_storey_is_closed_alone_and_columns_without_a_node_stay_open() -> None:
    low, high = all_cells(), all_cells(2.8)
    cells = Cells(np.concatenate([low.rc, high.rc]), np.concatenate([low.y, high.y]), np.zeros(2 * len(low.y), bool))
    halves = np.concatenate([floor_of((10, 10, 40, 20)), floor_of((10, 35, 40, 20))])
    assert np.array_equal(BodyFloor(cells, [0.0, 2.8], grid=GRID).closed(halves), halves)
    known = all_cells()
    pillar = known.chosen(np.flatnonzero(~floor_of((29, 31, 2, 2))))
    floor = floor_of((10, 10, 40, 20), (10, 35, 40, 20))[~floor_of((29, 31, 2, 2))]
    closed = BodyFloor(pillar, [0.0], grid=GRID).closed(floor)
    gap = (pillar.rc[:, 1] >= 30) & (pillar.rc[:, 1] < 35) & (pillar.rc[:, 0] >= 20) & (pillar.rc[:, 0] < 40)
    assert closed[gap].all()
