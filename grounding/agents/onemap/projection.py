"""One view as cells of OneMap's map: the mean feature, the confidence and the obstacles of each cell in it.

Depth, confidence, patches -> pixels grouped by cell -> `CellView` -> `FeatureGrid`.

OneMap resizes the patches to one vector per pixel and averages those of each cell. Both steps are linear, so a cell's
feature is a weighted mean of a few patches, and the vectors of pixels (0.9 GB a view) are never made.

OneMap's axes are x forward, y left and z up from the camera, turned by its yaw; ours (start frame) are x right, y up
and z back. Its (x, y, z) is our (-z, -x, y).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.compiled import njit
from sim.types import Camera, GridSpec

LEAST_CONFIDENCE = 1e-5
"""Pixels with less confidence, those beyond 9.8 m, are left out (OneMap's code)."""
OBSTACLE_LOW, OBSTACLE_HIGH = -0.6, 0.5
"""Points between these heights above the camera (metres) are obstacles (OneMap's code)."""
STAIRS_BELOW, FLOOR_BELOW = -1.1, -0.88
"""A point lower than the first height (metres above the camera) belongs to a stair down: it becomes an obstacle where
its ray meets the second height, the floor (OneMap's code)."""


class CellView(NamedTuple):
    """What one view shows of N cells."""

    cells: NDArray[np.int32]
    """(N,) index row * columns + column of each cell on the grid."""
    features: NDArray[np.float32]
    """(N, E) mean of the cell's pixels, weighted by confidence."""
    confidence: NDArray[np.float32]
    """(N,) mean confidence of the cell's pixels."""
    is_blocked: NDArray[np.bool_]
    """(N,) whether one of its points is an obstacle."""


def cells_of_pixels(
    depth_m: NDArray[np.float32],
    confidence: NDArray[np.float32],
    T_map_camera: NDArray[np.float64],
    camera: Camera,
    grid: GridSpec,
) -> tuple[NDArray[np.int32], NDArray[np.bool_]]:
    """(H, W) cell index of each pixel's point, -1 where it has none or too little confidence; (H, W) obstacles."""
    shape = (camera.height, camera.width)
    assert depth_m.shape == confidence.shape == shape, (depth_m.shape, confidence.shape, shape)
    return _located(
        np.ascontiguousarray(depth_m, np.float32),
        confidence,
        np.ascontiguousarray(T_map_camera[:3, :3], np.float64),
        (float(T_map_camera[0, 3]), float(T_map_camera[2, 3])),
        camera.lens,
        grid.origin_xz,
        grid.cell,
        grid.shape,
    )


def view_of_cells(
    cells: NDArray[np.int32],
    is_obstacle: NDArray[np.bool_],
    confidence: NDArray[np.float32],
    patches: NDArray[np.float32],
    num_cells: int,
) -> CellView:
    """The cells of a view from the cells of its pixels.

    Args:
        cells: (H, W) from `cells_of_pixels`.
        is_obstacle: (H, W) from it too.
        confidence: (H, W) of the pixels.
        patches: (h, w, E) vectors of patches that tile the picture evenly.
        num_cells: Cells of the whole grid.
    """
    touched, starts, order = _grouped(cells.ravel(), num_cells)
    features, mean, is_blocked = _averaged(
        starts, order, confidence, is_obstacle, np.ascontiguousarray(patches, np.float32)
    )
    return CellView(touched, features, mean, is_blocked)


@njit(cache=True, nogil=True)
def _located(depth, confidence, R, camera_xz, lens, corner, cell, shape):
    """(H, W) int32 cell index of each pixel's point or -1, and (H, W) whether the point is an obstacle."""
    fx, fy, cx, cy = lens
    height, width = depth.shape
    cells = np.full((height, width), np.int32(-1))
    is_obstacle = np.zeros((height, width), np.bool_)
    rights = (np.arange(width) + 0.5 - cx) / fx
    for r in range(height):
        down = (r + 0.5 - cy) / fy
        x_down, up_down, z_down = R[0, 1] * down + R[0, 2], R[1, 1] * down + R[1, 2], R[2, 1] * down + R[2, 2]
        for c in range(width):
            if not confidence[r, c] > LEAST_CONFIDENCE:
                continue
            d, right = np.float64(depth[r, c]), rights[c]
            up = (R[1, 0] * right + up_down) * d
            is_stair = up < STAIRS_BELOW
            if is_stair:
                d *= FLOOR_BELOW / up
            x = camera_xz[0] + (R[0, 0] * right + x_down) * d
            z = camera_xz[1] + (R[2, 0] * right + z_down) * d
            col, row = math.floor((x - corner[0]) / cell), math.floor((z - corner[1]) / cell)
            if 0 <= row < shape[0] and 0 <= col < shape[1]:
                cells[r, c] = row * shape[1] + col
                is_obstacle[r, c] = is_stair or OBSTACLE_LOW < up < OBSTACLE_HIGH
    return cells, is_obstacle


@njit(cache=True, nogil=True)
def _grouped(cells, num_cells):
    """Cells (N,) in view, ascending; (N + 1,) where each one's pixels begin in the last value, all pixels by cell."""
    counts = np.zeros(num_cells, np.int32)
    for cell in cells:
        if cell >= 0:
            counts[cell] += 1
    num_touched = 0
    for cell in range(num_cells):
        num_touched += counts[cell] > 0
    touched, starts = np.empty(num_touched, np.int32), np.zeros(num_touched + 1, np.int32)
    index = 0
    for cell in range(num_cells):
        if counts[cell] > 0:
            touched[index] = cell
            starts[index + 1] = starts[index] + counts[cell]
            counts[cell] = starts[index]  # from here on the place of the cell's next pixel
            index += 1
    order = np.empty(starts[num_touched], np.int32)
    for pixel in range(len(cells)):
        cell = cells[pixel]
        if cell >= 0:
            order[counts[cell]] = pixel
            counts[cell] += 1
    return touched, starts, order


@njit(cache=True, nogil=True)
def _averaged(starts, order, confidence, is_obstacle, patches):
    """Feature (N, E), confidence (N,) and obstacle (N,) of each group of pixels.

    A pixel's vector is the bilinear mean of the four patches around it, of the border patch beyond the last middle
    (torch's `interpolate` without `align_corners`). Pixels between the same four patches are summed before their
    weights are given to the patches.
    """
    num_cells = len(starts) - 1
    height, width = confidence.shape
    rows, cols, dim = patches.shape
    flat = patches.reshape(rows * cols, dim)
    features = np.empty((num_cells, dim), np.float32)
    mean, is_blocked = np.empty(num_cells, np.float32), np.zeros(num_cells, np.bool_)
    tops, downs = _between(height, rows)
    lefts, asides = _between(width, cols)
    shares = np.zeros(rows * cols)
    used = np.empty(rows * cols, np.int64)
    total = np.empty(dim)
    for cell in range(num_cells):
        num_used, weight, k = 0, 0.0, starts[cell]
        while k < starts[cell + 1]:
            top, left = tops[order[k] // width], lefts[order[k] % width]
            both, down, aside, neither = 0.0, 0.0, 0.0, 0.0
            while k < starts[cell + 1]:
                r = order[k] // width
                c = order[k] - r * width
                if tops[r] != top or lefts[c] != left:
                    break
                w, v, u = np.float64(confidence[r, c]), downs[r], asides[c]
                is_blocked[cell] |= is_obstacle[r, c]
                neither, down, aside, both = neither + w, down + w * v, aside + w * u, both + w * v * u
                k += 1
            weight += neither
            low, right = min(top + 1, rows - 1), min(left + 1, cols - 1)
            for at, share in (
                (top * cols + left, neither - down - aside + both),
                (top * cols + right, aside - both),
                (low * cols + left, down - both),
                (low * cols + right, both),
            ):
                if share > 0:
                    if shares[at] == 0:
                        used[num_used] = at
                        num_used += 1
                    shares[at] += share
        total[:] = 0
        for k in range(num_used):
            share, at = shares[used[k]] / weight, used[k]
            shares[at] = 0
            for e in range(dim):
                total[e] += share * flat[at, e]
        features[cell] = total
        mean[cell] = weight / (starts[cell + 1] - starts[cell])
    return features, mean, is_blocked


@njit(cache=True, nogil=True)
def _between(num_pixels, num_patches):
    """Of each pixel along one side: the patch before it, and how far it is on its way to the next, 0 to 1."""
    at = np.maximum((np.arange(num_pixels) + 0.5) * num_patches / num_pixels - 0.5, 0.0)
    before = at.astype(np.int64)
    return before, at - before
