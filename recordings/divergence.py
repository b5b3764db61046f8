"""Where a run leaves the shortest path, how far it strays, and where two runs part. Pure: arrays in, figures out.

A run strays by the planar distance from its feet to the nearest place of the path on the same storey. It leaves the
path at its first pose that is more than LIMIT away. Two runs go together as long as both can be walked forwards, each
at its own pace, with the two walkers within LIMIT of each other (the discrete Frechet distance); they part at the
first pose of each that cannot be reached like that. So a detour counts where it begins, a pause or a turn never.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.walk.storeys import same_storey

LIMIT = 1.0
"""Metres within which a run follows a path: the success radius."""
_PIECE = 0.25
"""Longest piece into which a path is cut, metres: a long one can climb from one storey to the next."""


@dataclass(frozen=True, slots=True)
class Departure:
    """The first pose of a run that is off another way."""

    row: int
    """Number of actions taken until then, 0 at the start."""
    path_m: float
    """Metres walked until then."""


@dataclass(frozen=True, slots=True)
class Stray:
    """How one run keeps to the shortest path."""

    deviation: NDArray[np.float64]
    """(T + 1,) `path_deviation` at the start and after each step."""
    departure: Departure | None
    """None for a run that never leaves the path."""


@dataclass(frozen=True, slots=True)
class Divergence:
    """How the runs of an episode keep to the shortest path, and two of them to each other."""

    strays: tuple[Stray | None, ...]
    """One per run; None for those that do not walk, and for all where there is no path."""
    pair: tuple[int, int] | None = None
    """Which two runs are held against each other."""
    parted: tuple[Departure, Departure] | None = None
    """Where those two part; None where one goes along the other's way to its end."""


def divergence_of(
    ways: Sequence[NDArray[np.float64] | None], path: NDArray[np.float64] | None, *, pair: tuple[int, int] | None
) -> Divergence:
    """The divergence of several runs.

    Args:
        ways: Feet (T + 1, 3) of each run; None for runs that do not walk.
        path: (K, 3) the shortest path; None where there is none.
        pair: Which two runs to hold against each other.
    """
    strays: list[Stray | None] = []
    for way in ways:
        if way is None or path is None:
            strays.append(None)
            continue
        deviation = path_deviation(way, path)
        strays.append(Stray(deviation, departure(way, deviation)))
    first, second = (None, None) if pair is None else (ways[pair[0]], ways[pair[1]])
    parted = None if first is None or second is None else parting(first, second)
    return Divergence(tuple(strays), pair, parted)


def path_deviation(positions: NDArray[np.float64], path: NDArray[np.float64]) -> NDArray[np.float64]:
    """Planar metres (T,) from feet (T, 3) to the path (K, 3), K >= 1; inf where no piece of it is on their storey."""
    starts, ends = _pieces(path)
    along = (ends - starts)[:, [0, 2]]  # (P, 2)
    squared = np.maximum((along**2).sum(axis=1), 1e-18)
    offsets = positions[:, None, [0, 2]] - starts[:, [0, 2]]  # (T, P, 2)
    share = np.clip((offsets * along).sum(axis=-1) / squared, 0.0, 1.0)
    nearest_y = starts[:, 1] + share * (ends - starts)[:, 1]
    apart = np.linalg.norm(offsets - share[..., None] * along, axis=-1)
    on_storey = same_storey(positions[:, None, 1], nearest_y)
    return np.where(on_storey, apart, np.inf).min(axis=1)


def departure(positions: NDArray[np.float64], deviation: NDArray[np.float64]) -> Departure | None:
    """Where a run (T, 3) first strays by more than LIMIT, from its `path_deviation` (T,); None if it never does."""
    off = np.flatnonzero(deviation > LIMIT)
    return _departure(positions, int(off[0])) if len(off) else None


def parting(first: NDArray[np.float64], second: NDArray[np.float64]) -> tuple[Departure, Departure] | None:
    """Where the ways of two runs, feet (T, 3) and (U, 3), part: a place on each.

    None when one of them ends before, that is, when its whole way lies along the other's.
    """
    shared_first, shared_second = _shared_rows(first, second)
    if shared_first == len(first) or shared_second == len(second):
        return None
    return _departure(first, shared_first), _departure(second, shared_second)


def _shared_rows(first: NDArray[np.float64], second: NDArray[np.float64]) -> tuple[int, int]:
    """How many poses of each run can be reached with the walkers never more than LIMIT apart."""
    columns = np.arange(len(second))
    reached = np.zeros(len(second), bool)  # columns reached with the first walker at the row before
    rows, furthest = 0, -1
    for row, position in enumerate(first):
        offsets = second - position
        near = np.hypot(offsets[:, 0], offsets[:, 2]) <= LIMIT
        near &= same_storey(second[:, 1], position[1])
        entered = reached | np.append(row == 0, reached[:-1])  # from the pose before of the first, or of both
        # the second walker may go on alone from an entered column until a column that is not near
        last_entered = np.maximum.accumulate(np.where(entered & near, columns, -1))
        last_far = np.maximum.accumulate(np.where(near, -1, columns))
        reached = last_entered > last_far
        if not reached.any():
            break
        rows, furthest = row + 1, max(furthest, int(np.flatnonzero(reached)[-1]))
    return rows, furthest + 1


def _departure(positions: NDArray[np.float64], row: int) -> Departure:
    walked = np.linalg.norm(np.diff(positions[: row + 1], axis=0), axis=1).sum()
    return Departure(row, float(walked))


def _pieces(path: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Ends (P, 3) and (P, 3) of pieces of at most _PIECE metres; a path of one point is one piece of no length."""
    points = [path[:1]]
    for start, end in itertools.pairwise(path):
        count = max(1, int(np.ceil(np.linalg.norm(end - start) / _PIECE)))
        points.append(start + (end - start) * (np.arange(1, count + 1) / count)[:, None])
    cut = np.concatenate(points)
    return (cut[:-1], cut[1:]) if len(cut) > 1 else (cut, cut)
