"""Walkable cells of schematic homes: what counts as known and what as guessed."""

import math

import numpy as np
import pytest

from sim.homes.cells import CellGrid, Cells
from sim.homes.plan import Storey
from sim.homes.recovered.recorded import PathLength, Recorded
from sim.homes.recovered.walkable import PLAN_CLIMB, walkable_cells
from sim.walk.floor_grid import FloorGrid

Place = tuple[float, float, float]
GROUND = (Storey(label="ground floor", floor_y=0.0),)
GRID = CellGrid(origin_xz=(-2.0, -2.0), shape=(160, 240), walkable=())
ROOM = [(0.25 * i, 0.0, 0.25 * j) for i in range(5) for j in range(5)]


def recorded_of(
    standing: list[Place], *, extras: list[Place] | None = None, lengths: tuple[PathLength, ...] = ()
) -> Recorded:
    return Recorded(np.array(standing), np.array(extras or [], float).reshape(-1, 3), {}, {}, lengths)


def floor_from(cells: Cells, grid: CellGrid = GRID) -> FloorGrid:
    return FloorGrid.from_cells(cells.rc, cells.y, grid=grid.grid, max_climb=PLAN_CLIMB)


def shifted(x: float, y: float = 0.0) -> list[Place]:
    return [(px + x, py + y, pz) for px, py, pz in ROOM]


def test_islands_are_joined_by_a_guessed_strip_or_by_a_line_that_a_record_proves_free() -> None:
    cells = walkable_cells(recorded_of(ROOM + shifted(4.0)), GROUND, grid=GRID)
    x = GRID.grid.xz_from_rc(cells.rc[cells.guessed])[:, 0]
    assert x.min() > 0.8, "the strip is 0.4 m wide, with round ends"
    assert x.max() < 4.2
    length = floor_from(cells).distances(np.array([[0.5, 0, 0.5]]), np.array([[4.5, 0, 0.5]]))[0]
    assert length == pytest.approx(4.0, rel=0.15)
    proof = PathLength("easy", "table_1", (0.5, 0.0, 0.5), (4.5, 0.0, 0.5), 4.0)
    cells = walkable_cells(recorded_of(ROOM + shifted(4.0), lengths=(proof,)), GROUND, grid=GRID)
    assert not cells.guessed.any()
    assert floor_from(cells).distances(np.array([proof.start]), np.array([proof.end]))[0] == pytest.approx(
        4.0, rel=0.01
    )


def test_places_above_others_that_are_too_few_for_a_storey_keep_their_height() -> None:
    above = [(0.25 * i, 3.0, 0.5) for i in range(5)]
    cells = walkable_cells(recorded_of(ROOM + above), GROUND, grid=GRID)
    floor = floor_from(cells)
    assert all(floor.is_navigable(np.array(place)) for place in ROOM + above)
    assert {0.0, 3.0} <= set(cells.y.tolist())


def test_extra_places_count_where_links_join_them_to_a_standing_one() -> None:
    table_top = [(3.0, 0.8, 0.5)]
    row = [(1.0 + 0.3 * k, 0.0, 0.5) for k in range(1, 6)]
    cells = walkable_cells(recorded_of(ROOM, extras=[*row, *table_top]), GROUND, grid=GRID)
    floor = floor_from(cells)
    assert floor.is_navigable(np.array([2.5, 0.0, 0.5]))
    assert not floor.is_navigable(np.array([3.0, 0.8, 0.5]))
    assert not cells.guessed.any()


def test_a_ramp_that_rises_over_level_floor_joins_both_its_ends() -> None:
    storeys = (*GROUND, Storey(label="first floor", floor_y=2.8))
    hall = [(0.25 * i, 0.0, 0.25 * j) for i in range(21) for j in range(5)]
    cells = walkable_cells(recorded_of(hall + shifted(5.5, 2.8)), storeys, grid=GRID)
    floor = floor_from(cells)
    assert len(np.unique(floor.islands)) == 1
    below = floor.shortest_path(np.array([0.0, 0, 0.5]), np.array([[5.0, 0.0, 0.5]]))
    assert below is not None
    assert np.abs(below[:, 1]).max() < 0.3  # the hall under the ramp stays open


def test_recorded_stairs_join_storeys_without_a_guess() -> None:
    storeys = (*GROUND, Storey(label="first floor", floor_y=1.6))
    stairs = [(1.0 + 0.25 * k, 0.16 * k, 0.5) for k in range(1, 10)]
    cells = walkable_cells(recorded_of(ROOM + shifted(3.5, 1.6), extras=stairs), storeys, grid=GRID)
    assert not cells.guessed.any()
    length = floor_from(cells).distances(np.array([[1.0, 0, 0.5]]), np.array([[3.5, 1.6, 0.5]]))[0]
    assert length == pytest.approx(math.hypot(2.5, 1.6), rel=0.05)


def test_steps_between_two_near_levels_are_equally_deep() -> None:
    platform = [(1.4 + 0.25 * i, 0.5, 0.25 * j) for i in range(5) for j in range(5)]
    proof = PathLength("easy", "table_1", (0.5, 0.0, 0.5), (2.0, 0.5, 0.5), 1.6)
    cells = walkable_cells(recorded_of(ROOM, extras=platform, lengths=(proof,)), GROUND, grid=GRID)
    row = cells.chosen(cells.rc[:, 0] == GRID.grid.rc_from_xz(np.array([0.5, 0.5]))[0])
    heights, counts = np.unique(row.y.round(2), return_counts=True)
    assert heights.tolist() == [0.0, 0.19, 0.38, 0.57]
    assert counts[1:3].min() >= 3, "a map loses steps that are less than three cells deep"
    assert floor_from(cells).distances(np.array([proof.start]), np.array([[2.0, 0.57, 0.5]]))[0] < 1.8
