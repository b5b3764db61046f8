"""Where people and agents walked and pointed at one episode, seen from above, as SVG; under them the free floor."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.homes.kind import scene_labels
from sim.tasks.run_files import Answer, EpisodeRun
from sim.types import EpisodeKey, GridSpec, TaskKind

from .overlay_marks import framed, legend, line, mark, scale_bar, start, target
from .row_labels import row_label
from .trial_groups import CountedTrial, TrialGroup

_PIXELS = 640
"""Longer side of the drawing."""
_MARGIN = 0.6
"""Metres around everything that is drawn."""


@dataclass(frozen=True, slots=True)
class FloorPlan:
    """What lies under the paths."""

    free: NDArray[np.bool_]
    """(rows, cols), True where the robot's centre can be."""
    grid: GridSpec
    targets: tuple[tuple[float, float], ...] = ()
    """Middles of the right objects on the floor plan."""


def overlay_keys(groups: Sequence[TrialGroup], task: TaskKind, *, most: int) -> list[EpisodeKey]:
    """The episodes that most people did, those on which they differ most first.

    Args:
        groups: People and agents.
        task: Of the overlays.
        most: So many at most.
    """
    hits: dict[EpisodeKey, list[float]] = {}
    for trial in (t for group in groups if group.task == task and group.kind == "human" for t in group.trials):
        if trial.item is not None:
            hits.setdefault(trial.key, []).append(trial.figures["sr"] or 0.0)
    apart = {key: min(np.mean(values), 100 - np.mean(values)) for key, values in hits.items()}
    ordered = sorted(hits, key=lambda key: (-len(hits[key]), -apart[key], key))
    return sorted(ordered[:most])


def overlay_svg(
    groups: Sequence[TrialGroup], key: EpisodeKey, task: TaskKind, *, floor: FloorPlan | None = None
) -> str:
    """All paths (PAN) or marks (POG) of one episode, a shape and a colour per row, and what must be said of the home.

    Args:
        groups: People and agents, several runs of an agent included.
        key: The episode.
        task: Of the overlay.
        floor: Under the paths; None = only a frame.
    """
    shown = [(group, [t for t in group.trials if t.key == key and t.item is not None]) for group in groups]
    shown = [(group, trials) for group, trials in shown if group.task == task and trials]
    lines = {id(trial): _points(trial) for _, trials in shown for trial in trials}
    points = np.concatenate([*lines.values(), np.zeros((0, 2))])
    view = _View.around(points, floor)
    drawn, rows = [], []
    for number, (group, trials) in reversed(list(enumerate(shown))):  # people above agents
        for trial in trials:
            drawn.append(_trial(view.pixels(lines[id(trial)]), trial, number, is_dashed=group.kind != "human"))
        hits = sum(trial.figures["sr"] == 100 for trial in trials)
        text = f"{row_label(group.who, group.condition)}: {hits} of {len(trials)} succeed"
        rows.insert(0, (text, group.kind != "human" if task == "pan" else None))
    starts = _start(view, shown) if task == "pan" else ""
    below = legend(rows, has_start=bool(starts), has_targets=bool(floor and floor.targets), has_floor=floor is not None)
    picture = (
        f"{_floor(view, floor)}{''.join(drawn)}{starts}{_targets(view, floor)}{scale_bar(view.scale, view.height - 10)}"
    )
    labels = scene_labels(group.scene_kind for group, _ in shown)
    below = [*below, *(f'<text x="34" y="4" font-weight="bold">{label}</text>' for label in labels)]
    return framed(f"{task.upper()} {key}", picture, below, size=(view.width, view.height))


