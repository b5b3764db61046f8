"""Looking around without a mouse: what each press does to the camera."""

import asyncio
import contextlib
import math
from collections.abc import Awaitable, Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from human_study.texts.catalogue import catalogue_of
from human_study.trial.commands import ShowStorey
from personal_viz.study_app.home.looks import VIEW_ANGLE, framing_distance, place_camera, window_aspect
from personal_viz.study_app.home.surfaces import Surface
from personal_viz.study_app.screens.camera import (
    ELEVATIONS,
    TURN,
    ZOOM,
    StoreyButtons,
    orbit,
    shift,
    storey_names,
    zoom,
)


class Camera:
    """A camera like viser's: setting the position takes `look_at` along."""

    def __init__(self, position: tuple[float, float, float], look_at: tuple[float, float, float]) -> None:
        self._position = np.array(position)
        self.look_at = np.array(look_at)
        self.client: Any = self

    @property
    def position(self) -> np.ndarray:
        return self._position

    @position.setter
    def position(self, value: np.ndarray) -> None:
        self.look_at = self.look_at + (value - self._position)
        self._position = np.asarray(value, float)

    def atomic(self) -> contextlib.nullcontext:
        return contextlib.nullcontext()


def test_turning_goes_round_the_same_place_at_the_same_height() -> None:
    camera: Any = Camera((1.0, 5.0, 7.0), (1.0, 0.0, 2.0))
    orbit(camera, "right")
    assert camera.look_at == pytest.approx((1.0, 0.0, 2.0))
    offset = camera.position - camera.look_at
    assert offset == pytest.approx((5 * math.sin(TURN), 5.0, 5 * math.cos(TURN)))
    orbit(camera, "left")
    assert camera.position == pytest.approx((1.0, 5.0, 7.0))


def test_the_camera_never_goes_below_the_ground_or_over_the_top() -> None:
    camera: Any = Camera((0.0, 5.0, 5.0), (0.0, 0.0, 0.0))
    for side, limit in (("up", ELEVATIONS[1]), ("down", ELEVATIONS[0])):
        for _ in range(20):
            orbit(camera, side)
        distance = np.linalg.norm(camera.position)
        assert math.asin(camera.position[1] / distance) == pytest.approx(limit)
        assert distance == pytest.approx(math.hypot(5, 5))


def test_zooming_in_and_out_again_changes_nothing() -> None:
    camera: Any = Camera((1.0, 5.0, 7.0), (1.0, 0.0, 2.0))
    zoom(camera, "in")
    assert camera.position == pytest.approx((1.0, 5 * ZOOM, 2 + 5 * ZOOM))
    zoom(camera, "out")
    assert camera.position == pytest.approx((1.0, 5.0, 7.0))


@pytest.mark.parametrize(
    ("side", "moved"), [("up", (0, -1.5)), ("down", (0, 1.5)), ("left", (-1.5, 0)), ("right", (1.5, 0))]
)
def test_a_map_moves_with_north_up(side: str, moved: tuple[float, float]) -> None:
    camera: Any = Camera((2.0, 13.0, 4.0), (2.0, 3.0, 4.0))
    shift(camera, side)
    assert camera.position == pytest.approx((2.0 + moved[0], 13.0, 4.0 + moved[1]))
    assert camera.look_at == pytest.approx((2.0 + moved[0], 3.0, 4.0 + moved[1]))


WORDS = catalogue_of("en")


class ButtonPage:
    """A page that keeps its buttons and keys."""

    words = WORDS

    def __init__(self) -> None:
        self.buttons: list[Any] = []
        self.keys: dict[str, Callable[[], Awaitable[None]]] = {}

    def button(self, label: str, press: Callable[[], Awaitable[None]]) -> Any:
        self.buttons.append(SimpleNamespace(label=label, color="blue", press=press))
        return self.buttons[-1]

    def hotkey(self, key: str, label: str, press: Callable[[], Awaitable[None]]) -> None:
        self.keys[key] = press


def storey_buttons(*names: str) -> tuple[StoreyButtons, ButtonPage, list[Any]]:
    """Buttons of storeys, their page, and the commands that they send."""
    sent: list[Any] = []

    async def send(command: Any) -> None:
        sent.append(command)

    page: Any = ButtonPage()
    return StoreyButtons(page, names, send), page, sent


def test_the_shown_storey_is_marked_in_words_and_the_one_with_the_mark_tells_of_it() -> None:
    buttons, page, _ = storey_buttons("basement", "ground floor", "first floor")
    buttons.show(1)
    labels = ["Show basement", "Ground floor: shown now", "Show first floor"]
    assert [button.label for button in page.buttons] == labels
    assert [button.color for button in page.buttons] == ["blue", "dark", "blue"]
    buttons.show(1, {2})
    assert page.buttons[2].label == "Show first floor: your mark is there"
    buttons.show(2, {2})
    assert [page.buttons[index].label for index in (1, 2)] == ["Show ground floor", "First floor: shown now"]


