"""Draws one storey from above into a figure: free space, objects, every run's way or points, start and goal."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Polygon, Rectangle
from numpy.typing import NDArray

from recordings.scene import GoalRegion
from recordings.traces import Trace
from sim.frames import forward_from_yaw
from sim.mesh import Scene
from sim.plan_view.axes import CLOSED, draw_free_floor
from sim.plan_view.storey import StoreyMap, storey_map, storeys_of
from sim.tasks.rules import SUCCESS_RADIUS
from sim.tasks.run_files import Answer, EpisodeRun

_PIECE, _PIECE_EDGE, _WORD = "#e9e6df", "#b9b3a7", "#8a857b"
INK, GOAL = "#1c1d21", "#d81b60"
"""The goal's colour is none of the runs'."""
LineStyle = str | tuple[int, tuple[float, float]]
STYLES: tuple[LineStyle, ...] = ("solid", (0, (4, 1.6)), (0, (1.2, 1.2)))
"""Lines of the first, second and third round of the palette."""
_WIDEST, _NARROWEST = 4.2, 1.6
"""Line widths in points: the runs that are drawn first are wider, so that runs on one way all show."""
_MARGIN = 1.6
"""Metres shown around ways and goal at least: room for the largest success radius."""
_LARGE_PIECE, _NAMED_PIECE = 0.25, 0.7
"""Square metres from which an object is drawn, and from which it is named."""
_TALLEST_FLOOR = 2.2
"""An object whose centre is higher over the floor hangs from the ceiling (metres)."""


@dataclass(frozen=True, slots=True)
class Floor:
    """One storey to be drawn."""

    index: int
    """Place in the scene's storey heights."""
    count: int
    """How many storeys the home has."""
    floor_y: float
    map: StoreyMap | None
    """None where the geometry of a scan may not be shown."""
    low: tuple[float, float]
    high: tuple[float, float]
    """Corners (x, z) of the shown part, world metres."""

    @property
    def aspect(self) -> float:
        """Width over height."""
        return (self.high[0] - self.low[0]) / (self.high[1] - self.low[1])


def floors_of(scene: Scene, goal: GoalRegion, traces: Sequence[Trace], *, has_map: bool) -> list[Floor]:
    """The storeys on which a run, an answer or a target is, from the lowest."""
    heights = scene.navigation.storey_heights
    points = np.concatenate([goal.centres, *(trace.positions for trace in traces)])
    floor_ys = np.concatenate([goal.floors_y, *(trace.positions[:, 1] for trace in traces)])
    storeys = storeys_of(floor_ys, scene.navigation)
    found = []
    for index in sorted(set(storeys.tolist())):
        here = points[storeys == index][:, [0, 2]]
        low, high = here.min(axis=0) - _MARGIN, here.max(axis=0) + _MARGIN
        picture = storey_map(scene.navigation, index) if has_map else None
        if picture is not None:
            origin = np.asarray(picture.grid.origin_xz)
            size = np.array(picture.grid.shape)[::-1] * picture.grid.cell
            low, high = np.minimum(low, origin), np.maximum(high, origin + size)
        corners = (float(low[0]), float(low[1])), (float(high[0]), float(high[1]))
        found.append(Floor(index, len(heights), heights[index], picture, *corners))
    return found


def draw_floor(
    axes: Axes, floor: Floor, scene: Scene, goal: GoalRegion, traces: Sequence[Trace], *, words: bool
) -> None:
    """Draws a storey into `axes`, world metres, +x right and +z down.

    Args:
        axes: Shaped as `floor.aspect`.
        floor: One of `floors_of`.
        traces: PAN runs, or answers; never both.
        words: Whether objects, marks and the scale are named; thumbnails have no room for it.
    """
    axes.set_xlim(floor.low[0], floor.high[0])
    axes.set_ylim(floor.high[1], floor.low[1])
    axes.set_axis_off()
    is_walk = any(isinstance(trace.run, EpisodeRun) for trace in traces)
    if floor.map is not None:
        axes.add_patch(Rectangle(floor.low, *np.subtract(floor.high, floor.low), facecolor=CLOSED, lw=0, zorder=-1))
        draw_free_floor(axes, floor.map.free, floor.map.grid)
        axes.set_aspect("auto")
        _draw_pieces(axes, floor, scene, words=words)
    _draw_goal(axes, floor, goal, is_walk=is_walk, size=1.0 if words else 0.7)
    if floor.map is not None and is_walk and goal.path is not None:
        xz = np.where((goal.path_storeys == floor.index)[:, None], goal.path[:, [0, 2]], math.nan)
        axes.plot(xz[:, 0], xz[:, 1], color=GOAL, lw=1.0, ls=(0, (1, 1.8)), zorder=4)
    _draw_runs(axes, floor, scene, traces, words=words, size=1.0 if words else 0.7)
    if words:
        _draw_scale(axes, floor)


