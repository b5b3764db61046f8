"""The maps of VLFM and OneMap in their literal forms, for comparison only: numpy over whole grids and whole pictures.

The benchmark of agents measures them beside `grounding.agents`, and requires the same maps.
"""

import math
from collections.abc import Iterator

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import ndimage

from grounding.agents.onemap.confidence import observation_confidence
from grounding.agents.onemap.feature_grid import START_CONFIDENCE, START_REACH
from grounding.agents.onemap.projection import cells_of_pixels
from grounding.agents.vlfm.explored import (
    LEAST_ISLAND,
    OBSTACLE_HIGH,
    OBSTACLE_LOW,
    OBSTACLE_REACH,
    frontier_midpoints,
)
from grounding.agents.vlfm.value_map import DECISIVE, EDGE_CONFIDENCE, NEAREST, RANGE, VALUE_RADIUS
from sim.types import Frame, GridSpec

_EIGHT = np.ones((3, 3))
_EVERY, _LEAVE = 2, 0.25
"""Which pixels show obstacles, and where rays begin near one (metres): as in `explored.py`."""
_BAND = 32
"""Rows of pixels whose vectors are held at once: those of a whole picture take 0.9 GB."""


class LiteralValues:
    """VLFM's maps; every view changes, widens and searches the whole grid."""

    def __init__(self, grid: GridSpec) -> None:
        """Starts with nothing seen."""
        self.grid = grid
        self.obstacles, self.blocked, self.explored = (np.zeros(grid.shape, bool) for _ in range(3))
        """(rows, cols)."""
        self.values, self.confidence = np.zeros(grid.shape, np.float32), np.zeros(grid.shape, np.float32)
        """(rows, cols)."""
        self.frontiers = np.zeros((0, 2))
        """(N, 2) (x, z), metres."""

    def add(self, frame: Frame, score: float) -> None:
        """Adds a view on a floor at height 0, and finds the frontiers and their values."""
        u, v = self.grid.uv_from_xz(frame.T_world_camera[[0, 2], 3]).tolist()
        self._mark_obstacles(frame)
        self._lift_fog(frame, u, v)
        least_cells = round(LEAST_ISLAND / self.grid.cell**2)
        self.frontiers = self.grid.xz_from_uv(frontier_midpoints(self.explored, ~self.blocked, least_cells=least_cells))
        self._fuse(frame, u, v, score)
        for xz in self.frontiers:
            self._value_at(xz)

    def _mark_obstacles(self, frame: Frame) -> None:
        depth = frame.depth_m[::_EVERY, ::_EVERY].astype(np.float64)
        fx, fy, cx, cy = frame.camera.lens
        right = ((np.arange(0, frame.camera.width, _EVERY) + 0.5 - cx) / fx)[None]
        down = ((np.arange(0, frame.camera.height, _EVERY) + 0.5 - cy) / fy)[:, None]
        R, t = frame.T_world_camera[:3, :3], frame.T_world_camera[:3, 3]
        u, v = self.grid.uv_from_xz(t[[0, 2]])
        heights = t[1] + depth * (R[1, 0] * right + R[1, 1] * down + R[1, 2])
        shown = (depth > 0) & (depth < RANGE) & (heights >= OBSTACLE_LOW) & (heights <= OBSTACLE_HIGH)
        cols = np.floor(u + depth * (R[0, 0] * right + R[0, 1] * down + R[0, 2]) / self.grid.cell)[shown]
        rows = np.floor(v + depth * (R[2, 0] * right + R[2, 1] * down + R[2, 2]) / self.grid.cell)[shown]
        rc = np.column_stack([rows, cols]).astype(np.int64)
        rc = rc[self.grid.contains(rc)]
        self.obstacles[rc[:, 0], rc[:, 1]] = True
        self.blocked = ndimage.maximum_filter(self.obstacles.view(np.uint8), 2 * OBSTACLE_REACH + 1) > 0

    def _lift_fog(self, frame: Frame, u: float, v: float) -> None:
        cell, fov = self.grid.cell, math.radians(frame.camera.hfov_deg)
        T = frame.T_world_camera
        heading = math.atan2(T[2, 0], T[0, 0])
        num_rays, half_cells = math.ceil(2 * fov * RANGE / cell) + 1, 0.5 * np.arange(int(2 * RANGE / cell) + 1)
        angles = [heading - math.pi / 2 + fov * (ray / (num_rays - 1) - 0.5) for ray in range(num_rays)]
        rows = np.floor(v + half_cells * np.array([[math.sin(angle)] for angle in angles])).astype(np.int64)
        cols = np.floor(u + half_cells * np.array([[math.cos(angle)] for angle in angles])).astype(np.int64)
        is_outside = ~self.grid.contains(np.stack([rows, cols], axis=-1))
        rows, cols = rows.clip(0, self.grid.shape[0] - 1), cols.clip(0, self.grid.shape[1] - 1)
        is_blocked = self.blocked[rows, cols] & ~is_outside
        is_open = ~is_blocked & ~is_outside
        has_left = np.cumsum(is_open, axis=1) - is_open > 0
        is_over = np.logical_or.accumulate(
            is_outside | (is_blocked & (has_left | (half_cells * cell > _LEAVE))), axis=1
        )
        fog = np.zeros(self.grid.shape, np.uint8)
        fog[rows[is_open & ~is_over], cols[is_open & ~is_over]] = 1
        explored = (self.explored | (ndimage.maximum_filter(fog, 3, mode="constant") > 0)) & ~self.blocked
        labels = np.asarray(ndimage.label(explored, structure=_EIGHT)[0])  # type: ignore[index]
        cells = np.argwhere(explored)
        if len(cells):
            away = (cells[:, 0] + 0.5 - v) ** 2 + (cells[:, 1] + 0.5 - u) ** 2
            explored = labels == labels[tuple(cells[away.argmin()])]
        self.explored = explored

    def _fuse(self, frame: Frame, u: float, v: float, score: float) -> None:
        depth, T, cell = frame.depth_m, frame.T_world_camera, self.grid.cell
        farthest = np.where((depth == 0).any(axis=0), RANGE, np.clip(depth.max(axis=0), NEAREST, RANGE))
        half, reach = math.radians(frame.camera.hfov_deg) / 2, math.ceil(RANGE / cell) + 1
        rows = np.arange(max(int(v) - reach, 0), min(int(v) + reach + 1, self.grid.shape[0]))
        cols = np.arange(max(int(u) - reach, 0), min(int(u) + reach + 1, self.grid.shape[1]))
        dx, dz = ((cols + 0.5 - u) * cell)[None], ((rows + 0.5 - v) * cell)[:, None]
        forward, aside = dx * T[2, 0] - dz * T[0, 0], dx * T[0, 0] + dz * T[2, 0]
        bearing = np.arctan2(aside, forward)
        at = ((bearing + half) / (2 * half) * (len(farthest) - 1) + 0.5).clip(0, len(farthest) - 1).astype(np.int64)
        is_shown = (forward**2 + aside**2 <= RANGE**2) & (np.abs(bearing) <= half) & (forward <= farthest[at])
        cone = EDGE_CONFIDENCE + (1 - EDGE_CONFIDENCE) * np.cos(bearing / half * math.pi / 2) ** 2
        new = np.zeros(self.grid.shape)
        new[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1] = np.where(is_shown, cone, 0.0)
        new[(new < DECISIVE) & (new < self.confidence)] = 0
        total = self.confidence + new
        with np.errstate(invalid="ignore"):
            values = np.nan_to_num((self.confidence * self.values + new * score) / total)
            confidence = np.nan_to_num((self.confidence.astype(np.float64) ** 2 + new**2) / total)
        self.values, self.confidence = values.astype(np.float32), confidence.astype(np.float32)

    def _value_at(self, xz: NDArray[np.float64]) -> float:
        row, col = self.grid.rc_from_xz(xz).tolist()
        reach = round(VALUE_RADIUS / self.grid.cell)
        first_row, first_col = max(row - reach, 0), max(col - reach, 0)
        part = np.s_[first_row : row + reach + 1, first_col : col + reach + 1]
        rows, cols = np.ogrid[part]
        is_near = (rows - row) ** 2 + (cols - col) ** 2 <= reach**2
        values, confidence = self.values[part], self.confidence[part]
        seen = values[is_near[: len(values), : values.shape[1]] & (confidence > 0)]
        return float(np.median(seen)) if len(seen) else -math.inf


