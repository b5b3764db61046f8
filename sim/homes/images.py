"""Images of floor cells: nearest cells, distances, connected parts, neighbours.

These functions are not in cells.py, because plans need that module and it loads without scipy.ndimage.
"""

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

Image = NDArray[np.bool_]
_BOX = np.ones((3, 3), bool)


def nearest(mask: Image) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Row and column of the nearest True cell of each cell, (rows, cols) each; the mask has at least one True cell."""
    found = ndimage.distance_transform_edt(~mask, return_distances=False, return_indices=True)
    assert isinstance(found, np.ndarray)
    rows, cols = found
    return rows, cols


def distance_to(mask: Image) -> NDArray[np.float64]:
    """Distance (rows, cols) of each cell to the nearest True cell, in cells; inf where there is none."""
    if not mask.any():
        return np.full(mask.shape, np.inf)
    found = ndimage.distance_transform_edt(~mask)
    assert isinstance(found, np.ndarray)
    return found


def parts_of(mask: Image, *, diagonal: bool = False) -> tuple[NDArray[np.int64], int]:
    """Number of the connected part of each True cell, 0 elsewhere, and the number of parts."""
    found = ndimage.label(mask, _BOX if diagonal else None)
    assert isinstance(found, tuple)
    parts, count = found
    return np.asarray(parts, np.int64), int(count)


def widened(mask: Image, cells: int) -> Image:
    """The mask grown by `cells` rows and columns on each side: a tenth of the cost of scipy's filters."""
    tall = mask.copy()
    for step in range(1, cells + 1):
        tall[step:] |= mask[:-step]
        tall[:-step] |= mask[step:]
    wide = tall.copy()
    for step in range(1, cells + 1):
        wide[:, step:] |= tall[:, :-step]
        wide[:, :-step] |= tall[:, step:]
    return wide


def grown(heights: NDArray[np.float64], radius_cells: float) -> NDArray[np.float64]:
    """One layer (rows, cols) with every gap within `radius_cells` filled from the nearest cell."""
    known = ~np.isnan(heights)
    if not known.any():
        return heights
    near = ~known if np.isinf(radius_cells) else ~known & (distance_to(known) <= radius_cells)
    found = heights.copy()
    rows, cols = nearest(known)
    found[near] = heights[rows[near], cols[near]]
    return found


def cells_of(mask: Image) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows and columns of the True cells."""
    rows, cols = np.nonzero(mask)
    return rows, cols


def neighbours(image: NDArray) -> list[tuple[tuple[int, int], NDArray]]:
    """For each of four sides: its (row, col) step, and the image of each cell's neighbour there; nan or 0 outside."""
    rows, cols = image.shape[-2:]
    around = [(0, 0)] * (image.ndim - 2) + [(1, 1), (1, 1)]
    wide = np.pad(image, around, constant_values=np.nan if image.dtype.kind == "f" else 0)
    steps = ((1, 0), (-1, 0), (0, 1), (0, -1))
    return [((dr, dc), wide[..., 1 + dr : 1 + dr + rows, 1 + dc : 1 + dc + cols]) for dr, dc in steps]
