"""A storey from above in matplotlib axes: world metres, +x right and +z down."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from numpy.typing import NDArray

from sim.types import GridSpec

FREE, CLOSED = "#fbfbf9", "#c9ccd1"
"""Colours of cells where a robot can stand, and of all others."""


def draw_free_floor(axes: Axes, free: NDArray[np.bool_], grid: GridSpec) -> None:
    """Paints the cells (rows, cols) of a storey, below everything else in the axes."""
    (left, top), (rows, cols) = grid.origin_xz, grid.shape
    extent = (left, left + cols * grid.cell, top + rows * grid.cell, top)
    colours = ListedColormap([CLOSED, FREE])
    axes.imshow(free, extent=extent, cmap=colours, vmin=0, vmax=1, interpolation="nearest", zorder=0)
