"""VLFM's value map: how well the pictures that showed a place fitted the text, and how far that is to be trusted.

Depth, scores of one picture -> `ValueMap.add` -> value of a frontier -> the agent's choice. Only the box around the
visible cone is touched; the result is that of the whole grid.
"""

import math
from collections.abc import Sequence
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from sim.compiled import njit
from sim.types import Camera, GridSpec

Fusion = Literal["weighted", "replace", "equal_weighting"]
"""How a new score joins the map: weighted by confidence; instead of the old one; or as the mean of both."""
NEAREST, RANGE = 0.5, 5.0
"""Depth is taken as at least and at most this far, metres; no return counts as RANGE (Habitat's sensor)."""
EDGE_CONFIDENCE = 0.25
"""Confidence at the sides of the picture; it is 1 in the middle (VLFM's code)."""
DECISIVE = 0.35
"""A confidence below this does not change a cell that has more (VLFM's code)."""
VALUE_RADIUS = 0.5
"""The value of a place is the median of the seen cells within this distance, metres (VLFM's code)."""


@njit(cache=True, nogil=True)
def cone_confidence(bearing, half_fov):
    """Confidence of a cell at this bearing from the picture's middle; both in radians."""
    return EDGE_CONFIDENCE + (1 - EDGE_CONFIDENCE) * math.cos(bearing / half_fov * math.pi / 2) ** 2


@njit(cache=True, nogil=True)
def fuse(value, confidence, score, new_confidence, fusion):
    """(value, confidence) of a cell after a picture with this score; `fusion` is the index of a `Fusion`."""
    if fusion == 1:
        return (score, new_confidence) if new_confidence > 0 else (value, confidence)
    if fusion == 2:
        confidence, new_confidence = 1.0 if confidence > 0 else 0.0, 1.0 if new_confidence > 0 else 0.0
    if new_confidence < DECISIVE and new_confidence < confidence:
        new_confidence = 0.0
    total = confidence + new_confidence
    if total == 0:
        return 0.0, 0.0
    return (confidence * value + new_confidence * score) / total, (confidence**2 + new_confidence**2) / total


class ValueMap:
    """Values of C texts and their common confidence on a grid of the floor. Frame: start."""

    def __init__(self, grid: GridSpec, *, num_texts: int = 1, fusion: Fusion = "weighted") -> None:
        """Starts with nothing seen."""
        self.grid = grid
        """The grid of the cells."""
        self.values = np.zeros((*grid.shape, num_texts), np.float32)
        """(rows, cols, C) cosines, 0 where nothing was seen."""
        self.confidence = np.zeros(grid.shape, np.float32)
        """(rows, cols) in [0, 1]; a cell was seen if it is above 0. Values say nothing about that: they may be
        negative."""
        self._fusion = get_args(Fusion).index(fusion)

    def add(
        self,
        depth_m: NDArray[np.float32],
        T_start_camera: NDArray[np.float64],
        camera: Camera,
        scores: NDArray[np.floating] | Sequence[float],
    ) -> None:
        """Adds one picture's scores (C,) to the cells that it shows.

        Args:
            depth_m: (H, W) planar metres, 0 = no return.
            T_start_camera: (4, 4) pose of the camera (OpenCV axes); its tilt is ignored.
            camera: Its intrinsics; bearings are spread evenly over its columns, as in VLFM's code.
            scores: One per text.
        """
        assert depth_m.shape == (camera.height, camera.width), depth_m.shape
        assert len(scores) == self.values.shape[2], len(scores)
        u, v = self.grid.uv_from_xz(T_start_camera[[0, 2], 3])
        _fuse_cone(
            self.values,
            self.confidence,
            depth_row(depth_m),
            (float(u), float(v)),
            (float(T_start_camera[0, 0]), float(T_start_camera[2, 0])),
            self.grid.cell,
            math.radians(camera.hfov_deg) / 2,
            np.asarray(scores, np.float64),
            self._fusion,
        )

    def values_at(self, xz: NDArray[np.floating]) -> NDArray[np.float64]:
        """(N, C) values of places (N, 2): medians of the seen cells within VALUE_RADIUS, -inf where none is seen.

        Cells outside the grid do not count.
        """
        rc = self.grid.rc_from_xz(np.asarray(xz, float).reshape(-1, 2))
        return _medians(self.values, self.confidence, rc, round(VALUE_RADIUS / self.grid.cell))


