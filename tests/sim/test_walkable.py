"""Walkable cells of schematic homes: what counts as known, what as guessed, and how well real homes fit."""

import math
from pathlib import Path

import numpy as np
import pytest

from sim.episodes.dataset import PersonalDataset
from sim.homes.cells import CELL, CellGrid, Cells
from sim.homes.plan import Storey
from sim.homes.recovered.recorded import PathLength, Recorded, recorded_facts
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


def test_a_lattice_of_places_is_known_floor_without_holes() -> None:
    cells = walkable_cells(recorded_of(ROOM), GROUND, grid=GRID)
    assert not cells.guessed.any()
    assert (cells.y == 0).all()
    # 1 m by 1 m, grown by 0.15 m around the places: between (1.0 + 0.24)^2 and (1.0 + 0.30)^2
    assert 1.5 < len(cells.y) * CELL**2 < 1.7
    inside = [(x, 0.0, z) for x in np.arange(0.02, 1, 0.07) for z in np.arange(0.02, 1, 0.07)]
    assert all(floor_from(cells).is_navigable(np.array(point)) for point in inside)


def test_islands_without_a_record_are_joined_by_a_guessed_strip() -> None:
    cells = walkable_cells(recorded_of(ROOM + shifted(4.0)), GROUND, grid=GRID)
    x = GRID.grid.xz_from_rc(cells.rc[cells.guessed])[:, 0]
    assert x.min() > 1.0
    assert x.max() < 4.0
    length = floor_from(cells).distances(np.array([[0.5, 0, 0.5]]), np.array([[4.5, 0, 0.5]]))[0]
    assert length == pytest.approx(4.0, rel=0.15)


def test_a_record_as_long_as_the_straight_line_proves_the_line_free() -> None:
    proof = PathLength("easy", "table_1", (0.5, 0.0, 0.5), (4.5, 0.0, 0.5), 4.0)
    cells = walkable_cells(recorded_of(ROOM + shifted(4.0), lengths=(proof,)), GROUND, grid=GRID)
    assert not cells.guessed.any()
    assert floor_from(cells).distances(np.array([proof.start]), np.array([proof.end]))[0] == pytest.approx(
        4.0, rel=0.01
    )


def test_extra_places_count_where_links_join_them_to_a_standing_one() -> None:
    table_top = [(3.0, 0.8, 0.5)]
    row = [(1.0 + 0.3 * k, 0.0, 0.5) for k in range(1, 6)]
    cells = walkable_cells(recorded_of(ROOM, extras=[*row, *table_top]), GROUND, grid=GRID)
    floor = floor_from(cells)
    assert floor.is_navigable(np.array([2.5, 0.0, 0.5]))
    assert not floor.is_navigable(np.array([3.0, 0.8, 0.5]))
    assert not cells.guessed.any()


def test_storeys_get_one_ramp_of_at_most_40_degrees() -> None:
    storeys = (*GROUND, Storey(label="first floor", floor_y=2.8))
    cells = walkable_cells(recorded_of(ROOM + shifted(6.0, 2.8)), storeys, grid=GRID)
    path = floor_from(cells).shortest_path(np.array([0.5, 0, 0.5]), np.array([[6.5, 2.8, 0.5]]))
    assert path is not None
    moves = np.diff(path, axis=0)
    assert np.abs(moves[:, 1]).sum() == pytest.approx(2.8, abs=0.1)
    assert np.hypot(moves[:, 0], moves[:, 2]).sum() >= 2.8 / np.tan(np.radians(40))


def test_a_ramp_that_rises_over_level_floor_joins_both_its_ends() -> None:
    storeys = (*GROUND, Storey(label="first floor", floor_y=2.8))
    hall = [(0.25 * i, 0.0, 0.25 * j) for i in range(21) for j in range(5)]
    cells = walkable_cells(recorded_of(hall + shifted(5.5, 2.8)), storeys, grid=GRID)
    floor = floor_from(cells)
    assert len(np.unique(floor.islands)) == 1
    below = floor.shortest_path(np.array([0.0, 0, 0.5]), np.array([[5.0, 0.0, 0.5]]))
    assert below is not None
    assert np.abs(below[:, 1]).max() < 0.3  # the hall under the ramp stays open


def test_recorded_stairs_join_the_storeys_without_a_guess() -> None:
    storeys = (*GROUND, Storey(label="first floor", floor_y=1.6))
    stairs = [(1.0 + 0.25 * k, 0.16 * k, 0.5) for k in range(1, 10)]
    cells = walkable_cells(recorded_of(ROOM + shifted(3.5, 1.6), extras=stairs), storeys, grid=GRID)
    assert not cells.guessed.any()
    length = floor_from(cells).distances(np.array([[1.0, 0, 0.5]]), np.array([[3.5, 1.6, 0.5]]))[0]
    assert length == pytest.approx(math.hypot(2.5, 1.6), rel=0.05)


def test_a_storey_without_room_for_a_ramp_stays_an_island() -> None:
    storeys = (*GROUND, Storey(label="first floor", floor_y=2.8))
    cells = walkable_cells(recorded_of([(1.0, 0.0, 0.0), (2.0, 2.8, 0.0)]), storeys, grid=GRID)
    floor = floor_from(cells)
    assert floor.is_navigable(np.array([2.0, 2.8, 0.0]))
    assert np.isinf(floor.distances(np.array([[1.0, 0, 0]]), np.array([[2.0, 2.8, 0]]))[0])


@pytest.mark.parametrize(
    "scene",
    [
        pytest.param("QaLdnwvtxbs", marks=pytest.mark.slow),
        *(pytest.param(name, marks=pytest.mark.release) for name in ("CrMo8WxCyVb", "XB4GS9ShBRE")),
    ],
)
def test_paths_of_a_released_home_are_as_long_as_recorded(dataset_root: Path, scene: str) -> None:
    recorded = recorded_facts(PersonalDataset(dataset_root), scene)
    heights = recorded.standing[:, 1]
    levels = sorted({round(float(np.median(heights[np.abs(heights - y) < 0.75])), 2) for y in heights})
    floors = [y for k, y in enumerate(levels) if k == 0 or y - levels[k - 1] > 1.5]
    storeys = tuple(Storey(label=f"storey {k}", floor_y=y) for k, y in enumerate(floors))
    low = np.floor(recorded.places[:, [0, 2]].min(axis=0)) - 2
    cols, rows = (np.ceil((recorded.places[:, [0, 2]].max(axis=0) + 2 - low) / CELL)).astype(int).tolist()
    grid = CellGrid(origin_xz=(float(low[0]), float(low[1])), shape=(rows, cols), walkable=())
    cells = walkable_cells(recorded, storeys, grid=grid)
    floor = floor_from(cells, grid)
    ratios = np.array([floor.distances(np.array([r.start]), np.array([r.end]))[0] / r.length for r in recorded.lengths])
    assert np.isfinite(ratios).all()
    assert abs(np.median(ratios) - 1) < 0.02
    assert (np.abs(ratios - 1) <= 0.05).mean() >= 0.70
    assert (np.abs(ratios - 1) <= 0.10).mean() >= 0.80
    assert cells.guessed.mean() <= 0.15
