"""Storeys: the heights that belong to one, the storey of a point, and the storeys of a home."""

from collections.abc import Sequence
from typing import overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim.errors import SceneError
from sim.types import STOREY_GAP

BELOW_FLOOR = 0.3
"""A point this far below a storey's lowest floor still belongs to it (floors are noisy), metres."""
_MIN_SHARE = 0.1
"""Islands and levels smaller than this share of the largest are not storeys (table tops, landings)."""
_MIN_COVERED = 0.1
"""An island with less than this share of ceiling over it, while others have one, is a roof, not a storey."""
_LEVEL = 0.25
"""Floor up to this far from a storey's typical height is at that storey's level, metres."""


@overload
def same_storey(y: float, other_y: float) -> bool: ...
@overload
def same_storey(y: NDArray[np.floating], other_y: float | NDArray[np.floating]) -> NDArray[np.bool_]: ...
def same_storey(y, other_y):
    """Whether floors, or robots' feet, at these heights (...) lie on one storey: less than STOREY_GAP apart."""
    return abs(y - other_y) < STOREY_GAP


def nearest_storey(y: ArrayLike, floors: ArrayLike) -> NDArray[np.int64]:
    """Index (...) of the storey whose floor is nearest to each height (...); the first wins ties."""
    return np.abs(np.subtract.outer(y, floors)).argmin(axis=-1)


def storey_of(y: float, storeys: Sequence[tuple[float, float]]) -> int:
    """Index of the storey (lowest, highest floor) of anything at height `y`, things on shelves included: the highest
    storey whose floor is not above it."""
    return max((index for index, (low, _) in enumerate(storeys) if y >= low - BELOW_FLOOR), default=0)


def storey_clusters(heights: NDArray[np.floating]) -> list[tuple[float, float]]:
    """(lowest, highest) of each group of heights (N,) whose sorted neighbours are on one storey, ascending."""
    ordered = np.sort(np.asarray(heights, float))
    if not len(ordered):
        return []
    breaks = np.flatnonzero(~same_storey(ordered[1:], ordered[:-1]))
    firsts, lasts = np.append(0, breaks + 1), np.append(breaks, len(ordered) - 1)
    return [(float(ordered[a]), float(ordered[b])) for a, b in zip(firsts, lasts, strict=True)]


def no_such_storey(storey_y: float | None, heights: Sequence[float]) -> SceneError:
    """The error of a map that has no floor at this height; `heights` are those of its storeys."""
    known = ", ".join(f"{height:.2f}" for height in heights)
    return SceneError(
        f"navigation: no free cell at storey_y {storey_y!r}; expected a height near one of [{known}]. "
        "Pass one of storey_heights."
    )


def storey_levels(
    y: NDArray[np.float64], islands: NDArray[np.int32], covered: NDArray[np.bool_] | None
) -> tuple[float, ...]:
    """Typical height of each storey, ascending and at least STOREY_GAP apart.

    Levels are peaks of the height histogram, so a stair does not merge two storeys; levels within STOREY_GAP of a
    larger one belong to it.
    """
    left = y[_large_indoors(islands, covered)[islands]]
    levels: list[float] = []
    largest = 0
    while len(left):
        bins = np.round(left / 0.1).astype(np.int64)
        low = bins.min()
        counts = np.convolve(np.bincount(bins - low), [1, 1, 1], mode="same")
        near = left[np.abs(left - 0.1 * (counts.argmax() + low)) <= _LEVEL]
        if levels and len(near) < _MIN_SHARE * largest:
            break
        largest = largest or len(near)
        levels.append(float(np.median(near)))
        left = left[~same_storey(left, levels[-1])]
    return tuple(sorted(levels))


def is_on_storey_island(
    y: NDArray[np.float64], islands: NDArray[np.int32], covered: NDArray[np.bool_] | None, levels: Sequence[float]
) -> NDArray[np.bool_]:
    """(N,) whether each floor lies on an island that is part of a storey; `levels` are those of `storey_levels`.

    Such an island is large, is no roof and has floor at a storey's level. Tops of tables and beds are not.
    """
    is_level = (np.abs(np.subtract.outer(y, levels)) <= _LEVEL).any(axis=1)
    has_level = np.bincount(islands, weights=is_level) > 0
    return (_large_indoors(islands, covered) & has_level)[islands]


def _large_indoors(islands: NDArray[np.int32], covered: NDArray[np.bool_] | None) -> NDArray[np.bool_]:
    """(I,) whether each island is large enough for a storey, and no roof."""
    sizes = np.bincount(islands)
    matters = sizes >= _MIN_SHARE * sizes.max()
    if covered is not None:
        under_roof = np.bincount(islands, weights=covered) / sizes
        if under_roof[matters].max() > 0.5:
            matters &= under_roof >= _MIN_COVERED
    return matters