def depth_row(depth_m: NDArray[np.float32]) -> NDArray[np.float32]:
    """(W,) the farthest depth of each column, metres, in [NEAREST, RANGE]; no return counts as RANGE."""
    is_hole = depth_m.min(axis=0) == 0
    return np.where(is_hole, np.float32(RANGE), np.clip(depth_m.max(axis=0), NEAREST, RANGE)).astype(np.float32)


def most_valuable(values: NDArray[np.float64], *, threshold: float) -> NDArray[np.float64]:
    """(N,) one value per frontier from those of C texts (N, C): of the first text that fits one well, else of the last.

    Args:
        values: At least one row.
        threshold: A text fits well if its best value is at least this (VLFM's `exploration_thresh`).
    """
    for text in range(values.shape[1] - 1):
        if values[:, text].max() >= threshold:
            return values[:, text]
    return values[:, -1]


@njit(cache=True, nogil=True)
def _fuse_cone(values, confidence, depth, middle, right, cell, half_fov, scores, fusion):
    """Fuses the scores (C,) into the cells of the visible cone; changes `values` and `confidence`.

    Args:
        values: (rows, cols, C).
        confidence: (rows, cols).
        depth: (W,) farthest depth of the columns, left to right.
        middle: Column and row of the camera, with fractions.
        right: (x, z) of the camera's right, a unit vector.
        cell: Metres.
        half_fov: Radians.
        scores: (C,).
        fusion: Index of a `Fusion`.
    """
    rows, cols, num_texts = values.shape
    u, v = middle
    ahead = right[1], -right[0]
    u0, u1, v0, v1 = u, u, v, v
    for k in range(-8, 9):  # the box of the cone, grown by the height of an arc between two of these directions
        along, aside = math.cos(half_fov * k / 8), math.sin(half_fov * k / 8)
        to_u = u + RANGE / cell * (along * ahead[0] + aside * right[0])
        to_v = v + RANGE / cell * (along * ahead[1] + aside * right[1])
        u0, u1, v0, v1 = min(u0, to_u), max(u1, to_u), min(v0, to_v), max(v1, to_v)
    grown = RANGE / cell * (1 - math.cos(half_fov / 16)) + 1
    deepest, is_narrow = depth.max(), half_fov < math.pi / 2
    for row in range(max(math.floor(v0 - grown), 0), min(math.ceil(v1 + grown) + 1, rows)):
        for col in range(max(math.floor(u0 - grown), 0), min(math.ceil(u1 + grown) + 1, cols)):
            dx, dz = (col + 0.5 - u) * cell, (row + 0.5 - v) * cell
            forward, aside = dx * ahead[0] + dz * ahead[1], dx * right[0] + dz * right[1]
            if forward > deepest or (is_narrow and forward < 0) or forward**2 + aside**2 > RANGE**2:
                continue  # as the lines below say too, but without the bearing
            bearing = math.atan2(aside, forward)
            if abs(bearing) > half_fov:
                continue
            at = (bearing + half_fov) / (2 * half_fov) * (len(depth) - 1)
            if forward > depth[int(at + 0.5)]:
                continue
            new_confidence = cone_confidence(bearing, half_fov)
            was = confidence[row, col]
            for text in range(num_texts):
                value, after = fuse(float(values[row, col, text]), float(was), scores[text], new_confidence, fusion)
                values[row, col, text] = value
                confidence[row, col] = after


@njit(cache=True, nogil=True)
def _medians(values, confidence, rc, reach):
    """(N, C) medians of the values of the seen cells within `reach` cells of each place (N, 2); -inf where none is."""
    rows, cols, num_texts = values.shape
    found = np.full((len(rc), num_texts), -np.inf)
    near = np.empty((num_texts, (2 * reach + 1) ** 2))
    for k in range(len(rc)):
        count, (at_row, at_col) = 0, rc[k]
        for row in range(max(at_row - reach, 0), min(at_row + reach + 1, rows)):
            for col in range(max(at_col - reach, 0), min(at_col + reach + 1, cols)):
                if (row - at_row) ** 2 + (col - at_col) ** 2 <= reach**2 and confidence[row, col] > 0:
                    near[:, count] = values[row, col]
                    count += 1
        if count:
            for text in range(num_texts):
                ordered = np.sort(near[text, :count])
                found[k, text] = (ordered[(count - 1) // 2] + ordered[count // 2]) / 2
    return found
