"""One failure from above as SVG: the map's scores, the answers, the right object and what else the home holds."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from grounding.maps.files import load_memory
from grounding.maps.home_map import HomeMemory, ObjectMap
from grounding.types import FeatureMap, Layers
from sim.episodes.schema import Goal
from sim.plan_view.heat import heat_colours, heat_shares
from sim.plan_view.svg import drawn_svg, free_path
from sim.plan_view.view import PlanView
from sim.tasks.observers import FREE
from sim.tasks.rules import SUCCESS_RADIUS
from sim.walk.storeys import same_storey

from .gallery import DrawnFailure

_TEMPLATE = Path(__file__).with_name("failure.svg.j2")
_PIXELS, _LEAST_PIXELS = 420, 160
"""Longer side of the drawing, and least length of a side."""
_MARGIN = 1.5
"""Metres around everything that is drawn."""
_CLOSED, _KNOWN = "#d7d7d2", "#e4e9f2"
"""Cells and objects that are closed to the method, and those of a method without scores."""
_NEAR = 2.5
"""Metres from the answer or the goal within which other objects are named; the mouse shows the names of the rest."""


@dataclass(frozen=True, slots=True)
class _Tile:
    """A cell or an object of the map, in pixels."""

    left: float
    top: float
    width: float
    height: float
    colour: str
    title: str = ""
    """Shown under the mouse."""


@dataclass(frozen=True, slots=True)
class _Dot:
    """An object that is not the right one, in pixels."""

    x: float
    y: float
    title: str
    label: str
    """Its category where it matters, or nothing."""
    is_same_category: bool


def failure_svg(item: DrawnFailure) -> str:
    """The picture; the same failure gives the same text."""
    floor_y = item.episode.targets[0].floor_y
    goals = [goal for goal in item.goals if same_storey(goal.floor_y, floor_y)]
    view, memory = _view(item, goals), item.again.memory
    layers = item.again.grounding.layers if item.again.grounding else None
    free = None
    if item.again.map_file is not None:  # oracle maps have no free floor
        occupancy = _memory_of(item.again.map_file).storey_near(floor_y).occupancy
        free = free_path(view, occupancy.cells == FREE, occupancy.grid)
    return drawn_svg(
        _TEMPLATE,
        title=f"{item.method}: {item.episode.key}",
        label=item.info.scene_label,
        view=view,
        free=free,
        cells=_cells(view, memory, layers) if isinstance(memory, FeatureMap) else [],
        boxes=_boxes(view, memory, layers) if isinstance(memory, ObjectMap) else [],
        others=_others(view, item, goals),
        targets=[(target.object_category, *_pixels(view, target.position)) for target in item.episode.targets],
        radius=SUCCESS_RADIUS * view.scale,
        answers=[_pixels(view, point) for point in item.answer.candidates],
    )


def _pixels(view: PlanView, point: tuple[float, float, float]) -> tuple[float, float]:
    """(right, down) of a world point."""
    right, down = view.pixels((point[0], point[2])).tolist()
    return right, down


def _view(item: DrawnFailure, goals: list[Goal]) -> PlanView:
    points = [goal.position for goal in goals] + list(item.answer.candidates)
    memory = item.again.memory
    if isinstance(memory, ObjectMap):
        points += [thing.centre for thing in memory.objects]
    xz = np.array(points, float).reshape(-1, 3)[:, [0, 2]]
    if isinstance(memory, FeatureMap):
        xz = np.concatenate([xz, memory.grid.xz_from_rc(memory.rc)])
    return PlanView.around(xz, margin=_MARGIN, longest=_PIXELS, least=_LEAST_PIXELS)


@lru_cache(maxsize=4)
def _memory_of(path: Path) -> HomeMemory:
    return load_memory(path)


def _cells(view: PlanView, memory: FeatureMap, layers: Layers | None) -> list[_Tile]:
    """Every known cell, and over it its final score; grey where the phrases' gate is closed."""
    side = memory.grid.cell * view.scale

    def squares(rc: NDArray[np.integer], colours: list[str], titles: list[str]) -> list[_Tile]:
        corners = view.pixels(memory.grid.xz_from_rc(rc) - memory.grid.cell / 2).reshape(-1, 2).tolist()
        found = zip(corners, colours, titles, strict=True)
        return [_Tile(left, top, side, side, colour, title) for (left, top), colour, title in found]

    blank = [""] * len(memory.rc)
    if layers is None:
        return squares(memory.rc, [_KNOWN] * len(memory.rc), blank)
    is_open = np.isfinite(layers.final)
    scores = layers.final[is_open]
    known = squares(memory.rc, [_CLOSED] * len(memory.rc), blank)
    return known + squares(layers.rc[is_open], _heat(scores), [f"{score:.3f}" for score in scores.tolist()])


def _boxes(view: PlanView, memory: ObjectMap, layers: Layers | None) -> list[_Tile]:
    scores = layers.final if layers is not None and len(layers.final) == len(memory.objects) else None
    colours = [_KNOWN] * len(memory.objects) if scores is None else _heat(scores)
    tiles = []
    for thing, colour in zip(memory.objects, colours, strict=True):
        low, high = (_pixels(view, corner) for corner in thing.box)
        width, height = (max(2.0, far - near) for near, far in zip(low, high, strict=True))
        tiles.append(_Tile(*low, width, height, colour, thing.caption or "no caption"))
    return tiles


def _heat(scores: NDArray[np.float32]) -> list[str]:
    """Colours from the least (dark blue) to the greatest (yellow); grey where there is none."""
    is_known = np.isfinite(scores)
    rgb = heat_colours(np.where(is_known, heat_shares(scores), 0.0))
    names = ["#{:02x}{:02x}{:02x}".format(*row) for row in np.round(rgb).astype(int).tolist()]
    return [name if known else _CLOSED for name, known in zip(names, is_known.tolist(), strict=True)]


def _others(view: PlanView, item: DrawnFailure, goals: list[Goal]) -> list[_Dot]:
    right = {target.object_name for target in item.episode.targets}
    marked = np.array([target.position for target in item.episode.targets] + list(item.answer.candidates[:1]), float)
    dots = []
    for goal in goals:
        if goal.object_name in right:
            continue
        is_same = goal.object_category == item.episode.record.object_category
        is_near = np.hypot(*(marked - goal.position).T[[0, 2]]).min() <= _NEAR
        is_named = goal.object_name == item.failure.object_name or (is_same and is_near)
        label = goal.object_category if is_named else ""
        dots.append(_Dot(*_pixels(view, goal.position), goal.object_name, label, is_same))
    return dots
