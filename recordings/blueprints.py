"""How the viewer lays a comparison out: first camera | home and map | last camera; below them plot, task, actions."""

from collections.abc import Iterable, Sequence

import numpy as np
import rerun.blueprint as rrb
from rerun.blueprint.api import VisualizerLike
from rerun.blueprint.encodings import TextLogColumn
from rerun.encodings import EntityPathLike

from sim.tasks.run_files import EpisodeRun

from . import paths
from .log_maps import StoreyMap
from .log_run import Trace

BACKGROUND = (24, 26, 30)
EYE = np.array([0.0, 1.25, 0.22])
"""Where the home is looked at from, from its middle, in units of its depth: steep, so that walls hide little."""


def comparison_blueprint(traces: Sequence[Trace], maps: Sequence[StoreyMap]) -> rrb.Blueprint:
    """The layout for any number of runs of one episode.

    Args:
        traces: The runs, in the recording's order.
        maps: The storeys shown; each has a view of its own in the home and on the map, since floors hide each other.
    """
    walks = [trace for trace in traces if isinstance(trace.run, EpisodeRun)]
    shown = walks[:1] + walks[1:][-1:]
    middle = rrb.Vertical(_homes(traces, maps), _maps(traces, maps), row_shares=[1, 1])
    row: list[rrb.View | rrb.Container] = [middle]
    shares = [6]
    if shown:
        row.insert(0, _camera(shown[0]))
        shares.insert(0, 5)
    if len(shown) > 1:
        row.append(_camera(shown[1]))
        shares.append(5)
    log = rrb.TextLogView(
        origin="/",
        contents=[paths.run_path(trace.label, "actions") for trace in traces],
        name="Actions",
        columns=rrb.TextLogColumns(text_log_columns=[TextLogColumn("Body")]),
    )
    task = rrb.TextDocumentView(origin=paths.TASK, name="Task and results")
    below: list[rrb.View | rrb.Container] = [task, log]
    if walks:
        contents = [paths.run_path(trace.label, "centre_distance") for trace in walks]
        below.insert(0, rrb.TimeSeriesView(origin="/", contents=contents, name="Metres to the target's centre"))
    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Horizontal(*row, column_shares=shares),
            rrb.Horizontal(*below, column_shares=[3, 4, 2][-len(below) :]),
            row_shares=[2, 1],
        ),
        rrb.TimePanel(state="collapsed", timeline=paths.STEP, fps=4.0, play_state="paused"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        auto_views=False,
        auto_layout=False,
    )


def _camera(trace: Trace) -> rrb.View:
    entity = paths.run_path(trace.label, "camera")
    return rrb.Spatial2DView(origin=entity, contents=[entity], name=f"{trace.title} sees", background=BACKGROUND)


def _homes(traces: Sequence[Trace], maps: Sequence[StoreyMap]) -> rrb.View | rrb.Container:
    shared = [f"{paths.GOAL}/centre"]
    for trace in traces:
        names = ("camera", "path", "trail") if isinstance(trace.run, EpisodeRun) else ("candidates", "click_ray")
        shared += [paths.run_path(trace.label, name) for name in names]
    views: list[rrb.View] = []
    for storey in maps:
        rows, cols = storey.grid.shape
        middle_xz = np.asarray(storey.grid.origin_xz) + np.array([cols, rows]) * storey.grid.cell / 2
        middle = np.array([middle_xz[0], storey.floor_y, middle_xz[1]])
        extent = max(rows, cols * len(maps) / 2) * storey.grid.cell  # views share a place twice as wide as high
        eye = rrb.EyeControls3D(position=middle + extent * EYE, look_target=middle, eye_up=(0.0, 1.0, 0.0))
        views.append(
            rrb.Spatial3DView(
                origin="/",
                contents=[f"{paths.MESH}/{storey.part}/**", *shared],
                name=_storey_name("Home", storey, maps),
                background=BACKGROUND,
                line_grid=False,
                eye_controls=eye,
                overrides=_trails(traces, "trail"),
            )
        )
    return views[0] if len(views) == 1 else rrb.Horizontal(*views)


def _maps(traces: Sequence[Trace], maps: Sequence[StoreyMap]) -> rrb.View | rrb.Container:
    views: list[rrb.View] = []
    for storey in maps:
        contents = [f"{storey.entity}/**", f"{paths.GOAL}/map/{storey.part}"]
        contents += [f"{paths.run_path(trace.label, 'map', storey.part)}/**" for trace in traces]
        views.append(
            rrb.Spatial2DView(
                origin=storey.entity,
                contents=contents,
                name=_storey_name("Map", storey, maps),
                background=BACKGROUND,
                overrides=_trails(traces, "map", storey.part, "trail"),
            )
        )
    return views[0] if len(views) == 1 else rrb.Horizontal(*views)


def _storey_name(view: str, storey: StoreyMap, maps: Sequence[StoreyMap]) -> str:
    return view if len(maps) == 1 else f"{view}, storey {storey.index + 1}"


def _trails(traces: Sequence[Trace], *parts: str) -> dict[EntityPathLike, VisualizerLike | Iterable[VisualizerLike]]:
    """Trails show all their rows up to the time cursor, on every timeline; all else shows its latest row."""
    until_now = rrb.VisibleTimeRanges(
        [
            rrb.VisibleTimeRange(
                timeline, start=rrb.TimeRangeBoundary.infinite(), end=rrb.TimeRangeBoundary.cursor_relative()
            )
            for timeline in paths.TIMELINES
        ]
    )
    walks = [trace for trace in traces if isinstance(trace.run, EpisodeRun) and trace.run.steps]
    return {paths.run_path(trace.label, *parts): until_now for trace in walks}
