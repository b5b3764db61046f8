"""How the viewer lays a comparison out: best person | home and map | best agent; below them plots, task, actions."""

from collections.abc import Sequence

import numpy as np
import rerun.blueprint as rrb
from rerun.blueprint.encodings import TextLogColumn

from sim.tasks.run_files import EpisodeRun

from . import paths
from .blueprint_layers import Overrides, hidden_layers, home_layers, map_bounds, memory_pages, phrase_pages
from .log_divergence import DEPARTURE, DEVIATION, PARTING
from .log_grounding import Regrounded, home_entity, map_entity
from .log_maps import StoreyMap
from .log_memory import NamedMemory
from .log_memory import home_entity as home_layer
from .log_run import Trace
from .traces import best_two

BACKGROUND = (24, 26, 30)
PLOTS = (("centre_distance", "Metres to the target's centre"), (DEVIATION, "Metres off the shortest path"))
WALK_ENTITIES = ("camera", "path", "trail", DEPARTURE, PARTING)
EYE = np.array([0.0, 1.15, 0.2])
"""Where the home is looked at from, from its middle, in units of its depth: steep, so that walls hide little."""
ASPECT, WIDE_ASPECT = 2.4, 1.5
"""Width over height of the place for the home: above the map, and beside it."""


def comparison_blueprint(
    traces: Sequence[Trace],
    maps: Sequence[StoreyMap],
    *,
    shown: Sequence[Trace] | None = None,
    regrounded: Sequence[Regrounded] = (),
    memories: Sequence[NamedMemory] = (),
) -> rrb.Blueprint:
    """The layout for any number of runs of one episode.

    Args:
        traces: The runs, in the recording's order.
        maps: The storeys shown; each has a view of its own in the home and on the map, since floors hide each other.
        shown: At most two PAN runs whose cameras are shown, left and right; None = the best two.
        regrounded: Grounders with layers, which the map shows.
        memories: Maps that they answered on, each with a page of its own; objects stand in the home too.
    """
    cameras = best_two(traces) if shown is None else shown
    middle = _middle(traces, maps, regrounded, memories, is_wide=not cameras)
    row: list[rrb.View | rrb.Container] = [middle]
    shares = [6]
    if cameras:
        row.insert(0, _camera(cameras[0]))
        shares.insert(0, 5)
    if len(cameras) > 1:
        row.append(_camera(cameras[1]))
        shares.append(5)
    below = _below(traces, maps, regrounded, memories)
    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Horizontal(*row, column_shares=shares),
            rrb.Horizontal(*(view for view, _ in below), column_shares=[share for _, share in below]),
            row_shares=[2, 1],
        ),
        rrb.TimePanel(state="collapsed", timeline=paths.STEP, fps=4.0, play_state="paused"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        auto_views=False,
        auto_layout=False,
    )


def _middle(
    traces: Sequence[Trace],
    maps: Sequence[StoreyMap],
    regrounded: Sequence[Regrounded],
    memories: Sequence[NamedMemory],
    *,
    is_wide: bool,
) -> rrb.Container:
    """The home above the map, or beside it where no camera needs the place."""
    home = _homes(traces, maps, regrounded, memories, aspect=WIDE_ASPECT if is_wide else ASPECT)
    plan = _maps(traces, maps, regrounded)
    return rrb.Horizontal(plan, home) if is_wide else rrb.Vertical(home, plan, row_shares=[1, 1])


def _below(
    traces: Sequence[Trace],
    maps: Sequence[StoreyMap],
    regrounded: Sequence[Regrounded],
    memories: Sequence[NamedMemory],
) -> list[tuple[rrb.View | rrb.Container, int]]:
    """Plots or phrases, the document, the actions; each with its share of the width."""
    parts: list[tuple[rrb.View | rrb.Container, int]] = []
    walks = [trace for trace in traces if isinstance(trace.run, EpisodeRun)]
    for number, (entity, name) in enumerate(PLOTS if walks else ()):
        contents = [paths.run_path(trace.label, entity) for trace in walks]
        legend = rrb.PlotLegend(rrb.Corner2D.LeftTop, visible=number > 0)  # one is enough, runs seldom stray at first
        parts.append((rrb.TimeSeriesView(origin="/", contents=contents, name=name, plot_legend=legend), 3))
    pages = [page for item in regrounded for page in phrase_pages(item, maps)]
    pages += [page for item in memories for page in memory_pages(item, maps)]
    if pages:
        parts.append((pages[0] if len(pages) == 1 else rrb.Tabs(*pages), 6))
    log = rrb.TextLogView(
        origin="/",
        contents=[paths.run_path(trace.label, "actions") for trace in traces],
        name="Actions",
        columns=rrb.TextLogColumns(text_log_columns=[TextLogColumn("Body")]),
    )
    return [*parts, (rrb.TextDocumentView(origin=paths.TASK, name="Task and results"), 5), (log, 2)]