def _draw_runs(axes: Axes, floor: Floor, scene: Scene, traces: Sequence[Trace], *, words: bool, size: float) -> None:
    starts: list[EpisodeRun] = []
    for place, trace in enumerate(traces):
        on_floor = storeys_of(trace.positions[:, 1], scene.navigation) == floor.index
        if not isinstance(trace.run, EpisodeRun):
            _draw_answer(axes, trace, on_floor, words=words, size=size)
            continue
        share = place / max(1, len(traces) - 1)
        width = size * (_WIDEST + share * (_NARROWEST - _WIDEST) if len(traces) > 1 else 2.6)
        _draw_walk(axes, trace, on_floor, width=width, style=style_of(traces, place), size=size)
        starts += [trace.run] if on_floor[0] else []
    for start in {(run.start.position, run.start.yaw) for run in starts}:
        _draw_start(axes, *start, size=size)


def style_of(traces: Sequence[Trace], place: int) -> LineStyle:
    """Line style of the run at this place: another one where runs before it have its colour."""
    return STYLES[sum(trace.rgb == traces[place].rgb for trace in traces[:place]) % len(STYLES)]


def end_marker(*, success: bool | None) -> str:
    """Shape at the end of a run: a circle where it succeeded, a cross where not, a square where not scored."""
    return "s" if success is None else "o" if success else "X"


def success_of(trace: Trace) -> bool | None:
    """Whether the run reached the goal; None = not scored."""
    if isinstance(trace.run, EpisodeRun):
        measures = trace.run.end.measures if trace.run.end.reason != "technical" else None
        rule = measures.rules["paper"] if measures else None
        return rule.success if rule else None
    assert isinstance(trace.run, Answer), "pages of compare are about episodes"
    found = trace.run.measures if trace.run.reason != "technical" else None
    return found.success if found else None


def color_of(trace: Trace) -> tuple[float, float, float]:
    """The run's colour as matplotlib wants it, 0-1."""
    red, green, blue = (value / 255 for value in trace.rgb)
    return red, green, blue


def casing(width: float) -> list[patheffects.AbstractPathEffect]:
    """A dark edge around a line or mark, so that light colours show on light ground."""
    return [patheffects.Stroke(linewidth=width + 1.1, foreground=INK), patheffects.Normal()]


def _draw_pieces(axes: Axes, floor: Floor, scene: Scene, *, words: bool) -> None:
    for item in scene.objects:
        up = item.centre[1] - floor.floor_y
        area = item.size[0] * item.size[2]
        if not -0.5 <= up <= _TALLEST_FLOOR or area < _LARGE_PIECE or area > 20:
            continue
        corner = item.centre[0] - item.size[0] / 2, item.centre[2] - item.size[2] / 2
        axes.add_patch(Rectangle(corner, item.size[0], item.size[2], facecolor=_PIECE, edgecolor=_PIECE_EDGE, lw=0.4))
        if words and area >= _NAMED_PIECE:
            axes.text(
                item.centre[0], item.centre[2], item.category, fontsize=4.8, color=_WORD, ha="center", va="center",
                clip_on=True, parse_math=False, zorder=2,
            )  # fmt: skip


