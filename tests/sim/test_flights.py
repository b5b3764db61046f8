"""Flights of schematic homes: where a guess puts them, their steps, and the floors that a map of the mesh joins."""

import itertools

import numpy as np

from sim.homes.building.house import mesh_from_plan
from sim.homes.cells import CellGrid, Cells, runs_from_cells
from sim.homes.plan import Furniture, Storey
from sim.homes.recovered.flights import RISER, stepped_strip
from sim.homes.recovered.recorded import Recorded
from sim.homes.recovered.walkable import walkable_cells
from sim.mesh import TriangleMesh
from sim.render.raycast import Raycaster
from sim.walk.floor_grid import FloorGrid, floor_grid_from_mesh

from .cell_plans import plan_of_cells
from .plans import piece

Place = tuple[float, float, float]
GRID = CellGrid(origin_xz=(0.0, 0.0), shape=(160, 300), walkable=())
LOW_Y, HIGH_Y = 0.0, 2.8
STOREYS = (
    Storey(label="ground floor", floor_y=LOW_Y, ceiling=2.5),
    Storey(label="first floor", floor_y=HIGH_Y, ceiling=2.5),
)


def room(x: float, z: float, y: float, *, width: float = 2.5, depth: float = 2.5) -> list[Place]:
    """Places every 0.25 m."""
    xs, zs = np.arange(x, x + width + 0.01, 0.25).tolist(), np.arange(z, z + depth + 0.01, 0.25).tolist()
    return [(px, y, pz) for px in xs for pz in zs]


def cells_of(places: list[Place], storeys: tuple[Storey, ...] = STOREYS, pieces: tuple[Furniture, ...] = ()) -> Cells:
    recorded = Recorded(np.array(places), np.zeros((0, 3)), {}, {}, ())
    return walkable_cells(recorded, storeys, grid=GRID, pieces=pieces)


def mesh_of(cells: Cells, storeys: tuple[Storey, ...] = STOREYS) -> tuple[TriangleMesh, FloorGrid]:
    plan = plan_of_cells(runs_from_cells(cells), storeys=storeys, shape=GRID.shape)
    mesh, _ = mesh_from_plan(plan)
    return mesh, floor_grid_from_mesh(mesh)


def on_the_way(floor: FloorGrid, start: Place, goal: Place) -> np.ndarray:
    """(N, 3) feet every 2 cm along the map's path."""
    path = floor.shortest_path(np.array(start), np.array([goal]))
    assert path is not None, "joined"
    feet = [path[0]]
    for a, b in itertools.pairwise(path):
        for share in np.linspace(0, 1, max(2, int(np.hypot(*(b - a)[[0, 2]]) / 0.02))):
            x, _, z = a * (1 - share) + b * share
            feet.append(np.array(floor.step(feet[-1], np.array([x, feet[-1][1], z])).position))
    np.testing.assert_allclose(feet[-1], goal, atol=0.01)
    return np.array(feet)


def assert_kept(floor: FloorGrid, places: list[Place]) -> None:
    """The map has the places, which lie a little inside of a floor's rim."""
    assert [place for place in places if not floor.is_navigable(np.array(place), max_dy=0.05)] == []


def test_a_map_of_the_mesh_goes_up_steps_of_at_most_20_cm_under_headroom_of_2_m() -> None:
    low, high = room(2, 2, LOW_Y), room(10, 2, HIGH_Y)
    mesh, floor = mesh_of(cells_of(low + high))
    feet = on_the_way(floor, low[0], high[0])
    caster = Raycaster(mesh)
    ground = caster.cast(feet + np.array([0, 0.5, 0]), np.tile([0.0, -1, 0], (len(feet), 1))).positions[:, 1]
    assert np.abs(np.diff(ground)).max() <= 0.2
    assert np.abs(feet[:, 1] - ground).max() <= 0.25
    over = caster.cast(feet + np.array([0, 0.3, 0]), np.tile([0.0, 1, 0], (len(feet), 1))).range_m + 0.3
    assert over.min() >= 2.0
    assert_kept(floor, room(2.25, 2.25, LOW_Y, width=2, depth=2) + room(10.25, 2.25, HIGH_Y, width=2, depth=2))


