"""Layouts of recordings in the viewer: runs side by side, a running episode or POG trial, a map alone."""

from collections.abc import Callable, Iterable, Sequence

import numpy as np
import rerun.blueprint as rrb
from rerun.blueprint.api import VisualizerLike
from rerun.blueprint.encodings import TextLogColumn
from rerun.encodings import EntityPathLike

from grounding.maps.home_map import HomeMemory, StoreyMemory
from sim.plan_view.storey import StoreyMap
from sim.sequences.runs import SequenceRun
from sim.tasks.run_files import Answer, EpisodeRun

from . import layers, memory, paths
from .divergence import DEPARTURE, DEVIATION, PARTING
from .episode import CENTRE_DISTANCE, FOUND_MARKS, GOAL_DISTANCE, OUTCOMES, SEEN_M2, Walker, trail_name
from .insight import OCCUPANCY, SIMILARITY
from .layers import Regrounded
from .memory import NamedMemory
from .scene import OLD
from .traces import Trace

BACKGROUND = (24, 26, 30)
PLOTS = ((CENTRE_DISTANCE, "Metres to the target's centre"), (DEVIATION, "Metres off the shortest path"))
WALK_ENTITIES = ("camera", "path", "trail", DEPARTURE, PARTING)
EYE = np.array([0.0, 1.15, 0.2])
"""Position of the eye relative to the home's middle, in units of the home's depth: steep, so that walls hide little."""
ASPECT, WIDE_ASPECT = 2.4, 1.5
"""Width over height of the home's view: above the map, and beside it."""
PER_PAGE = 6
"""Largest number of phrases whose maps stand beside each other."""
MARKS, MARK_RAY = "marks", "mark_ray"
"""Entities below the run of a POG trial: a person's marks before the answer."""
_TITLE = 44
"""Largest number of a phrase's letters in the title of its map."""
_IN_HOME = ("camera", "path", "trail", "collisions", "frontiers", "candidates", "chosen", "found")
_PAST_TOO = ("trail", "collisions")
"""Entities of a running episode that show all their rows up to the time cursor; all others show the latest row."""
Overrides = dict[EntityPathLike, VisualizerLike | Iterable[VisualizerLike]]
Parts = rrb.View | rrb.Container


def comparison_blueprint(
    traces: Sequence[Trace],
    maps: Sequence[StoreyMap],
    *,
    shown: Sequence[Trace],
    regrounded: Sequence[Regrounded] = (),
    memories: Sequence[NamedMemory] = (),
) -> rrb.Blueprint:
    """The layout for any number of runs of one episode.

    Best person | home and map | best agent; below them plots, task, actions. Each storey has its own view in the home
    and on the map, since floors hide each other.

    Args:
        shown: At most two PAN runs whose cameras are shown, left and right.
        regrounded: Grounders with layers, which the map shows.
        memories: The maps that grounders answered on, each with its own page; objects stand in the home too.
    """
    is_wide = not shown  # no camera needs the space beside the home
    home = _together(
        rrb.Horizontal, [_home(traces, maps, storey, regrounded, memories, is_wide=is_wide) for storey in maps]
    )
    plan = _together(rrb.Horizontal, [_map(traces, maps, storey, regrounded) for storey in maps])
    middle = rrb.Horizontal(plan, home) if is_wide else rrb.Vertical(home, plan, row_shares=[1, 1])
    row: list[tuple[Parts, int]] = [(_sees(trace.title, _entity(trace, "camera")), 5) for trace in shown]
    row.insert(min(1, len(row)), (middle, 6))
    return _blueprint(
        rrb.Vertical(_row(row), _row(_below(traces, maps, regrounded, memories)), row_shares=[2, 1]),
        rrb.TimePanel(state="collapsed", timeline=paths.STEP, fps=4.0, play_state="paused"),
    )


