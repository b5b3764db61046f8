"""Draws grids seen from above: as small PNGs on a storey's map, and as coloured squares above its floor."""

import io
from collections.abc import Sequence
from typing import TypeVar

import numpy as np
import rerun as rr
from numpy.typing import NDArray
from PIL import Image

from sim.plan_view.heat import heat_colours, heat_shares
from sim.plan_view.storey import StoreyMap
from sim.tasks.observers import FREE, OCCUPIED, UNKNOWN
from sim.types import GridSpec

from .scene import FREE_RGB, LIFT, WALL_RGB

SEEN_PALETTE = np.array([(38, 40, 44), (74, 76, 80), WALL_RGB, FREE_RGB], np.uint8)
"""Colours of cells: not seen and not free, not seen but free, seen and not free, seen and free."""
OCCUPANCY_PALETTE = np.array([(0, 0, 0, 0), (214, 232, 214, 255), (176, 96, 60, 255)], np.uint8)
"""RGBA of UNKNOWN, which is transparent, FREE and OCCUPIED."""
assert (UNKNOWN, FREE, OCCUPIED) == (0, 1, 2)
_HEAT_LEVELS = 255
_ALPHA = 200
HEAT_PALETTE = np.zeros((_HEAT_LEVELS + 1, 4), np.uint8)
"""Level 0 is transparent (nothing was seen); 1 to 255 go from the least to the most similar."""
HEAT_PALETTE[1:, :3] = heat_colours(np.linspace(0, 1, _HEAT_LEVELS))
HEAT_PALETTE[1:, 3] = _ALPHA
Value = TypeVar("Value", bound=np.generic)
_TAIL = 2.0
"""Percent of cells at either end of a channel that get its limit; otherwise a few odd cells would grey out the rest."""
GREY = 128


def seen_png(free: NDArray[np.bool_], seen: NDArray[np.bool_]) -> bytes:
    """A PNG of a storey's map on which seen cells are bright; both arrays are (rows, cols)."""
    return palette_png(free.astype(np.uint8) + 2 * seen.astype(np.uint8), SEEN_PALETTE)


def occupancy_png(occupancy: NDArray[np.uint8]) -> bytes:
    """A PNG of cells (rows, cols) UNKNOWN, FREE or OCCUPIED; unknown cells are transparent."""
    return palette_png(np.minimum(occupancy, OCCUPIED), OCCUPANCY_PALETTE)


def similarity_png(similarity: NDArray[np.float32]) -> bytes:
    """A PNG of values (rows, cols), from the least (dark blue) to the greatest (yellow); NaN is transparent."""
    known = np.isfinite(similarity)
    if not known.any():
        return palette_png(np.zeros(similarity.shape, np.uint8), HEAT_PALETTE)
    levels = np.where(known, 1 + np.nan_to_num(heat_shares(similarity)) * (_HEAT_LEVELS - 1), 0)
    return palette_png(np.round(levels).astype(np.uint8), HEAT_PALETTE)


def rgb_png(pixels: NDArray[np.uint8]) -> bytes:
    """A PNG of pixels (rows, cols, 4) red, green, blue, alpha."""
    buffer = io.BytesIO()
    Image.fromarray(pixels, "RGBA").save(buffer, "PNG", compress_level=1)
    return buffer.getvalue()


def palette_png(levels: NDArray[np.uint8], palette: NDArray[np.uint8]) -> bytes:
    """A PNG with few bits per cell: (rows, cols) indices into a palette (N, 3) RGB or (N, 4) RGBA."""
    image = Image.fromarray(levels, "P")
    image.putpalette(palette[:, :3].tobytes())
    bits = 2 if len(palette) <= 4 else 8
    transparency = {"transparency": palette[:, 3].tobytes()} if palette.shape[1] == 4 else {}
    buffer = io.BytesIO()
    image.save(buffer, "PNG", bits=bits, compress_level=1, **transparency)
    return buffer.getvalue()