def test_a_flight_stays_clear_of_the_floor_above_and_of_the_floor_beside_it() -> None:
    low, high = room(3, 2.5, LOW_Y, width=8), room(3, 2.5, HIGH_Y, width=8)
    cells = cells_of(low + high)
    _, floor = mesh_of(cells)
    assert floor.island(np.array(low[0])) == floor.island(np.array(high[0]))
    steps = cells.chosen((cells.y > 0.5) & (cells.y < HIGH_Y - 0.1))
    places = np.array(high)[:, [0, 2]]
    gaps = np.linalg.norm(GRID.grid.xz_from_rc(steps.rc)[:, None] - places[None], axis=-1)
    assert gaps.min() >= 0.4, "two bodies"
    inner = [room(3.25, 2.75, y, width=7.5, depth=2) for y in (LOW_Y, HIGH_Y)]
    assert_kept(floor, inner[0] + inner[1])


def test_a_flight_is_not_put_through_furniture() -> None:
    low, high = room(2, 2, LOW_Y), room(9, 2, HIGH_Y)
    free = cells_of(low + high)
    steps = free.chosen((free.y > 0.1) & (free.y < HIGH_Y - 0.1))
    x, z = GRID.grid.xz_from_rc(steps.rc).mean(axis=0).tolist()
    moved = cells_of(low + high, pieces=(piece("shelf_1", (x, 0.9, z), (0.6, 1.8, 0.6)),))
    steps = moved.chosen((moved.y > 0.1) & (moved.y < HIGH_Y - 0.1))
    assert len(steps.y)
    xz = GRID.grid.xz_from_rc(steps.rc)
    assert np.maximum(np.abs(xz[:, 0] - x), np.abs(xz[:, 1] - z)).min() >= 0.3 + 0.2


def test_half_a_storey_is_joined_by_steps() -> None:
    low, half = room(2, 2, LOW_Y), room(6, 2, 0.57)
    one = STOREYS[:1]
    # somebody walked there, or it would be the top of a table
    records = Recorded(np.array(low + half), np.zeros((0, 3)), {}, {}, ())
    assert walkable_cells(records, one, grid=GRID).y.max() == 0
    stairs = [(4.75 + 0.25 * k, 0.0 + 0.15 * k, 3.0) for k in range(5)]
    _, floor = mesh_of(cells_of(low + half + stairs, one), one)
    assert floor.island(np.array(low[0])) == floor.island(np.array(half[0]))
    for place in stairs + half:
        assert floor.is_navigable(np.array(place), max_dy=0.25)


def test_steps_are_level_straight_across_and_of_equal_rise() -> None:
    start, end = np.array([2.0, 0.0, 2.0]), np.array([4.0, 1.0, 3.0])
    strip = stepped_strip(start, end, grid=GRID)
    heights = np.unique(strip.y.round(6))
    np.testing.assert_allclose(heights, np.linspace(0, 1, 7), atol=1e-5)
    assert np.diff(heights).max() <= RISER
    along = (GRID.grid.xz_from_rc(strip.rc) - (2, 2)) @ (np.array([2, 1]) / 5**0.5)
    spans = [np.ptp(along[np.abs(strip.y - y) < 1e-6]) for y in heights[1:-1]]
    assert min(spans) >= 0.2 - 0.05
    assert max(spans) <= 0.25


def test_storeys_without_room_for_a_flight_stay_apart() -> None:
    small = CellGrid(origin_xz=(0.0, 0.0), shape=(60, 60), walkable=())
    places = [*room(1, 1, LOW_Y, width=1, depth=1), *room(1, 1, HIGH_Y, width=1, depth=1)]
    cells = walkable_cells(Recorded(np.array(places), np.zeros((0, 3)), {}, {}, ()), STOREYS, grid=small)
    assert set(np.unique(cells.y).tolist()) == {LOW_Y, HIGH_Y}
