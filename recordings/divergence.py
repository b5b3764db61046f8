"""Finds where a run leaves the shortest path, how far it strays, and where two runs part; logs plots and marks of it.

A run strays by the planar distance from its feet to the nearest place of the path on the same storey. It leaves the
path at its first pose that is more than LIMIT away. Two runs go together as long as both can be walked forwards, each
at its own pace, with the two walkers within LIMIT of each other (the discrete Frechet distance); they part at the
first pose of each that cannot be reached in this way. A detour thus counts where it begins; a pause or a turn never
counts.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from sim.plan_view.storey import StoreyMap
from sim.walk.storeys import same_storey

from .episode import Walk, log_figures, log_plot_style, set_moment
from .scene import LIFT
from .traces import Trace

LIMIT = 1.0
"""Largest distance at which a run still follows a path, metres: the success radius."""
_PIECE = 0.25
"""Longest piece into which a path is cut, metres: a long one can climb from one storey to the next."""
DEVIATION, DEPARTURE, PARTING = "path_deviation", "departure", "parting"
"""Entities below a run (on maps: below its storey's)."""
_SIZE = 0.22
"""Half the width of a mark, metres."""
_RADIUS = -1.8
"""Radius of a mark's strokes; negative = points of the screen."""
_CROSS = np.array([[[-1, -1], [1, 1]], [[-1, 1], [1, -1]]], float) * _SIZE
"""(strokes, points, xz) the mark where a run leaves the shortest path, metres."""
_DIAMOND = np.array([[[-1, 0], [0, -1], [1, 0], [0, 1], [-1, 0]]], float) * 1.5 * _SIZE
"""(strokes, points, xz) the mark where two runs part, metres."""


@dataclass(frozen=True, slots=True)
class Departure:
    """The first pose of a run that is off the path, or off another run's way."""

    row: int
    """Number of actions taken until then, 0 at the start."""
    path_m: float
    """Metres walked until then."""


@dataclass(frozen=True, slots=True)
class Stray:
    """How closely one run keeps to the shortest path."""

    deviation: NDArray[np.float64]
    """(T + 1,) `path_deviation` at the start and after each step."""
    departure: Departure | None
    """None for a run that never leaves the path."""


@dataclass(frozen=True, slots=True)
class Divergence:
    """How closely the runs of an episode keep to the shortest path, and two of them to each other."""

    strays: tuple[Stray | None, ...]
    """One per run; None for runs that do not walk, and for all runs if there is no path."""
    pair: tuple[int, int] | None = None
    """Indices of the two runs that are compared."""
    parted: tuple[Departure, Departure] | None = None
    """Where those two part; None if one follows the other's way to its own end."""


def divergence_of(
    ways: Sequence[NDArray[np.float64] | None], path: NDArray[np.float64] | None, *, pair: tuple[int, int] | None
) -> Divergence:
    """The divergence of several runs, given as feet (T + 1, 3), or None for a run that does not walk.

    `path` (K, 3) is the shortest path, and `pair` has the indices of the two runs to compare.
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
    """Planar metres (T,) from feet (T, 3) to the path (K, 3), K >= 1; inf where the path is not on their storey."""
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


def _pieces(path: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Ends (P, 3) and (P, 3) of pieces of at most _PIECE metres; a path of one point is one piece of length 0."""
    points = [path[:1]]
    for start, end in itertools.pairwise(path):
        count = max(1, int(np.ceil(np.linalg.norm(end - start) / _PIECE)))
        points.append(start + (end - start) * (np.arange(1, count + 1) / count)[:, None])
    cut = np.concatenate(points)
    return (cut[:-1], cut[1:]) if len(cut) > 1 else (cut, cut)


def log_divergence(
    stream: rr.RecordingStream,
    traces: Sequence[Trace],
    walks: Sequence[Walk],
    divergence: Divergence,
    maps: Sequence[StoreyMap],
) -> None:
    """Logs each walking run's distance from the shortest path, and marks that appear at the moment they stand for.

    `walks` are the runs among `traces` that walk; the divergence is that of all traces.
    """
    walk_of = {walk.trace.label: walk for walk in walks}
    for trace, stray in zip(traces, divergence.strays, strict=True):
        if stray is None:
            continue
        walk = walk_of[trace.label]
        log_plot_style(stream, walk.walker, DEVIATION, words=trace.title, rgb=trace.rgb)
        log_figures(stream, walk.walker, walk.rows, DEVIATION, stray.deviation)
        if stray.departure is not None:
            label = f"{trace.title} leaves the shortest path"
            _log_mark(stream, walk, stray.departure, DEPARTURE, _CROSS, label, maps)
    if divergence.pair is None or divergence.parted is None:
        return
    for index, other, place in zip(divergence.pair, divergence.pair[::-1], divergence.parted, strict=True):
        label = f"{traces[index].title} parts from {traces[other].title}"
        _log_mark(stream, walk_of[traces[index].label], place, PARTING, _DIAMOND, label, maps)


def _log_mark(
    stream: rr.RecordingStream,
    walk: Walk,
    place: Departure,
    name: str,
    shape: NDArray[np.float64],
    label: str,
    maps: Sequence[StoreyMap],
) -> None:
    """Logs a mark at the run's place, which appears on all timelines when the run gets there.

    The label is shown only when the mouse points at the mark; otherwise the words would hide the ways.
    """
    walker, row = walk.walker, walk.rows[place.row]
    strokes = np.insert(shape, 1, LIFT, axis=-1) + np.array(row.pose.position)  # (strokes, points, xyz)
    style = {"colors": [walker.rgb], "radii": _RADIUS, "labels": [label] * len(strokes), "show_labels": False}
    set_moment(stream, walker, row)
    stream.log(walker.entity(name), rr.LineStrips3D(list(strokes), **style))
    for storey in maps:
        if storey.index == row.storey:
            flat = rr.LineStrips2D(list(storey.pixels(strokes)), draw_order=50.0, **style)
            stream.log(walker.entity("map", storey.name, name), flat)
    stream.reset_time()
