"""How the viewer lays a running episode out: camera | home | map; below them a plot, actions and task."""

from collections.abc import Sequence

import rerun.blueprint as rrb
from rerun.blueprint.encodings import TextLogColumn

from . import paths
from .blueprints import BACKGROUND, home_eye, until_now
from .log_insight import OCCUPANCY, SIMILARITY
from .log_maps import StoreyMap
from .log_steps import SEEN_M2, Walker

_IN_HOME = ("camera", "path", "trail", "collisions", "frontiers", "candidates", "chosen", "found")
_PAST_TOO = ("trail", "collisions")
"""Entities that show all their rows up to the time cursor; all others show their latest one."""


def live_blueprint(
    walker: Walker, maps: Sequence[StoreyMap], *, explains: bool, with_depth: bool, follows: bool
) -> rrb.Blueprint:
    """The layout for one running episode.

    Args:
        walker: Who walks.
        maps: The storeys visited so far, at least one; each has a home view and a map of its own.
        explains: Whether the agent shows a map of its own, which then stands beside the map of what it saw.
        with_depth: Whether depth is logged.
        follows: Whether the time cursor stays at the newest data: in a viewer, not in a file.
    """
    camera, many = walker.entity("camera"), len(maps) > 1
    sees: rrb.View | rrb.Container = _flat(camera, [f"{camera}/**"], f"{walker.title} sees")
    if with_depth:
        depth = walker.entity("depth")
        sees = rrb.Vertical(sees, _flat(depth, [depth], "Depth"), row_shares=[3, 2])
    homes = rrb.Vertical(*(_home(walker, storey, len(maps)) for storey in maps))
    kinds = (False, True) if explains else (False,)
    seen = [rrb.Vertical(*(_map(walker, storey, own=own, many=many) for storey in maps)) for own in kinds]
    plotted = ["centre_distance", "goal_distance"] if walker.is_episode else [SEEN_M2]
    plot = rrb.TimeSeriesView(
        origin="/",
        contents=[walker.entity(name) for name in plotted],
        name="Metres to the goal" if walker.is_episode else "Free floor seen, square metres",
    )
    log = rrb.TextLogView(
        origin="/",
        contents=[walker.entity("actions"), walker.entity("note")],
        name="Actions",
        columns=rrb.TextLogColumns(text_log_columns=[TextLogColumn("Body")]),
    )
    task = rrb.TextDocumentView(origin=paths.TASK, name="Task and results")
    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Horizontal(sees, homes, *seen, column_shares=[5, 4, 3, 3] if explains else [5, 4, 4]),
            rrb.Horizontal(plot, log, task, column_shares=[3, 3, 4]),
            row_shares=[2, 1],
        ),
        rrb.TimePanel(state="collapsed", timeline=paths.STEP, fps=4.0, play_state="following" if follows else "paused"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        auto_views=False,
        auto_layout=False,
    )


def _flat(origin: str, contents: list[str], name: str) -> rrb.View:
    return rrb.Spatial2DView(origin=origin, contents=contents, name=name, background=BACKGROUND)


def _home(walker: Walker, storey: StoreyMap, count: int) -> rrb.View:
    rows, cols = storey.grid.shape
    extent = max(rows, cols) * storey.grid.cell * (1.0 if count == 1 else 1.3)  # several share the height
    shown = [walker.entity(name) for name in _IN_HOME]
    return rrb.Spatial3DView(
        origin="/",
        contents=[f"{paths.MESH}/{storey.part}/**", f"{paths.GOAL}/**", f"- {paths.GOAL}/map/**", *shown],
        name="Home" if count == 1 else f"Home, storey {storey.index + 1}",
        background=BACKGROUND,
        line_grid=False,
        eye_controls=home_eye(storey, extent=extent),
        overrides=until_now([walker.entity(name) for name in _PAST_TOO]),
    )


def _map(walker: Walker, storey: StoreyMap, *, own: bool, many: bool) -> rrb.View:
    """The map of what was seen, or the agent's own map of the same storey."""
    below = walker.entity("map", storey.part)
    hidden = ["seen"] if own else [OCCUPANCY, SIMILARITY]
    plan = [] if own else [f"{storey.entity}/**"]
    name = "What it thinks" if own else "Seen so far"
    goal = f"{paths.GOAL}/map/{storey.part}"
    return rrb.Spatial2DView(
        origin=storey.entity,
        contents=[*plan, f"{goal}/**", f"{below}/**", *(f"- {below}/{name}" for name in hidden)],
        name=f"{name}, storey {storey.index + 1}" if many else name,
        background=BACKGROUND,
        overrides=until_now([f"{below}/{name}" for name in _PAST_TOO]),
    )
