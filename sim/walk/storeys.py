"""Which parts of a floor grid hang together, and at which heights its storeys lie."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from sim.types import STOREY_GAP

_MIN_SHARE = 0.1
"""Islands and levels smaller than this share of the largest are no storeys (table tops, landings)."""
_MIN_COVERED = 0.1
"""An island with less than this share of ceiling over it, while others have one, is a roof and no storey."""


def connected_parts(links: NDArray[np.int32]) -> NDArray[np.int32]:
    """(N,) connected part of each node."""
    count = len(links)
    node, side = np.nonzero(links[:, :4] >= 0)
    pairs = coo_matrix((np.ones(len(node), bool), (node, links[node, side])), shape=(count, count))
    return connected_components(pairs, directed=False)[1]


def storey_levels(
    y: NDArray[np.float64], islands: NDArray[np.int32], covered: NDArray[np.bool_] | None
) -> tuple[float, ...]:
    """Typical height of each storey, ascending and at least STOREY_GAP apart.

    Levels are peaks of the height histogram, so a stair does not merge two storeys; what lies within STOREY_GAP of a
    larger level belongs to it.
    """
    sizes = np.bincount(islands)
    matters = sizes >= _MIN_SHARE * sizes.max()
    if covered is not None:
        under_roof = np.bincount(islands, weights=covered) / sizes
        if under_roof[matters].max() > 0.5:
            matters &= under_roof >= _MIN_COVERED
    left = y[matters[islands]]
    levels: list[float] = []
    largest = 0
    while len(left):
        bins = np.round(left / 0.1).astype(np.int64)
        low = bins.min()
        counts = np.convolve(np.bincount(bins - low), [1, 1, 1], mode="same")
        near = left[np.abs(left - 0.1 * (counts.argmax() + low)) <= 0.25]
        if levels and len(near) < _MIN_SHARE * largest:
            break
        largest = largest or len(near)
        levels.append(float(np.median(near)))
        left = left[np.abs(left - levels[-1]) >= STOREY_GAP]
    return tuple(sorted(levels))