def sequence_blueprint(
    traces: Sequence[Trace], maps: Sequence[StoreyMap], *, shown: Sequence[Trace], graph: rrb.VisualBounds2D
) -> rrb.Blueprint:
    """The layout for any number of runs of one home sequence.

    The best run's camera and map | home, maps of other runs | the second best; below them who owns what, a plot, what
    was told, the results. Each run has its own map, because there the colours tell the searches apart.

    Args:
        shown: At most two PAN runs whose cameras are shown, left and right.
        graph: The part of the graph of owners that is shown.
    """
    plans = {
        trace.label: _together(
            rrb.Horizontal, [_map([trace], maps, storey, (), whose=f": {trace.title}") for storey in maps]
        )
        for trace in traces
    }
    is_wide = not shown
    home = _together(rrb.Horizontal, [_home(traces, maps, storey, (), (), is_wide=is_wide) for storey in maps])
    rest = [plans[trace.label] for trace in traces if trace not in shown]
    middle = rrb.Vertical(home, _together(rrb.Tabs, rest), row_shares=[1, 1]) if rest else home
    row: list[tuple[Parts, int]] = [
        (rrb.Vertical(_sees(trace.title, _entity(trace, "camera")), plans[trace.label]), 5) for trace in shown
    ]
    row.insert(min(1, len(row)), (middle, 6))
    told = _actions([paths.TOLD, *(_entity(trace, OUTCOMES) for trace in traces)], name="Told, asked, found")
    below: list[tuple[Parts, int]] = [
        (rrb.GraphView(origin=paths.OWNERS, contents=paths.OWNERS, name="Who owns what", visual_bounds=graph), 4),
        (told, 5),
        (_task(), 5),
    ]
    walks = [_entity(trace, CENTRE_DISTANCE) for trace in traces if trace.is_walk]
    if walks:
        plot = rrb.TimeSeriesView(origin="/", contents=walks, name="Metres to the right object's centre")
        below.insert(1, (plot, 3))
    return _blueprint(
        rrb.Vertical(_row(row), _row(below), row_shares=[3, 2]),
        rrb.TimePanel(state="collapsed", timeline=paths.TOGETHER, fps=4.0, play_state="paused"),
    )


def live_blueprint(
    walker: Walker, maps: Sequence[StoreyMap], *, explains: bool, with_depth: bool, follows: bool
) -> rrb.Blueprint:
    """The layout for one running episode: camera | home | map; below them a plot, actions and task.

    Args:
        maps: The storeys visited so far, at least one; each has its own home view and map.
        explains: Whether the agent shows its own map, which then stands beside the map of the floor it saw.
        follows: Whether the time cursor stays at the newest data: in a viewer, not in a file.
    """
    sees: Parts = _sees(walker.title, walker.entity("camera"))
    if with_depth:
        depth = walker.entity("depth")
        flat = rrb.Spatial2DView(origin=depth, contents=[depth], name="Depth", background=BACKGROUND)
        sees = rrb.Vertical(sees, flat, row_shares=[3, 2])
    homes = rrb.Vertical(*(_live_home(walker, storey, maps) for storey in maps))
    kinds = (False, True) if explains else (False,)
    seen = [rrb.Vertical(*(_live_map(walker, storey, maps, own=own) for storey in maps)) for own in kinds]
    plotted = [CENTRE_DISTANCE, GOAL_DISTANCE] if walker.is_episode else [SEEN_M2]
    plot = rrb.TimeSeriesView(
        origin="/",
        contents=[walker.entity(name) for name in plotted],
        name="Metres to the goal" if walker.is_episode else "Free floor seen, square metres",
    )
    actions = _actions([walker.entity("actions"), walker.entity("note")])
    return _blueprint(
        rrb.Vertical(
            rrb.Horizontal(sees, homes, *seen, column_shares=[5, 4, 3, 3] if explains else [5, 4, 4]),
            rrb.Horizontal(plot, actions, _task(), column_shares=[3, 3, 4]),
            row_shares=[2, 1],
        ),
        rrb.TimePanel(state="collapsed", timeline=paths.STEP, fps=4.0, play_state="following" if follows else "paused"),
    )


def trial_blueprint(label: str, maps: Sequence[StoreyMap], *, follows: bool) -> rrb.Blueprint:
    """The layout for a running POG trial: home and map of each storey looked at; actions and task below them."""
    shown = [paths.run_path(label, name) for name in (MARKS, MARK_RAY, "candidates", "click_ray")]
    homes = [
        _home_view(
            storey,
            [f"{paths.MESH}/{storey.name}/**", f"{paths.GOAL}/**", f"- {paths.GOAL}/map/**", *shown],
            name=f"Home, storey {storey.index + 1}",
            extent=_extent(storey, across=1 / 1.5),
        )
        for storey in maps
    ]
    plans = [
        _map_view(
            storey,
            [*_plan(storey), f"{paths.run_path(label, 'map', storey.name)}/**"],
            name=f"Map, storey {storey.index + 1}",
            background=BACKGROUND,
        )
        for storey in maps
    ]
    actions = _actions("$origin/**", origin=paths.run_path(label, "actions"))
    return _blueprint(
        rrb.Vertical(
            rrb.Horizontal(rrb.Tabs(*homes), rrb.Tabs(*plans), column_shares=[6, 5]),
            rrb.Horizontal(actions, _task(), column_shares=[3, 4]),
            row_shares=[2, 1],
        ),
        rrb.TimePanel(state="collapsed", timeline=paths.TIME_S, play_state="following" if follows else "paused"),
    )


