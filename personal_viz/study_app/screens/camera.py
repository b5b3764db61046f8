"""Buttons to look around without a mouse: the storey that is shown, and the camera's turns, moves and zoom.

The camera's pose is sampled while it moves.
"""

import asyncio
import math
from collections.abc import Awaitable, Callable, Iterable, Sequence
from functools import partial

import numpy as np
import viser

from human_study.trial.commands import LookFrom, ShowStorey
from human_study.trial.trial_session import CAMERA_EVERY_S

from ..home.surfaces import place_camera
from .page import Page, Send

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
SIDES = {"left": (-1, 0), "right": (1, 0), "up": (0, 1), "down": (0, -1)}
"""(right, up) on the screen by the name of a side."""


def add_storey_buttons(page: Page, count: int, send: Send) -> None:
    """Adds a button for each storey, where there are several."""
    for index in range(count if count > 1 else 0):
        page.button(page.words("camera.storey", number=index + 1, all=count), partial(send, ShowStorey(index)))


def add_camera_buttons(page: Page, *, is_map: bool) -> None:
    """Adds the camera's buttons to the panel, until the next `Page.clear`.

    Args:
        page: The participant's page.
        is_map: Whether the buttons move a picture from above, instead of turning a home.
    """
    label, move = ("camera.move", shift) if is_map else ("camera.turn", orbit)
    add_group(page, page.words(label), tuple(SIDES), partial(_move, page, move))
    add_group(page, page.words("camera.zoom"), ("in", "out"), partial(_move, page, zoom))


def sample_camera(page: Page, send: Send) -> None:
    """Sends the camera's pose, as `LookFrom`, while it moves, until the next `Page.clear`."""
    latest: LookFrom | None = None
    is_sampling = False

    async def moved(camera: viser.CameraHandle) -> None:
        nonlocal latest, is_sampling
        latest = LookFrom(three(camera.position), four(camera.wxyz))
        if is_sampling:
            return
        is_sampling, sent = True, None
        while latest != sent:
            sent = latest
            await send(sent)
            await asyncio.sleep(SAMPLE_EVERY_S)
        is_sampling = False

    page.listen_to_camera(moved)


def orbit(camera: viser.CameraHandle, side: str) -> None:
    """Moves the camera around its target; the home's ground stays level."""
    right, up = SIDES[side]
    offset = np.asarray(camera.position, float) - camera.look_at
    distance = float(np.linalg.norm(offset))
    azimuth = math.atan2(offset[0], offset[2]) + right * TURN
    flat, steep = ELEVATIONS
    elevation = min(max(math.asin(max(-1.0, min(1.0, offset[1] / distance))) + up * TURN, flat), steep)
    level = math.cos(elevation)
    direction = [level * math.sin(azimuth), math.sin(elevation), level * math.cos(azimuth)]
    place_camera(camera, np.asarray(camera.look_at, float), distance * np.array(direction))


def shift(camera: viser.CameraHandle, side: str) -> None:
    """Moves the camera over a map that is seen from straight above, north (-z) up."""
    right, up = SIDES[side]
    offset = np.asarray(camera.position, float) - camera.look_at
    step = _SHIFT * float(np.linalg.norm(offset))
    place_camera(camera, np.asarray(camera.look_at, float) + np.array([right * step, 0.0, -up * step]), offset)


def zoom(camera: viser.CameraHandle, way: str) -> None:
    """Moves the camera nearer to its target or further away, within `DISTANCES`."""
    offset = np.asarray(camera.position, float) - camera.look_at
    distance = float(np.linalg.norm(offset))
    nearest, furthest = min(DISTANCES[0], distance), max(DISTANCES[1], distance)
    wanted = min(max(distance * (ZOOM if way == "in" else 1 / ZOOM), nearest), furthest)
    place_camera(camera, np.asarray(camera.look_at, float), offset * (wanted / distance))


def three(values: Iterable[float]) -> tuple[float, float, float]:
    """The three values as plain floats."""
    x, y, z = (float(value) for value in values)
    return (x, y, z)


def four(values: Iterable[float]) -> tuple[float, float, float, float]:
    """The four values as plain floats."""
    w, x, y, z = (float(value) for value in values)
    return (w, x, y, z)


def add_group(
    page: Page, label: str, names: Sequence[str], press: Callable[[str], Awaitable[None]], *, hint: str | None = None
) -> None:
    """Adds a group of buttons, until the next `Page.clear`.

    Args:
        page: The participant's page.
        label: The group's label.
        names: Names of the buttons; their labels are the words `camera.<name>`.
        press: Called with the name of the pressed button, on viser's event loop.
        hint: Words that appear beside the pointer.
    """
    by_label = {page.words(f"camera.{name}"): name for name in names}
    group = page.add(page.client.gui.add_button_group(label, tuple(by_label), hint=hint))

    @group.on_click
    async def _(event: viser.GuiEvent) -> None:
        if event.target.value in by_label:  # a browser may send any label
            await press(by_label[event.target.value])


async def _move(page: Page, move: Callable[[viser.CameraHandle, str], None], name: str) -> None:
    move(page.client.camera, name)
