"""Level and upright quads over many cells, merged to large rectangles; used by cell_mesh and stairs_mesh."""

import numpy as np
from numpy.typing import NDArray

from sim.types import GridSpec

Points = NDArray[np.floating]
Numbers = NDArray[np.int64]


def level_quads(grid: GridSpec, height: Points, kind: Numbers) -> tuple[Points, Numbers]:
    """Rectangles facing up that cover all cells with a height.

    Args:
        grid: Place of the images.
        height: (rows, cols) metres, nan where there is nothing.
        kind: (rows, cols) cells of different kinds are not merged.

    Returns:
        (Q, 4, 3) and the kind of each, (Q,).
    """
    rows, cols = np.nonzero(~np.isnan(height))
    y_mm = np.round(height[rows, cols] * 1000).astype(np.int64)
    keys = np.stack([y_mm, kind[rows, cols], rows], axis=1)
    first, width = _merged(keys, cols)
    # runs of one row become rectangles where the next row has the same run
    wide_keys = np.column_stack([keys[first][:, :2], cols[first], width])
    top, tall = _merged(wide_keys, rows[first])
    pick = first[top]
    x0, z0 = grid.origin_xz[0] + cols[pick] * grid.cell, grid.origin_xz[1] + rows[pick] * grid.cell
    x1, z1, y = x0 + width[top] * grid.cell, z0 + tall * grid.cell, y_mm[pick] / 1000
    corners = ((x0, y, z0), (x0, y, z1), (x1, y, z1), (x1, y, z0))
    return np.stack([np.stack(corner, axis=1) for corner in corners], axis=1), kind[rows[pick], cols[pick]]


def neighbours(image: NDArray) -> list[tuple[tuple[int, int], NDArray]]:
    """((row step, col step), image of the neighbours in that direction) for the four sides; the last two axes count."""
    rows, cols = image.shape[-2:]
    around = [(0, 0)] * (image.ndim - 2) + [(1, 1), (1, 1)]
    wide = np.pad(image, around, constant_values=np.nan if image.dtype.kind == "f" else 0)
    steps = ((1, 0), (-1, 0), (0, 1), (0, -1))
    return [((dr, dc), wide[..., 1 + dr : 1 + dr + rows, 1 + dc : 1 + dc + cols]) for dr, dc in steps]


def side_quads(
    grid: GridSpec, cells: tuple[Numbers, Numbers], span: tuple[Points, Points], step: tuple[int, int]
) -> tuple[Points, Numbers]:
    """Upright rectangles on one side of cells, facing away from them, merged along the side.

    Args:
        grid: Place of the cells.
        cells: Their rows and columns, (N,) each.
        span: Lower and upper heights, (N,) each, metres.
        step: (row, col) towards the side.

    Returns:
        (Q, 4, 3) and the index of a cell of each, (Q,).
    """
    rows, cols = cells
    low, high = span
    along, across = (cols, rows) if step[0] else (rows, cols)
    keys = np.column_stack([np.round(low * 1000), np.round(high * 1000), across]).astype(np.int64)
    first, length = _merged(keys, along)
    x = grid.origin_xz[0] + (cols[first] + (step[1] > 0)) * grid.cell
    z = grid.origin_xz[1] + (rows[first] + (step[0] > 0)) * grid.cell
    run = length * grid.cell
    x_a, x_b = (x, x + run) if step[0] else (x, x)
    z_a, z_b = (z, z) if step[0] else (z, z + run)
    if step[0] < 0 or step[1] > 0:
        x_a, x_b, z_a, z_b = x_b, x_a, z_b, z_a
    lo, hi = low[first], high[first]
    corners = ((x_a, lo, z_a), (x_b, lo, z_b), (x_b, hi, z_b), (x_a, hi, z_a))
    return np.stack([np.stack(corner, axis=1) for corner in corners], axis=1), first


def _merged(keys: Numbers, along: Numbers) -> tuple[Numbers, Numbers]:
    """Merge entries with equal `keys` (N, K) and consecutive `along` (N,): (index of each first entry, lengths)."""
    if not len(along):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    order = np.lexsort((along, *keys.T[::-1]))
    keys, along = keys[order], along[order]
    new = np.ones(len(order), bool)
    new[1:] = (np.diff(along) != 1) | (np.diff(keys, axis=0) != 0).any(axis=1)
    firsts = np.flatnonzero(new)
    return order[firsts], np.diff(np.append(firsts, len(order)))
