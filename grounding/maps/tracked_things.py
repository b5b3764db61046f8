"""The things of a growing object map, and those whose views a source with ids tells apart.

Things without ids: thing_merging.py.
"""

from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sim.types import Frame

from ..perception.segments import Segments
from .storeys import points_at
from .view_quality import NEAR, distance_weight

VOXEL = 0.05
"""Points are thinned to one per cube of this side, metres."""
EVERY_PIXEL = 2
"""Every 2nd pixel of every 2nd row of a view is used."""
_AXIS = 1 << 20


@dataclass
class Thing:
    """One thing, merged over views. Mutable, because it grows."""

    points: NDArray[np.float64]
    """(P, 3) thinned."""
    feature_sum: NDArray[np.float64]
    """(E,) sum of quality times unit feature."""
    views: int
    captions: Counter[str] = field(default_factory=Counter)

    @property
    def feature(self) -> NDArray[np.float64]:
        """(E,) unit vector; zero when the encoder never gave one."""
        length = np.linalg.norm(self.feature_sum)
        return self.feature_sum / length if length > 0 else self.feature_sum


class KnownThings:
    """Things of a source that gives the same id in each view of a thing."""

    def __init__(self, *, max_depth: float) -> None:
        """Starts without things; farther returns do not count, planar metres."""
        self._max_depth = max_depth
        self._things: dict[int, Thing] = {}

    def add(self, frame: Frame, found: Segments, features: NDArray[np.float64]) -> None:
        """Adds a view; `found` has ids, and features (M, E) are unit vectors or zero."""
        coarse = _inner(found.masks[:, ::EVERY_PIXEL, ::EVERY_PIXEL])
        depth = frame.depth_m[::EVERY_PIXEL, ::EVERY_PIXEL]
        is_valid = (depth >= NEAR) & (depth <= self._max_depth)
        for index, mask in enumerate(coarse):
            rc = np.argwhere(mask & is_valid) * EVERY_PIXEL
            if not len(rc):
                continue
            points = thinned(points_at(frame, rc))
            median = np.array([np.median(frame.depth_m[rc[:, 0], rc[:, 1]])], np.float64)
            feature = float(distance_weight(median)[0]) * features[index]
            thing = self._things.get(found.ids[index])
            if thing is None:
                thing = self._things[found.ids[index]] = Thing(points, feature, 1)
            else:
                thing.points = thinned(np.concatenate([thing.points, points]))
                thing.feature_sum = thing.feature_sum + feature
                thing.views += 1
            thing.captions.update([found.captions[index]] if found.captions and found.captions[index] else [])

    def things(self) -> list[Thing]:
        """All things, in the order in which they were first seen."""
        return list(self._things.values())


def thinned(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """The mean of the points (P, 3) in each cube of VOXEL metres, in an order that depends on the places only."""
    _, inverse, counts = np.unique(cube_keys(points), return_inverse=True, return_counts=True)
    sums = [np.bincount(inverse.reshape(-1), column) for column in points.T]
    return np.column_stack(sums) / counts[:, None]


def cube_keys(points: NDArray[np.float64]) -> NDArray[np.int64]:
    """(P,) a number for the cube of VOXEL metres in which each point (P, 3) is."""
    cubes = np.floor(points / VOXEL).astype(np.int64) + _AXIS // 2
    return (cubes[:, 0] * _AXIS + cubes[:, 1]) * _AXIS + cubes[:, 2]


def _inner(masks: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Masks (M, H, W) without their outermost pixels, whose depth may be the background's; thin ones stay whole."""
    inner = masks.copy()
    inner[:, 1:] &= masks[:, :-1]
    inner[:, :-1] &= masks[:, 1:]
    inner[:, :, 1:] &= masks[:, :, :-1]
    inner[:, :, :-1] &= masks[:, :, 1:]
    is_left = np.asarray(inner.any(axis=(1, 2)))
    return np.where(is_left[:, None, None], inner, masks)
