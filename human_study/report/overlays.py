"""Draws where people and agents walked and pointed at one episode, seen from above, on the free floor, as SVG."""

import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from sim.homes.kind import scene_labels
from sim.plan_view.svg import free_floor
from sim.plan_view.view import PlanView
from sim.tasks.run_files import Answer, EpisodeRun
from sim.types import EpisodeKey, GridSpec, TaskKind

from .trials import TrialGroup, row_label

_PIXELS = 640
"""Longer side of the drawing."""
_MARGIN = 0.6
"""Metres around everything that is drawn."""
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#aa4499", "#7a5c00", "#332288", "#000000", "#6b6b6b")
"""Colours of the report's rows in order; people's first. The first ones are those of Okabe and Ito, for colour-blind
readers, who also have the shapes."""
_SHAPES = ("circle", "square", "triangle", "diamond", "triangle down")
_LINE = 18
"""Height of a line of the legend in pixels."""
_TITLE = 26
DASHES = ' stroke-dasharray="6 3"'
"""Dash pattern of an agent's path."""


@dataclass(frozen=True, slots=True)
class FloorPlan:
    """The floor that is drawn under the paths."""

    free: NDArray[np.bool_]
    """(rows, cols), True where the robot's centre can be."""
    grid: GridSpec
    targets: tuple[tuple[float, float], ...] = ()
    """Middles of the right objects on the floor plan."""


def overlay_keys(groups: Sequence[TrialGroup], task: TaskKind, *, most: int) -> list[EpisodeKey]:
    """The episodes that most people did, beginning with those on which people differ most.

    Args:
        groups: People and agents.
        task: The overlays' task.
        most: Largest number of episodes.
    """
    hits: dict[EpisodeKey, list[float]] = {}
    for group in (group for group in groups if group.task == task and group.kind == "human"):
        for trial in _drawn(group):
            hits.setdefault(trial.key, []).append(trial.sr)
    apart = {key: min(np.mean(values), 100 - np.mean(values)) for key, values in hits.items()}
    ordered = sorted(hits, key=lambda key: (-len(hits[key]), -apart[key], key))
    return sorted(ordered[:most])


def overlay_svg(
    groups: Sequence[TrialGroup], key: EpisodeKey, task: TaskKind, *, floor: FloorPlan | None = None
) -> str:
    """All paths (PAN) or marks (POG) of one episode, a shape and a colour per row, with the label of the home.

    Args:
        groups: People and agents, with all runs of each agent.
        key: The episode.
        task: The overlay's task.
        floor: The floor under the paths; None = only a frame.
    """
    shown = [(group, _drawn(group, str(key))) for group in groups]
    shown = [(group, trials) for group, trials in shown if group.task == task and trials]
    lines = {id(trial): _points(trial) for _, trials in shown for trial in trials}
    points = np.concatenate([*lines.values(), np.zeros((0, 2))])
    view = _view_around(points, floor)
    drawn, rows = [], []
    for number, (group, trials) in reversed(list(enumerate(shown))):  # people above agents
        for trial in trials:
            drawn.append(_trial(view.pixels(lines[id(trial)]), trial, number, is_dashed=group.kind != "human"))
        hits = sum(trial.sr == 100 for trial in trials)
        text = f"{row_label(group.who, group.condition)}: {hits} of {len(trials)} succeed"
        rows.insert(0, (text, group.kind != "human" if task == "pan" else None))
    starts = _start(view, shown) if task == "pan" else ""
    below = _legend(
        rows, has_start=bool(starts), has_targets=bool(floor and floor.targets), has_floor=floor is not None
    )
    above = f"{starts}{_targets(view, floor)}{_scale_bar(view.scale, view.height - 10)}"
    picture = f"{_floor(view, floor)}{''.join(drawn)}{above}"
    labels = scene_labels(group.scene_kind for group, _ in shown)
    below = [*below, *(f'<text x="34" y="4" font-weight="bold">{label}</text>' for label in labels)]
    return _framed(f"{task.upper()} {key}", picture, below, size=(view.width, view.height))


def _view_around(points: NDArray[np.float64], floor: FloorPlan | None) -> PlanView:
    """The view that shows everything drawn."""
    corners = [points]
    if floor is not None and floor.free.any():
        rows, cols = np.nonzero(floor.free)
        at = np.array([[rows.min(), cols.min()], [rows.max(), cols.max()]])
        corners.append(floor.grid.xz_from_rc(at))
        corners += [np.array(floor.targets).reshape(-1, 2) + shift for shift in (-0.5, 0.5)]  # and their rings
    found = np.concatenate(corners)
    return PlanView.around(found if len(found) else np.zeros((1, 2)), margin=_MARGIN, longest=_PIXELS)


