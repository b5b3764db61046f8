"""Buttons that turn, move and zoom a view: looking around needs no mouse."""

import math
from collections.abc import Callable

import numpy as np
import viser
from numpy.typing import NDArray

from .panels import Page

TURN = math.radians(15)
"""Per press."""
ZOOM = 0.8
"""What is left of the distance after zooming in once."""
ELEVATIONS = (math.radians(10), math.radians(85))
"""How flat and how steep one can look down with the buttons."""
DISTANCES = (0.1, 500.0)
"""From what is looked at, that the buttons reach (metres): viser cannot turn a camera that stands in it."""
_SHIFT = 0.15
"""A map moves by this share of the camera's height per press."""
_SIDES = {"Left": (-1, 0), "Right": (1, 0), "Up": (0, 1), "Down": (0, -1)}
Move = Callable[[viser.CameraHandle, str], None]


def add_camera_buttons(page: Page, *, is_map: bool) -> None:
    """Adds them to the panel, until the next `Page.clear`.

    Args:
        page: Of the participant.
        is_map: Whether a picture from above is moved, instead of a home turned.
    """
    label, move = ("Move the map", shift) if is_map else ("Turn the view", orbit)
    _add_group(page, label, tuple(_SIDES), move)
    _add_group(page, "Zoom", ("In", "Out"), zoom)


def orbit(camera: viser.CameraHandle, side: str) -> None:
    """Goes round what is looked at, the home's ground staying level."""
    right, up = _SIDES[side]
    offset = np.asarray(camera.position, float) - camera.look_at
    distance = float(np.linalg.norm(offset))
    azimuth = math.atan2(offset[0], offset[2]) + right * TURN
    flat, steep = ELEVATIONS
    elevation = min(max(math.asin(max(-1.0, min(1.0, offset[1] / distance))) + up * TURN, flat), steep)
    level = math.cos(elevation)
    direction = [level * math.sin(azimuth), math.sin(elevation), level * math.cos(azimuth)]
    _look(camera, np.asarray(camera.look_at, float), distance * np.array(direction))


def shift(camera: viser.CameraHandle, side: str) -> None:
    """Moves over a map that is seen from straight above, north (-z) up."""
    right, up = _SIDES[side]
    offset = np.asarray(camera.position, float) - camera.look_at
    step = _SHIFT * float(np.linalg.norm(offset))
    _look(camera, np.asarray(camera.look_at, float) + np.array([right * step, 0.0, -up * step]), offset)


def zoom(camera: viser.CameraHandle, way: str) -> None:
    """Nearer to what is looked at, or further away, within `DISTANCES`."""
    offset = np.asarray(camera.position, float) - camera.look_at
    distance = float(np.linalg.norm(offset))
    nearest, furthest = min(DISTANCES[0], distance), max(DISTANCES[1], distance)
    wanted = min(max(distance * (ZOOM if way == "In" else 1 / ZOOM), nearest), furthest)
    _look(camera, np.asarray(camera.look_at, float), offset * (wanted / distance))


def _look(camera: viser.CameraHandle, at: NDArray[np.float64], offset: NDArray[np.float64]) -> None:
    with camera.client.atomic():
        camera.position = at + offset
        camera.look_at = at


def _add_group(page: Page, label: str, names: tuple[str, ...], move: Move) -> None:
    group = page.client.gui.add_button_group(label, names)

    @group.on_click
    async def _(event: viser.GuiEvent) -> None:
        if event.target.value in names:  # a browser may name any
            move(page.client.camera, event.target.value)

    page.add(group)
