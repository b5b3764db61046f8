"""Geometry of what is drawn over a home: box edges, heading marks, rays, paths. Pure: world metres in, arrays out."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from sim.frames import forward_from_yaw
from sim.types import Pose
from sim.walk.storeys import same_storey

Array = NDArray[np.float32]
_EDGES = np.array([(a, b) for a in range(8) for b in range(8) if a < b and (a ^ b) in (1, 2, 4)])
_CORNERS = np.array([[(k >> 2) & 1, (k >> 1) & 1, k & 1] for k in range(8)], np.float32) - 0.5
HEADING_VERTICES = np.array([[0, 0, -0.5], [0.3, 0, 0.35], [0, 0, 0.15], [-0.3, 0, 0.35], [0, 0.12, 0.1]], np.float32)
"""(5, 3) a dart that points along -z at yaw 0, one metre long; its spine is a little higher, so that light shows it."""
HEADING_FACES = np.array([[0, 4, 1], [0, 3, 4], [1, 4, 2], [3, 2, 4], [0, 1, 2], [0, 2, 3]], np.uint32)


def box_edges(centre: Sequence[float], size: Sequence[float] | NDArray[np.floating]) -> Array:
    """(12, 2, 3) edges of an upright box."""
    return (np.asarray(centre, np.float32) + _CORNERS * np.asarray(size, np.float32))[_EDGES].astype(np.float32)


def quat_wxyz_from_yaw(yaw: float) -> tuple[float, float, float, float]:
    """viser's order."""
    return (math.cos(yaw / 2), 0.0, math.sin(yaw / 2), 0.0)


def quat_wxyz_from_matrix(R_world_node: NDArray[np.float64]) -> tuple[float, float, float, float]:
    """viser's order, of a rotation (3, 3)."""
    x, y, z, w = Rotation.from_matrix(R_world_node).as_quat()
    return (float(w), float(x), float(y), float(z))


def path_segments(positions: NDArray[np.floating], floor_y: float, *, lift: float) -> Array:
    """(K, 2, 3) pieces of a polyline (N, 3) that lie on a storey, lifted over its floor so that they can be seen."""
    lifted = np.asarray(positions, np.float32) + np.array([0, lift, 0], np.float32)
    pieces = np.stack([lifted[:-1], lifted[1:]], axis=1)
    moved = np.linalg.norm(pieces[:, 1] - pieces[:, 0], axis=1) > 1e-6
    return pieces[moved & _near_floor(pieces[:, :, 1].mean(axis=1) - lift, floor_y)]


def on_storey(points: NDArray[np.floating], floor_y: float) -> NDArray[np.bool_]:
    """(N,) which points (N, 3) stand on the storey's floor."""
    return _near_floor(np.asarray(points)[:, 1], floor_y)


def nose(pose: Pose, *, height: float, length: float) -> Array:
    """(2, 3) a line from over the robot's feet along its heading."""
    start = np.array(pose.position, np.float32) + np.array([0, height, 0], np.float32)
    return np.stack([start, start + length * forward_from_yaw(pose.yaw).astype(np.float32)])


def thinned(points: NDArray[np.floating], cell: float) -> NDArray[np.floating]:
    """One of the points (N, 3) per square of the floor: regions are dense, and browsers draw each point."""
    if not len(points):
        return points
    _, first = np.unique(np.floor(points[:, [0, 2]] / cell).astype(np.int64), axis=0, return_index=True)
    return points[np.sort(first)]


def _near_floor(heights: NDArray[np.floating], floor_y: float) -> NDArray[np.bool_]:
    return same_storey(heights, floor_y)
