"""Weighted sums of vectors by cell of an endless lattice; only cells that were touched take memory."""

import numpy as np
from numpy.typing import NDArray

_FIRST_CELLS = 64


class CellSums:
    """Sums of one storey; cells are (row, col) of a lattice whose cell (0, 0) begins at the frame's origin."""

    def __init__(self, dim: int) -> None:
        """Starts without cells; vectors have E = `dim` numbers."""
        self._place: dict[tuple[int, int], int] = {}
        self._sums = np.zeros((_FIRST_CELLS, dim))
        self._weights = np.zeros(_FIRST_CELLS)

    def __len__(self) -> int:
        """The number of touched cells."""
        return len(self._place)

    def add(self, rc: NDArray[np.integer], vectors: NDArray[np.floating], weights: NDArray[np.floating]) -> None:
        """Adds `weights` (N,) times `vectors` (N, E) to the cells `rc` (N, 2), in which cells may repeat."""
        if not len(rc):
            return
        cells, inverse = np.unique(rc, axis=0, return_inverse=True)
        inverse = inverse.reshape(-1)
        order = np.argsort(inverse, kind="stable")
        firsts = np.searchsorted(inverse[order], np.arange(len(cells)))
        weighted = vectors[order] * weights[order, None].astype(vectors.dtype)
        parts = np.add.reduceat(weighted, firsts, axis=0)
        places = [self._place.setdefault((row, col), len(self._place)) for row, col in cells.tolist()]
        self._grow()
        self._sums[places] += parts
        self._weights[places] += np.bincount(inverse, weights, len(cells))

    def cells(self) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
        """(M, 2) cells, (M, E) sums and (M,) sums of weights, in the order in which the cells were first touched."""
        count = len(self._place)
        rc = np.array(list(self._place), np.int64).reshape(-1, 2)
        return rc, self._sums[:count].copy(), self._weights[:count].copy()

    def _grow(self) -> None:
        missing = len(self._place) - len(self._weights)
        if missing > 0:
            more = max(missing, len(self._weights))
            self._sums = np.concatenate([self._sums, np.zeros((more, self._sums.shape[1]))])
            self._weights = np.concatenate([self._weights, np.zeros(more)])
