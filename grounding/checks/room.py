"""A room with two boxes and exact views of it, made by arithmetic: the known world of `check_map_builder`."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.frames import T_world_camera
from sim.types import Camera, Frame, Pose

CAMERA = Camera(width=160, height=120)
ROOM = ((2.7, 0.0, -9.2), (8.1, 2.5, -3.6))
"""Lowest and highest corner of the room, metres; it lies off the origin, so that a mirrored map is elsewhere."""
BOXES = {1: ((6.6, 0.0, -8.3), (7.4, 0.8, -7.7)), 2: ((3.1, 0.0, -7.0), (3.7, 1.0, -6.4))}
"""Corners of each box by its instance id, metres; both stand on the floor."""
COLOURS = np.array([(150, 140, 130), (200, 30, 30), (30, 60, 210)], np.uint8)
"""RGB of the room and of the boxes, by id."""


@dataclass(frozen=True, slots=True)
class CheckView:
    """One exact view."""

    frame: Frame
    points: NDArray[np.float64]
    """(H, W, 3) the point that each pixel shows, map frame, metres."""


def check_views(*, T_map_room: NDArray[np.float64] | None = None, exchanged: bool = False) -> list[CheckView]:
    """Views of a robot that turns at three places in the room.

    Args:
        T_map_room: (4, 4) moves the room, the boxes and the robot together; by default they stay.
        exchanged: The boxes have each other's colour and id.
    """
    moved = np.eye(4) if T_map_room is None else T_map_room
    places = ((5.2, -6.4), (6.1, -6.0), (4.4, -7.2))
    poses = [Pose((x, 0.0, z), math.radians(turn)) for x, z in places for turn in range(0, 360, 45)]
    names = {1: 2, 2: 1} if exchanged else {1: 1, 2: 2}
    return [_view(T_world_camera(pose, CAMERA), moved, names) for pose in poses]


def is_free(xz: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(N,) which places (N, 2) of the unmoved room may be free: floor, and two cells of 5 cm under walls and boxes."""
    (x0, _, z0), (x1, _, z1) = ROOM
    inside = _holds(xz, (x0, z0), (x1, z1), 0.1)
    for low, high in BOXES.values():
        inside &= ~_holds(xz, (low[0], low[2]), (high[0], high[2]), -0.1)
    return inside


def is_solid(xz: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(N,) which places (N, 2) of the unmoved room are within two cells of 5 cm of a wall or box."""
    (x0, _, z0), (x1, _, z1) = ROOM
    solid = _holds(xz, (x0, z0), (x1, z1), 0.1) & ~_holds(xz, (x0, z0), (x1, z1), -0.1)
    for low, high in BOXES.values():
        solid |= _holds(xz, (low[0], low[2]), (high[0], high[2]), 0.1)
    return solid


def _holds(xz: NDArray, low: tuple[float, float], high: tuple[float, float], grown: float) -> NDArray[np.bool_]:
    inside = (xz >= np.array(low) - grown) & (xz <= np.array(high) + grown)
    return np.asarray(inside.all(axis=-1))


def _view(T_room_camera: NDArray[np.float64], T_map_room: NDArray[np.float64], names: dict[int, int]) -> CheckView:
    rows, cols = np.mgrid[0 : CAMERA.height, 0 : CAMERA.width] + 0.5
    fx, fy, cx, cy = CAMERA.lens
    rays = np.stack([(cols - cx) / fx, (rows - cy) / fy, np.ones_like(rows)], axis=-1)
    directions, eye = rays @ T_room_camera[:3, :3].T, T_room_camera[:3, 3]
    depth = _slabs(eye, directions, *ROOM)[1]  # where the rays leave the room
    ids = np.zeros(depth.shape, np.int32)
    for number, (low, high) in BOXES.items():
        enter, leave = _slabs(eye, directions, low, high)
        is_hit = (enter > 0) & (enter < leave) & (enter < depth)
        depth, ids = np.where(is_hit, enter, depth), np.where(is_hit, np.int32(names[number]), ids)
    points = (eye + directions * depth[..., None]) @ T_map_room[:3, :3].T + T_map_room[:3, 3]
    frame = Frame(COLOURS[ids], depth.astype(np.float32), T_map_room @ T_room_camera, CAMERA, ids)
    return CheckView(frame, points)


def _slabs(eye: NDArray, directions: NDArray, low: tuple, high: tuple) -> tuple[NDArray, NDArray]:
    """Depths (H, W) at which rays enter and leave a box; planar, since the rays have depth 1."""
    enter, leave = np.full(directions.shape[:2], -np.inf), np.full(directions.shape[:2], np.inf)
    with np.errstate(divide="ignore"):
        for axis in range(3):
            first, second = ((bound[axis] - eye[axis]) / directions[..., axis] for bound in (low, high))
            enter, leave = np.maximum(enter, np.minimum(first, second)), np.minimum(leave, np.maximum(first, second))
    return enter, leave
