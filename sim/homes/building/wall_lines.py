"""Edges between cells on which a wall stands, and the chains that they form; from cell_spaces to outlines."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

_STUMP = 10
"""A wall that ends free after fewer cells is left out."""
_SCRAP = 40
"""Walls that hang together and are shorter than this many cells are left out."""
_STEPS = ((0, 1), (0, -1), (1, 0), (-1, 0))
"""(row, col) of the four ways from a corner; the numbers of `WallLines.ways`."""


class WallLines(NamedTuple):
    """Sides of cells with a wall."""

    across: NDArray[np.bool_]
    """(rows + 1, cols): between cell (r - 1, c) and cell (r, c)."""
    along: NDArray[np.bool_]
    """(rows, cols + 1): between cell (r, c - 1) and cell (r, c)."""

    @classmethod
    def none(cls, shape: tuple[int, ...]) -> "WallLines":
        """No wall on a grid of this shape (rows, cols)."""
        rows, cols = shape
        return cls(np.zeros((rows + 1, cols), bool), np.zeros((rows, cols + 1), bool))

    def ways(self) -> NDArray[np.bool_]:
        """(rows + 1, cols + 1, 4) whether a wall leaves each corner to the east, west, south (row + 1), north."""
        rows, cols = self.along.shape[0], self.across.shape[1]
        found = np.zeros((rows + 1, cols + 1, 4), bool)
        found[:, :-1, 0] = found[:, 1:, 1] = self.across
        found[:-1, :, 2] = found[1:, :, 3] = self.along
        return found

    def corners(self) -> NDArray[np.bool_]:
        """(rows + 1, cols + 1) corners of cells at which a wall stands."""
        return np.asarray(self.ways().any(axis=2), bool)


class Chain(NamedTuple):
    """A line of walls from corner to corner without a fork."""

    corners: NDArray[np.int64]
    """(N + 1, 2) row and column of cell corners; the first equals the last where `is_closed`."""
    is_closed: bool

    @property
    def steps(self) -> NDArray[np.int64]:
        """(N, 2)."""
        return np.diff(self.corners, axis=0)

    def cells(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """(row, col) of the cells on the left and on the right of every step, each (N, 2); -z is left of +x."""
        start, step = self.corners[:-1], self.steps
        second = np.minimum(start, start + step)  # south or east of the step
        first = second + np.where((step[:, 0] == 0)[:, None], [-1, 0], [0, -1])  # north or west of it
        forward = (step[:, 1] == 1) | (step[:, 0] == -1)
        return np.where(forward[:, None], first, second), np.where(forward[:, None], second, first)


def chains_of(walls: WallLines) -> list[Chain]:
    """All chains; forks and free ends are their ends, everything else is a loop."""
    ways = walls.ways()
    left = ways.copy()
    degree = ways.sum(axis=2)
    found = []
    ends = np.argwhere((degree > 0) & (degree != 2))
    for start in ends.tolist():
        for way in range(4):
            if left[start[0], start[1], way]:
                found.append(Chain(_followed(start, way, left, degree), False))
    for start in np.argwhere((degree == 2) & left.any(axis=2)).tolist():
        if left[start[0], start[1]].any():
            way = int(left[start[0], start[1]].argmax())
            found.append(Chain(_followed(start, way, left, degree), True))
    return found


def _followed(start: list[int], way: int, left: NDArray[np.bool_], degree: NDArray[np.int64]) -> NDArray[np.int64]:
    """The corners from `start` on until a fork, an end or the start; takes the steps out of `left`."""
    row, col = start
    corners = [(row, col)]
    while True:
        left[row, col, way] = False
        row, col = row + _STEPS[way][0], col + _STEPS[way][1]
        left[row, col, way ^ 1] = False
        corners.append((row, col))
        following = left[row, col].nonzero()[0]
        if degree[row, col] != 2 or not len(following):
            return np.array(corners)
        way = int(following[0])


def without_bits(walls: WallLines) -> WallLines:
    """The walls without short stumps and without scraps that touch no other wall."""
    across, along = walls.across.copy(), walls.along.copy()
    degree = walls.ways().sum(axis=2)
    for chain in chains_of(walls):
        ends = degree[chain.corners[[0, -1], 0], chain.corners[[0, -1], 1]]
        if not chain.is_closed and len(chain.corners) <= _STUMP and (ends == 1).any():
            _erase(across, along, chain.corners)
    return _without_scraps(WallLines(across, along))


def _erase(across: NDArray[np.bool_], along: NDArray[np.bool_], corners: NDArray[np.int64]) -> None:
    low = np.minimum(corners[:-1], corners[1:])
    is_across = np.diff(corners[:, 0]) == 0
    across[tuple(low[is_across].T)] = False
    along[tuple(low[~is_across].T)] = False


def _without_scraps(walls: WallLines) -> WallLines:
    rows, cols = walls.along.shape[0], walls.across.shape[1]
    r, c = np.nonzero(walls.across)
    a_across = r * (cols + 1) + c
    r2, c2 = np.nonzero(walls.along)
    a_along = r2 * (cols + 1) + c2
    a = np.concatenate([a_across, a_along])
    b = np.concatenate([a_across + 1, a_along + cols + 1])
    num = (rows + 1) * (cols + 1)
    _, part = connected_components(coo_array((np.ones(len(a), bool), (a, b)), shape=(num, num)), directed=False)
    keep = np.bincount(part[a], minlength=part.max() + 1)[part[a]] >= _SCRAP
    across, along = np.zeros_like(walls.across), np.zeros_like(walls.along)
    across[r, c], along[r2, c2] = keep[: len(r)], keep[len(r) :]
    return WallLines(across, along)
