"""The part of a storey that a robot has seen, from above: by depth and the camera's pose, or by the free map alone."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from sim.types import Camera, GridSpec

MAX_RANGE = 5.0
"""Nothing farther than this counts as seen, metres (VLFM's fog of war)."""
TALLEST, LOWEST = 1.6, -0.3
"""A ray shows the floor below it while it is between these heights above the floor, metres: higher things hide nothing,
and lower places are a stair or another storey."""
NEAR = 0.3
"""Without depth: recorded starts may lie off the map, so nothing nearer than this (metres) hides the floor."""
BEHIND = 0.25
"""Without depth: the free map ends a robot's radius before a wall, so this much more (metres) counts as seen."""
_EVERY_ROW, _EVERY_COL = 16, 8
"""Every 16th row and 8th column of a picture is used: columns are then 9 cm apart at MAX_RANGE."""


class SeenArea:
    """The cells of one storey's top-down grid that a robot on that storey has seen."""

    def __init__(self, free: NDArray[np.bool_], grid: GridSpec) -> None:
        """Starts with nothing seen.

        `free` (rows, cols) on the grid is where the robot's centre can be; only views without depth use it.
        """
        self._free = free
        self._grid = grid
        self._image = Image.new("L", (grid.shape[1], grid.shape[0]), 0)
        self._draw = ImageDraw.Draw(self._image)

    @property
    def cells(self) -> NDArray[np.bool_]:
        """(rows, cols) True where a cell was seen; a copy."""
        return np.asarray(self._image, bool)

    def see(self, T_world_camera: NDArray[np.float64], camera: Camera, depth_m: NDArray[np.float32] | None) -> None:
        """Adds the floor that one view shows, up to MAX_RANGE: one polygon, so that there are no gaps between rays.

        Args:
            T_world_camera: (4, 4) pose of the camera (OpenCV axes), `camera.mount_height` above the floor.
            camera: Intrinsics of the view.
            depth_m: (H, W) planar metres, 0 = no return: the ray is free. None = rays on the free map instead.
        """
        here, R_world_camera = T_world_camera[[0, 2], 3], T_world_camera[:3, :3]
        if depth_m is None:
            reach = _reach_on_map(here, R_world_camera, camera, self._free, self._grid)
        else:
            reach = _reach_of_depth(R_world_camera, camera, depth_m)
        corners = (np.vstack([here, here + reach]) - np.asarray(self._grid.origin_xz)) / self._grid.cell - 0.5
        self._draw.polygon(corners.ravel().tolist(), fill=255)


def _reach_of_depth(
    R_world_camera: NDArray[np.float64], camera: Camera, depth_m: NDArray[np.float32]
) -> NDArray[np.float64]:
    """(C, 2) xz metres from the camera to the farthest place that each used column shows, left to right."""
    assert depth_m.shape == (camera.height, camera.width), depth_m.shape
    right, heading = _flat_axes(R_world_camera)
    rays = _tilted_rays(camera, float(R_world_camera[1, 1]), float(R_world_camera[1, 2]))
    depth = depth_m[_EVERY_ROW // 2 :: _EVERY_ROW, _EVERY_COL // 2 :: _EVERY_COL]
    open_depth = np.minimum(np.where(depth > 0, depth, np.float32(np.inf)), rays.leaves)
    reach = np.minimum(open_depth * rays.flat, np.float32(MAX_RANGE))
    row, col = reach.argmax(axis=0), np.arange(reach.shape[1])
    scale = reach[row, col] / rays.flat[row, col]
    return (rays.u * scale)[:, None] * right + (rays.ahead[row] * scale)[:, None] * heading


def _reach_on_map(
    here: NDArray[np.float64],
    R_world_camera: NDArray[np.float64],
    camera: Camera,
    free: NDArray[np.bool_],
    grid: GridSpec,
) -> NDArray[np.float64]:
    """(C, 2) xz metres from the camera to the place where each column's ray leaves the free map, left to right."""
    u, _ = _rays(camera)
    right, heading = _flat_axes(R_world_camera)
    directions = (u[:, None] * right + heading) / np.sqrt(1 + u**2)[:, None]  # (C, 2)
    ranges = np.arange(NEAR, MAX_RANGE, grid.cell)  # (S,)
    rc = grid.rc_from_xz(here + directions[:, None] * ranges[:, None])  # (C, S, 2)
    inside = grid.contains(rc)
    row, col = (np.where(inside, rc[..., axis], 0) for axis in (0, 1))
    blocked = ~(inside & free[row, col])
    reach = np.where(blocked.any(axis=1), ranges[blocked.argmax(axis=1)] + BEHIND, MAX_RANGE)
    return directions * np.minimum(reach, MAX_RANGE)[:, None]


class _Rays(NamedTuple):
    """The used rays of a camera with one tilt, per metre of depth."""

    u: NDArray[np.float64]
    """(C,) metres to the right."""
    ahead: NDArray[np.float64]
    """(R,) metres along the heading."""
    flat: NDArray[np.float32]
    """(R, C) metres over the floor."""
    leaves: NDArray[np.float32]
    """(R, 1) depth at which the ray is lower than LOWEST or higher than TALLEST."""


@lru_cache(maxsize=16)
def _tilted_rays(camera: Camera, up_y: float, up_z: float) -> _Rays:
    """The rays of a camera whose own down and forward axes rise by `up_y` and `up_z`; cached, because tilts repeat."""
    u, v = _rays(camera)
    rise = up_y * v + up_z  # (R, 1)
    ahead = up_z * v - up_y  # (R, 1)
    leaves = (np.where(rise > 0, TALLEST, LOWEST) - camera.mount_height) / np.where(rise == 0, 1e-9, rise)
    flat = np.sqrt(u**2 + ahead**2)
    return _Rays(u, ahead[:, 0], flat.astype(np.float32), np.abs(leaves).astype(np.float32))


def _rays(camera: Camera) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Sideways (C,) and downwards (R, 1) metres per metre of depth, for the used columns and rows."""
    cols = np.arange(_EVERY_COL // 2, camera.width, _EVERY_COL)
    rows = np.arange(_EVERY_ROW // 2, camera.height, _EVERY_ROW)
    fx, fy, cx, cy = camera.lens
    u, v = (cols + 0.5 - cx) / fx, (rows + 0.5 - cy) / fy
    return u.astype(np.float64), v[:, None].astype(np.float64)


def _flat_axes(R_world_camera: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The camera's right and its heading on the floor plane, (2,) xz unit vectors; tilt changes neither."""
    right = R_world_camera[[0, 2], 0]
    return right, np.array([right[1], -right[0]])
