"""Finds equal rows of a table; used to join vertices of meshes."""

import numpy as np
from numpy.typing import NDArray

from sim.compiled import njit


def numbered(rows: NDArray[np.int32]) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Numbers the distinct rows of a table (N, K) in order of first appearance.

    Returns:
        The index of the first row of each number (M,), and the number of each row (N,).
    """
    first = _first_of_equal(np.ascontiguousarray(rows))
    is_first = first == np.arange(len(rows))
    return np.flatnonzero(is_first), (np.cumsum(is_first) - 1)[first].astype(np.int32)


@njit(cache=True, nogil=True)
def _first_of_equal(rows):
    """(N,) index of the first row equal to each of `rows` (N, K) int32."""
    count, width = rows.shape
    size = 1
    while size < 2 * count + 1:
        size *= 2
    table = np.full(size, -1, np.int64)
    first = np.empty(count, np.int64)
    for i in range(count):
        mixed = np.uint64(1469598103934665603)
        for k in range(width):
            mixed = (mixed ^ np.uint64(np.uint32(rows[i, k]))) * np.uint64(1099511628211)
            mixed ^= mixed >> np.uint64(29)
        at = np.int64(mixed & np.uint64(size - 1))
        while True:
            j = table[at]
            if j < 0:
                table[at] = i
                first[i] = i
                break
            same = True
            for k in range(width):
                if rows[i, k] != rows[j, k]:
                    same = False
                    break
            if same:
                first[i] = j
                break
            at = (at + 1) & (size - 1)
    return first
