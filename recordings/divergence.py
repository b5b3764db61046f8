"""How runs keep to the shortest path and where two of them part (`sim.walk.ways`); logs plots and marks of it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from sim.plan_view.storey import StoreyMap
from sim.walk.ways import Apart, Departure, apart_from_path, departure, parting, path_deviation

from .episode import Walk, log_figures, log_plot_style, set_moment
from .scene import LIFT
from .traces import Trace

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
class Stray:
    """How closely one run keeps to the shortest path."""

    deviation: NDArray[np.float64]
    """(T + 1,) `path_deviation` at the start and after each step."""
    apart: Apart
    """Distance of the whole way from the path."""
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
        strays.append(Stray(deviation, apart_from_path(way, path), departure(way, deviation)))
    first, second = (None, None) if pair is None else (ways[pair[0]], ways[pair[1]])
    parted = None if first is None or second is None else parting(first, second)
    return Divergence(tuple(strays), pair, parted)


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
