"""VLFM's explored area and frontiers: borders with known middles, small islands, fog of war in open space."""

import numpy as np
import pytest

from grounding.agents.vlfm.explored import ExploredArea, frontier_midpoints
from sim.frames import T_world_camera
from sim.render.raycast import Raycaster
from sim.types import Camera, GridSpec, Pose

from .two_rooms import two_room_scene

GRID = GridSpec((-10.0, -10.0), 0.05, (400, 400))
CAMERA = Camera(64, 48)
START = Pose((0.0, 0.0, 0.0), 0.0)


def room(rows: int, cols: int) -> np.ndarray:
    """(rows + 20, cols + 20) navigable cells of a room with walls of ten cells around it."""
    navigable = np.zeros((rows + 20, cols + 20), bool)
    navigable[10:-10, 10:-10] = True
    return navigable


def test_a_border_of_ten_cells_gives_one_way_point_in_its_middle() -> None:
    navigable = room(150, 10)
    explored = navigable.copy()
    explored[40:] = False
    (found,) = frontier_midpoints(explored, navigable, least_cells=600)
    assert found == pytest.approx([15.0, 42.0]), "columns 10-19, two rows beyond the last explored one"


def test_a_half_explored_room_has_one_frontier_in_the_middle_of_its_border() -> None:
    navigable = room(80, 160)
    explored = navigable.copy()
    explored[:, 90:] = False
    (found,) = frontier_midpoints(explored, navigable, least_cells=600)
    assert found == pytest.approx([92.0, 50.0])


@pytest.mark.parametrize(("rows", "cols", "num_frontiers"), [(20, 20, 0), (20, 35, 1)])
def test_an_unexplored_island_counts_from_600_cells(rows: int, cols: int, num_frontiers: int) -> None:
    """Islands of 400 and 700 cells after the explored area is widened by two cells."""
    navigable = room(100, 100)
    explored = navigable.copy()
    explored[40 : 44 + rows, 40 : 44 + cols] = False
    assert len(frontier_midpoints(explored, navigable, least_cells=600)) == num_frontiers
    assert len(frontier_midpoints(explored, navigable, least_cells=300)) == 1


def test_a_small_island_with_something_explored_inside_stays() -> None:
    navigable = room(100, 100)
    explored = navigable.copy()
    explored[40:60, 40:60] = False
    explored[50, 50] = True
    assert len(frontier_midpoints(explored, navigable, least_cells=600)) > 0


def test_two_openings_give_two_frontiers_and_a_closed_room_none() -> None:
    navigable = room(60, 60)
    explored = navigable.copy()
    assert len(frontier_midpoints(explored, navigable, least_cells=600)) == 0
    navigable[:10, 20:30] = True
    navigable[30:50, 70:] = True
    found = frontier_midpoints(explored, navigable, least_cells=600)
    assert found[found[:, 0].argsort()].tolist() == [pytest.approx([25.0, 8.0]), pytest.approx([72.0, 40.0])]


def test_fog_lifts_in_open_space_without_any_obstacle() -> None:
    area = ExploredArea(GRID)
    area.see(np.zeros((48, 64), np.float32), T_world_camera(START, CAMERA), CAMERA, floor_y=0.0)
    seen = GRID.xz_from_rc(np.argwhere(area.explored))
    assert np.hypot(*seen.T).max() == pytest.approx(5.0, abs=0.1)
    # a sector of 79 degrees and 5 m has 17.2 m2; its rim of 16.9 m is widened by one cell, by up to two at a slant
    assert 17.24 + 0.05 * 16.9 < len(seen) * 0.05**2 < 17.24 + 0.1 * 16.9
    assert len(area.frontiers()) == 1


def test_a_wall_between_015_and_088_metres_hides_the_floor_behind_it_for_ever() -> None:
    area = ExploredArea(GRID)
    T = T_world_camera(START, CAMERA)
    depth = np.zeros((48, 64), np.float32)
    depth[26:30] = 2.0  # below the camera's middle row: 0.67 to 0.85 m above the floor
    area.see(depth, T, CAMERA, floor_y=0.0)
    rows = np.argwhere(area.obstacles)[:, 0]
    assert set(rows) == {160}, "z = -2 is where rows 159 and 160 meet, and a cell holds its side of lower z"
    assert not area.explored[:156].any()
    area.see(np.zeros((48, 64), np.float32), T, CAMERA, floor_y=0.0)
    assert len(np.argwhere(area.obstacles)) == len(rows)


@pytest.mark.parametrize(("height", "is_obstacle"), [(0.1, False), (0.2, True), (0.8, True), (0.9, False)])
def test_obstacles_are_points_in_the_band_of_heights(height: float, is_obstacle: bool) -> None:
    area = ExploredArea(GRID)
    depth = np.zeros((48, 64), np.float32)
    depth[24, 32] = 2.0  # the ray of this pixel falls 1.29 cm per metre of depth
    T = T_world_camera(START, CAMERA)
    area.see(depth, T, CAMERA, floor_y=0.88 - 0.026 - height)
    assert area.obstacles.any() == is_obstacle
    assert int(area.blocked.sum()) == (49 if is_obstacle else 0)


def test_only_the_area_around_the_robot_is_kept() -> None:
    area = ExploredArea(GRID)
    blind = np.zeros((48, 64), np.float32)
    area.see(blind, T_world_camera(START, CAMERA), CAMERA, floor_y=0.0)
    area.see(blind, T_world_camera(Pose((0.0, 0.0, 5.0), np.pi), CAMERA), CAMERA, floor_y=0.0)
    z = GRID.xz_from_rc(np.argwhere(area.explored))[:, 1]
    assert z.min() > 4.9


def test_kept_frontiers_are_those_of_the_whole_grid_along_a_walk() -> None:
    scene = two_room_scene()
    renderer, area = Raycaster(scene.mesh), ExploredArea(GRID)
    turns = [Pose((1.0, 0.0, 1.0), 0.5 + k * np.pi / 6) for k in range(13)]
    walk = [Pose((1.0 + 0.25 * k, 0.0, 1.0 + 0.08 * k), -np.pi / 2) for k in range(12)]
    num_kept, last = 0, np.zeros((0, 2))
    for pose in [*turns, *turns[:2], *walk]:
        T = T_world_camera(pose, CAMERA)
        area.see(renderer.depth(T, CAMERA), T, CAMERA, floor_y=0.0)
        found = area.frontiers()
        num_kept += found is last
        again = GRID.xz_from_uv(frontier_midpoints(area.explored, ~area.blocked, least_cells=600))
        np.testing.assert_allclose(found, again, atol=1e-12)
        last = found
    assert num_kept >= 2, "the robot turned to two views that it knew"
    assert len(last) > 0
