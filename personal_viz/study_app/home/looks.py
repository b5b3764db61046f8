"""Where a browser looks: at all of a home from above at first, as closely as its window allows."""

import math
from collections.abc import Callable, Sequence

import numpy as np
import viser
from numpy.typing import NDArray

VIEW_ANGLE = math.radians(55)
"""Elevation from which a storey is first shown."""
FIT = 1.04
"""The first view shows this many times the size of the home or its map."""
BOX_CORNERS = np.array([(x, y, z) for y in (-1, 1) for x, z in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
"""(8, 3) signs of a box's corners, the lower four first."""
_FROM_ABOVE = np.array([0.0, math.sin(VIEW_ANGLE), math.cos(VIEW_ANGLE)])
"""Direction from a storey to its first camera."""
_SAME_SHAPE = 1e-3
"""Windows whose width over height differs by less have the same shape."""
_UNMOVED = 1e-3
"""A camera that is nearer to its first place has not been moved (metres)."""


class FirstLook:
    """The look that a browser has until somebody moves its camera.

    A window tells its shape late: the panel docks after the page was opened. Then the look is taken anew, but never
    over somebody's own view.
    """

    def __init__(self, camera: viser.CameraHandle, look: Callable[[], None]) -> None:
        """Takes the look.

        Args:
            camera: The browser's camera.
            look: Places the camera for the window's present shape.
        """
        self._camera, self._look = camera, look
        self._take()

    def renew(self) -> bool:
        """Takes the look anew if the window's shape has changed and nobody has moved the camera; whether it did."""
        has_changed = abs(window_aspect(self._camera) - self._aspect) > _SAME_SHAPE
        if has_changed and np.allclose(self._camera.position, self._position, atol=_UNMOVED):
            self._take()
            return True
        return False

    def _take(self) -> None:
        self._look()
        self._aspect = window_aspect(self._camera)
        self._position = np.array(self._camera.position, float)


def window_aspect(camera: viser.CameraHandle) -> float:
    """A window's width over its height, at least 0.1; 1 while it has no height, as a page that is not laid out yet."""
    return max(0.1, camera.image_width / camera.image_height) if camera.image_height > 0 else 1.0


def framing_distance(size: Sequence[float] | NDArray[np.float64], *, fov: float, aspect: float) -> float:
    """Least distance from the middle of a box at which a camera VIEW_ANGLE above it has the whole box in its window.

    Args:
        size: Sides of the box along x, y, z, metres; the camera looks along -z and down.
        fov: The window's vertical field of view, radians.
        aspect: The window's width over its height.
    """
    corners = BOX_CORNERS * np.asarray(size, float) / 2
    up = np.array([0.0, _FROM_ABOVE[2], -_FROM_ABOVE[1]])
    vertical = math.tan(fov / 2)
    beside = np.maximum(np.abs(corners[:, 0]) / (vertical * aspect), np.abs(corners @ up) / vertical)
    return float(FIT * (corners @ _FROM_ABOVE + beside).max())


def look_from_above(camera: viser.CameraHandle, low: NDArray[np.float64], high: NDArray[np.float64]) -> None:
    """Makes a browser look at all of a box between two corners (3,), world metres, from VIEW_ANGLE above."""
    distance = framing_distance(high - low, fov=camera.fov, aspect=window_aspect(camera))
    place_camera(camera, (low + high) / 2, distance * _FROM_ABOVE, up=(0.0, 1.0, 0.0))


def place_camera(
    camera: viser.CameraHandle,
    centre: Sequence[float] | NDArray[np.float64],
    offset: Sequence[float] | NDArray[np.float64],
    *,
    up: tuple[float, float, float] | None = None,
) -> None:
    """Makes a browser look at a point.

    Args:
        camera: The browser's camera.
        centre: The point (3,), world metres.
        offset: The way (3,) from the point to the camera.
        up: The new up direction; None keeps the old one.
    """
    with camera.client.atomic():
        if up is not None:
            camera.up_direction = up
        camera.position = np.asarray(centre, float) + np.asarray(offset, float)
        camera.look_at = np.asarray(centre, float)
