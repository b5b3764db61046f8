"""Images of cells: nearest cells, distances, connected parts and edges between neighbours."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from .outlines import WallLines

Image = NDArray[np.bool_]
Numbers = NDArray[np.int64]
_BOX = np.ones((3, 3), bool)


def nearest(mask: Image) -> tuple[Numbers, Numbers]:
    """(rows, cols) images: where the nearest True cell of each cell is; the mask has at least one."""
    found = ndimage.distance_transform_edt(~mask, return_distances=False, return_indices=True)
    assert isinstance(found, np.ndarray)
    rows, cols = found
    return rows, cols


def distance_to(mask: Image) -> NDArray[np.float64]:
    """(rows, cols) distance of each cell to the nearest True one, in cells; inf where there is none."""
    if not mask.any():
        return np.full(mask.shape, np.inf)
    found = ndimage.distance_transform_edt(~mask)
    assert isinstance(found, np.ndarray)
    return found


def parts_of(mask: Image, *, diagonal: bool = False) -> tuple[Numbers, int]:
    """Number of the connected part of each True cell, 0 elsewhere, and how many there are."""
    found = ndimage.label(mask, _BOX if diagonal else None)
    assert isinstance(found, tuple)
    parts, count = found
    return np.asarray(parts, np.int64), int(count)


def widened(mask: Image, cells: int) -> Image:
    """The mask grown by a square of `cells` on each side."""
    return np.asarray(ndimage.binary_dilation(mask, _BOX, iterations=cells), bool)


def cells_of(mask: Image) -> tuple[Numbers, Numbers]:
    """Rows and columns of the True cells."""
    rows, cols = np.nonzero(mask)
    return rows, cols


def edges_where(between: Callable[[tuple[slice, slice], tuple[slice, slice], int], Image]) -> WallLines:
    """Edges between neighbouring cells for which `between` says so; none at the rim.

    Args:
        between: Gets two slices, of the cells before and behind the edges along one axis, and the axis (0 = rows); for
            an image `image`, `image[a]` and `image[b]` are the values on both sides. Returns an image of that shape.
    """
    every = slice(None)
    low, high = slice(None, -1), slice(1, None)
    across = np.pad(between((low, every), (high, every), 0), ((1, 1), (0, 0)))
    along = np.pad(between((every, low), (every, high), 1), ((0, 0), (1, 1)))
    return WallLines(across, along)
