"""Rooms from cells: straight walls around the walked floor, ceilings, doors and stairs, each in its finish."""

import math

import numpy as np
import pytest

from sim.copies.cut import storey_mesh
from sim.homes.building.cells.flights import RISE, with_whole_flights
from sim.homes.building.cells.mesh import add_cells
from sim.homes.building.cells.spaces import floor_layers, padded
from sim.homes.building.cells.storeys import StoreyCells, storeys_of_cells
from sim.homes.building.house import mesh_from_plan
from sim.homes.building.quads import QuadBuilder
from sim.homes.cells import cells_from_runs
from sim.homes.open_home import scene_from_plan
from sim.homes.plan import HomePlan
from sim.mesh import TriangleMesh
from sim.render.raycast import Raycaster
from sim.types import CUT_HEIGHT

from .cell_plans import BLUE, RED, block, plan_of_cells, two_cell_rooms, two_storeys


def storeys_of(plan: HomePlan) -> list[StoreyCells]:
    assert plan.cells is not None
    floors = padded(floor_layers(plan.cells, plan.storeys), np.nan)
    return storeys_of_cells(plan, with_whole_flights(floors, [storey.floor_y for storey in plan.storeys]))


def walls_seen(mesh: TriangleMesh, x: float, z: float, *, y: float = 1.0, count: int = 32) -> np.ndarray:
    """Distances (count,) in metres from a place to the nearest surface in each direction, from +x towards +z."""
    angle = np.arange(count) * 2 * np.pi / count
    to = np.stack([np.cos(angle), 0 * angle, np.sin(angle)], axis=1)
    return Raycaster(mesh).cast(np.tile([x, y, z], (count, 1)), to).range_m


def test_a_rectangle_of_cells_with_or_without_small_dents_is_a_room_of_four_walls() -> None:
    (storey,) = storeys_of(plan_of_cells(block(20, 20, 40, 40)))
    assert len(storey.lines) == 4
    assert sum(line.length for line in storey.lines) * 0.05 == pytest.approx(4 * 2.6, abs=0.9)
    for line in storey.lines:
        assert min(np.abs(line.end - line.start)) == 0, "along an axis"
    dented = [run for run in block(20, 20, 40, 40) if not 36 <= run.row < 44]
    dented += [run for row in range(36, 44) for run in block(row, 20, 1, 12) + block(row, 42, 1, 18)]
    (storey,) = storeys_of(plan_of_cells(tuple(sorted(dented))))
    assert len(storey.lines) == 4


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
    assert hits.positions[0, 0] < hits.positions[1, 0] < 3.4, "two faces of one wall"
    assert left[2] > left[0] + 20, BLUE
    assert right[0] > right[2] + 20, RED
    through = caster.cast(np.array([[2.0, 1.0, 1.95]]), np.array([[1.0, 0, 0]])).range_m[0]
    assert through > 2.5, "the door is open"
    over = caster.cast(np.array([[2.0, 2.3, 1.95]]), np.array([[1.0, 0, 0]])).range_m[0]
    assert over == pytest.approx(1.2, abs=0.15), "the wall continues above the door"


def test_walls_leave_the_walked_path_open_and_its_length_the_same() -> None:
    scene = scene_from_plan(two_cell_rooms())
    walked = scene.navigation.distances(np.array([[1.5, 0.0, 1.95]]), np.array([[4.7, 0.0, 1.95]]))[0]
    assert walked == pytest.approx(3.2, abs=0.05)


def test_a_ceiling_covers_the_room_and_the_cut_of_the_storey_removes_it() -> None:
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


def test_floor_that_was_never_walked_is_a_little_higher_and_darker_and_a_guess_is_lighter() -> None:
    known, guess = block(20, 20, 40, 40), block(20, 60, 40, 20, guessed=True)
    plan = plan_of_cells((*known, *guess), plinth=block(64, 20, 40, 60, y_cm=2))
    mesh, _ = mesh_from_plan(plan)
    eyes = np.array([[1.5, 1.0, 2.0], [3.5, 1.0, 2.0], [2.5, 1.0, 4.4]])
    hits = Raycaster(mesh).cast(eyes, np.tile([0.0, -1, 0], (3, 1)))
    assert hits.positions[:, 1] == pytest.approx([0, 0, 0.02], abs=1e-4)
    known_finish, guessed_finish, raised = mesh.face_rgb[hits.face_ids].astype(int).sum(axis=1)
    assert guessed_finish > known_finish > raised


def test_a_bed_that_an_agent_stood_on_does_not_become_floor_but_a_platform_does() -> None:
    floor, bed = block(20, 20, 30, 160), block(50, 20, 22, 22, y_cm=60)
    platform = block(50, 110, 80, 70, y_cm=60)
    mesh, _ = mesh_from_plan(plan_of_cells((*floor, *bed, *platform), shape=(150, 200)))
    above = np.array([[1.55, 1.5, 3.2], [7.25, 1.5, 4.5]])
    down = Raycaster(mesh).cast(above, np.tile([0.0, -1.0, 0.0], (2, 1)))
    np.testing.assert_allclose(1.5 - down.range_m, [0.0, 0.6], atol=0.1)


def test_a_stair_flight_has_level_steps_and_a_stairwell_above() -> None:
    plan = two_storeys()
    scene = scene_from_plan(plan)
    caster = Raycaster(scene.mesh)
    xs = np.linspace(3.3, 6.2, 30)
    origins = np.stack([xs, np.full(30, 2.75), np.full(30, 2.15)], axis=1)
    high = caster.cast(origins[xs < 5.8], np.tile([0.0, -1, 0], ((xs < 5.8).sum(), 1))).positions[:, 1]
    assert (np.diff(high) >= -1e-4).all(), "the flight rises"
    steps = high / RISE
    assert np.abs(steps - np.round(steps)).max() < 0.02
    ramp = (xs[xs < 5.8] - 3.0) / 0.05 * 0.04
    assert np.abs(high - ramp).max() < 0.3
    walked = scene.navigation.distances(np.array([[1.5, 0.0, 2.0]]), np.array([[8.0, 2.8, 2.0]]))[0]
    assert np.isfinite(walked)
    up = caster.cast(np.array([[5.0, 2.4, 2.15]]), np.array([[0.0, 1, 0]])).positions[0, 1]
    assert up == pytest.approx(2.8 + 2.5, abs=0.02), "no ceiling and no floor in the stairwell"


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
    assert sky[2] > sky[0], "the window shows sky"


def test_the_same_plan_gives_the_same_mesh_and_a_storey_without_recorded_floor_gives_none() -> None:
    assert mesh_from_plan(two_storeys())[0].digest() == mesh_from_plan(two_storeys())[0].digest()
    plan = two_storeys()
    assert plan.cells is not None
    only_low = tuple(run for run in plan.cells.walkable if run.y_cm == 0)
    alone = plan.model_copy(update={"cells": plan.cells.model_copy(update={"walkable": only_low})})
    mesh, _ = mesh_from_plan(alone)
    assert mesh.vertices[:, 1].max() < 2.8
