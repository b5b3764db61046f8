"""Cells of a coarse grid on a storey: at the pixels of its map, and as coloured squares above its floor."""

import io

import numpy as np
import rerun as rr
from numpy.typing import NDArray
from PIL import Image

from sim.types import GridSpec

from .log_maps import StoreyMap
from .log_run import LIFT
from .map_pictures import similarity_png


def on_map(values: NDArray[np.float32], grid: GridSpec, storey: StoreyMap) -> NDArray[np.float32]:
    """Values (R, C) of a grid at the pixels of a storey's map; NaN outside the grid."""
    rc = np.stack(np.meshgrid(*map(np.arange, storey.grid.shape), indexing="ij"), axis=-1)
    cells = grid.rc_from_xz(storey.grid.xz_from_rc(rc))
    inside = grid.contains(cells)
    rows, cols = np.moveaxis(np.where(inside[..., None], cells, 0), -1, 0)
    return np.where(inside, values[rows, cols], np.float32(np.nan))


def heat_rgb(values: NDArray[np.float32]) -> NDArray[np.uint8]:
    """(R, C, 3) the colours that `similarity_png` gives values (R, C)."""
    return np.array(Image.open(io.BytesIO(similarity_png(values))).convert("RGBA"))[..., :3]


def carpet(rgb: NDArray[np.uint8], shown: NDArray[np.bool_], grid: GridSpec, storey: StoreyMap) -> rr.Mesh3D:
    """The cells that are shown as squares above the floor; a picture there would hide the home below it.

    Args:
        rgb: (R, C, 3) colour of each cell.
        shown: (R, C).
        grid: Where the cells are.
        storey: On whose floor.
    """
    cells = np.argwhere(shown)  # (C, 2)
    corners = cells[:, None] + np.array([[0, 0], [0, 1], [1, 1], [1, 0]])  # (C, 4, 2)
    xz = np.asarray(grid.origin_xz) + corners[..., ::-1] * grid.cell
    points = np.insert(xz, 1, storey.floor_y + LIFT / 2, axis=-1).reshape(-1, 3)
    squares = 4 * np.arange(len(cells))[:, None, None] + np.array([[0, 2, 1], [0, 3, 2]])
    colors = np.repeat(rgb[cells[:, 0], cells[:, 1]], 4, axis=0)
    return rr.Mesh3D(vertex_positions=points, triangle_indices=squares.reshape(-1, 3), vertex_colors=colors)
