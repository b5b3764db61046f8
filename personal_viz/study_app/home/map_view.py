"""A storey's picture from above in a participant's 3-D view: it lies on the storey's floor, so a click is a place.

The browser sends the ray of a click. The place is the point where the ray meets the floor's plane, exact to the
rounding of the browser's numbers, at any zoom, pixel density or camera angle.
"""

import math

import numpy as np
import viser

from human_study.trial.commands import Click
from sim.tasks.run_files import ClickRay, Vector3

from .scene_view import MARK_COLOR
from .top_view import TopView

JPEG_QUALITY = 90
_FIT = 1.04
"""The first view shows this many times the picture's size."""
_ABOVE = 0.02
"""Height of the mark over the picture (metres)."""
_QUAT_WXYZ_LYING = (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)
"""Turns viser's upright pictures (right = x, down = y) onto the floor: right = +x, down = +z."""


class MapView:
    """The maps in one browser; a `Surface` of screens/pog.py."""

    advice = "Scroll to zoom, right-drag to move."
    is_map = True

    def __init__(self, client: viser.ClientHandle, maps: tuple[TopView, ...]) -> None:
        """Shows nothing yet."""
        self._client, self._maps = client, maps
        self._picture: viser.ImageHandle | None = None
        self._mark: list = []

    def show_storey(self, index: int, *, move_camera: bool = True) -> None:
        """Shows one storey's picture and, unless told otherwise, looks straight down at all of it."""
        self.remove()
        view, rgb = self._maps[index], self._maps[index].rgb()
        width, height = (side * view.grid.cell for side in (rgb.shape[1], rgb.shape[0]))
        x, z = view.grid.origin_xz
        centre = np.array([x + width / 2, view.floor_y, z + height / 2])
        self._picture = self._client.scene.add_image(
            "/map",
            rgb,
            width,
            height,
            format="jpeg",
            jpeg_quality=JPEG_QUALITY,
            cast_shadow=False,
            receive_shadow=False,
            wxyz=_QUAT_WXYZ_LYING,
            position=centre,
        )
        if move_camera:
            self._look_down(centre, width, height)
        self._client.flush()

    def show_mark(self, position: Vector3) -> None:
        """Puts the participant's mark on the picture: a ring with a dot, large enough to see, small enough to aim."""
        for node in self._mark:
            node.remove()
        x, y, z = position
        ring = np.array([[math.cos(a), 0.0, math.sin(a)] for a in np.linspace(0, 2 * math.pi, 49)]) * 0.3
        segments = np.stack([ring[:-1], ring[1:]], axis=1) + np.array([x, y + _ABOVE, z])
        self._mark = [
            self._client.scene.add_line_segments("/mark/ring", segments, MARK_COLOR, thickness=0.05),
            self._client.scene.add_icosphere("/mark/dot", radius=0.06, color=MARK_COLOR, position=(x, y + _ABOVE, z)),
            self._client.scene.add_label("/mark/label", "your mark", position=(x, y + 0.05, z - 0.45)),
        ]
        self._client.flush()

    def remove(self) -> None:
        """Removes picture and mark."""
        for node in (self._picture, *self._mark):
            if node is not None:
                node.remove()
        self._picture, self._mark = None, []

    def _look_down(self, centre: np.ndarray, width: float, height: float) -> None:
        camera = self._client.camera
        distance = _FIT * max(height, width / max(camera.aspect, 0.1)) / 2 / math.tan(camera.fov / 2)
        with self._client.atomic():
            camera.up_direction = (0.0, 0.0, -1.0)
            camera.position = centre + np.array([0.0, distance, 0.0])
            camera.look_at = centre


def map_click(view: TopView, ray: ClickRay) -> Click:
    """The click of a ray on a storey's picture: the hit is the place of its pixel, on the storey's floor.

    Args:
        view: The picture of the shown storey.
        ray: The ray from the browser; its `storey_y` must be the storey's.

    Returns:
        A click that hit nothing where the ray goes past the picture, or to the strip below it.
    """
    assert ray.storey_y == view.floor_y, (ray.storey_y, view.floor_y)
    down = ray.origin[1] - view.floor_y
    if ray.direction[1] * down >= 0:
        return Click(ray, None)
    t = -down / ray.direction[1]
    pixel = view.pixel_at((ray.origin[0] + t * ray.direction[0], ray.origin[2] + t * ray.direction[2]))
    return Click(ray, None if pixel is None else pixel.point(view.floor_y), pixel)
