"""Draws where people and agents walked and pointed at one episode, seen from above, on the free floor, as SVG."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from sim.homes.kind import scene_labels
from sim.plan_view.storey import StoreyMap
from sim.plan_view.svg import drawn_svg, free_path
from sim.plan_view.view import PlanView
from sim.tasks.run_files import Answer, EpisodeRun
from sim.types import EpisodeKey, TaskKind

from .trials import TrialGroup, row_label

_PIXELS = 640
"""Longer side of the drawing."""
_MARGIN = 0.6
"""Metres around everything that is drawn."""
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#aa4499", "#7a5c00", "#332288", "#000000", "#6b6b6b")
"""Colours of the report's rows in order; people's first. The first ones are those of Okabe and Ito, for colour-blind
readers, who also have the shapes."""
_SHAPES = (
    "m-5 0 a5 5 0 1 0 10 0 a5 5 0 1 0 -10 0 z",
    "m-4.5 -4.5 h9 v9 h-9 z",
    "m0 -5.8 l5.5 9.8 h-11 z",
    "m0 -6.2 l6.2 6.2 l-6.2 6.2 l-6.2 -6.2 z",
    "m0 5.8 l5.5 -9.8 h-11 z",
)
"""Circle, square, triangle, diamond, triangle upside down; path data from the mark's middle."""
_TEMPLATE = Path(__file__).parent / "templates" / "overlay.svg.j2"


class _Trial(Protocol):
    """One line of a group's trials."""

    key: EpisodeKey
    item: EpisodeRun | Answer
    sr: float


@dataclass(frozen=True, slots=True)
class _Row:
    """One row name's trials, in pixels."""

    label: str
    colour: str
    shape: str
    is_dashed: bool
    trials: tuple[tuple[list[list[float]], bool], ...]
    """(corners of the way, or the one place pointed at; whether it succeeded) of each trial."""


def overlay_keys(groups: Sequence[TrialGroup], task: TaskKind, *, most: int) -> list[EpisodeKey]:
    """At most `most` episodes: those that most people did, and of these the ones on which people differ most."""
    hits: dict[EpisodeKey, list[float]] = {}
    for group in (group for group in groups if group.task == task and group.kind == "human"):
        for trial in _drawn(group):
            hits.setdefault(trial.key, []).append(trial.sr)
    apart = {key: min(np.mean(values), 100 - np.mean(values)) for key, values in hits.items()}
    ordered = sorted(hits, key=lambda key: (-len(hits[key]), -apart[key], key))
    return sorted(ordered[:most])


def overlay_name(key: EpisodeKey, task: TaskKind) -> str:
    """File name of an overlay."""
    return f"overlay-{task}-{key.split}-{key.scene}-{key.episode_id}.svg"


def floors_needed(groups: Sequence[TrialGroup], keys: Sequence[EpisodeKey]) -> Mapping[EpisodeKey, float]:
    """Height of the floor on which each episode starts or people pointed, for the storey under its overlay."""
    found: dict[EpisodeKey, float] = {}
    for trial in (trial for group in groups for trial in _drawn(group) if trial.key in keys):
        if isinstance(trial.item, EpisodeRun):
            found.setdefault(trial.key, trial.item.start.position[1])
        elif trial.item.ray is not None:
            found.setdefault(trial.key, trial.item.ray.storey_y)
        elif trial.item.candidates:
            found.setdefault(trial.key, trial.item.candidates[0][1])
    return found


def overlay_svg(
    groups: Sequence[TrialGroup],
    key: EpisodeKey,
    task: TaskKind,
    *,
    storey: StoreyMap | None = None,
    targets: Sequence[tuple[float, float]] = (),
) -> str:
    """All paths (PAN) or marks (POG) of one episode, a shape and a colour per row, with the label of the home.

    Args:
        groups: People and agents, with all runs of each agent.
        storey: The storey under the paths; None = only a frame.
        targets: Middles (x, z) of the right objects.
    """
    shown = [(group, trials) for group in groups if group.task == task and (trials := _drawn(group, str(key)))]
    places = [_points(trial.item) for _, trials in shown for trial in trials]
    view = _view_around(np.concatenate([*places, np.zeros((0, 2))]), storey, targets)
    starts = [t.item.start.position for _, trials in shown for t in trials if isinstance(t.item, EpisodeRun)]
    return drawn_svg(
        _TEMPLATE,
        title=f"{task.upper()} {key}",
        view=view,
        rows=[_row(group, trials, number, view) for number, (group, trials) in enumerate(shown)],
        are_walks=task == "pan",
        start=view.pixels((starts[0][0], starts[0][2])).tolist() if starts else None,
        targets=[view.pixels(target).tolist() for target in targets],
        free=None if storey is None else free_path(view, storey.free, storey.grid),
        labels=scene_labels(group.scene_kind for group, _ in shown),
    )


def _row(group: TrialGroup, trials: Sequence[_Trial], number: int, view: PlanView) -> _Row:
    hits = [trial.sr == 100 for trial in trials]
    ways = [view.pixels(_points(trial.item)).tolist() for trial in trials]
    return _Row(
        label=f"{row_label(group.who, group.condition)}: {sum(hits)} of {len(hits)} succeed",
        colour=_COLOURS[number % len(_COLOURS)],
        shape=_SHAPES[number % len(_SHAPES)],
        is_dashed=group.kind != "human",
        trials=tuple((way, hit) for way, hit in zip(ways, hits, strict=True) if way),
    )


def _view_around(
    points: NDArray[np.float64], storey: StoreyMap | None, targets: Sequence[tuple[float, float]]
) -> PlanView:
    """The view that shows everything drawn."""
    corners = [points]
    if storey is not None and storey.free.any():
        rows, cols = np.nonzero(storey.free)
        corners.append(storey.grid.xz_from_rc(np.array([[rows.min(), cols.min()], [rows.max(), cols.max()]])))
        corners += [np.array(targets).reshape(-1, 2) + shift for shift in (-0.5, 0.5)]  # and their rings
    found = np.concatenate(corners)
    return PlanView.around(found if len(found) else np.zeros((1, 2)), margin=_MARGIN, longest=_PIXELS)


def _drawn(group: TrialGroup, episode: str | None = None) -> list[_Trial]:
    """The trials that have a run or an answer, of one episode or of all."""
    trials = group.trials if episode is None else group.trials[group.trials["episode"] == episode]
    return list(trials[trials["item"].notna()].itertuples())


def _points(item: EpisodeRun | Answer) -> NDArray[np.float64]:
    """(N, 2) corners of the way, or the place pointed at, metres; turning on the spot adds none."""
    if isinstance(item, Answer):
        return np.array([[point[0], point[2]] for point in item.candidates[:1]]).reshape(-1, 2)
    xz = np.array([[pose.position[0], pose.position[2]] for pose in item.poses])
    return xz[np.concatenate([[True], np.any(np.abs(np.diff(xz, axis=0)) > 1e-9, axis=1)])]
