"""A storey's free floor as a picture whose pixels are cells, cropped to its free space; drawings are laid on it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.types import GridSpec
from sim.walk.navigation_map import NavigationMap
from sim.walk.storeys import storey_of

MARGIN = 0.5
"""Metres of map shown around the free space."""


@dataclass(frozen=True, slots=True)
class StoreyMap:
    """One storey from above, cropped to its free space."""

    index: int
    """Place in the scene's storey heights."""
    floor_y: float
    """Metres."""
    free: NDArray[np.bool_]
    """(rows, cols)."""
    grid: GridSpec

    @property
    def name(self) -> str:
        """`storey_0` is the lowest."""
        return storey_name(self.index)

    def pixels(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Picture coordinates (..., 2), column first, of world points (..., 3)."""
        return (points[..., [0, 2]] - np.asarray(self.grid.origin_xz)) / self.grid.cell

    def flat_boxes(
        self, low: NDArray[np.float64], high: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Low corners and sizes (N, 2) in the picture of boxes with these corners (N, 3) in the world."""
        corners = np.stack([self.pixels(low), self.pixels(high)], axis=1)  # (N, 2, 2)
        return corners.min(axis=1), np.ptp(corners, axis=1)


def storey_name(index: int) -> str:
    """Name of a storey, index from the lowest."""
    return f"storey_{index}"


def storey_map(navigation: NavigationMap, index: int) -> StoreyMap:
    """The map of one storey of a scene; the whole grid when nothing is free there."""
    floor_y = navigation.storey_heights[index]
    free, grid, _ = navigation.top_down(floor_y)
    return cropped_map(index, floor_y, free, grid, around=free)


def cropped_map(
    index: int, floor_y: float, free: NDArray[np.bool_], grid: GridSpec, *, around: NDArray[np.bool_]
) -> StoreyMap:
    """A storey whose picture ends `MARGIN` behind the cells `around` (rows, cols); the whole grid where none is set."""
    rows, cols = np.flatnonzero(around.any(axis=1)), np.flatnonzero(around.any(axis=0))
    if not len(rows):
        return StoreyMap(index, floor_y, free, grid)
    pad = round(MARGIN / grid.cell)
    top, bottom = max(0, rows[0] - pad), min(grid.shape[0], rows[-1] + 1 + pad)
    left, right = max(0, cols[0] - pad), min(grid.shape[1], cols[-1] + 1 + pad)
    origin = (float(grid.origin_xz[0] + left * grid.cell), float(grid.origin_xz[1] + top * grid.cell))
    cropped = free[top:bottom, left:right]
    return StoreyMap(index, floor_y, cropped, GridSpec(origin, grid.cell, cropped.shape))


def storeys_of(heights: NDArray[np.float64], navigation: NavigationMap) -> NDArray[np.int64]:
    """Index of the storey (N,) that points at each height (N,) belong to."""
    storeys = [(height, height) for height in navigation.storey_heights]
    return np.array([storey_of(float(y), storeys) for y in heights], np.int64)
