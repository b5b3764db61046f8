"""DBSCAN of points: clusters are places where many points lie close together.

Points of a mask -> `density_clusters` -> `object_cloud`. No library of this program has it for dense clouds in
milliseconds.
"""

import numpy as np
from numpy.typing import NDArray

from sim.compiled import njit


def density_clusters(points: NDArray[np.float64], *, reach: float, least: int) -> NDArray[np.int64]:
    """(N,) number of each point's cluster, from 0 in the order of their first core points; -1 = in none.

    A core point has at least `least` points, itself included, within `reach`. Core points within `reach` of each other
    are in one cluster; another point is in the first cluster that has a core point within `reach` of it.

    Args:
        points: (N, 3), metres.
        reach: Metres.
        least: Number of points.
    """
    if not len(points):
        return np.zeros(0, np.int64)
    cells = np.floor((points - points.min(axis=0)) / reach).astype(np.int64) + 1
    shape = cells.max(axis=0) + 2
    keys = (cells[:, 0] * shape[1] + cells[:, 1]) * shape[2] + cells[:, 2]
    order = np.argsort(keys, kind="stable")
    used, starts = np.unique(keys[order], return_index=True)
    steps = np.array([(i * shape[1] + j) * shape[2] + k for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1)])
    beside = np.searchsorted(used, used[:, None] + steps)  # (cells, 27) places of the neighbouring cells
    is_used = (beside < len(used)) & (used[np.minimum(beside, len(used) - 1)] == used[:, None] + steps)
    return _grown(
        np.ascontiguousarray(points, np.float64),
        np.searchsorted(used, keys),
        np.where(is_used, beside, -1),
        order,
        np.append(starts, len(points)),
        reach**2,
        least,
    )


@njit(cache=True, nogil=True)
def _grown(points, cell_of, beside, order, starts, reach2, least):
    """(N,) clusters.

    Args:
        points: (N, 3).
        cell_of: (N,) cell of each point.
        beside: (cells, 27) neighbouring cells, itself included, -1 = none.
        order: (N,) points by cell; changed.
        starts: (cells + 1,) where each cell's points begin in `order`.
        reach2: Square of the reach.
        least: Number of points.
    """
    num_points = len(points)
    is_core = np.zeros(num_points, np.bool_)
    for i in range(num_points):
        count = 0
        for cell in beside[cell_of[i]]:
            if cell < 0 or count >= least:
                continue
            for k in range(starts[cell], starts[cell + 1]):
                count += _apart2(points, i, order[k]) <= reach2
                if count >= least:
                    break
        is_core[i] = count >= least
    labels = np.full(num_points, -1)
    ends = starts[1:].copy()  # points of a cell that are in no cluster yet come before its end
    stack = np.empty(num_points, np.int64)
    num_clusters = 0
    for first in range(num_points):
        if not is_core[first] or labels[first] >= 0:
            continue
        labels[first], stack[0], size = num_clusters, first, 1
        while size:
            size -= 1
            at = stack[size]
            for cell in beside[cell_of[at]]:
                if cell < 0:
                    continue
                k = starts[cell]
                while k < ends[cell]:
                    other = order[k]
                    is_new = labels[other] < 0
                    if is_new and _apart2(points, at, other) > reach2:
                        k += 1
                        continue
                    if is_new:
                        labels[other] = num_clusters
                        if is_core[other]:
                            stack[size] = other
                            size += 1
                    ends[cell] -= 1
                    order[k] = order[ends[cell]]
        num_clusters += 1
    return labels


@njit(cache=True, nogil=True)
def _apart2(points, i, j):
    """Square of the distance between two points."""
    return (points[i, 0] - points[j, 0]) ** 2 + (points[i, 1] - points[j, 1]) ** 2 + (points[i, 2] - points[j, 2]) ** 2
