"""The area that a robot has seen, from above: cones in the open, walls and furniture that hide what is behind them."""

import numpy as np
import pytest

from sim.frames import T_world_camera
from sim.tasks.fog import MAX_RANGE, SeenArea
from sim.types import Camera, GridSpec, Pose

CAMERA = Camera()
GRID = GridSpec((-8.0, -8.0), 0.05, (320, 320))
OPEN = np.ones(GRID.shape, bool)
CONE = np.pi * MAX_RANGE**2 * CAMERA.hfov_deg / 360
"""Area within MAX_RANGE and the field of view, square metres."""


def depth_of(value: float) -> np.ndarray:
    """A depth picture (H, W) with every pixel at this planar depth, metres."""
    return np.full((CAMERA.height, CAMERA.width), value, np.float32)


def seen_from(pose: Pose, depth_m: np.ndarray | None, *, free: np.ndarray = OPEN) -> SeenArea:
    area = SeenArea(free, GRID)
    area.see(T_world_camera(pose, CAMERA), CAMERA, depth_m)
    return area


def is_seen(area: SeenArea, x: float, z: float) -> bool:
    row, col = GRID.rc_from_xz(np.array([x, z]))
    return bool(area.cells[row, col])


def test_nothing_is_seen_at_first_and_views_only_add_to_the_seen_area() -> None:
    assert not SeenArea(OPEN, GRID).cells.any()
    area = seen_from(Pose((0.0, 0.0, 0.0), 0.0), depth_of(3.0))
    before = area.cells
    area.see(T_world_camera(Pose((0.0, 0.0, 0.0), np.pi), CAMERA), CAMERA, depth_of(1.0))
    assert (area.cells | before == area.cells).all()
    assert area.cells.sum() > before.sum()


@pytest.mark.parametrize("depth_m", [depth_of(0.0), depth_of(100.0), None], ids=["no return", "far wall", "no depth"])
def test_an_open_view_reveals_its_whole_cone(depth_m: np.ndarray | None) -> None:
    area = seen_from(Pose((0.0, 0.0, 0.0), 0.0), depth_m)
    assert area.cells.sum() * GRID.cell**2 == pytest.approx(CONE, rel=0.03)
    assert is_seen(area, 0.0, -4.9)
    assert not is_seen(area, 0.0, -5.2)
    assert not is_seen(area, 0.0, 0.3)


def test_yaw_turns_the_cone_to_the_left_and_looking_down_shortens_it() -> None:
    area = seen_from(Pose((1.0, 0.0, 2.0), np.pi / 2), depth_of(0.0))
    assert is_seen(area, -3.5, 2.0)
    assert not is_seen(area, 4.0, 2.0)
    assert not is_seen(area, 1.0, -2.0)
    ahead = seen_from(Pose((0.0, 0.0, 0.0), 0.0), depth_of(0.0)).cells.sum()
    down = seen_from(Pose((0.0, 0.0, 0.0), 0.0, -np.pi / 3), depth_of(0.0)).cells.sum()
    assert 0 < down < ahead / 2


def test_walls_and_tall_furniture_hide_the_area_behind_them_and_low_furniture_does_not() -> None:
    area = seen_from(Pose((0.0, 0.0, 0.0), 0.0), depth_of(2.0))
    assert is_seen(area, 0.0, -1.95)
    assert is_seen(area, 1.4, -1.9)
    assert not is_seen(area, 0.0, -2.2)
    depth = depth_of(4.0)
    depth[:, : CAMERA.width // 2] = 1.0
    area = seen_from(Pose((0.0, 0.0, 0.0), 0.0), depth)
    assert not is_seen(area, -0.5, -2.0)
    assert is_seen(area, 0.5, -2.0)
    depth[CAMERA.height * 2 // 3 :] = 1.0  # a footstool; the rows above look over it
    assert is_seen(seen_from(Pose((0.0, 0.0, 0.0), 0.0), depth), 0.0, -3.9)


def test_without_depth_blocked_cells_end_the_view_except_at_the_robots_feet_and_the_map_bounds_it() -> None:
    free = OPEN.copy()
    free[: GRID.rc_from_xz(np.array([0.0, -2.0]))[0]] = False
    area = seen_from(Pose((0.0, 0.0, 0.0), 0.0), None, free=free)
    assert is_seen(area, 0.0, -2.1)
    assert not is_seen(area, 0.0, -2.5)
    free = OPEN.copy()
    row, col = GRID.rc_from_xz(np.array([0.0, 0.0]))
    free[row - 3 : row + 4, col - 3 : col + 4] = False
    assert seen_from(Pose((0.0, 0.0, 0.0), 0.0), None, free=free).cells.sum() * GRID.cell**2 > 0.9 * CONE
    area = seen_from(Pose((-7.9, 0.0, -7.9), 0.0), depth_of(0.0))
    assert area.cells.shape == GRID.shape
    assert area.cells.any()
