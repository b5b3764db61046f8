"""Small pictures of the way, and the one that shows a place best.

Views of an episode -> `KeptViews` -> a crop towards each frontier for the question to a chat model.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from sim.types import Frame

_WIDTH = 320
"""Pictures are kept at this width in pixels, at most."""
_HEIGHT_ABOVE = 0.3
"""A place on the floor is looked for this high above it, metres."""
_BEST_DISTANCE = 2.5
"""Distance from which a picture shows a place and the space around it best, metres."""
_HIDDEN = 0.4
"""A place is hidden if the picture's depth ends this far before it, metres."""
_SIDE_SHARE = 0.1
"""A place in the outer parts of a picture, this share of its width, counts as out of view."""


class _View(NamedTuple):
    rgb: NDArray[np.uint8]
    """(h, w, 3)."""
    depth_m: NDArray[np.float32]
    """(h, w) planar, 0 = no return."""
    T_camera_start: NDArray[np.float64]
    """(4, 4)."""
    lens: tuple[float, float, float, float]
    """Focal lengths and principal point of the small picture, pixels."""


class KeptViews:
    """The pictures of an episode so far. Frame: start."""

    def __init__(self) -> None:
        """Starts empty."""
        self._views: list[_View] = []

    def see(self, frame: Frame) -> None:
        """Keeps a view."""
        height, width = frame.depth_m.shape
        scale = min(1.0, _WIDTH / width)
        size = (max(1, round(width * scale)), max(1, round(height * scale)))
        rows = ((np.arange(size[1]) + 0.5) * height / size[1]).astype(int)
        cols = ((np.arange(size[0]) + 0.5) * width / size[0]).astype(int)
        fx, fy, cx, cy = frame.camera.lens
        along, down = size[0] / width, size[1] / height
        self._views.append(
            _View(
                np.asarray(Image.fromarray(frame.rgb).resize(size, Image.Resampling.BOX)),
                frame.depth_m[np.ix_(rows, cols)],
                np.linalg.inv(frame.T_world_camera).astype(np.float64),
                (fx * along, fy * down, cx * along, cy * down),
            )
        )

    def towards(self, xz: tuple[float, float], *, floor_y: float) -> NDArray[np.uint8] | None:
        """(h, h, 3) the part of the picture that shows a place on the floor best; None if none shows it.

        Best is near the picture's middle and near _BEST_DISTANCE; the latest among equals.
        """
        place = np.array([xz[0], floor_y + _HEIGHT_ABOVE, xz[1], 1.0])
        best: tuple[float, int, float] | None = None
        for index, view in enumerate(self._views):
            seen = _seen(view, place)
            if seen is not None and (best is None or seen[0] <= best[0]):
                best = (seen[0], index, seen[1])
        if best is None:
            return None
        rgb = self._views[best[1]].rgb
        height, width = rgb.shape[:2]
        first = round(min(max(best[2] - height / 2, 0), max(width - height, 0)))
        return rgb[:, first : first + height]


def _seen(view: _View, place: NDArray[np.float64]) -> tuple[float, float] | None:
    """How badly a view shows a place, and the column of the place; None if it is out of view or hidden."""
    x, y, z, _ = (view.T_camera_start @ place).tolist()
    if z <= 0.1:
        return None
    fx, fy, cx, cy = view.lens
    height, width = view.depth_m.shape
    u, v = fx * x / z + cx, fy * y / z + cy
    if not _SIDE_SHARE * width <= u < (1 - _SIDE_SHARE) * width:
        return None
    depth = float(view.depth_m[min(max(int(v), 0), height - 1), int(u)])
    if 0 < depth < z - _HIDDEN and v < height:
        return None
    return abs(u - cx) / width + abs(math.hypot(x, z) - _BEST_DISTANCE) / _BEST_DISTANCE / 2, u
