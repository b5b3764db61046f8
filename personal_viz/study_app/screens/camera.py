"""Buttons to look around without a mouse: the storey that is shown, and the camera's turns, moves and zoom.

The camera's pose is sampled while it moves.
"""

import asyncio
import math
from collections.abc import Awaitable, Callable, Collection, Iterable, Sequence
from functools import partial

import numpy as np
import viser

from human_study.texts.catalogue import Catalogue
from human_study.trial.commands import LookFrom, ShowNames, ShowStorey
from human_study.trial.trial_session import CAMERA_EVERY_S
from sim.homes.storey_names import StoreyNaming, floors_above_ground

from ..home.looks import place_camera
from ..home.surfaces import HomeSurface, Surface
from .page import Page, Send, relabel

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


class StoreyButtons:
    """A button for each storey, where there are several, and the keys PgUp and PgDn, until the next `Page.clear`."""

    def __init__(self, page: Page, names: Sequence[str], send: Send) -> None:
        """Adds the buttons.

        Args:
            page: The participant's page.
            names: Name of each storey, the lowest first (`storey_names`).
            send: Receives `ShowStorey`.
        """
        self._words, self._send, self._shown, self._names = page.words, send, 0, names
        self._buttons: list[viser.GuiButtonHandle] = []
        if len(names) > 1:
            self._buttons = [page.button(name, partial(send, ShowStorey(index))) for index, name in enumerate(names)]
            page.hotkey("pageup", page.words("camera.storey_up"), partial(self._step, 1))
            page.hotkey("pagedown", page.words("camera.storey_down"), partial(self._step, -1))

    def show(self, shown: int, marked: Collection[int] = ()) -> None:
        """Labels the buttons, with the storey that is shown, and others on which marks of the participant are."""
        self._shown = shown
        for index, (name, button) in enumerate(zip(self._names, self._buttons, strict=False)):
            state = "storey_shown" if index == shown else "storey_marked" if index in marked else "storey_show"
            label = self._words(f"camera.{state}", name=name)
            relabel(button, label[:1].upper() + label[1:], "dark" if index == shown else "blue")

    async def _step(self, by: int) -> None:
        """Shows the storey so many above, where there is one."""
        if 0 <= self._shown + by < len(self._names):
            await self._send(ShowStorey(self._shown + by))


class NamesButton:
    """A button for names in the home, where the study shows some on demand, until the next `Page.clear`."""

    def __init__(self, page: Page, surface: Surface | None, send: Send, *, is_there: bool) -> None:
        """Adds the button.

        Args:
            page: The participant's page.
            surface: Shows the names; a map has none of its own.
            send: Receives `ShowNames`.
            is_there: Whether the study shows names on demand.
        """
        self._surface = surface if is_there and isinstance(surface, HomeSurface) else None
        self._words, self._send, self._is_shown = page.words, send, False
        if self._surface is not None:
            self._button = page.button(page.words("camera.names_show"), self._press)

    def show(self, *, is_shown: bool) -> None:
        """Shows the names or takes them away."""
        self._is_shown = is_shown
        if self._surface is not None:
            self._surface.ask_names(is_asked=is_shown)
            relabel(self._button, self._words("camera.names_hide" if is_shown else "camera.names_show"))

    async def _press(self) -> None:
        await self._send(ShowNames(not self._is_shown))


def storey_names(words: Catalogue, naming: StoreyNaming, labels: Sequence[int]) -> list[str]:
    """Name of each storey as it is written in the middle of a sentence.

    Args:
        words: The study's language.
        naming: The study's choice.
        labels: From `sim.homes.storey_names.storey_labels`, the lowest storey first.
    """
    if naming == "numbers":
        return [words("camera.storey", number=index + 1, all=len(labels)) for index in range(len(labels))]
    floors = floors_above_ground(labels, naming)
    keys = [f"floor.{floor}" if -1 <= floor <= 3 else "floor.other" if floor > 3 else "floor.below" for floor in floors]
    return [words(key, number=abs(floor)) for key, floor in zip(keys, floors, strict=True)]


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
