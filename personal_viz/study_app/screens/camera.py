"""The camera of a home or a map: buttons that turn, move and zoom it, and samples of its pose."""

import asyncio
import math
from collections.abc import Awaitable, Callable, Iterable

import numpy as np
import viser
from numpy.typing import NDArray

from human_study.trial.commands import LookFrom
from human_study.trial.trial_session import CAMERA_EVERY_S

from .panels import Page

TURN = math.radians(15)
"""Turn of one press, radians."""
ZOOM = 0.8
"""Factor of the distance when zooming in once."""
ELEVATIONS = (math.radians(10), math.radians(85))
"""Flattest and steepest view down that the buttons reach, radians."""
DISTANCES = (0.1, 500.0)
"""Least and largest distance from the camera's target that the buttons reach (metres); viser cannot turn a camera at
its target."""
SAMPLE_EVERY_S = 1.1 * CAMERA_EVERY_S
"""A little more than the session's limit, so that it keeps every sample."""
_SHIFT = 0.15
"""A map moves by this share of the camera's height per press."""
_SIDES = {"Left": (-1, 0), "Right": (1, 0), "Up": (0, 1), "Down": (0, -1)}
Move = Callable[[viser.CameraHandle, str], None]


def add_camera_buttons(page: Page, *, is_map: bool) -> None:
    """Adds the camera's buttons to the panel, until the next `Page.clear`.

    Args:
        page: The participant's page.
        is_map: Whether the buttons move a picture from above, instead of turning a home.
    """
    label, move = ("Move the map", shift) if is_map else ("Turn the view", orbit)
    _add_group(page, label, tuple(_SIDES), move)
    _add_group(page, "Zoom", ("In", "Out"), zoom)


def orbit(camera: viser.CameraHandle, side: str) -> None:
    """Moves the camera around its target; the home's ground stays level."""
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
    """Moves the camera over a map that is seen from straight above, north (-z) up."""
    right, up = _SIDES[side]
    offset = np.asarray(camera.position, float) - camera.look_at
    step = _SHIFT * float(np.linalg.norm(offset))
    _look(camera, np.asarray(camera.look_at, float) + np.array([right * step, 0.0, -up * step]), offset)


def zoom(camera: viser.CameraHandle, way: str) -> None:
    """Moves the camera nearer to its target or further away, within `DISTANCES`."""
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
        if event.target.value in names:  # a browser may send any name
            move(page.client.camera, event.target.value)

    page.add(group)


class CameraSamples:
    """Samples the camera of one screen."""

    def __init__(self, sample: Callable[[LookFrom], Awaitable[None]]) -> None:
        """Samples nothing before the camera moves; `sample` is called with each pose to keep."""
        self._sample = sample
        self._looked_from: LookFrom | None = None
        self._is_sampling = False

    async def moved(self, camera: viser.CameraHandle) -> None:
        """Samples the camera while it moves."""
        self._looked_from = LookFrom(three(camera.position), four(camera.wxyz))
        if self._is_sampling:
            return
        self._is_sampling = True
        sent = None
        while self._looked_from != sent:
            sent = self._looked_from
            await self._sample(sent)
            await asyncio.sleep(SAMPLE_EVERY_S)
        self._is_sampling = False


def three(values: Iterable[float]) -> tuple[float, float, float]:
    """The three values as plain floats."""
    x, y, z = (float(value) for value in values)
    return (x, y, z)


def four(values: Iterable[float]) -> tuple[float, float, float, float]:
    """The four values as plain floats."""
    w, x, y, z = (float(value) for value in values)
    return (w, x, y, z)