@dataclass(frozen=True, slots=True)
class _View:
    """From metres on the floor plan to pixels."""

    low: tuple[float, float]
    scale: float
    """Pixels per metre."""
    width: int
    height: int

    @classmethod
    def around(cls, points: NDArray[np.float64], floor: FloorPlan | None) -> "_View":
        corners = [points]
        if floor is not None and floor.free.any():
            rows, cols = np.nonzero(floor.free)
            at = np.array([[rows.min(), cols.min()], [rows.max(), cols.max()]])
            corners.append(floor.grid.xz_from_rc(at))
            corners += [np.array(floor.targets).reshape(-1, 2) + shift for shift in (-0.5, 0.5)]  # and their rings
        found = np.concatenate(corners)
        found = found if len(found) else np.zeros((1, 2))
        low, high = found.min(axis=0) - _MARGIN, found.max(axis=0) + _MARGIN
        scale = _PIXELS / float(max(high - low))
        return cls((float(low[0]), float(low[1])), scale, *(round(side * scale) for side in high - low))

    def pixels(self, xz: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N, 2) drawing coordinates of (N, 2) metres."""
        return (xz - np.array(self.low)) * self.scale


def _points(trial: CountedTrial) -> NDArray[np.float64]:
    """(N, 2) metres: the path, or the mark."""
    if isinstance(trial.item, EpisodeRun):
        return np.array([[pose.position[0], pose.position[2]] for pose in trial.item.poses])
    found = trial.item.candidates[:1] if isinstance(trial.item, Answer) else ()
    return np.array([[point[0], point[2]] for point in found]).reshape(-1, 2)


def _trial(points: NDArray[np.float64], trial: CountedTrial, number: int, *, is_dashed: bool) -> str:
    if not len(points):
        return ""
    x, y = points[-1]
    end = mark(x, y, number, is_filled=trial.figures["sr"] == 100)
    if isinstance(trial.item, Answer):
        return end
    moves = np.concatenate([[True], np.any(np.abs(np.diff(points, axis=0)) > 1e-6, axis=1)])  # turning draws nothing
    path = " ".join(f"{px:.1f},{py:.1f}" for px, py in points[moves])
    return line(path, number, is_dashed=is_dashed) + end


def _start(view: _View, shown: Sequence[tuple[TrialGroup, list[CountedTrial]]]) -> str:
    first = next((trial.item for _, trials in shown for trial in trials if isinstance(trial.item, EpisodeRun)), None)
    if first is None:
        return ""
    (place, *_) = view.pixels(np.array([[first.start.position[0], first.start.position[2]]])).tolist()
    return start(*place)


def _targets(view: _View, floor: FloorPlan | None) -> str:
    """A ring of one metre, within which an answer is right, around each target."""
    if floor is None or not floor.targets:
        return ""
    return "".join(target(x, y, view.scale) for x, y in view.pixels(np.array(floor.targets)))


def _floor(view: _View, floor: FloorPlan | None) -> str:
    """Free cells as one path, a rectangle per run of cells in a row, on what nobody can stand on."""
    if floor is None:
        return ""
    edges = np.diff(np.pad(floor.free.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    firsts, lasts = np.argwhere(edges == 1), np.argwhere(edges == -1)
    corner = view.pixels(floor.grid.xz_from_rc(firsts) - floor.grid.cell / 2)
    side = floor.grid.cell * view.scale
    runs = [
        f"M{x:.1f} {y:.1f}h{(last - first) * side:.1f}v{side + 0.3:.1f}h{-(last - first) * side:.1f}z"
        for (x, y), (_, first), (_, last) in zip(corner, firsts, lasts, strict=True)
    ]
    ground = f'<rect width="{view.width}" height="{view.height}" fill="#dcdcd8"/>'
    return f'{ground}<path d="{"".join(runs)}" fill="#ffffff"/>'


def overlay_name(key: EpisodeKey, task: TaskKind) -> str:
    """File name of an overlay."""
    return f"overlay-{task}-{key.split}-{key.scene}-{key.episode_id}.svg"


def floors_needed(groups: Sequence[TrialGroup], keys: Sequence[EpisodeKey]) -> Mapping[EpisodeKey, float]:
    """Height of the floor on which each episode starts, or was pointed at; for the plan under it."""
    found: dict[EpisodeKey, float] = {}
    for trial in (trial for group in groups for trial in group.trials if trial.key in keys):
        if isinstance(trial.item, EpisodeRun):
            found.setdefault(trial.key, trial.item.start.position[1])
        elif isinstance(trial.item, Answer) and trial.item.ray is not None:
            found.setdefault(trial.key, trial.item.ray.storey_y)
        elif isinstance(trial.item, Answer) and trial.item.candidates:
            found.setdefault(trial.key, trial.item.candidates[0][1])
    return found
