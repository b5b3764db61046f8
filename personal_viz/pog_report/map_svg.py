"""One failure from above as SVG: the map's scores, the answers, the right object and what else the home holds."""

import html
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from grounding.maps.files import load_memory
from grounding.maps.home_map import HomeMemory, ObjectMap
from grounding.types import FeatureMap, Layers
from sim.plan_view.heat import heat_colours, heat_shares
from sim.plan_view.svg import free_floor
from sim.plan_view.view import PlanView
from sim.tasks.observers import FREE
from sim.tasks.rules import SUCCESS_RADIUS
from sim.types import STOREY_GAP, GridSpec

from .gallery import DrawnFailure

_PIXELS, _LEAST_PIXELS = 420, 160
"""Longer side of the drawing, and least length of a side."""
_MARGIN = 1.5
"""Metres around everything that is drawn."""
_GROUND, _CLOSED, _KNOWN = "#f4f4f1", "#d7d7d2", "#e4e9f2"
_OPAQUE = 0.85
"""Of cells: the floor that a robot saw shines through."""
_GOAL, _ANSWER, _OTHER = "#d02020", "#ffffff", "#55555a"
_NEAR = 2.5
"""Metres from the answer or the goal within which other objects are named; the mouse shows the names of the rest."""


def failure_svg(item: DrawnFailure) -> str:
    """The picture; the same failure gives the same text."""
    view = _view(item)
    layers = item.again.grounding.layers if item.again.grounding else None
    memory = item.again.memory
    parts = [f'<rect width="{view.width}" height="{view.height}" fill="{_GROUND}"/>', *_floor(view, item)]
    if isinstance(memory, FeatureMap):
        parts += _cells(view, memory, layers)
    elif isinstance(memory, ObjectMap):
        parts += _boxes(view, memory, layers)
    parts += [*_others(view, item), *_targets(view, item), *_answers(view, item), _bar(view)]
    label = item.info.scene_label
    words = f'<text x="8" y="{view.height + 12}" font-size="9">{label}</text>' if label else ""
    below = 18 if label else 0
    title = html.escape(f"{item.method}: {item.episode.key}")
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{view.width}" height="{view.height + below}" role="img" '
        f'aria-label="{title}" font-family="sans-serif" font-size="11"><title>{title}</title>'
        f"{''.join(parts)}{words}</svg>\n"
    )


def _at(view: PlanView, x: float, z: float) -> tuple[float, float]:
    """(right, down) pixels."""
    right, down = view.pixels((x, z)).tolist()
    return right, down


def _floor_y(item: DrawnFailure) -> float:
    return item.episode.targets[0].floor_y


def _on_storey(item: DrawnFailure) -> list[tuple[str, str, float, float, bool]]:
    """(name, category, x, z, is right) of the objects on the goal's storey."""
    right = {target.object_name for target in item.episode.targets}
    return [
        (goal.object_name, goal.object_category, goal.position[0], goal.position[2], goal.object_name in right)
        for goal in item.goals
        if abs(goal.floor_y - _floor_y(item)) < STOREY_GAP
    ]


def _view(item: DrawnFailure) -> PlanView:
    points = [(x, z) for _, _, x, z, _ in _on_storey(item)] + [(p[0], p[2]) for p in item.answer.candidates]
    memory = item.again.memory
    if isinstance(memory, FeatureMap) and len(memory.rc):
        points += [tuple(xz) for xz in memory.grid.xz_from_rc(memory.rc).tolist()]
    elif isinstance(memory, ObjectMap):
        points += [(thing.centre[0], thing.centre[2]) for thing in memory.objects]
    return PlanView.around(np.array(points, float), margin=_MARGIN, longest=_PIXELS, least=_LEAST_PIXELS)


def _floor(view: PlanView, item: DrawnFailure) -> list[str]:
    """What the robot that made the map knew to be free, a rectangle per run of cells in a row; none on oracle maps."""
    if item.again.map_file is None:
        return []
    occupancy = _memory_of(item.again.map_file).storey_near(_floor_y(item)).occupancy
    return [free_floor(view, occupancy.cells == FREE, occupancy.grid)]


@lru_cache(maxsize=4)
def _memory_of(path: Path) -> HomeMemory:
    return load_memory(path)


def _cells(view: PlanView, memory: FeatureMap, layers: Layers | None) -> list[str]:
    """Every known cell with its final score; grey where the phrases' gate is closed."""
    known = [_square(view, memory.grid, rc, _KNOWN if layers is None else _CLOSED) for rc in memory.rc.tolist()]
    if layers is None:
        return known
    open_ = np.isfinite(layers.final)
    colours = _heat(layers.final[open_])
    cells = [
        _square(view, memory.grid, rc, colour, title=f"{score:.3f}")
        for rc, colour, score in zip(layers.rc[open_].tolist(), colours, layers.final[open_].tolist(), strict=True)
    ]
    return known + cells