def map_blueprint(
    name: str, whole: HomeMemory, maps: Sequence[StoreyMap], *, asked: Sequence[str] = ()
) -> rrb.Blueprint:
    """The layout for a map alone, a page per storey: the home, flat views, and the text below.

    A flat view shows one question that was asked, or, if there is none, one layer of the map.
    """
    pages: list[Parts] = []
    for shown in maps:
        known = memory.storey_at(whole, shown)
        assert known is not None
        entities = [f"{memory.home_entity(name, layer, shown)}/**" for layer in memory.HOME_LAYERS]
        entities += [f"{paths.asked_path(name, 'home', shown.name, number)}/**" for number in range(len(asked))]
        home = _home_view(shown, [f"{paths.MESH}/{shown.name}/**", *entities], name="Home", extent=_extent(shown))
        views = _asked_views(name, asked, shown) if asked else _memory_views(name, known, shown)
        flat = rrb.Grid(*views, grid_columns=2)
        page = f"Storey {shown.index + 1}" if len(maps) > 1 else "Map"
        pages.append(rrb.Horizontal(home, flat, name=page, column_shares=[1, 1]))
    text = rrb.TextDocumentView(origin=paths.TASK, name="Map")
    return _blueprint(rrb.Vertical(_together(rrb.Tabs, pages), text, row_shares=[4, 1]), rrb.TimePanel(state="hidden"))


def _blueprint(root: Parts, time_panel: rrb.TimePanel) -> rrb.Blueprint:
    """A blueprint of these views and this time panel, without the viewer's other panels."""
    return rrb.Blueprint(
        root,
        time_panel,
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        auto_views=False,
        auto_layout=False,
    )


def _home(
    traces: Sequence[Trace],
    maps: Sequence[StoreyMap],
    storey: StoreyMap,
    regrounded: Sequence[Regrounded],
    memories: Sequence[NamedMemory],
    *,
    is_wide: bool,
) -> rrb.View:
    """One storey of the home in a comparison."""
    shown = [f"{paths.GOAL}/{name}" for name in ("centre", "region", "places", "path", OLD)]
    for trace in traces:
        names = (*WALK_ENTITIES, *_growing(trace)) if trace.is_walk else ("candidates", "click_ray")
        shown += [_entity(trace, name) for name in dict.fromkeys(names)]
    shown += [layers.home_entity(item.trace, name, storey) for item in regrounded for name in item.names]
    shown += [memory.home_entity(item.name, "objects", storey) for item in memories]
    return _home_view(
        storey,
        [f"{paths.MESH}/{storey.name}/**", *shown],
        name=_named("Home", storey, maps),
        extent=_extent(storey, across=len(maps) / (WIDE_ASPECT if is_wide else ASPECT)),
        overrides=_trails(traces)
        | _hidden([layers.home_entity(*layer, storey) for layer in layers.covering(regrounded)]),
    )


def _map(
    traces: Sequence[Trace],
    maps: Sequence[StoreyMap],
    storey: StoreyMap,
    regrounded: Sequence[Regrounded],
    *,
    whose: str = "",
) -> rrb.View:
    """One storey from above in a comparison; `whose` is added to its name."""
    return _map_view(
        storey,
        [*_plan(storey), *(f"{_entity(trace, 'map', storey.name)}/**" for trace in traces)],
        name=_named(f"Map{whose}", storey, maps),
        background=BACKGROUND,
        is_cropped=True,
        overrides=_trails(traces, "map", storey.name)
        | _hidden([layers.map_entity(*layer, storey) for layer in layers.covering(regrounded)]),
    )


def _below(
    traces: Sequence[Trace],
    maps: Sequence[StoreyMap],
    regrounded: Sequence[Regrounded],
    memories: Sequence[NamedMemory],
) -> list[tuple[Parts, int]]:
    """Plots or phrases, the document, the actions; each with its share of the width."""
    parts: list[tuple[Parts, int]] = []
    walks = [trace for trace in traces if isinstance(trace.run, EpisodeRun)]
    for number, (entity, name) in enumerate(PLOTS if walks else ()):
        contents = [_entity(trace, entity) for trace in walks]
        legend = rrb.PlotLegend(rrb.Corner2D.LeftTop, visible=number > 0)  # one legend is enough
        parts.append((rrb.TimeSeriesView(origin="/", contents=contents, name=name, plot_legend=legend), 3))
    pages = [page for item in regrounded for page in _phrase_pages(item, maps)]
    pages += [page for item in memories for page in _memory_pages(item, maps)]
    if pages:
        parts.append((_together(rrb.Tabs, pages), 6))
    return [*parts, (_task(), 5), (_actions([_entity(trace, "actions") for trace in traces]), 2)]