class LiteralFeatures:
    """OneMap's map; every pixel gets a vector, resized from the patches, and cells average those of their pixels."""

    def __init__(self, grid: GridSpec, *, dim: int) -> None:
        """Starts with nothing seen."""
        self.grid = grid
        num_cells = grid.shape[0] * grid.shape[1]
        self.features = np.zeros((num_cells, dim), np.float32)  # memory is taken only for rows that are written
        """(cells, E) mean features."""
        self.confidence = np.zeros(num_cells, np.float32)
        """(cells,)."""

    def add(self, frame: Frame, patches: NDArray[np.float32]) -> None:
        """Adds a view with its patches (h, w, E)."""
        is_first = not self.confidence.any()
        confidence = observation_confidence(frame.depth_m, frame.camera.lens)
        cells, _ = cells_of_pixels(frame.depth_m, confidence, frame.T_world_camera, frame.camera, self.grid)
        touched, index = np.unique(cells, return_inverse=True)
        index, weights = torch.from_numpy(index.ravel()), torch.from_numpy(confidence.ravel())
        sums = torch.zeros((len(touched), patches.shape[-1]))
        for first, vectors in _pixel_vectors(patches, *frame.depth_m.shape):
            part = slice(first * frame.camera.width, first * frame.camera.width + len(vectors))
            sums.index_add_(0, index[part], vectors * weights[part, None])
        total = torch.zeros(len(touched)).index_add_(0, index, weights).numpy()
        count = np.bincount(index.numpy(), minlength=len(touched))
        is_cell = touched >= 0
        own, new = touched[is_cell], (total / count)[is_cell]
        seen = sums.numpy()[is_cell] / total[is_cell, None]
        old = self.confidence[own]
        share = (new / (old + new))[:, None]
        self.features[own] += share * (seen - self.features[own])
        self.confidence[own] = old + new
        if is_first:
            row, col = self.grid.rc_from_xz(frame.T_world_camera[[0, 2], 3]).tolist()
            around = self.confidence.reshape(self.grid.shape)
            around[row - START_REACH : row + START_REACH, col - START_REACH : col + START_REACH] += START_CONFIDENCE


def _pixel_vectors(patches: NDArray[np.float32], height: int, width: int) -> Iterator[tuple[int, torch.Tensor]]:
    """First row, and vectors (rows * width, E) of its pixels and those of the rows below, band by band."""
    image = torch.from_numpy(patches).permute(2, 0, 1)[None]
    rows = len(patches)
    wide = torch.nn.functional.interpolate(image, size=(rows, width), mode="bilinear", align_corners=False)[0]
    v = ((torch.arange(height) + 0.5) * rows / height - 0.5).clamp(min=0)
    top = v.long()
    low, share = (top + 1).clamp(max=rows - 1), (v - top)[None, :, None]
    for first in range(0, height, _BAND):
        part = slice(first, first + _BAND)
        band = wide[:, top[part]] * (1 - share[:, part]) + wide[:, low[part]] * share[:, part]
        yield first, band.permute(1, 2, 0).reshape(-1, patches.shape[2])
