"""Finds edges between neighbouring cells, and merges cells into level and upright quads."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from sim.types import GridSpec

from ...cells import runs_of
from .outlines import WallLines

Points = NDArray[np.floating]
Image = NDArray[np.bool_]
Numbers = NDArray[np.int64]


def edges_where(between: Callable[[tuple[slice, slice], tuple[slice, slice], int], Image]) -> WallLines:
    """Edges between neighbouring cells for which `between` is true; none at the rim.

    Args:
        between: Gets the slices `a` and `b` of the cells before and behind the edges, and the axis (0 = rows); returns
            a mask of the shape of `image[a]`, where `image` is an image of all cells.
    """
    every = slice(None)
    low, high = slice(None, -1), slice(1, None)
    across = np.pad(between((low, every), (high, every), 0), ((1, 1), (0, 0)))
    along = np.pad(between((every, low), (every, high), 1), ((0, 0), (1, 1)))
    return WallLines(across, along)


def level_quads(grid: GridSpec, height: Points, kind: Numbers) -> tuple[Points, Numbers]:
    """Rectangles facing up that cover all cells with a height.

    Args:
        grid: Place of the images.
        height: (rows, cols) metres, nan where there is nothing.
        kind: (rows, cols) cells of different kinds are not merged.

    Returns:
        Quads (Q, 4, 3) and the kind of each, (Q,).
    """
    rows, cols = np.nonzero(~np.isnan(height))
    y_mm = np.round(height[rows, cols] * 1000).astype(np.int64)
    keys = np.stack([y_mm, kind[rows, cols], rows], axis=1)
    first, width = runs_of(keys, cols)
    # runs of one row become rectangles where the next row has the same run
    wide_keys = np.column_stack([keys[first][:, :2], cols[first], width])
    top, tall = runs_of(wide_keys, rows[first])
    pick = first[top]
    x0, z0 = grid.origin_xz[0] + cols[pick] * grid.cell, grid.origin_xz[1] + rows[pick] * grid.cell
    x1, z1, y = x0 + width[top] * grid.cell, z0 + tall * grid.cell, y_mm[pick] / 1000
    corners = ((x0, y, z0), (x0, y, z1), (x1, y, z1), (x1, y, z0))
    return np.stack([np.stack(corner, axis=1) for corner in corners], axis=1), kind[rows[pick], cols[pick]]


def side_quads(
    grid: GridSpec, cells: tuple[Numbers, Numbers], span: tuple[Points, Points], step: tuple[int, int]
) -> tuple[Points, Numbers]:
    """Upright rectangles on one side of cells, facing away from them, merged along the side.

    Args:
        grid: Place of the cells.
        cells: Rows and columns of the cells, (N,) each.
        span: Lower and upper heights, (N,) each, metres.
        step: (row, col) towards the side.

    Returns:
        Quads (Q, 4, 3) and the index of one cell of each, (Q,).
    """
    rows, cols = cells
    low, high = span
    along, across = (cols, rows) if step[0] else (rows, cols)
    keys = np.column_stack([np.round(low * 1000), np.round(high * 1000), across]).astype(np.int64)
    first, length = runs_of(keys, along)
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
