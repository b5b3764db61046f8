"""Where OneMap goes next: frontiers of the explored area, points of interest, and cells that may hold the target.

Images of a `FeatureGrid` -> `MapGoal`s with scores of one scale (similarity + 1) -> the chosen one.
"""

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from sim.compiled import njit
from sim.homes.images import widened

ISLAND_CELLS = 100
"""Unexplored islands with fewer cells count as explored: 1 m2 (OneMap's code)."""
LEAST_RUN = 3
"""Least number of border cells of a frontier (OneMap's code)."""
LOOK_CELLS = 25
"""A frontier's score looks this many cells past it, along seen cells: 2.5 m (OneMap's code)."""
PEAK_WINDOW, PEAK_SHARE, LEAST_REGION = 10, 0.8, 2
"""Side of the window in which a point of interest is the best, share of its value that the cells of its region reach,
and their least number (OneMap's code)."""
POINT_REACH = 15
"""Points of interest lie in the explored area or this near to it, cells (OneMap's code)."""
STICK_CELLS, STICK_GAIN = 5.0, 0.01
"""The last goal is kept while one lies within this distance (cells) and scores no more than this below it (VLFM)."""
HOT_PERCENT, HOT_REACH = 99, 3
"""The target is believed only within this many cells of cells above this percentile of similarity (OneMap's
configuration: percentile_exploitation 99, and a 7 x 7 square)."""
_TIE = 1e-6
"""Similarities closer than this are equal."""
_EIGHT = np.ones((3, 3))
_CROSS = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]], bool)


class MapGoal(NamedTuple):
    """One place that is worth going to."""

    kind: Literal["frontier", "point"]
    """A frontier of the explored area, or a point of interest: a similar place that was not looked at closely."""
    rc: tuple[int, int]
    """Its cell."""
    score: float
    """The greatest similarity there or behind it, plus 1."""


