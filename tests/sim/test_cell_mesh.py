"""Rooms from cells: straight walls around all that was walked on, ceilings, doors, stairs, each in its finish."""

import math

import numpy as np
import pytest

from sim.copies.cut import storey_mesh
from sim.homes.building.cells.mesh import add_cells
from sim.homes.building.cells.spaces import floor_layers, padded
from sim.homes.building.cells.storeys import StoreyCells, storeys_of_cells
from sim.homes.building.house import mesh_from_plan
from sim.homes.building.quads import QuadBuilder
from sim.homes.cells import Cells, cells_from_runs, runs_from_cells
from sim.homes.open_home import scene_from_plan
from sim.homes.plan import HomePlan
from sim.homes.recovered.body_floor import BodyFloor
from sim.mesh import TriangleMesh
from sim.render.raycast import Raycaster
from sim.types import CUT_HEIGHT, GridSpec
from sim.walk.floor_grid import FloorGrid

from .cell_plans import BLUE, RED, block, plan_of_cells, two_cell_rooms, two_storeys
from .plans import piece


def storeys_of(plan: HomePlan) -> list[StoreyCells]:
    assert plan.cells is not None
    floors = padded(floor_layers(plan.cells, plan.storeys), np.nan)
    return storeys_of_cells(plan, floors)


def walls_seen(mesh: TriangleMesh, x: float, z: float, *, y: float = 1.0, count: int = 32) -> np.ndarray:
    """(count,) metres to what stands around a place, from +x over +z."""
    angle = np.arange(count) * 2 * np.pi / count
    to = np.stack([np.cos(angle), 0 * angle, np.sin(angle)], axis=1)
    return Raycaster(mesh).cast(np.tile([x, y, z], (count, 1)), to).range_m


def test_a_rectangle_of_cells_is_a_room_of_four_walls_and_four_cut_corners_whatever_small_holes_it_has() -> None:
    (storey,) = storeys_of(plan_of_cells(block(20, 20, 40, 40)))
    walls = [line for line in storey.lines if line.length > 20]
    assert (len(walls), len(storey.lines)) == (4, 8)
    for line in walls:
        assert min(np.abs(line.end - line.start)) == 0, "along an axis"
        # 40 cells and 4 on each side for the body, whose round shape takes 3 from each corner
        assert line.length == pytest.approx(40 + 2 * 4 - 2 * 3, abs=0.5)
    for line in (line for line in storey.lines if line.length < 20):
        assert np.abs(line.end - line.start) == pytest.approx([3, 3], abs=0.3)
    dented = [run for run in block(20, 20, 40, 40) if not 36 <= run.row < 44]
    dented += [run for row in range(36, 44) for run in block(row, 20, 1, 12) + block(row, 42, 1, 18)]
    (storey,) = storeys_of(plan_of_cells(tuple(sorted(dented))))
    assert len(storey.lines) == 8


