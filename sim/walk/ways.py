"""Compares the ways that runs walked, with the shortest path and with each other: how far apart, and where they part.

A way is the feet of a run, (T, 3) world metres, at the start and after each step. docs/metrics.md has the formulas.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.types import SUCCESS_RADIUS, Action, Pose

from .storeys import same_storey

LIMIT = SUCCESS_RADIUS
"""Largest distance at which a run still follows a path, metres."""
Decisions = Sequence[tuple[Action | None, Pose]]
"""A run's start, without an action, and then each action with the pose after it."""
_PIECE = 0.25
"""Longest piece into which a path is cut, metres: the robot's step. A long one can climb from storey to storey."""
_SAME_PLACE, _SAME_ANGLE = 0.01, 0.01
"""Differences of poses that are rounding, metres and radians."""
_SAME_FEET = 1e-6
"""Metres below which the feet did not move."""


@dataclass(frozen=True, slots=True)
class Departure:
    """The first pose of a run that is off the path, or off another run's way."""

    row: int
    """Number of actions taken until then, 0 at the start."""
    path_m: float
    """Metres walked until then."""


@dataclass(frozen=True, slots=True)
class Apart:
    """How far a way is from another one, by dynamic time warping (DTW) and at the ends."""

    dtw_m: float
    """DTW divided by the number of places of the longer way: metres per place."""
    ndtw: float
    """exp(-DTW / (number of the other way's places x 1 m)): 1 = the same way, towards 0 the further apart."""
    end_m: float
    """Metres between the ends."""


def apart(way: NDArray[np.float64], other: NDArray[np.float64]) -> Apart:
    """How far a way (T, 3) is from another one (U, 3), which is the reference of nDTW; T and U >= 1.

    Places follow each other without those where the feet stayed, so that turns and pauses do not count. Distances are
    straight lines in 3-D: on one storey they are planar, another storey is at least its height away, walls do not
    count.
    """
    walked, reference = _moved(way), _moved(other)
    total = warped_distance(walked, reference)
    return Apart(
        dtw_m=total / max(len(walked), len(reference)),
        ndtw=math.exp(-total / (len(reference) * LIMIT)),
        end_m=math.dist(way[-1], other[-1]),
    )


def apart_from_path(way: NDArray[np.float64], path: NDArray[np.float64]) -> Apart:
    """`apart` from a shortest path, given by its corners (K, 3), K >= 1: one place every 25 cm or less."""
    return apart(way, cut(path))


def warped_distance(first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
    """DTW of (T, 3) and (U, 3), metres: the smallest sum of distances of matched places.

    The matches begin at both starts and end at both ends; from one to the next, one or both of the ways go on by one
    place (Sakoe and Chiba 1978, without a window and without weights).
    """
    if len(second) < len(first):
        first, second = second, first  # the loop runs over the shorter one
    costs = np.linalg.norm(first[:, None] - second, axis=2)
    sums = np.cumsum(costs, axis=1)
    row = sums[0]
    for cost, summed in zip(costs[1:], sums[1:], strict=True):
        entered = np.minimum(row, np.append(np.inf, row[:-1]))  # the first way went on, alone or with the second
        # then the second way may go on alone: the cheapest column to enter, plus the costs from there
        row = summed + np.minimum.accumulate(entered - (summed - cost))
    return max(0.0, float(row[-1]))


def parting_decision(first: Decisions, second: Decisions) -> int | None:
    """The first decision, from 1, at which two runs of an episode part; None for runs that do the same throughout.

    The runs part where their actions, or the poses after them, differ; where one of them ended, by whatever reason, and
    the other went on, the decision is the one that only one of them took. 0 = they start at different poses.
    """
    for number, ((action, pose), (other_action, other_pose)) in enumerate(zip(first, second, strict=False)):
        if action != other_action or not _is_same(pose, other_pose):
            return number
    return None if len(first) == len(second) else min(len(first), len(second))


def path_deviation(positions: NDArray[np.float64], path: NDArray[np.float64]) -> NDArray[np.float64]:
    """Planar metres (T,) from feet (T, 3) to the path (K, 3), K >= 1; inf where the path is not on their storey."""
    corners = cut(path)
    starts, ends = (corners[:-1], corners[1:]) if len(corners) > 1 else (corners, corners)
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

    They go together as long as both can be walked forwards, each at its own pace, with the two walkers within LIMIT of
    each other (the discrete Frechet distance). A detour thus parts where it begins; a pause or a turn never counts.
    None if one of them ends before that, so that its whole way lies along the other's.
    """
    shared_first, shared_second = _shared_rows(first, second)
    if shared_first == len(first) or shared_second == len(second):
        return None
    return _departure(first, shared_first), _departure(second, shared_second)


def _shared_rows(first: NDArray[np.float64], second: NDArray[np.float64]) -> tuple[int, int]:
    """Number of poses of each run that can be reached with the walkers never more than LIMIT apart."""
    columns = np.arange(len(second))
    reached = np.zeros(len(second), bool)  # columns reached with the first walker one row earlier
    rows, furthest = 0, -1
    for row, position in enumerate(first):
        offsets = second - position
        near = np.hypot(offsets[:, 0], offsets[:, 2]) <= LIMIT
        near &= same_storey(second[:, 1], position[1])
        entered = reached | np.append(row == 0, reached[:-1])  # the first walker moved on, or both did
        # the second walker may go on alone from an entered column up to the next column that is not near
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


def cut(path: NDArray[np.float64]) -> NDArray[np.float64]:
    """The path (K, 3), K >= 1, as points (P, 3) at most 25 cm apart."""
    points = [path[:1]]
    for start, end in itertools.pairwise(path):
        count = max(1, int(np.ceil(np.linalg.norm(end - start) / _PIECE)))
        points.append(start + (end - start) * (np.arange(1, count + 1) / count)[:, None])
    return np.concatenate(points)


def _moved(way: NDArray[np.float64]) -> NDArray[np.float64]:
    """The way's places, each that differs from the one before it."""
    has_moved = np.linalg.norm(np.diff(way, axis=0), axis=1) > _SAME_FEET
    return way[np.append(True, has_moved)]


def _is_same(pose: Pose, other: Pose) -> bool:
    angles = (math.remainder(pose.yaw - other.yaw, 2 * math.pi), pose.tilt - other.tilt)
    is_near = math.dist(pose.position, other.position) <= _SAME_PLACE
    return is_near and all(abs(angle) <= _SAME_ANGLE for angle in angles)