def _square(view: PlanView, grid: GridSpec, rc: list[int], colour: str, *, title: str = "") -> str:
    x, z = grid.origin_xz[0] + rc[1] * grid.cell, grid.origin_xz[1] + rc[0] * grid.cell
    left, top = _at(view, x, z)
    side = grid.cell * view.scale
    shape = f'<rect x="{left:.1f}" y="{top:.1f}" width="{side:.1f}" height="{side:.1f}" fill="{colour}" '
    shape += f'fill-opacity="{_OPAQUE}"'
    return f"{shape}><title>{title}</title></rect>" if title else f"{shape}/>"


def _boxes(view: PlanView, memory: ObjectMap, layers: Layers | None) -> list[str]:
    scores = layers.final if layers is not None and len(layers.final) == len(memory.objects) else None
    colours = [_KNOWN] * len(memory.objects) if scores is None else _heat(scores)
    parts = []
    for thing, colour in zip(memory.objects, colours, strict=True):
        (x0, _, z0), (x1, _, z1) = thing.box
        left, top = _at(view, x0, z0)
        width, height = (max(2.0, length * view.scale) for length in (x1 - x0, z1 - z0))
        name = html.escape(thing.caption or "no caption")
        parts.append(
            f'<rect x="{left:.1f}" y="{top:.1f}" width="{width:.1f}" height="{height:.1f}" fill="{colour}" '
            f'stroke="#888" stroke-width=".6"><title>{name}</title></rect>'
        )
    return parts


def _heat(scores: NDArray[np.float32]) -> list[str]:
    """Colours from the least (dark blue) to the greatest (yellow); grey where there is none."""
    is_known = np.isfinite(scores)
    rgb = heat_colours(np.where(is_known, heat_shares(scores), 0.0))
    names = ["#{:02x}{:02x}{:02x}".format(*row) for row in np.round(rgb).astype(int).tolist()]
    return [name if known else _CLOSED for name, known in zip(names, is_known.tolist(), strict=True)]


def _others(view: PlanView, item: DrawnFailure) -> list[str]:
    """A dot for every other object; its category beside it where it matters."""
    marked = [(target.position[0], target.position[2]) for target in item.episode.targets]
    marked += [(point[0], point[2]) for point in item.answer.candidates[:1]]
    parts = []
    for name, category, x, z, is_right in _on_storey(item):
        if is_right:
            continue
        left, top = _at(view, x, z)
        same = category == item.episode.record.object_category
        dot = f'<circle cx="{left:.1f}" cy="{top:.1f}" r="{3.2 if same else 1.8}" '
        dot += f'fill="{_GOAL if same else _OTHER}" stroke="white" stroke-width=".7">'
        parts.append(f"{dot}<title>{html.escape(name)}</title></circle>")
        is_near = any(np.hypot(x - mx, z - mz) <= _NEAR for mx, mz in marked)
        if name == item.failure.object_name or (same and is_near):
            parts.append(_text(view, left, top - 4, category, "#222"))
    return parts


def _targets(view: PlanView, item: DrawnFailure) -> list[str]:
    parts = []
    for target in item.episode.targets:
        x, y = _at(view, target.position[0], target.position[2])
        ring = f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{SUCCESS_RADIUS * view.scale:.1f}" fill="none" stroke="{_GOAL}"'
        cross = f"M{x - 5:.1f} {y - 5:.1f}l10 10m-10 0l10 -10"
        parts.append(
            f'{ring} stroke-width="1.6" stroke-dasharray="5 3"/>'
            f'<path d="{cross}" stroke="white" stroke-width="4"/><path d="{cross}" stroke="{_GOAL}" stroke-width="2"/>'
            f"{_text(view, x, y + 14, target.object_category, _GOAL)}"
        )
    return parts


def _answers(view: PlanView, item: DrawnFailure) -> list[str]:
    """The candidates as numbered discs, the first one black."""
    parts = []
    for rank, point in reversed(list(enumerate(item.answer.candidates, start=1))):
        x, y = _at(view, point[0], point[2])
        fill, ink = ("#111", _ANSWER) if rank == 1 else (_ANSWER, "#111")
        parts.append(
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="7.5" fill="{fill}" stroke="#111" stroke-width="1.2"/>'
            f'<text x="{x:.1f}" y="{y + 4:.1f}" text-anchor="middle" fill="{ink}" font-weight="bold">{rank}</text>'
        )
    return parts


def _bar(view: PlanView) -> str:
    y = view.height - 8
    return (
        f'<path d="M8 {y} h{view.scale:.1f}" stroke="#111" stroke-width="2"/>'
        f'<text x="{12 + view.scale:.1f}" y="{y + 4}">1 m</text>'
    )


def _text(view: PlanView, x: float, y: float, text: str, colour: str) -> str:
    """Beside a place, towards the middle of the picture, so that its edge cuts nothing off."""
    is_right = x > 0.6 * view.width
    anchor = ' text-anchor="end"' if is_right else ""
    return (
        f'<text x="{x + (-7 if is_right else 7):.1f}" y="{y:.1f}" fill="{colour}" stroke="white" stroke-width="3" '
        f'paint-order="stroke"{anchor}>{html.escape(text)}</text>'
    )