def _draw_goal(axes: Axes, floor: Floor, goal: GoalRegion, *, is_walk: bool, size: float) -> None:
    if floor.map is not None and is_walk:
        places = goal.places[goal.place_storeys == floor.index]
        axes.plot(
            places[:, 0], places[:, 2], ls="", marker="s", markersize=1.6, color=GOAL, alpha=0.16, mew=0, zorder=3
        )
    for centre, radius, storey in zip(goal.centres, goal.radii, goal.storeys, strict=True):
        if storey != floor.index:
            continue
        xz = float(centre[0]), float(centre[2])
        reach = float(radius) if is_walk else SUCCESS_RADIUS
        axes.add_patch(Circle(xz, reach, facecolor=GOAL, alpha=0.07, lw=0, zorder=3))
        axes.add_patch(Circle(xz, reach, facecolor="none", edgecolor=GOAL, lw=1.1, ls=(0, (3, 2)), zorder=4))
        axes.plot(
            xz[0], xz[1], marker="*", markersize=13 * size, color=GOAL, mec="white", mew=0.8, zorder=9 if is_walk else 5
        )


def _draw_walk(
    axes: Axes, trace: Trace, on_floor: NDArray[np.bool_], *, width: float, style: LineStyle, size: float
) -> None:
    xz = trace.positions[:, [0, 2]].copy()
    xz[~on_floor] = math.nan  # leaves gaps where the run is on another storey
    color = color_of(trace)
    if style != "solid":
        axes.plot(xz[:, 0], xz[:, 1], color=INK, lw=0.5, zorder=5)
    axes.plot(
        xz[:, 0], xz[:, 1], color=color, lw=width, ls=style, solid_joinstyle="round", zorder=5,
        path_effects=casing(width) if style == "solid" else None,
    )  # fmt: skip
    if on_floor[-1]:
        marker = end_marker(success=success_of(trace))
        axes.plot(
            xz[-1:, 0], xz[-1:, 1], marker=marker, markersize=(7.5 + width) * size, color=color, markeredgecolor=INK,
            markeredgewidth=0.9, zorder=8,
        )  # fmt: skip


def _draw_answer(axes: Axes, trace: Trace, on_floor: NDArray[np.bool_], *, words: bool, size: float) -> None:
    """Ranked points: the first is a full mark, the others are small; a person's click has no rank."""
    assert not isinstance(trace.run, EpisodeRun)
    is_click = trace.info.who_kind == "human"
    for rank in np.flatnonzero(on_floor)[::-1].tolist():
        x, _, z = trace.positions[rank]
        marker = "P" if is_click else "o"
        side = (11.0 if is_click else 13.0 if rank == 0 else 9.0) * size
        axes.plot(
            [x], [z], marker=marker, markersize=side, color=color_of(trace), markeredgecolor=INK,
            markeredgewidth=1.0, alpha=1.0 if rank == 0 else 0.85, zorder=7 if rank == 0 else 6,
        )  # fmt: skip
        if words and not is_click:
            axes.text(
                x, z, str(rank + 1), fontsize=7 if rank == 0 else 5.5, color=INK, ha="center", va="center_baseline",
                fontweight="bold", zorder=8, parse_math=False,
            )  # fmt: skip


def _draw_start(axes: Axes, position: tuple[float, float, float], yaw: float, *, size: float) -> None:
    """An arrow head that points where the robot looks first."""
    ahead = forward_from_yaw(yaw)[[0, 2]]
    side = np.array([-ahead[1], ahead[0]])
    middle = np.array(position)[[0, 2]]
    reach = 0.3 / size
    corners = [middle + reach * ahead, middle - 0.7 * reach * ahead + 0.7 * reach * side]
    corners += [middle - 0.3 * reach * ahead, middle - 0.7 * reach * ahead - 0.7 * reach * side]
    axes.add_patch(Polygon(corners, facecolor=INK, edgecolor="white", lw=0.9, zorder=7))


def _draw_scale(axes: Axes, floor: Floor) -> None:
    """A bar of 1 or 2 m, lower left."""
    metres = 1 if floor.high[0] - floor.low[0] < 6 else 2
    x = floor.low[0] + 0.02 * (floor.high[0] - floor.low[0])
    z = floor.high[1] - 0.02 * (floor.high[1] - floor.low[1])
    axes.plot(
        [x, x + metres], [z, z], color=INK, lw=2.2, solid_capstyle="butt", zorder=10, path_effects=casing(0.6)[1:]
    )
    axes.annotate(
        f"{metres} m", (x + metres / 2, z), xytext=(0, 2.5), textcoords="offset points", fontsize=6.5, color=INK,
        ha="center", va="bottom", zorder=10,
    )  # fmt: skip
