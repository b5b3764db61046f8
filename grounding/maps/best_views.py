"""Finds the pictures of a recording or a walk that see a point best, so that people can look at an answer."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from sim.episodes.schema import Vector3
from sim.types import Camera, Frame

_NEAR, _BEST, _FAR = 0.5, 2.0, 6.0
"""Planar depth (metres) at which a thing is still in a picture, at which it is seen best, and at which it is small."""
_MOST_LOADED = 60
"""Pictures that are opened to see whether something stands before the point."""
_HIDDEN = 0.3
"""A surface this much nearer than the point (metres) hides it; a point inside a thing lies behind its surface."""
_AROUND = 2
"""Depth is the median over this many pixels to each side."""
_APART, _TURNED = 0.5, np.cos(np.radians(25))
"""Two pictures show different sides if their cameras are this far apart (metres), or turned by more than this angle."""


class PosedView(Protocol):
    """A picture that is loaded, or rendered, when it is needed."""

    @property
    def T_map_camera(self) -> NDArray[np.float64]:
        """(4, 4) camera (OpenCV axes) in the map frame."""
        ...

    @property
    def camera(self) -> Camera:
        """Its camera."""
        ...

    def load(self) -> Frame | None:
        """The picture with its depth; None if it cannot be read."""
        ...


@runtime_checkable
class DepthFirstView(PosedView, Protocol):
    """A picture whose depth can be loaded without its colours, which are slow to find in a video."""

    def load_depth(self) -> NDArray[np.float32] | None:
        """(H, W) the depth of `load`; None if it cannot be read."""
        ...


@dataclass(frozen=True, slots=True)
class Sight:
    """A picture that sees a point."""

    frame: Frame
    uv: tuple[float, float]
    """Where the point is in it: pixels from the left and from the top."""


def best_views(views: Sequence[PosedView], point: Vector3, *, count: int = 3) -> list[Sight]:
    """At most `count` pictures that see a point (map frame), best first, from different places where there are any.

    A picture is better the nearer the point is to its middle and to 2 m of depth. Where a surface stands before the
    point, the picture does not see it. Where depth can be loaded alone, colours are loaded for chosen pictures only.
    """
    found: list[Sight] = []
    ranks = [_rank(view, point) for view in views]
    order = [index for index in np.argsort(ranks)[::-1].tolist() if ranks[index] > 0][:_MOST_LOADED]
    for index in order:
        if len(found) == count:
            break
        if any(_are_alike(views[index].T_map_camera, sight.frame.T_world_camera) for sight in found):
            continue
        if (sight := _sight(views[index], point)) is not None:
            found.append(sight)
    return found


def _rank(view: PosedView, point: Vector3) -> float:
    """How well a picture would show the point if nothing stood before it; 0 = not at all."""
    u, v, depth = _pixel(view.T_map_camera, view.camera, point)
    width, height = view.camera.width, view.camera.height
    if not (_NEAR < depth < _FAR and 0 <= u < width and 0 <= v < height):
        return 0.0
    aside = max(abs(2 * u / width - 1), abs(2 * v / height - 1))
    return (1 - 0.8 * aside) * min(depth / _BEST, _BEST / depth)


def _sight(view: PosedView, point: Vector3) -> Sight | None:
    """The picture with the point's pixel; None if a surface hides the point, or the picture cannot be read."""
    u, v, depth = _pixel(view.T_map_camera, view.camera, point)
    if isinstance(view, DepthFirstView):
        depth_m = view.load_depth()
        if depth_m is None or _is_hidden(depth_m, int(u), int(v), depth):
            return None
        frame = view.load()
        return None if frame is None else Sight(frame, (u, v))
    frame = view.load()
    return None if frame is None or _is_hidden(frame.depth_m, int(u), int(v), depth) else Sight(frame, (u, v))


def _is_hidden(depth_m: NDArray[np.float32], col: int, row: int, depth: float) -> bool:
    """Whether a surface stands before a point at this pixel and planar depth."""
    near = depth_m[max(0, row - _AROUND) : row + _AROUND + 1, max(0, col - _AROUND) : col + _AROUND + 1]
    known = near[near > 0]
    return len(known) > 0 and float(np.median(known)) < depth - _HIDDEN


def _pixel(T_map_camera: NDArray[np.float64], camera: Camera, point: Vector3) -> tuple[float, float, float]:
    """Pixels from the left and the top, and the planar depth, of a point; the depth is negative behind the camera."""
    x, y, depth = ((np.asarray(point) - T_map_camera[:3, 3]) @ T_map_camera[:3, :3]).tolist()
    if depth <= 0:
        return -1.0, -1.0, depth
    fx, fy, cx, cy = camera.lens
    return fx * x / depth + cx, fy * y / depth + cy, depth


def _are_alike(T: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
    is_near = float(np.linalg.norm(T[:3, 3] - other[:3, 3])) < _APART
    return is_near and float(T[:3, 2] @ other[:3, 2]) > _TURNED
