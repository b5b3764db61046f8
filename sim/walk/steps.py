"""The forward rule on a floor grid: stop at the first wall (habitat-sim <= 0.3.3), or slide along it."""

import math

import numpy as np
from numpy.typing import NDArray

from .grid_kernels import Cells, clamp, slide_end, walk

STOP_MARGIN = 1e-4
"""A blocked walk ends this far before the wall (metres), so that its end is navigable."""


def end_of_walk(
    cells: Cells, start_uv: tuple[float, float], *, node: int, end_uv: tuple[float, float], margin: float, slide: bool
) -> tuple[float, float, int]:
    """The end of a straight walk, in grid units (see grid_kernels).

    Without sliding the walk stops `margin` before the first side of a cell that it cannot cross. With sliding it ends
    at the reachable point nearest to the wanted end, which may be a little farther away than one step (as in Detour).

    Args:
        cells: The grid.
        start_uv: (u, v) of the start, inside the cell of `node`.
        node: Node of the start.
        end_uv: (u, v) of the wanted end.
        margin: Distance to keep from a wall, in grid units.
        slide: Whether walls deflect the walk instead of stopping it.

    Returns:
        (u, v, node) of the end.
    """
    (u, v), (end_u, end_v) = start_uv, end_uv
    last, share = walk(cells, u, v, node, end_u, end_v)
    if share >= 1.0:
        return end_u, end_v, last
    if slide:
        return slide_end(cells, u, v, node, end_u, end_v)
    wanted = math.hypot(end_u - u, end_v - v)
    kept = max(0.0, share * wanted - margin) / wanted
    u, v = u + kept * (end_u - u), v + kept * (end_v - v)
    # The last cell may have been entered within the margin: then the end lies in the cell before it.
    last, _ = walk(cells, *start_uv, node, u, v)
    u, v = clamp(cells, last, u, v)
    return u, v, last


def has_collided(start: NDArray[np.float64], end: NDArray[np.float64], *, wanted: NDArray[np.float64]) -> bool:
    """Habitat's rule |moved|^2 + 1e-5 < |wanted|^2 for a walk from `start` that ended at `end`; all (3,) metres."""
    moved, asked = end - start, wanted - start
    return bool(moved @ moved + 1e-5 < asked @ asked)
