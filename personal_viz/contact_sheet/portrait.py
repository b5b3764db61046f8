"""A picture of one piece of furniture by itself, as a visitor would see it: for contact sheets and for tests."""

import math

import numpy as np
from numpy.typing import NDArray

from sim.frames import T_world_camera
from sim.homes.building.quads import QuadBuilder, add_piece
from sim.homes.furniture.families import look_of
from sim.homes.plan import Finish, Furniture
from sim.render.raycast import Raycaster
from sim.types import Camera, Pose

_FLOOR = Finish(material="plastic", rgb=(222, 218, 212))
_WALL = Finish(material="plastic", rgb=(236, 236, 234))
_BACKGROUND = (246, 246, 246)
_HFOV_DEG = 34.0
_TURN = math.radians(32)
"""The camera stands this far to the side of the front."""
_EYE = 1.2
_STEEPEST = math.radians(28)
_MARGIN = 1.08
_RIM_HEIGHTS = {"sink": 0.9, "mantle": 1.5, "door": 2.05, "curtain": 2.2}
"""Height of the upper edge of families that do not hang at eye level, metres."""


def portrait(piece: Furniture, *, side: int = 256) -> NDArray[np.uint8]:
    """A three-quarter view of the piece on a floor, or before a wall where such things hang.

    Args:
        piece: Its place and yaw do not matter.
        side: Width and height of the picture in pixels.

    Returns:
        (side, side, 3) RGB.
    """
    mounting = look_of(piece.category).mounting
    w, h, d = piece.size
    hung = max(0.0, _RIM_HEIGHTS.get(look_of(piece.category).family, 1.35 + h / 2) - h)
    bottom = {"floor": 0.0, "wall": hung, "ceiling": max(0.2, 2.3 - h), "on": 0.0}[mounting]
    moved = piece.model_copy(update={"centre": (0.0, bottom + h / 2, 0.0), "yaw": 0.0})
    builder = QuadBuilder()
    add_piece(builder, moved, instance=1)
    floor = [(-6, 0, -6), (-6, 0, 6), (6, 0, 6), (6, 0, -6)]
    builder.add_quads([[(x, y - 0.002, z) for x, y, z in floor]], _FLOOR)
    if mounting == "wall":
        z = -d / 2 - 0.002
        builder.add_quads([[(-3, 0, z), (3, 0, z), (3, 3.5, z), (-3, 3.5, z)]], _WALL)
    pose, camera = _view_of((w, h, d), bottom, side=side, turn=_TURN * (0.6 if mounting == "wall" else 1.0))
    frame = Raycaster(builder.mesh(), texture_filter="mipmap").render(T_world_camera(pose, camera), camera)
    picture = frame.rgb.copy()
    picture[frame.depth_m == 0] = _BACKGROUND
    return picture


def _view_of(size: tuple[float, float, float], bottom: float, *, side: int, turn: float) -> tuple[Pose, Camera]:
    """Pose and camera that show a box of `size` around (0, bottom + h / 2, 0) whole, from eye height or above it."""
    w, h, d = size
    radius = 0.5 * math.hypot(w, h, d) * _MARGIN
    away = radius / math.sin(math.radians(_HFOV_DEG / 2))
    middle = bottom + h / 2
    down = max(math.radians(-12), min(_STEEPEST, math.asin(np.clip((_EYE - middle) / away, -1, 1))))
    if middle < _EYE:
        down = max(down, math.radians(40 if h < 0.1 * max(w, d) else 14))
    flat, rise = away * math.cos(down), away * math.sin(down)
    place = (flat * math.sin(turn), middle + rise, flat * math.cos(turn))
    camera = Camera(side, side, hfov_deg=_HFOV_DEG, mount_height=0.0)
    return Pose(place, turn, -down), camera
