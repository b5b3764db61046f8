"""Chooses the few views of a walk that together show most of a home."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from sim.types import Frame

from ..maps.storeys import points_at

CUBE = 0.25
"""Side of the cubes that are counted as seen, metres."""
FARTHEST = 5.0
"""Things farther away are too small to count as seen, metres."""
_EVERY_PIXEL = 4
_AXIS = 1 << 20


def key_views(frames: Iterable[Frame], *, most: int) -> list[int]:
    """Indices of the views that show most, ascending: each in turn adds the most cubes that those before do not show.

    Args:
        frames: Views of a walk in order; only their depth counts, so small ones do.
        most: Most views; fewer come back where no other adds anything.
    """
    left = [_cubes(frame) for frame in frames]
    chosen: list[int] = []
    while len(chosen) < most and left:
        best = max(range(len(left)), key=lambda index: len(left[index]))  # the first of equals
        if not len(left[best]):
            break
        chosen.append(best)
        shown = left[best]
        left = [np.setdiff1d(cubes, shown, assume_unique=True) for cubes in left]
    return sorted(chosen)


def _cubes(frame: Frame) -> NDArray[np.int64]:
    """(N,) numbers of the cubes that a view shows, ascending, each once."""
    depth = frame.depth_m[::_EVERY_PIXEL, ::_EVERY_PIXEL]
    rc = np.argwhere((depth > 0) & (depth <= FARTHEST)) * _EVERY_PIXEL
    cubes = np.floor(points_at(frame, rc) / CUBE).astype(np.int64) + _AXIS // 2
    return np.unique((cubes[:, 0] * _AXIS + cubes[:, 1]) * _AXIS + cubes[:, 2])