class Resampler:
    """Carries grids of the start frame onto a storey's map in the world; remembers where each cell comes from."""

    def __init__(self, T_world_start: NDArray[np.float64], target: GridSpec) -> None:
        """Prepares for one episode and one map."""
        xz = target.xz_from_rc(np.moveaxis(np.indices(target.shape), 0, -1))  # (rows, cols, 2)
        T_start_world = np.linalg.inv(T_world_start)
        self._xz_start = xz @ T_start_world[np.ix_([0, 2], [0, 2])].T + T_start_world[[0, 2], 3]
        self._grid: GridSpec | None = None
        self._source = np.empty(0, np.int64)

    def resampled(self, values: NDArray[Value], grid: GridSpec, *, outside: float) -> NDArray[Value]:
        """The map's cells (rows, cols) with the value of the cell of `grid` that holds their centre, or `outside`."""
        if grid != self._grid:
            rc = grid.rc_from_xz(self._xz_start)
            cols, count = grid.shape[1], grid.shape[0] * grid.shape[1]
            self._source = np.where(grid.contains(rc), rc[..., 0] * cols + rc[..., 1], count)
            self._grid = grid
        padded = np.append(values.ravel(), np.array([outside], values.dtype))
        return padded[self._source]


def vector_rgb(blocks: Sequence[NDArray[np.float32]]) -> list[NDArray[np.uint8]]:
    """(N_i, 3) colours of vectors (N_i, E), on one scale for all blocks; similar colours mean similar vectors.

    The colours are principal components of all vectors together. Their signs are fixed, so that the same map gets the
    same colours. Directions in which no vectors differ are grey.
    """
    rows = np.concatenate([np.asarray(block, np.float64) for block in blocks]) if blocks else np.empty((0, 3))
    if not len(rows):
        return [np.empty((0, 3), np.uint8) for _ in blocks]
    centred = rows - rows.mean(axis=0)
    # uses the smaller of the two products: maps have hundreds of cells, vectors hundreds of numbers
    _, spread, directions = np.linalg.svd(centred, full_matrices=False)
    directions = directions[:3] * np.sign(directions[:3, np.abs(directions[:3]).argmax(axis=1)].diagonal())[:, None]
    parts = np.zeros((len(rows), 3))
    known = spread[:3] > 1e-9 * max(float(spread[0]), 1.0)
    parts[:, : len(known)] = (centred @ directions.T) * known
    low, high = np.percentile(parts, [_TAIL, 100 - _TAIL], axis=0)
    share = np.divide(parts - low, high - low, out=np.full_like(parts, GREY / 255), where=high > low)
    colours = np.round(np.clip(share, 0, 1) * 255).astype(np.uint8)
    return list(np.split(colours, np.cumsum([len(block) for block in blocks])[:-1]))


def on_map(values: NDArray[np.float32], grid: GridSpec, storey: StoreyMap) -> NDArray[np.float32]:
    """Values (R, C) of a grid at the pixels of a storey's map; NaN outside the grid."""
    return Resampler(np.eye(4), storey.grid).resampled(values, grid, outside=np.nan)


def heat_rgb(values: NDArray[np.float32]) -> NDArray[np.uint8]:
    """(R, C, 3) the colours that `similarity_png` gives to values (R, C)."""
    return np.array(Image.open(io.BytesIO(similarity_png(values))).convert("RGBA"))[..., :3]


def carpet(rgb: NDArray[np.uint8], shown: NDArray[np.bool_], grid: GridSpec, storey: StoreyMap) -> rr.Mesh3D:
    """The shown cells (R, C) of a grid, in colours (R, C, 3), as squares above the storey's floor.

    A whole picture there would hide the home below it.
    """
    cells = np.argwhere(shown)  # (C, 2)
    corners = cells[:, None] + np.array([[0, 0], [0, 1], [1, 1], [1, 0]])  # (C, 4, 2)
    xz = np.asarray(grid.origin_xz) + corners[..., ::-1] * grid.cell
    points = np.insert(xz, 1, storey.floor_y + LIFT / 2, axis=-1).reshape(-1, 3)
    squares = 4 * np.arange(len(cells))[:, None, None] + np.array([[0, 2, 1], [0, 3, 2]])
    colors = np.repeat(rgb[cells[:, 0], cells[:, 1]], 4, axis=0)
    return rr.Mesh3D(vertex_positions=points, triangle_indices=squares.reshape(-1, 3), vertex_colors=colors)
