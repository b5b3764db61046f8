"""A home that the server draws: small pictures while the camera moves, large ones at rest, within limits."""

import math
import threading
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from personal_viz.study_app.home import pictures
from personal_viz.study_app.home.frames import RenderThreads
from personal_viz.study_app.home.names import REST_S
from personal_viz.study_app.home.pictures import MOVING_PIXELS, RESTING_PIXELS, Painter
from sim.types import Camera


class Browser:
    """Stands for a `viser.ClientHandle`: a camera, and the pictures that were sent."""

    def __init__(self) -> None:
        self.camera = SimpleNamespace(
            wxyz=(1.0, 0.0, 0.0, 0.0),
            position=(1.0, 2.0, 3.0),
            fov=1.0,
            aspect=1.6,
            image_width=1600,
            image_height=1000,
        )
        self.sent: list[NDArray[np.uint8] | None] = []
        self.changed = threading.Condition()
        self.scene = self

    def set_background_image(self, image: NDArray[np.uint8] | None, *_: str, **__: int) -> None:
        with self.changed:
            self.sent.append(image)
            self.changed.notify_all()

    def flush(self) -> None:
        pass

    def wait_for(self, wanted: Callable[[], object]) -> None:
        with self.changed:
            assert self.changed.wait_for(wanted, timeout=30)


@pytest.fixture
def asked() -> list[tuple[int, NDArray[np.float64], Camera]]:
    """The pictures that were drawn: storey, pose, camera."""
    return []


@pytest.fixture
def browser() -> Browser:
    return Browser()


@pytest.fixture
def painter(browser: Browser, asked: list[Any]) -> Painter:
    def picture(storey: int, T: NDArray[np.float64], camera: Camera) -> NDArray[np.uint8]:
        asked.append((storey, T, camera))
        return np.zeros((camera.height, camera.width, 3), np.uint8)

    return Painter(browser, picture, RenderThreads(1))  # type: ignore[arg-type]


def size(image: NDArray[np.uint8] | None) -> int:
    return 0 if image is None else image.shape[0] * image.shape[1]


def test_a_storey_is_drawn_at_once_and_large_from_the_browsers_camera(
    painter: Painter, browser: Browser, asked: list[Any]
) -> None:
    painter.show(1)
    browser.wait_for(lambda: browser.sent)
    ((storey, T, camera),) = asked
    assert storey == 1
    assert T[:3, 3].tolist() == [1, 2, 3]
    assert T[:3, :3].tolist() == np.eye(3).tolist()
    assert camera.width / camera.height == pytest.approx(1.6, abs=0.01)
    assert size(browser.sent[0]) == pytest.approx(RESTING_PIXELS, rel=0.01)
    vfov = 2 * math.atan(math.tan(math.radians(camera.hfov_deg) / 2) * camera.height / camera.width)
    assert vfov == pytest.approx(1.0, abs=1e-6)


def test_pictures_are_small_while_the_camera_moves_and_large_when_it_rests(
    painter: Painter, browser: Browser, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [0.0]
    monkeypatch.setattr(pictures, "time", SimpleNamespace(monotonic=lambda: now[0]))
    rests: list[Callable[[], object]] = []

    class Timer:
        """A timer that ends when the test says so."""

        def __init__(self, seconds: float, call: Callable[..., object], arguments: tuple[Any, ...]) -> None:
            assert 0 <= seconds <= REST_S
            self.end = lambda: call(*arguments)

        def start(self) -> None:
            with browser.changed:
                rests.append(self.end)
                browser.changed.notify_all()

    monkeypatch.setattr(pictures, "threading", SimpleNamespace(Timer=Timer))
    painter.show(0)
    browser.wait_for(lambda: len(browser.sent) == 1)
    for move in range(1, 4):  # each is drawn at once: none waits for the camera to rest
        painter.moved()
        browser.wait_for(lambda move=move: len(browser.sent) > move)
        assert size(browser.sent[move]) <= MOVING_PIXELS * 1.01
        browser.wait_for(lambda move=move: len(rests) == move)
    now[0] = 1.0
    rests[0]()  # the camera has moved since: nothing is drawn
    assert len(browser.sent) == 4
    rests[-1]()
    browser.wait_for(lambda: size(browser.sent[-1]) > 2 * MOVING_PIXELS)


def test_nothing_is_drawn_after_the_home_is_gone_nor_twice_for_one_camera(
    painter: Painter, browser: Browser, asked: list[Any]
) -> None:
    painter.show(0)
    browser.wait_for(lambda: browser.sent)
    painter.show(None)
    painter.moved()
    assert browser.sent[-1] is None
    painter.show(1)
    browser.wait_for(lambda: browser.sent[-1] is not None)
    assert [storey for storey, _, _ in asked] == [0, 1]


@pytest.mark.parametrize("odd", [{"fov": math.nan}, {"wxyz": (0.0, 0.0, 0.0, 0.0)}, {"position": (math.inf, 0.0, 0.0)}])
def test_cameras_that_no_picture_can_have_are_left_out(
    odd: dict[str, Any], painter: Painter, browser: Browser, asked: list[Any]
) -> None:
    usual = dict(vars(browser.camera))
    vars(browser.camera).update(odd)
    painter.show(0)
    painter.show(None)
    vars(browser.camera).update(usual)
    painter.show(2)
    browser.wait_for(lambda: browser.sent[-1] is not None)
    assert {storey for storey, _, _ in asked} == {2}


@pytest.mark.parametrize("shape", [{"aspect": 1e9, "fov": 3.1}, {"aspect": 1e-9, "fov": 1e-9}])
def test_pictures_of_odd_cameras_stay_within_limits(
    shape: dict[str, float], painter: Painter, browser: Browser, asked: list[Any]
) -> None:
    vars(browser.camera).update(shape)
    painter.show(0)
    browser.wait_for(lambda: browser.sent)
    ((_, _, camera),) = asked
    assert camera.width * camera.height <= RESTING_PIXELS * 1.1
    assert 0 < camera.hfov_deg < 180


def test_a_picture_that_fails_stops_neither_the_thread_nor_the_next_one(browser: Browser) -> None:
    calls: list[int] = []

    def picture(storey: int, T: NDArray[np.float64], camera: Camera) -> NDArray[np.uint8]:
        calls.append(storey)
        if storey == 0:
            raise MemoryError
        return np.zeros((camera.height, camera.width, 3), np.uint8)

    painter = Painter(browser, picture, RenderThreads(1))  # type: ignore[arg-type]
    painter.show(0)
    painter.show(1)
    browser.wait_for(lambda: browser.sent)
    assert calls[-1] == 1
