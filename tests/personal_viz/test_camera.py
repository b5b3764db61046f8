"""Looking around without a mouse: what each press does to the camera."""

import contextlib
import math
from typing import Any

import numpy as np
import pytest

from personal_viz.study_app.screens.camera import ELEVATIONS, TURN, ZOOM, orbit, shift, zoom


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
