"""Things in a view from depth alone: smooth or bulging regions above the floor. No weights, no colours, no labels.

Use it where there is no segmentation model: things that touch become one where their joint is smooth, and a thing with
dents may become several. Walls and other regions larger than furniture are left out.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from sim.types import Frame

from ..maps.occupancy import MAX_DEPTH
from ..maps.storeys import points_at
from .segments import Segments

_COLUMNS = 160
"""About this many columns of a view are used, and rows with the same spacing."""
_REACH = 2
"""Normals and dents are measured over this many columns or rows to each side."""
_JUMP, _JUMP_SHARE = 0.05, 0.03
"""Largest depth difference between neighbouring pixels of one surface: metres, plus a share of the depth."""
_DENT = 0.25
"""A joint is a dent if its normals turn towards each other by more than this (cosine units)."""
_LOW, _HIGH = 0.08, 2.3
"""Things are searched between these heights above the floor, metres."""
_LEAST_PIXELS, _LARGEST = 40, 3.0
"""Least number of used pixels of a thing; greatest length of its longest side, metres."""


class DepthRegions:
    """A `ViewSegmenter` for any view with depth and known floors."""

    name = "depth regions"

    def __init__(self, *, floors: Sequence[float], max_depth: float = MAX_DEPTH) -> None:
        """Takes the heights of the storeys' floors, and the planar depth up to which returns count; metres."""
        self._floors = np.sort(np.asarray(floors, float))
        self._max_depth = max_depth

    def segment(self, frame: Frame) -> Segments:
        """One mask per region, without captions."""
        height, width = frame.depth_m.shape
        every = max(1, round(width / _COLUMNS))
        rows, cols = np.mgrid[0:height:every, 0:width:every]
        points = points_at(frame, np.column_stack([rows.ravel(), cols.ravel()])).reshape(*rows.shape, 3)
        depth = frame.depth_m[::every, ::every]
        eye = frame.T_world_camera[:3, 3]
        floor = self._floors[max(0, int(np.searchsorted(self._floors, eye[1], side="right")) - 1)]
        above = points[..., 1] - floor
        with np.errstate(invalid="ignore"):
            is_thing = (above > _LOW) & (above < _HIGH) & (depth <= self._max_depth)
        regions = ndimage.label(is_thing & ~_edges(points, depth, eye))
        labels: NDArray[np.int32] = regions[0]  # type: ignore[index]  # scipy's stubs know the other form only
        kept = [
            index
            for index in range(1, int(labels.max()) + 1)
            if (labels == index).sum() >= _LEAST_PIXELS and _size(points[labels == index]) <= _LARGEST
        ]
        coarse = labels[None] == np.array(kept, labels.dtype)[:, None, None]
        masks = coarse.repeat(every, axis=1).repeat(every, axis=2)[:, :height, :width]
        return Segments(masks)


def depth_jump(depth: NDArray[np.float32]) -> NDArray[np.float32]:
    """Largest difference of depth, metres, from pixels of this depth to neighbours on the same surface."""
    return _JUMP + _JUMP_SHARE * depth


def _size(points: NDArray[np.float64]) -> float:
    return float(np.ptp(points, axis=0).max())


def _edges(points: NDArray[np.float64], depth: NDArray[np.float32], eye: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(h, w) where a surface ends, or meets another one in a dent."""
    jump = depth_jump(depth)
    normals = _normals(points, eye)
    edges = np.zeros(depth.shape, bool)
    for axis in (0, 1):
        step = np.abs(np.diff(depth, axis=axis))
        both = np.minimum(*_pairs(jump, axis, 1))
        is_cut = step > both
        before, after = _slices(axis, 1)
        edges[before] |= is_cut
        edges[after] |= is_cut
        first, second = _pairs(points, axis, 2 * _REACH)
        first_n, second_n = _pairs(normals, axis, 2 * _REACH)
        apart = second - first
        length = np.linalg.norm(apart, axis=-1)
        with np.errstate(invalid="ignore", divide="ignore"):
            bulge = ((second_n - first_n) * apart).sum(axis=-1) / length
            middle = tuple(slice(_REACH, -_REACH) if this == axis else slice(None) for this in range(2))
            edges[middle] |= bulge < -_DENT
    return edges


def _normals(points: NDArray[np.float64], eye: NDArray[np.float64]) -> NDArray[np.float64]:
    """(h, w, 3) unit normals towards the camera; nan beside missing depth."""
    down = np.gradient(points, axis=0)
    right = np.gradient(points, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        normals = np.cross(down, right)
        normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
        away = (normals * (points - eye)).sum(axis=-1, keepdims=True) > 0
    return np.where(away, -normals, normals)


def _pairs(values: NDArray, axis: int, apart: int) -> tuple[NDArray, NDArray]:
    """Views of the values that are `apart` places before and after each other along an axis."""
    before, after = _slices(axis, apart)
    return values[before], values[after]


def _slices(axis: int, apart: int) -> tuple[tuple[slice, ...], tuple[slice, ...]]:
    whole = [slice(None)] * 2
    before, after = list(whole), list(whole)
    before[axis], after[axis] = slice(None, -apart), slice(apart, None)
    return tuple(before), tuple(after)