def explored_region(is_explored: NDArray[np.bool_], is_navigable: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(rows, cols) the largest connected part of the explored navigable cells, with small islands filled."""
    filled = is_explored & is_navigable
    holes = _labelled(~filled, None)
    sizes = np.bincount(holes.ravel())
    at_border = np.unique(np.concatenate([holes[0], holes[-1], holes[:, 0], holes[:, -1]]))
    is_island = sizes < ISLAND_CELLS
    is_island[at_border] = False
    is_island[0] = False
    filled = filled | is_island[holes]
    parts = _labelled(filled, _EIGHT)
    sizes = np.bincount(parts.ravel())
    sizes[0] = 0
    return parts == sizes.argmax() if sizes.any() else np.zeros(filled.shape, bool)


def frontiers(
    region: NDArray[np.bool_],
    is_navigable: NDArray[np.bool_],
    similarity: NDArray[np.float32],
    is_seen: NDArray[np.bool_],
) -> list[MapGoal]:
    """Frontiers of the explored region, from top to bottom.

    A frontier is a connected run of the region's border cells without an obstacle beside them. Its goal is the cell of
    the run nearest to the run's middle.
    """
    is_clear = ndimage.minimum_filter(is_navigable.view(np.uint8), 3, mode="constant") > 0
    border = region & is_clear & (ndimage.minimum_filter(region.view(np.uint8), footprint=_CROSS) == 0)
    runs = _labelled(border, _EIGHT)
    found = []
    for index, part in enumerate(ndimage.find_objects(runs), start=1):
        corner = np.array([part[0].start, part[1].start])
        cells = np.argwhere(runs[part] == index) + corner
        if len(cells) >= LEAST_RUN:
            away = ((cells - cells.mean(axis=0)) ** 2).sum(axis=1)
            row, col = cells[away.argmin()].tolist()
            score = _best_behind(similarity, is_seen, row, col, LOOK_CELLS)
            found.append(MapGoal("frontier", (row, col), float(score)))
    return found


def points_of_interest(
    similarity: NDArray[np.float32],
    is_seen: NDArray[np.bool_],
    *,
    region: NDArray[np.bool_],
    is_explored: NDArray[np.bool_],
    is_checked: NDArray[np.bool_],
) -> list[MapGoal]:
    """Places of high similarity near the explored area that were not looked at closely since the query, best first.

    A region grows around each peak of similarity, the highest first; a lower peak in a grown region is no peak.
    There are none where all cells are equally similar.
    """
    low, high = min(float(similarity.min()), 0.0), max(float(similarity.max()), 0.0)
    if high - low < _TIE:
        return []
    scaled = (similarity - low) / (high - low)
    is_peak = (ndimage.maximum_filter(scaled, PEAK_WINDOW) == scaled) & is_seen
    is_peak &= ndimage.minimum_filter(scaled, PEAK_WINDOW) < scaled - _TIE  # a plateau has no peak
    peaks = np.argwhere(is_peak)
    peaks = peaks[np.argsort(-scaled[peaks[:, 0], peaks[:, 1]], kind="stable")]
    sizes = _grown(scaled.astype(np.float32), is_seen, peaks, PEAK_SHARE)
    inside = np.argwhere(region)
    return [
        MapGoal("point", (row, col), float(similarity[row, col]) + 1)
        for (row, col), size in zip(peaks.tolist(), sizes, strict=True)
        if size >= LEAST_REGION and not is_checked[row, col] and (is_explored[row, col] or _is_near(inside, row, col))
    ]


def chosen(goals: Sequence[MapGoal], last: MapGoal | None) -> MapGoal:
    """The goal with the best score, or the one at or near the last goal unless it scores clearly less than that did.

    Args:
        goals: At least one.
        last: The goal until now, with its score when it was chosen.
    """
    if last is not None:
        nearest = min(goals, key=lambda goal: math.dist(goal.rc, last.rc))
        if math.dist(nearest.rc, last.rc) <= STICK_CELLS and nearest.score + STICK_GAIN > last.score:
            return nearest
    return max(goals, key=lambda goal: goal.score)


def hot_cells(similarity: NDArray[np.float32], is_seen: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(rows, cols) the consensus filter: cells so similar to the text that a detection there is believed.

    The most similar hundredth of the seen cells, and cells within HOT_REACH of them. Where the best cells are equal and
    more than a hundredth, all of them; none where all cells are equally similar.
    """
    values = similarity[is_seen]
    if not len(values) or float(np.ptp(values)) < _TIE:
        return np.zeros(similarity.shape, bool)
    limit = min(float(np.percentile(values, HOT_PERCENT)), float(values.max()) - _TIE)
    is_best = is_seen & (similarity > limit)
    return widened(is_best, HOT_REACH)


def _is_near(inside: NDArray[np.int64], row: int, col: int) -> bool:
    """Whether a cell lies less than POINT_REACH from the nearest of those inside, or there are none."""
    away = (inside[:, 0] - row) ** 2 + (inside[:, 1] - col) ** 2
    return not len(inside) or int(away.min()) < POINT_REACH**2


def _labelled(mask: NDArray[np.bool_], structure: NDArray | None) -> NDArray[np.int32]:
    return ndimage.label(mask, structure=structure)[0]  # type: ignore[index,return-value]  # scipy's stubs


@njit(cache=True, nogil=True)
def _best_behind(similarity, is_seen, row, col, reach):
    """Greatest similarity + 1 of the seen cells at most `reach` steps to a side away, along seen cells; 0 unseen."""
    rows, cols = similarity.shape
    if not is_seen[row, col]:
        return 0.0
    side = 2 * reach + 1
    was_at = np.zeros((side, side), np.bool_)
    queue = np.empty((side * side, 3), np.int32)
    queue[0, 0], queue[0, 1], queue[0, 2] = row, col, 0
    was_at[reach, reach] = True
    best, first, last = similarity[row, col], 0, 1
    while first < last:
        r, c, steps = queue[first]
        first += 1
        best = max(best, similarity[r, c])
        if steps == reach:
            continue
        for dr, dc in ((-1, 0), (1, 0), (0, -1), (0, 1)):
            to_r, to_c = r + dr, c + dc
            if not (0 <= to_r < rows and 0 <= to_c < cols) or was_at[to_r - row + reach, to_c - col + reach]:
                continue
            was_at[to_r - row + reach, to_c - col + reach] = True
            if is_seen[to_r, to_c]:
                queue[last, 0], queue[last, 1], queue[last, 2] = to_r, to_c, steps + 1
                last += 1
    return best + 1.0


@njit(cache=True, nogil=True)
def _grown(values, is_seen, peaks, least_share):
    """(P,) cells of the region around each peak with at least its value times the share; 0 for one in a region."""
    rows, cols = values.shape
    is_taken = np.zeros((rows, cols), np.bool_)
    queue = np.empty((rows * cols, 2), np.int32)
    sizes = np.zeros(len(peaks), np.int64)
    for p in range(len(peaks)):
        row, col = peaks[p]
        if is_taken[row, col]:
            continue
        limit = values[row, col] * least_share
        is_taken[row, col] = True
        queue[0, 0], queue[0, 1] = row, col
        first, last = 0, 1
        while first < last:
            r, c = queue[first]
            first += 1
            for dr in range(-1, 2):
                for dc in range(-1, 2):
                    to_r, to_c = r + dr, c + dc
                    if not (0 <= to_r < rows and 0 <= to_c < cols) or is_taken[to_r, to_c]:
                        continue
                    if is_seen[to_r, to_c] and values[to_r, to_c] >= limit:
                        is_taken[to_r, to_c] = True
                        queue[last, 0], queue[last, 1] = to_r, to_c
                        last += 1
        sizes[p] = last
    return sizes