class _Trial(Protocol):
    """One row of a group's trials."""

    key: EpisodeKey
    sr: float
    item: EpisodeRun | Answer


def _drawn(group: TrialGroup, episode: str | None = None) -> list[_Trial]:
    """Trials that have a run or an answer, of one episode or of all."""
    trials = group.trials if episode is None else group.trials[group.trials["episode"] == episode]
    return list(trials[trials["item"].notna()].itertuples())


def _points(trial: _Trial) -> NDArray[np.float64]:
    """The points (N, 2) of the path, or the mark, metres."""
    if isinstance(trial.item, EpisodeRun):
        return np.array([[pose.position[0], pose.position[2]] for pose in trial.item.poses])
    found = trial.item.candidates[:1] if isinstance(trial.item, Answer) else ()
    return np.array([[point[0], point[2]] for point in found]).reshape(-1, 2)


def _trial(points: NDArray[np.float64], trial: _Trial, number: int, *, is_dashed: bool) -> str:
    if not len(points):
        return ""
    x, y = points[-1]
    end = _mark(x, y, number, is_filled=trial.sr == 100)
    if isinstance(trial.item, Answer):
        return end
    moves = np.concatenate([[True], np.any(np.abs(np.diff(points, axis=0)) > 1e-6, axis=1)])  # turning draws nothing
    path = " ".join(f"{px:.1f},{py:.1f}" for px, py in points[moves])
    return _line(path, number, is_dashed=is_dashed) + end


def _start(view: PlanView, shown: Sequence[tuple[TrialGroup, list[_Trial]]]) -> str:
    first = next((trial.item for _, trials in shown for trial in trials if isinstance(trial.item, EpisodeRun)), None)
    if first is None:
        return ""
    (place, *_) = view.pixels(np.array([[first.start.position[0], first.start.position[2]]])).tolist()
    return _cross(*place)


def _targets(view: PlanView, floor: FloorPlan | None) -> str:
    """A ring of one metre, within which an answer is right, around each target."""
    if floor is None or not floor.targets:
        return ""
    return "".join(_ring(x, y, view.scale) for x, y in view.pixels(np.array(floor.targets)))


def _floor(view: PlanView, floor: FloorPlan | None) -> str:
    """The free floor, drawn over a background where nobody can stand."""
    if floor is None:
        return ""
    ground = f'<rect width="{view.width}" height="{view.height}" fill="#dcdcd8"/>'
    return ground + free_floor(view, floor.free, floor.grid)


def overlay_name(key: EpisodeKey, task: TaskKind) -> str:
    """File name of an overlay."""
    return f"overlay-{task}-{key.split}-{key.scene}-{key.episode_id}.svg"


def floors_needed(groups: Sequence[TrialGroup], keys: Sequence[EpisodeKey]) -> Mapping[EpisodeKey, float]:
    """Height of the floor on which each episode starts or people pointed, for the floor plan under its overlay."""
    found: dict[EpisodeKey, float] = {}
    for trial in (trial for group in groups for trial in _drawn(group) if trial.key in keys):
        if isinstance(trial.item, EpisodeRun):
            found.setdefault(trial.key, trial.item.start.position[1])
        elif isinstance(trial.item, Answer) and trial.item.ray is not None:
            found.setdefault(trial.key, trial.item.ray.storey_y)
        elif isinstance(trial.item, Answer) and trial.item.candidates:
            found.setdefault(trial.key, trial.item.candidates[0][1])
    return found


def _mark(x: float, y: float, number: int, *, is_filled: bool) -> str:
    """The end of a path, or a mark, for the row with this number; a thin white edge keeps neighbours apart."""
    colour = COLOURS[number % len(COLOURS)]
    edge, width = ("white", 2) if is_filled else (colour, 1.8)
    paint = f'fill="{colour if is_filled else "white"}" stroke="{edge}" stroke-width="{width}" paint-order="stroke"'
    match _SHAPES[number % len(_SHAPES)]:
        case "circle":
            return f'<circle class="mark" cx="{x:.1f}" cy="{y:.1f}" r="5" {paint}/>'
        case "square":
            shape = "m-4.5 -4.5 h9 v9 h-9 z"
        case "triangle":
            shape = "m0 -5.8 l5.5 9.8 h-11 z"
        case "diamond":
            shape = "m0 -6.2 l6.2 6.2 l-6.2 6.2 l-6.2 -6.2 z"
        case _:
            shape = "m0 5.8 l5.5 -9.8 h-11 z"
    return f'<path class="mark" d="M{x:.1f} {y:.1f} {shape}" {paint}/>'