def _camera(trace: Trace) -> rrb.View:
    entity = paths.run_path(trace.label, "camera")
    return rrb.Spatial2DView(
        origin=entity, contents=[f"{entity}/**"], name=f"{trace.title} sees", background=BACKGROUND
    )


def _homes(
    traces: Sequence[Trace],
    maps: Sequence[StoreyMap],
    regrounded: Sequence[Regrounded],
    memories: Sequence[NamedMemory],
    *,
    aspect: float,
) -> rrb.View | rrb.Container:
    shared = [f"{paths.GOAL}/{name}" for name in ("centre", "region", "places", "path")]
    for trace in traces:
        names = WALK_ENTITIES if isinstance(trace.run, EpisodeRun) else ("candidates", "click_ray")
        shared += [paths.run_path(trace.label, name) for name in names]
    views: list[rrb.View] = []
    for storey in maps:
        rows, cols = storey.grid.shape
        eye = home_eye(storey, extent=max(rows, cols * len(maps) / aspect) * storey.grid.cell)
        views.append(
            rrb.Spatial3DView(
                origin="/",
                contents=[
                    f"{paths.MESH}/{storey.part}/**",
                    *shared,
                    *home_layers(regrounded, storey),
                    *(home_layer(item.name, "objects", storey) for item in memories),
                ],
                name=_storey_name("Home", storey, maps),
                background=BACKGROUND,
                line_grid=False,
                eye_controls=eye,
                overrides=_trails(traces, "trail") | hidden_layers(regrounded, storey, entity=home_entity),
            )
        )
    return views[0] if len(views) == 1 else rrb.Horizontal(*views)


def _maps(
    traces: Sequence[Trace], maps: Sequence[StoreyMap], regrounded: Sequence[Regrounded]
) -> rrb.View | rrb.Container:
    views: list[rrb.View] = []
    for storey in maps:
        contents = [f"{storey.entity}/**", f"{paths.GOAL}/map/{storey.part}/**"]
        contents += [f"{paths.run_path(trace.label, 'map', storey.part)}/**" for trace in traces]
        views.append(
            rrb.Spatial2DView(
                origin=storey.entity,
                contents=contents,
                name=_storey_name("Map", storey, maps),
                background=BACKGROUND,
                visual_bounds=map_bounds(storey),
                overrides=_trails(traces, "map", storey.part, "trail")
                | hidden_layers(regrounded, storey, entity=map_entity),
            )
        )
    return views[0] if len(views) == 1 else rrb.Horizontal(*views)


def _storey_name(view: str, storey: StoreyMap, maps: Sequence[StoreyMap]) -> str:
    return view if len(maps) == 1 else f"{view}, storey {storey.index + 1}"


def until_now(entities: Sequence[str]) -> Overrides:
    """These show all their rows up to the time cursor, on every timeline; all else shows its latest row."""
    ranges = rrb.VisibleTimeRanges(
        [
            rrb.VisibleTimeRange(
                timeline, start=rrb.TimeRangeBoundary.infinite(), end=rrb.TimeRangeBoundary.cursor_relative()
            )
            for timeline in paths.TIMELINES
        ]
    )
    return dict.fromkeys(entities, ranges)


def home_eye(storey: StoreyMap, *, extent: float) -> rrb.EyeControls3D:
    """Looks at a storey's middle from above, so far that `extent` metres fit."""
    rows, cols = storey.grid.shape
    middle_xz = np.asarray(storey.grid.origin_xz) + np.array([cols, rows]) * storey.grid.cell / 2
    middle = np.array([middle_xz[0], storey.floor_y, middle_xz[1]])
    return rrb.EyeControls3D(position=middle + extent * EYE, look_target=middle, eye_up=(0.0, 1.0, 0.0))


def _trails(traces: Sequence[Trace], *parts: str) -> Overrides:
    walks = [trace for trace in traces if isinstance(trace.run, EpisodeRun) and trace.run.steps]
    return until_now([paths.run_path(trace.label, *parts) for trace in walks])