def test_the_edge_of_a_diagonal_strip_is_one_straight_wall() -> None:
    strip = tuple(run for k in range(60) for run in block(20 + k, 20 + k, 1, 24))
    (storey,) = storeys_of(plan_of_cells(strip))
    slanted = [line for line in storey.lines if min(np.abs(line.end - line.start)) > 10]
    assert len(slanted) == 2
    for line in slanted:
        row, col = np.abs(line.end - line.start)
        assert row == pytest.approx(col, rel=0.15)
        assert line.length > 60 * math.sqrt(2) * 0.7


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_no_place_to_stand_is_in_or_behind_a_wall(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.integers(20, 90, (14, 2))
    runs = {run for row, col in points.tolist() for run in block(row, col, 14, 14)}
    covered = {(run.row, col) for run in runs for col in range(run.col, run.col + run.length)}
    plan = plan_of_cells(tuple(block(row, col, 1, 1)[0] for row, col in sorted(covered)))
    assert plan.cells is not None
    mesh, _ = mesh_from_plan(plan)
    centres = plan.cells.grid.xz_from_rc(cells_from_runs(plan.cells.walkable).rc)[::23]
    for x, z in centres.tolist():
        ranges = walls_seen(mesh, x, z, count=16)
        assert ranges.min() > 0.07, (x, z)
        assert np.isfinite(ranges).all(), "closed on all sides"
    down = np.tile([0.0, -1, 0], (len(centres), 1))
    eyes = np.stack([centres[:, 0], np.full(len(centres), 0.88), centres[:, 1]], axis=1)
    assert Raycaster(mesh).cast(eyes, down).range_m == pytest.approx(0.88, abs=0.05)


def test_rooms_are_divided_by_a_wall_with_a_door_and_have_their_own_finish() -> None:
    plan = two_cell_rooms()
    mesh, _ = mesh_from_plan(plan)
    caster = Raycaster(mesh)
    hits = caster.cast(np.array([[2.0, 1.5, 1.15], [4.5, 1.5, 1.15]]), np.array([[1.0, 0, 0], [-1, 0, 0]]))
    left, right = mesh.face_rgb[hits.face_ids].astype(int)
    assert hits.positions[0, 0] == pytest.approx(3.2, abs=0.15)
    assert hits.positions[0, 0] < hits.positions[1, 0] < 3.4, "two faces with a wall between them"
    assert left[2] > left[0] + 20, BLUE
    assert right[0] > right[2] + 20, RED
    through = caster.cast(np.array([[2.0, 1.0, 1.95]]), np.array([[1.0, 0, 0]])).range_m[0]
    assert through > 2.5, "the door is open"
    over = caster.cast(np.array([[2.0, 2.3, 1.95]]), np.array([[1.0, 0, 0]])).range_m[0]
    assert over == pytest.approx(1.2, abs=0.15), "the wall goes on over the door"


def test_a_way_stays_open_and_walls_do_not_change_where_one_walks() -> None:
    scene = scene_from_plan(two_cell_rooms())
    walked = scene.navigation.distances(np.array([[1.5, 0.0, 1.95]]), np.array([[4.7, 0.0, 1.95]]))[0]
    assert walked == pytest.approx(3.2, abs=0.05)


def test_a_ceiling_covers_the_room_and_the_storeys_cut_takes_it_away() -> None:
    plan = plan_of_cells(block(20, 20, 40, 40))
    scene = scene_from_plan(plan)
    up = Raycaster(scene.mesh).cast(np.array([[1.3, 0.88, 1.3]]), np.array([[0.0, 1, 0]]))
    assert up.positions[0, 1] == pytest.approx(2.5, abs=1e-4)
    cut = storey_mesh(scene, 0.0)
    assert cut.vertices[:, 1].max() <= CUT_HEIGHT + 1e-4
    above = np.array([[1.3, 5.0, 1.3], [2.0, 5.0, 0.74]])
    down = Raycaster(cut).cast(above, np.array([[0.0, -1, 0], [0, -1, 0]])).positions[:, 1]
    assert down[0] == pytest.approx(0, abs=1e-4)
    assert down[1] == pytest.approx(CUT_HEIGHT, abs=0.01), "walls are seen from above"


def test_a_low_block_is_darker_than_floor_and_a_guess_is_lighter() -> None:
    known, guess = block(20, 20, 40, 40), block(20, 60, 40, 20, guessed=True)
    plan = plan_of_cells((*known, *guess), plinth=block(64, 20, 40, 30, y_cm=45) + block(64, 50, 40, 30, y_cm=8))
    mesh, _ = mesh_from_plan(plan)
    eyes = np.array([[1.5, 1.0, 2.0], [3.5, 1.0, 2.0], [1.5, 1.0, 4.4], [3.5, 1.0, 4.4]])
    hits = Raycaster(mesh).cast(eyes, np.tile([0.0, -1, 0], (4, 1)))
    assert hits.positions[:, 1] == pytest.approx([0, 0, 0.45, 0], abs=1e-4), "0.08 m is too low for a block"
    known_finish, guessed_finish, top, _ = mesh.face_rgb[hits.face_ids].astype(int).sum(axis=1)
    assert guessed_finish > known_finish > top
    front = Raycaster(mesh).cast(np.array([[1.5, 0.3, 2.0], [1.5, 0.5, 2.0]]), np.tile([0.0, 0, 1], (2, 1)))
    # the floor goes on for the body behind the last row of places, 60; the wall stands behind the block's last row
    assert front.positions[:, 2] == pytest.approx([64 * 0.05, 104 * 0.05], abs=0.06)


def test_the_map_of_the_mesh_has_the_places_of_the_plan() -> None:
    # a room with a table in its middle, a corridor as wide as three places, a room with a low block behind it
    room = {(row, col) for row in range(20, 70) for col in range(20, 80)}
    table_rc = {(row, col) for row in range(35, 55) for col in range(35, 60)}  # 0.25 m around the table
    corridor = {(row, col) for row in range(43, 46) for col in range(80, 120)}
    small = {(row, col) for row in range(30, 60) for col in range(120, 150)}
    floor = (room - table_rc) | corridor | small
    under = block(40, 40, 10, 15)
    known = np.array(sorted(floor))
    every = np.argwhere(np.ones((120, 180), bool))
    cells = Cells(every, np.zeros(len(every)), np.zeros(len(every), bool))
    cells = cells.chosen(np.array([(row, col) not in table_rc for row, col in every.tolist()]))
    is_floor = np.isin(cells.rc @ (180, 1), known @ (180, 1))
    cells = cells.chosen(BodyFloor(cells, [0.0], grid=GridSpec((0.0, 0.0), 0.05, (120, 180))).closed(is_floor))
    floor = {(row, col) for row, col in cells.rc.tolist()}
    plan = plan_of_cells(
        runs_from_cells(cells),
        plinth=(*under, *block(64, 120, 20, 30, y_cm=65)),
        shape=(120, 180),
    ).model_copy(update={"furniture": (piece("table_1", (2.375, 0.375, 2.25), (0.75, 0.75, 0.5)),)})
    navigation = scene_from_plan(plan).navigation
    assert isinstance(navigation, FloorGrid)
    xz = navigation.grid.xz_from_rc(np.stack([navigation.cells.row, navigation.cells.col], axis=1))
    mapped = {(row, col) for col, row in np.floor(xz / 0.05).astype(int).tolist()}
    assert floor <= mapped
    # the body is round: it reaches a little around the four corners of the table and the four at the corridor's ends
    assert len(mapped & table_rc) <= 4 * 6
    more = mapped - floor - table_rc
    assert len(more) <= 4 * 2
    assert more <= {(row + dr, col + dc) for row, col in floor for dr in (-1, 0, 1) for dc in (-1, 0, 1)}


def test_a_flight_has_level_steps_sides_and_a_well_above() -> None:
    plan = two_storeys()
    scene = scene_from_plan(plan)
    caster = Raycaster(scene.mesh)
    xs = np.linspace(3.3, 6.2, 30)
    origins = np.stack([xs, np.full(30, 2.75), np.full(30, 2.15)], axis=1)
    high = caster.cast(origins[xs < 5.8], np.tile([0.0, -1, 0], ((xs < 5.8).sum(), 1))).positions[:, 1]
    assert (np.diff(high) >= -1e-4).all(), "it goes up"
    steps = (np.floor((xs[xs < 5.8] - 3.0) / 0.25) + 1) * 2.8 / 15
    np.testing.assert_allclose(high, steps, atol=0.01)
    walked = scene.navigation.distances(np.array([[1.5, 0.0, 2.0]]), np.array([[8.0, 2.8, 2.0]]))[0]
    assert np.isfinite(walked)
    up = caster.cast(np.array([[5.0, 2.4, 2.15]]), np.array([[0.0, 1, 0]])).positions[0, 1]
    assert up == pytest.approx(2.8 + 2.5, abs=0.02), "no ceiling and no floor in the well"


def test_every_wall_and_floor_faces_the_side_from_which_it_is_seen() -> None:
    for plan in (two_cell_rooms(), two_storeys(), plan_of_cells(block(20, 20, 40, 40))):
        assert plan.cells is not None
        mesh, _ = mesh_from_plan(plan)
        cells = cells_from_runs(plan.cells.walkable)
        xz = plan.cells.grid.xz_from_rc(cells.rc)[::97]
        eyes = np.stack([xz[:, 0], cells.y[::97] + 0.88, xz[:, 1]], axis=1)
        rng = np.random.default_rng(0)
        to = rng.normal(size=(len(eyes) * 60, 3))
        hits = Raycaster(mesh).cast(np.repeat(eyes, 60, axis=0), to)
        seen = hits.face_ids >= 0
        a, b, c = np.moveaxis(mesh.vertices[mesh.faces[hits.face_ids[seen]]].astype(float), 1, 0)
        towards = np.einsum("ij,ij->i", np.cross(b - a, c - a), to[seen])
        assert seen.mean() > 0.99
        assert (towards < 1e-9).mean() > 0.995


def test_lamps_hang_in_every_room_and_windows_on_long_outer_walls() -> None:
    builder = QuadBuilder()
    lamps = add_cells(builder, two_cell_rooms())
    assert [lamp[1] for lamp in lamps] == pytest.approx([2.36, 2.36], abs=0.05)
    assert sorted(lamp[0] for lamp in lamps) == pytest.approx([2.0, 4.5], abs=0.4)
    mesh, _ = mesh_from_plan(two_cell_rooms())
    outside = Raycaster(mesh).cast(np.array([[2.0, 1.8, 1.8]]), np.array([[-1.0, 0, 0]]))
    sky = mesh.face_rgb[outside.face_ids[0]].astype(int)
    assert sky[2] > sky[0], "a pane with sky"


def test_the_same_plan_gives_the_same_mesh_and_a_storey_without_recorded_floor_none() -> None:
    assert mesh_from_plan(two_storeys())[0].digest() == mesh_from_plan(two_storeys())[0].digest()
    plan = two_storeys()
    assert plan.cells is not None
    only_low = tuple(run for run in plan.cells.walkable if run.y_cm == 0)
    alone = plan.model_copy(update={"cells": plan.cells.model_copy(update={"walkable": only_low})})
    mesh, _ = mesh_from_plan(alone)
    assert mesh.vertices[:, 1].max() < 2.8


def test_the_tops_of_cut_walls_never_stand_out_into_a_room() -> None:
    plan = two_cell_rooms()
    assert plan.cells is not None
    mesh, _ = mesh_from_plan(plan)
    corners = mesh.vertices[mesh.faces].astype(float)
    tops = corners[np.abs(corners[..., 1] - CUT_HEIGHT).max(axis=1) < 0.005]
    assert len(tops) > 20
    places = 0.9 * tops + 0.1 * tops.mean(axis=1, keepdims=True)
    rows, cols = plan.cells.grid.rc_from_xz(places[..., [0, 2]].reshape(-1, 2)).T
    floor = ~np.isnan(floor_layers(plan.cells, plan.storeys)[0])
    assert not floor[rows, cols].any(), "two cells are between the rooms, less than two outer walls"