def test_pages_up_and_down_go_one_storey_and_stop_at_the_ends() -> None:
    buttons, page, sent = storey_buttons("ground floor", "first floor")
    buttons.show(0)
    asyncio.run(page.keys["pagedown"]())
    assert not sent
    asyncio.run(page.keys["pageup"]())
    assert sent == [ShowStorey(1)]
    buttons.show(1)
    asyncio.run(page.keys["pageup"]())
    asyncio.run(page.keys["pagedown"]())
    assert sent == [ShowStorey(1), ShowStorey(0)]


def test_a_home_with_one_storey_has_neither_buttons_nor_keys_of_storeys() -> None:
    buttons, page, _ = storey_buttons("ground floor")
    buttons.show(0)
    assert (page.buttons, page.keys) == ([], {})


def test_storeys_are_named_in_the_studys_habit() -> None:
    assert storey_names(WORDS, "numbers", (1, 2)) == ["storey 1 of 2", "storey 2 of 2"]
    assert storey_names(WORDS, "british", (1, 2)) == ["ground floor", "first floor"]
    assert storey_names(WORDS, "texts", (1, 2)) == ["first floor", "second floor"]
    assert storey_names(WORDS, "american", (-1, 0, 4)) == ["basement", "first floor", "floor 5"]
    assert storey_names(WORDS, "british", (-3, -2, -1)) == ["basement 3", "basement 2", "basement"]


@pytest.mark.parametrize("size", [(10.0, 2.0, 6.0), (4.0, 2.0, 20.0), (30.0, 0.0, 1.0)])
@pytest.mark.parametrize("aspect", [0.6, 1.0, 2.4])
def test_the_first_camera_has_the_whole_home_in_its_window_and_is_no_further_away(
    size: tuple[float, float, float], aspect: float
) -> None:
    fov = math.radians(75)
    distance = framing_distance(size, fov=fov, aspect=aspect)
    camera = np.array([0.0, math.sin(VIEW_ANGLE), math.cos(VIEW_ANGLE)]) * distance
    forward = -camera / distance
    up = np.array([0.0, -forward[2], forward[1]])
    places = []
    for signs in np.ndindex(2, 2, 2):
        seen = (np.array(signs) - 0.5) * size - camera
        depth = seen @ forward
        places.append([seen[0] / depth / aspect, seen @ up / depth])
    furthest = np.abs(np.array(places)).max() / math.tan(fov / 2)  # 1 = on the window's edge
    assert 0.9 < furthest < 1


def test_a_flat_square_straight_in_front_is_framed_by_hand() -> None:
    # 2 m wide and without depth: its ends are 45 degrees apart at 1 / tan(22.5) m, and the view shows 4 % more
    distance = framing_distance((2.0, 0.0, 0.0), fov=math.radians(45), aspect=1.0)
    assert distance == pytest.approx(1.04 / math.tan(math.radians(22.5)))


class WindowCamera(Camera):
    """A camera of a window with a shape."""

    fov = math.radians(75)
    image_width, image_height = 1280, 800
    up_direction: Any = None


class FlatHome(Surface):
    """A home of two storeys, 10 m wide and 2 m deep, of which nothing is drawn."""

    is_map = False

    def _floor(self, index: int) -> float:
        return 3.0 * index

    def _look_at_home(self, index: int) -> None:
        camera = self._client.camera
        distance = framing_distance((10.0, 2.0, 2.0), fov=camera.fov, aspect=window_aspect(camera))
        place_camera(camera, (0.0, self._floor(index), 0.0), (0.0, 0.0, distance))

    def _show(self, index: int) -> None: ...

    def _mark_at(self, position: Any, label: str) -> list[Any]:
        return []

    def _mark_on(self, position: Any, label: str, item: Any) -> list[Any]:
        return []


def flat_home() -> tuple[FlatHome, Any]:
    """A home in a browser, and the browser's camera."""
    camera: Any = WindowCamera((0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
    client: Any = SimpleNamespace(camera=camera, flush=lambda: None)
    return FlatHome(client), camera


def test_the_camera_goes_up_with_the_storeys_and_keeps_its_view() -> None:
    home, camera = flat_home()
    home.show_storey(0)
    zoom(camera, "in")
    before = camera.position - camera.look_at
    home.show_storey(1)
    assert camera.look_at == pytest.approx((0.0, 3.0, 0.0))
    assert camera.position - camera.look_at == pytest.approx(before)


def test_a_window_that_changes_its_shape_gets_its_own_first_look_until_somebody_has_moved() -> None:
    home, camera = flat_home()
    home.show_storey(0)
    wide = float(camera.position[2])
    camera.image_width = 640
    asyncio.run(home.camera_moved(camera))
    narrow = float(camera.position[2])
    assert narrow > 1.5 * wide
    zoom(camera, "in")
    own = camera.position.copy()
    camera.image_width = 1280
    asyncio.run(home.camera_moved(camera))
    assert camera.position == pytest.approx(own)


def test_a_window_without_height_gets_its_first_look_when_it_has_one() -> None:
    home, camera = flat_home()
    camera.image_width = camera.image_height = 0
    home.show_storey(0)
    hidden = float(camera.position[2])
    camera.image_width, camera.image_height = 640, 800
    asyncio.run(home.camera_moved(camera))
    assert float(camera.position[2]) > hidden
