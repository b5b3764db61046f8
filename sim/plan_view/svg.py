"""A storey from above as SVG."""

import numpy as np
from numpy.typing import NDArray

from sim.types import GridSpec

from .view import PlanView

_OVERLAP = 0.3
"""Pixels by which a row of cells reaches into the next, so that no gap shows between them."""


def free_floor(view: PlanView, free: NDArray[np.bool_], grid: GridSpec, *, fill: str = "#ffffff") -> str:
    """Free cells (rows, cols) as one path: a rectangle for each run of cells in a row."""
    edges = np.diff(np.pad(free.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    firsts, lasts = np.argwhere(edges == 1), np.argwhere(edges == -1)
    corners = view.pixels(grid.xz_from_rc(firsts) - grid.cell / 2)
    widths = (lasts - firsts)[:, 1] * (grid.cell * view.scale)
    height = grid.cell * view.scale + _OVERLAP
    runs = [
        f"M{left:.1f} {top:.1f}h{width:.1f}v{height:.1f}h{-width:.1f}z"
        for (left, top), width in zip(corners.tolist(), widths.tolist(), strict=True)
    ]
    return f'<path d="{"".join(runs)}" fill="{fill}"/>'