def _live_home(walker: Walker, storey: StoreyMap, maps: Sequence[StoreyMap]) -> rrb.View:
    shown = [walker.entity(name) for name in _IN_HOME]
    return _home_view(
        storey,
        [f"{paths.MESH}/{storey.name}/**", f"{paths.GOAL}/**", f"- {paths.GOAL}/map/**", *shown],
        name=_named("Home", storey, maps),
        extent=_extent(storey) * (1.0 if len(maps) == 1 else 1.3),  # several storeys share the height
        overrides=_until_now([walker.entity(name) for name in _PAST_TOO]),
    )


def _live_map(walker: Walker, storey: StoreyMap, maps: Sequence[StoreyMap], *, own: bool) -> rrb.View:
    """The map of the floor seen so far, or the agent's own map of the same storey."""
    below = walker.entity("map", storey.name)
    hidden = ["seen"] if own else [OCCUPANCY, SIMILARITY]
    plan = _plan(storey)[1:] if own else _plan(storey)
    return _map_view(
        storey,
        [*plan, f"{below}/**", *(f"- {below}/{name}" for name in hidden)],
        name=_named("What it thinks" if own else "Seen so far", storey, maps),
        background=BACKGROUND,
        overrides=_until_now([f"{below}/{name}" for name in _PAST_TOO]),
    )


def _phrase_pages(item: Regrounded, maps: Sequence[StoreyMap]) -> list[rrb.Container]:
    """Pages of small maps, one per phrase of a grounder, with the phrase's similarity, its peaks and the answers."""
    if item.layers is None or item.memory is None:
        return []
    heights = layers.places_of(item.memory, item.layers)[:, 1]
    storey = min(maps, key=lambda storey: float(abs(heights - storey.floor_y).mean()))
    views = [_phrase_view(item, number, phrase, storey) for number, phrase in enumerate(item.layers.phrases)]
    pages: list[rrb.Container] = []
    for first in range(0, len(views), PER_PAGE):
        page = views[first : first + PER_PAGE]
        name = f"{item.trace.title}: phrases {first + 1}-{first + len(page)}"
        pages.append(rrb.Grid(*page, grid_columns=min(3, len(page)), name=name))
    return pages


def _phrase_view(item: Regrounded, number: int, phrase: str, storey: StoreyMap) -> rrb.View:
    names = (layers.SIMILARITY, layers.PEAKS)
    shown = [layers.map_entity(item.trace, f"{name}_{number}", storey) for name in names]
    short = phrase if len(phrase) <= _TITLE else phrase[: _TITLE - 3] + "..."
    contents = [paths.map_entity(storey.name), *shown, f"{paths.GOAL}/map/{storey.name}/region"]
    return _map_view(storey, contents, name=f"{number + 1}. {short}", is_cropped=True)


def _memory_pages(item: NamedMemory, maps: Sequence[StoreyMap]) -> list[rrb.Container]:
    """A page per storey that shows, side by side, the layers of a map that grounders answered on."""
    pages: list[rrb.Container] = []
    for storey in maps:
        known = memory.storey_at(item.memory, storey)
        if known is not None:
            views = _memory_views(item.name, known, storey)
            name = _named(f"Map {item.name[:_TITLE]}", storey, maps)
            pages.append(rrb.Grid(*views, grid_columns=len(views), name=name))
    return pages


def _memory_views(name: str, known: StoreyMemory, storey: StoreyMap) -> list[rrb.View]:
    """A flat view per layer of a map's storey."""
    return [
        _map_view(
            storey,
            [f"{paths.map_entity(storey.name)}/**", memory.map_entity(name, layer, storey)],
            name=memory.LAYER_NAMES[layer],
            is_cropped=True,
        )
        for layer in memory.layers_of(known)
    ]


def _asked_views(name: str, asked: Sequence[str], storey: StoreyMap) -> list[rrb.View]:
    """A flat view per question on a map's storey."""
    return [
        _map_view(
            storey,
            [f"{paths.map_entity(storey.name)}/**", f"{paths.asked_path(name, 'map', storey.name, number)}/**"],
            name=query,
            is_cropped=True,
        )
        for number, query in enumerate(asked)
    ]


