"""Mark on floor and map where runs leave the shortest path and where two of them part, and plot how far they stray."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from sim.tasks.run_files import EpisodeRun
from sim.walk.navigation_map import NavigationMap

from . import paths
from .divergence import Departure, Divergence
from .log_maps import StoreyMap, storeys_of
from .log_run import LIFT, Trace, log_series, set_row

DEVIATION, DEPARTURE, PARTING = "path_deviation", "departure", "parting"
"""Entities below a run (on maps: below its storey's)."""
_SIZE = 0.22
"""Half the width of a mark, metres."""
_RADIUS = -1.8
"""Of a mark's strokes; negative = points of the screen."""
_CROSS = np.array([[[-1, -1], [1, 1]], [[-1, 1], [1, -1]]], float) * _SIZE
"""(strokes, points, xz) where a run leaves the shortest path."""
_DIAMOND = np.array([[[-1, 0], [0, -1], [1, 0], [0, 1], [-1, 0]]], float) * 1.5 * _SIZE
"""The same where two runs part."""


def log_divergence(
    stream: rr.RecordingStream,
    traces: Sequence[Trace],
    divergence: Divergence,
    *,
    maps: Sequence[StoreyMap],
    navigation: NavigationMap,
) -> None:
    """Logs each walking run's distance from the shortest path, and marks that appear when what they mark happens.

    Args:
        stream: The recording.
        traces: The runs.
        divergence: Theirs, in the same order.
        maps: The storeys shown.
        navigation: Tells the storeys' heights.
    """
    for trace, stray in zip(traces, divergence.strays, strict=True):
        if stray is None:
            continue
        log_series(stream, trace, DEVIATION, stray.deviation)
        if stray.departure is not None:
            mark = _Mark(DEPARTURE, _CROSS, stray.departure, f"{trace.title} leaves the shortest path")
            _log_mark(stream, trace, mark, maps, navigation)
    if divergence.pair is None or divergence.parted is None:
        return
    for index, other, place in zip(divergence.pair, divergence.pair[::-1], divergence.parted, strict=True):
        mark = _Mark(PARTING, _DIAMOND, place, f"{traces[index].title} parts from {traces[other].title}")
        _log_mark(stream, traces[index], mark, maps, navigation)


@dataclass(frozen=True, slots=True)
class _Mark:
    name: str
    strokes: NDArray[np.float64]
    place: Departure
    label: str
    """Shown when somebody points at the mark: always shown, the words would hide the ways."""


def _log_mark(
    stream: rr.RecordingStream, trace: Trace, mark: _Mark, maps: Sequence[StoreyMap], navigation: NavigationMap
) -> None:
    """Logs a mark where the run stands at its place, on all timelines when it gets there."""
    assert isinstance(trace.run, EpisodeRun)
    feet = trace.positions[mark.place.row]
    strokes = np.insert(mark.strokes, 1, LIFT, axis=-1) + feet  # (strokes, points, xyz)
    labels = [mark.label] * len(strokes)
    set_row(stream, trace.run, mark.place.row)
    strips = rr.LineStrips3D(list(strokes), colors=[trace.rgb], radii=_RADIUS, labels=labels, show_labels=False)
    stream.log(paths.run_path(trace.label, mark.name), strips)
    (floor,) = storeys_of(feet[1:2], navigation)
    for storey in maps:
        if storey.index == floor:
            flat = rr.LineStrips2D(
                list(storey.pixels(strokes)),
                colors=[trace.rgb],
                radii=_RADIUS,
                labels=labels,
                show_labels=False,
                draw_order=50.0,
            )
            stream.log(paths.run_path(trace.label, "map", storey.part, mark.name), flat)
    stream.reset_time()