def _line(points: str, number: int, *, is_dashed: bool) -> str:
    """A path in the colour of the row with this number."""
    colour = COLOURS[number % len(COLOURS)]
    dashes = DASHES if is_dashed else ""
    return f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="1.6" opacity=".75"{dashes}/>'


def _cross(x: float, y: float) -> str:
    """A cross where an episode starts, the same for everybody."""
    return f'<path d="M{x - 6:.1f} {y:.1f} h12 M{x:.1f} {y - 6:.1f} v12" stroke="black" stroke-width="2.2"/>'


def _ring(x: float, y: float, radius: float) -> str:
    """A right object, and a ring around it."""
    ring = "" if radius <= 0 else f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}" fill="none" stroke="black"'
    ring += "" if radius <= 0 else ' stroke-dasharray="5 4"/>'
    return ring + f'<path d="M{x - 5:.1f} {y - 5:.1f} l10 10 m-10 0 l10 -10" stroke="black" stroke-width="1.8"/>'


def _scale_bar(metre: float, y: float) -> str:
    """A scale bar of one metre, or of five where one metre is short on the picture."""
    length = 1 if metre >= 30 else 5
    return (
        f'<path d="M10 {y:g} h{length * metre:.1f}" stroke="black" stroke-width="2"/>'
        f'<text x="{14 + length * metre:.1f}" y="{y + 4:g}">{length} m</text>'
    )


def _legend(
    rows: Sequence[tuple[str, bool | None]], *, has_start: bool, has_targets: bool, has_floor: bool
) -> list[str]:
    """The lines below an overlay, each drawn from its own corner.

    Args:
        rows: Text of each row in order, and whether its paths are dashed; None = it has marks and no paths.
        has_start: Whether the start is drawn.
        has_targets: Whether the right objects are drawn.
        has_floor: Whether the free floor is drawn.
    """
    lines = []
    for number, (text, is_dashed) in enumerate(rows):
        sample = "" if is_dashed is None else _line("0,0 22,0", number, is_dashed=is_dashed)
        lines.append(f'{sample}{_mark(22, 0, number, is_filled=True)}<text x="34" y="4">{html.escape(text)}</text>')
    signs = "Filled: success. Open: failure."
    lines.append(f'<text x="34" y="4">{signs}</text>')
    if has_start:
        lines.append(f'{_cross(22, 0)}<text x="34" y="4">Start</text>')
    if has_targets:
        lines.append(f'{_ring(22, 0, 0)}<text x="34" y="4">Right object; the ring is 1 m around its middle</text>')
    ground = "White: where the robot can stand. Grey: walls, furniture, outside."
    if not has_floor:
        ground = "The floor is not drawn: the report was made without --dataset."
    return [*lines, f'<text x="34" y="4">{ground}</text>']


def _framed(title: str, picture: str, lines: Sequence[str], *, size: tuple[int, int]) -> str:
    """The whole file: a title, the picture, and the legend.

    Args:
        title: Text above the picture.
        picture: SVG elements of the picture, drawn from (0, 0).
        lines: Lines of the legend.
        size: (width, height) of the picture in pixels.
    """
    width, height = size
    text = html.escape(title)
    below = _TITLE + height + 20
    rows = "".join(f'<g transform="translate(10 {below + _LINE * n})">{one}</g>' for n, one in enumerate(lines))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{max(width, 460) + 20}" height="{below + _LINE * len(lines)}" '
        f'role="img" aria-label="{text}" font-family="sans-serif" font-size="12">'
        f'<rect width="100%" height="100%" fill="white"/>'
        f'<text x="10" y="18" font-size="13" font-weight="bold">{text}</text>'
        f'<g transform="translate(10 {_TITLE})">{picture}'
        f'<rect width="{width}" height="{height}" fill="none" stroke="#8a8a86"/></g>{rows}</svg>\n'
    )
