"""Draws the answers of `ask`: for each question the map with scores and marks, and the pictures that see them best."""

import io
import textwrap
from collections.abc import Sequence

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from grounding.maps.best_views import Sight
from grounding.maps.home_map import HomeMemory, Memory
from grounding.methods.free_text import Reply
from grounding.types import FeatureMap
from recordings.layers import places_of
from recordings.memory import storeys_of_memory
from sim.plan_view.axes import draw_free_floor
from sim.plan_view.storey import StoreyMap
from sim.walk.storeys import storey_of

MOST_SIGHTS = 3
"""Pictures beside a map."""
_MARK, _HEIGHT, _WIDTHS, _DPI = "#ff6020", 3.4, (4.6, 3.4), 110
"""Colour of marks; inches of a row, of a map and of a picture."""


def answers_png(
    home: HomeMemory, memory: Memory, replies: Sequence[Reply], sights: Sequence[Sequence[Sight]], *, title: str
) -> bytes:
    """A PNG with a row per question: the storey of the best place, then the pictures that see it best.

    Args:
        memory: The map that was asked, `Asker.memory`.
        sights: At most MOST_SIGHTS pictures of each question's best place; none = the map alone.
    """
    columns = max(map(len, sights), default=0)
    size = (_WIDTHS[0] + columns * _WIDTHS[1], 0.5 + _HEIGHT * len(replies))
    figure = Figure(figsize=size, layout="constrained")
    rows = figure.subplots(len(replies), 1 + columns, squeeze=False, width_ratios=[_WIDTHS[0], *[_WIDTHS[1]] * columns])
    maps = storeys_of_memory(home)
    for axes, reply, seen in zip(rows, replies, sights, strict=True):
        _draw_map(axes[0], maps, memory, reply)
        for panel in axes[1:]:
            panel.set_axis_off()
        for panel, sight in zip(axes[1:], seen, strict=False):
            panel.imshow(sight.frame.rgb)
            panel.plot(*sight.uv, "o", markersize=15, markerfacecolor="none", markeredgecolor=_MARK, markeredgewidth=2)
    figure.suptitle(title, fontsize=9)
    buffer = io.BytesIO()
    with matplotlib.rc_context({"svg.hashsalt": "personal-viz"}):
        figure.savefig(buffer, format="png", dpi=_DPI, metadata={"Software": None})
    return buffer.getvalue()


def _draw_map(axes: Axes, maps: Sequence[StoreyMap], memory: Memory, reply: Reply) -> None:
    index = reply.places[0].storey if reply.places else 0
    shown = maps[index]
    draw_free_floor(axes, shown.free, shown.grid)
    _draw_scores(axes, maps, index, memory, reply)
    for rank, place in enumerate(reply.places, start=1):
        if place.storey == index:
            x, _, z = place.position
            axes.plot(x, z, "o", color=_MARK, markersize=12, markeredgecolor="white")
            axes.annotate(str(rank), (x, z), color="white", ha="center", va="center", fontsize=8)
    (left, top), (rows, cols), cell = shown.grid.origin_xz, shown.grid.shape, shown.grid.cell
    axes.set_xlim(left, left + cols * cell)
    axes.set_ylim(top + rows * cell, top)
    axes.set_aspect("equal")
    axes.tick_params(labelsize=6)
    storey = f"storey {index}" if len(maps) > 1 else ""
    axes.set_title("\n".join(textwrap.wrap(reply.query, 50)), fontsize=9)
    axes.set_xlabel("\n".join(textwrap.wrap("; ".join(filter(None, (storey, reply.phrase))), 70)), fontsize=7)


def _draw_scores(axes: Axes, maps: Sequence[StoreyMap], index: int, memory: Memory, reply: Reply) -> None:
    layers = reply.grounding.layers
    if layers is None or not len(layers.rc):
        return
    points, floors = places_of(memory, layers), [(shown.floor_y, shown.floor_y) for shown in maps]
    here = np.array([storey_of(y, floors) == index for y in points[:, 1].tolist()]) & np.isfinite(layers.final)
    if isinstance(memory, FeatureMap):
        (left, top), (rows, cols), cell = memory.grid.origin_xz, memory.grid.shape, memory.grid.cell
        extent = (left, left + cols * cell, top + rows * cell, top)
        values = layers.on_grid(np.where(here, layers.final, np.nan))
        axes.imshow(values, extent=extent, cmap="viridis", alpha=0.75, interpolation="nearest", zorder=1)
    else:
        xz = points[here][:, [0, 2]]
        axes.scatter(*xz.T, c=layers.final[here], cmap="viridis", s=24, edgecolors="#555", linewidths=0.4, zorder=1)
