"""A home that the browser never gets: the server draws it from the browser's camera, as the background of the scene.

The browser's camera moves -> `Painter` draws on a render thread, small while the camera moves, large when it rests -> a
JPEG behind everything that viser draws (the mark, category names). viser's own controls turn and zoom, so a click comes
back as the ray of its pixel, as from a home in the browser.
"""

import math
import threading
import time
from collections.abc import Callable

import numpy as np
import viser
import viser.transforms
from numpy.typing import NDArray

from sim.render.renderer import JPEG_QUALITY
from sim.tasks.pog import PogScene
from sim.types import Camera

from .frames import RenderThreads
from .names import REST_S, NamesOf
from .surfaces import HomeSurface, StoreyCopies

MOVING_PIXELS, RESTING_PIXELS = 320 * 240, 1280 * 960
"""Most pixels of a picture while the camera moves, and when it rests."""
_VFOV, _ASPECT = (math.radians(10), math.radians(120)), (0.2, 5.0)
"""Least and largest field of view and width over height of a picture; a browser may ask for anything."""
_SIDES = (16, 4096)


class PictureView(HomeSurface):
    """A home as pictures that the server makes."""

    def __init__(
        self,
        client: viser.ClientHandle,
        copies: StoreyCopies,
        names_of: NamesOf,
        *,
        pog_scene: PogScene,
        threads: RenderThreads,
    ) -> None:
        """Shows nothing yet."""
        super().__init__(client, copies, names_of)
        self._painter = Painter(client, pog_scene.picture, threads)

    async def camera_moved(self, camera: viser.CameraHandle) -> None:
        """Draws the home anew, and lays out the names."""
        self._painter.moved()
        await super().camera_moved(camera)

    def remove(self) -> None:
        """Takes everything out of the browser."""
        super().remove()
        self._painter.show(None)

    def _show_home(self, index: int) -> None:
        self._painter.show(index)


class Painter:
    """Draws one browser's background whenever its camera or the storey has changed; one picture at a time."""

    def __init__(
        self,
        client: viser.ClientHandle,
        picture: Callable[[int, NDArray[np.float64], Camera], NDArray[np.uint8]],
        threads: RenderThreads,
    ) -> None:
        """Draws nothing before `show`.

        Args:
            client: The browser.
            picture: Draws a storey from a camera at a pose (4, 4; OpenCV axes).
            threads: The threads that draw.
        """
        self._client, self._picture, self._threads = client, picture, threads
        self._lock = threading.Lock()
        self._storey: int | None = None
        self._wanted = 0
        """Number of the newest change."""
        self._moved_s = -math.inf
        self._is_busy = False

    def show(self, storey: int | None) -> None:
        """Shows a storey, at full size; None = nothing, at once."""
        with self._lock:
            self._storey = storey
            self._moved_s = -math.inf
            self._change()
        if storey is None:
            self._client.scene.set_background_image(None)

    def moved(self) -> None:
        """Draws again, because the camera has moved."""
        with self._lock:
            self._moved_s = time.monotonic()
            self._change()

    def _change(self) -> None:
        """Notes a change; called with the lock held."""
        self._wanted += 1
        self._begin()

    def _begin(self) -> None:
        """Draws as soon as a thread is free, unless a picture is being drawn; called with the lock held."""
        if not self._is_busy and self._storey is not None:
            self._is_busy = True
            self._threads.run(self._draw)

    def _rested(self, number: int) -> None:
        """Draws at full size if nothing has changed since."""
        with self._lock:
            if self._wanted == number:
                self._begin()

    def _draw(self) -> None:
        """Draws the newest change; later ones follow, and full size when the camera rests."""
        with self._lock:
            storey, number = self._storey, self._wanted
            is_moving = time.monotonic() - self._moved_s < REST_S
        try:
            seen = _camera_of(self._client.camera, MOVING_PIXELS if is_moving else RESTING_PIXELS)
            if storey is not None and seen is not None:
                rgb = self._picture(storey, *seen)
                if self._storey == storey:  # otherwise the browser has something else to show by now
                    self._client.scene.set_background_image(rgb, "jpeg", jpeg_quality=JPEG_QUALITY)
                    self._client.flush()
                if self._storey is None:  # it was taken away meanwhile
                    self._client.scene.set_background_image(None)
        finally:
            with self._lock:
                self._is_busy = False
                if self._wanted != number:
                    self._begin()
                elif is_moving:
                    left_s = max(0.0, self._moved_s + REST_S - time.monotonic())
                    timer = threading.Timer(left_s, self._rested, (number,))
                    timer.daemon = True
                    timer.start()


def _camera_of(handle: viser.CameraHandle, most: int) -> tuple[NDArray[np.float64], Camera] | None:
    """Pose and camera of a picture that fills the browser's canvas, with at most so many pixels; None = not usable."""
    wxyz, position = np.asarray(handle.wxyz, float), np.asarray(handle.position, float)
    numbers = np.array([*wxyz, *position, handle.fov, handle.aspect], float)
    if not np.isfinite(numbers).all() or not np.any(wxyz):
        return None
    vfov = min(max(float(handle.fov), _VFOV[0]), _VFOV[1])
    aspect = min(max(float(handle.aspect), _ASPECT[0]), _ASPECT[1])
    own = max(handle.image_width, 1) * max(handle.image_height, 1)
    height = math.sqrt(min(most, own) / aspect)
    width, height = (min(max(round(side), _SIDES[0]), _SIDES[1]) for side in (aspect * height, height))
    T = np.eye(4)
    T[:3, :3] = viser.transforms.SO3(wxyz / np.linalg.norm(wxyz)).as_matrix()
    T[:3, 3] = position
    hfov = 2 * math.atan(math.tan(vfov / 2) * width / height)
    return T, Camera(width, height, math.degrees(hfov))
