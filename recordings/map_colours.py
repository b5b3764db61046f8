"""Colours that show how alike the vectors of a map are: their three strongest directions as red, green, blue."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

_TAIL = 2.0
"""Percent of cells at either end of a channel that get its limit: a few odd cells would grey out all others."""
GREY = 128


def vector_rgb(blocks: Sequence[NDArray[np.float32]]) -> list[NDArray[np.uint8]]:
    """(N_i, 3) colours of vectors (N_i, E), one colour scale for all blocks; like colours stand for like vectors.

    Principal components of all vectors together; the sign of each is fixed, so that the same map gets the same colours.
    Directions in which nothing differs are grey.
    """
    rows = np.concatenate([np.asarray(block, np.float64) for block in blocks]) if blocks else np.empty((0, 3))
    if not len(rows):
        return [np.empty((0, 3), np.uint8) for _ in blocks]
    centred = rows - rows.mean(axis=0)
    # eigenvectors of the smaller of the two products: maps have hundreds of cells, vectors hundreds of numbers
    _, spread, directions = np.linalg.svd(centred, full_matrices=False)
    directions = directions[:3] * np.sign(directions[:3, np.abs(directions[:3]).argmax(axis=1)].diagonal())[:, None]
    parts = np.zeros((len(rows), 3))
    known = spread[:3] > 1e-9 * max(float(spread[0]), 1.0)
    parts[:, : len(known)] = (centred @ directions.T) * known
    low, high = np.percentile(parts, [_TAIL, 100 - _TAIL], axis=0)
    share = np.divide(parts - low, high - low, out=np.full_like(parts, GREY / 255), where=high > low)
    colours = np.round(np.clip(share, 0, 1) * 255).astype(np.uint8)
    return list(np.split(colours, np.cumsum([len(block) for block in blocks])[:-1]))
