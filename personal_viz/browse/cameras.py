"""Where a browser's camera goes: over a whole storey, or near one object. World metres."""

import math
from collections.abc import Sequence

import numpy as np
import viser

from personal_viz.study_app.home.scene_view import VIEW_ANGLE

from .library import OpenHome

_MARGIN = 1.12
"""Room around a storey, as a factor."""
_LOWER = 0.1
"""Share of a storey's depth by which the camera looks in front of its middle: a panel may cover the lower corner."""
_NEAR = 4.5
"""Metres from which one object is shown."""


def look_at_storey(client: viser.ClientHandle, home: OpenHome, storey: int) -> None:
    """All of a storey from above."""
    floor_y = home.copies.storeys[storey]
    top_down = home.scene.navigation.top_down(floor_y)
    xz = top_down.grid.xz_from_rc(np.argwhere(top_down.free))
    low, high = xz.min(axis=0), xz.max(axis=0)
    x, z = (low + high) / 2
    camera = client.camera
    width, depth = (high - low) / 2
    reach = math.tan(camera.fov / 2)  # of half the canvas's height at 1 m
    across = width / (reach * camera.aspect) + depth * math.cos(VIEW_ANGLE)  # its near side is nearer by that much
    upright = depth * math.sin(VIEW_ANGLE) / reach + depth * math.cos(VIEW_ANGLE)
    distance = _MARGIN * max(across, upright) + 1.0
    offset = distance * np.array([0.0, math.sin(VIEW_ANGLE), math.cos(VIEW_ANGLE)])
    _place(client, np.array([x, floor_y, z + _LOWER * (high - low)[1]]), offset)


def look_at_object(client: viser.ClientHandle, centre: Sequence[float], size: Sequence[float]) -> None:
    """One object from the side on which the camera is, from above walls."""
    centre_ = np.asarray(centre, float)
    away = np.asarray(client.camera.position, float) - centre_
    flat = np.array([away[0], 0.0, away[2]])
    norm = float(np.linalg.norm(flat))
    side = flat / norm if norm > 0.1 else np.array([0.0, 0.0, 1.0])
    distance = _NEAR + float(np.max(size))
    _place(client, centre_, distance * (math.cos(VIEW_ANGLE) * side + np.array([0.0, math.sin(VIEW_ANGLE), 0.0])))


def _place(client: viser.ClientHandle, centre: np.ndarray, offset: np.ndarray) -> None:
    camera = client.camera
    with client.atomic():
        camera.up_direction = (0.0, 1.0, 0.0)
        camera.position = centre + offset
        camera.look_at = centre