def _hidden(entities: Sequence[str]) -> Overrides:
    """Overrides that hide these entities at first; the eye beside an entity's name shows it."""
    return dict.fromkeys(entities, rrb.EntityBehavior(visible=False))


def _sees(title: str, camera: str) -> rrb.View:
    return rrb.Spatial2DView(origin=camera, contents=[f"{camera}/**"], name=f"{title} sees", background=BACKGROUND)


def _task() -> rrb.View:
    return rrb.TextDocumentView(origin=paths.TASK, name="Task and results")


def _actions(contents: str | list[str], *, origin: str = "/", name: str = "Actions") -> rrb.View:
    columns = rrb.TextLogColumns(text_log_columns=[TextLogColumn("Body")])
    return rrb.TextLogView(origin=origin, contents=contents, name=name, columns=columns)


def _home_view(
    storey: StoreyMap, contents: list[str], *, name: str, extent: float, overrides: Overrides | None = None
) -> rrb.View:
    """A view of a storey's home from above, from far enough that `extent` metres fit."""
    rows, cols = storey.grid.shape
    middle_xz = np.asarray(storey.grid.origin_xz) + np.array([cols, rows]) * storey.grid.cell / 2
    middle = np.array([middle_xz[0], storey.floor_y, middle_xz[1]])
    eye = rrb.EyeControls3D(position=middle + extent * EYE, look_target=middle, eye_up=(0.0, 1.0, 0.0))
    return rrb.Spatial3DView(
        origin="/",
        contents=contents,
        name=name,
        background=BACKGROUND,
        line_grid=False,
        eye_controls=eye,
        overrides=overrides,
    )


def _plan(storey: StoreyMap) -> list[str]:
    """Entities of a storey's map and of the goal on it."""
    return [f"{paths.map_entity(storey.name)}/**", f"{paths.GOAL}/map/{storey.name}/**"]


def _extent(storey: StoreyMap, *, across: float = 1.0) -> float:
    """A storey's depth in metres, or its width times `across` if that is more."""
    rows, cols = storey.grid.shape
    return max(rows, cols * across) * storey.grid.cell


def _map_view(
    storey: StoreyMap,
    contents: list[str],
    *,
    name: str,
    background: tuple[int, int, int] | None = None,
    is_cropped: bool = False,
    overrides: Overrides | None = None,
) -> rrb.View:
    """A view of a storey's map; if cropped, it first shows the map's picture only and nothing beyond it."""
    rows, cols = storey.grid.shape
    bounds = rrb.VisualBounds2D(x_range=(0.0, float(cols)), y_range=(0.0, float(rows))) if is_cropped else None
    return rrb.Spatial2DView(
        origin=paths.map_entity(storey.name),
        contents=contents,
        name=name,
        background=background,
        visual_bounds=bounds,
        overrides=overrides,
    )


def _trails(traces: Sequence[Trace], *parts: str) -> Overrides:
    """Overrides of what grows with the time cursor; `parts` lead to it below a run."""
    walks = [trace for trace in traces if trace.is_walk and not isinstance(trace.run, Answer) and trace.run.steps]
    return _until_now([_entity(trace, *parts, name) for trace in walks for name in _growing(trace)])


def _growing(trace: Trace) -> list[str]:
    """Names below a PAN run of what shows all its rows up to the time cursor."""
    if isinstance(trace.run, SequenceRun):
        return [*map(trail_name, range(len(trace.run.end.searches))), FOUND_MARKS]
    return [trail_name(None)]


def _until_now(entities: Sequence[str]) -> Overrides:
    """Overrides that show all rows of these entities up to the time cursor; other entities show their latest row."""
    start, end = rrb.TimeRangeBoundary.infinite(), rrb.TimeRangeBoundary.cursor_relative()
    ranges = [rrb.VisibleTimeRange(timeline, start=start, end=end) for timeline in paths.TIMELINES]
    return dict.fromkeys(entities, rrb.VisibleTimeRanges(ranges))


def _entity(trace: Trace, *parts: str) -> str:
    return paths.run_path(trace.label, *parts)


def _named(view: str, storey: StoreyMap, maps: Sequence[StoreyMap]) -> str:
    return view if len(maps) == 1 else f"{view}, storey {storey.index + 1}"


def _together(container: Callable[..., rrb.Container], parts: Sequence[Parts]) -> Parts:
    return parts[0] if len(parts) == 1 else container(*parts)


def _row(parts: Sequence[tuple[Parts, int]]) -> rrb.Container:
    """Views side by side, each with its share of the width."""
    return rrb.Horizontal(*(part for part, _ in parts), column_shares=[share for _, share in parts])
