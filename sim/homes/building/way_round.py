"""Whether places that lie near each other are far apart for someone who walks; used by cell_spaces to find walls."""

import numpy as np
from numpy.typing import NDArray

from sim.compiled import njit

_DETOUR = 1.5
_SLACK = 3
"""Places are apart when the way round is longer than _DETOUR times the straight one and _SLACK cells."""


def are_apart(free: NDArray[np.bool_], rc_a: NDArray[np.int64], rc_b: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether the way from each a to its b through free cells is a long way round, or there is none.

    Args:
        free: (rows, cols) where one can go, in four directions.
        rc_a: (N, 2) free cells.
        rc_b: (N, 2) free cells.

    Returns:
        (N,).
    """
    if not len(rc_a):
        return np.zeros(0, bool)
    pairs, which = np.unique(np.concatenate([rc_a, rc_b], axis=1), axis=0, return_inverse=True)
    return _apart(free, pairs)[which.reshape(-1)]


@njit(cache=True, nogil=True)
def _apart(free, pairs):
    rows, cols = free.shape
    found = np.ones(len(pairs), np.bool_)
    seen = np.full((rows, cols), -1, np.int64)
    queue = np.empty((rows * cols, 3), np.int32)
    for n in range(len(pairs)):
        r0, c0, r1, c1 = pairs[n, 0], pairs[n, 1], pairs[n, 2], pairs[n, 3]
        limit = int(_DETOUR * (abs(r0 - r1) + abs(c0 - c1))) + _SLACK
        queue[0, 0], queue[0, 1], queue[0, 2] = r0, c0, 0
        seen[r0, c0] = n
        first, last = 0, 1
        while first < last and found[n]:
            r, c, steps = queue[first, 0], queue[first, 1], queue[first, 2]
            first += 1
            if r == r1 and c == c1:
                found[n] = False
            for side in range(4):
                rr = r + (side == 0) - (side == 1)
                cc = c + (side == 2) - (side == 3)
                if rr < 0 or cc < 0 or rr >= rows or cc >= cols or not free[rr, cc] or seen[rr, cc] == n:
                    continue
                if steps + 1 + abs(rr - r1) + abs(cc - c1) <= limit:
                    seen[rr, cc] = n
                    queue[last, 0], queue[last, 1], queue[last, 2] = rr, cc, steps + 1
                    last += 1
    return found
