"""The contact sheet of one episode, for papers: maps with every run's way, how it went, what robots saw last."""

import io
import warnings
from collections.abc import Sequence
from textwrap import wrap

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from numpy.typing import NDArray
from PIL import Image

from recordings.scene import GoalRegion, goal_region
from recordings.texts import NOTICE
from recordings.traces import Trace, path_lengths, times
from sim.episodes.schema import Episode
from sim.frames import T_world_camera
from sim.homes.kind import scene_label
from sim.mesh import Scene
from sim.render.renderer import Renderer
from sim.tasks.run_files import Answer, EpisodeRun
from sim.types import Camera

from ..contact_sheet.sheet import png_bytes
from .sheet_map import INK, Floor, LineStyle, casing, color_of, draw_floor, end_marker, floors_of, style_of, success_of

WIDTH_IN, DPI = 9.5, 200
"""1,900 pixels: two columns of a paper at 200 dots per inch."""
_EDGE = 0.12
_PER_ROW, _CAPTION_IN = 5, 0.36
_MAP_HEIGHT_IN, _SMALL_MAP_IN = 4.6, 3.6
"""Highest maps where there is one task, and where there are two."""
_LINE_IN, _HEAD_IN = 0.2, 0.26
_VIEW = Camera(400, 300)
_COLUMNS = (2.15, 3.25, 3.7, 4.13, 4.5)
"""Inches from a line's left to its mark (left-aligned) and figures (right-aligned)."""
_HEADS = {"PAN": ("SPL %", "steps", "path m", "time s"), "POG": ("off m", "top 3", "time s")}
_THUMB_SIDE = 240
"""Largest side of a thumbnail, pixels."""
_SOFT = "#5b5e66"
LEFT_OUT = "Map and pictures of the scan are left out; --with-pixels draws them, under the scan's terms of use."


class _Sheet:
    """A figure that grows downwards: its parts are placed in inches from the top."""

    def __init__(self, height: float) -> None:
        self.height = height
        self.figure = Figure(figsize=(WIDTH_IN, height), dpi=DPI, facecolor="white")
        self.top = _EDGE

    def axes(self, left: float, top: float, width: float, height: float) -> Axes:
        """Axes whose place is given in inches."""
        at = left / WIDTH_IN, 1 - (top + height) / self.height, width / WIDTH_IN, height / self.height
        return self.figure.add_axes(at)

    def text(self, left: float, top: float, words: str, *, size: float = 8, **style: object) -> None:
        """One line of text, its top at `top`; nobody's name is read as mathematics."""
        at = left / WIDTH_IN, 1 - top / self.height
        more: dict[str, object] = {"va": "top", "color": INK, "parse_math": False} | style
        self.figure.text(*at, words, fontsize=size, **more)  # type: ignore[arg-type]

    def line(self, xs: Sequence[float], top: float, **style: object) -> None:
        """A level line or mark, inches."""
        at = [x / WIDTH_IN for x in xs], [1 - top / self.height] * len(xs)
        self.figure.add_artist(Line2D(*at, **style))  # type: ignore[arg-type]

    def picture(self, rgb: NDArray[np.uint8], left: float, top: float, width: float, height: float) -> None:
        """A picture (H, W, 3), fitted to a place in inches."""
        fitted = Image.fromarray(rgb).resize((round(width * DPI), round(height * DPI)), Image.Resampling.LANCZOS)
        below = round((self.height - top - height) * DPI)
        self.figure.figimage(np.asarray(fitted), round(left * DPI), below)

    def frame(self, left: float, top: float, width: float, height: float, **style: object) -> None:
        """The edge of a place in inches."""
        at = left / WIDTH_IN, 1 - (top + height) / self.height
        size = width / WIDTH_IN, height / self.height
        edge = Rectangle(at, *size, fill=False, transform=self.figure.transFigure, **style)  # type: ignore[arg-type]
        self.figure.add_artist(edge)


def sheet_png(scene: Scene, episode: Episode, traces: Sequence[Trace], *, renderer: Renderer | None) -> bytes:
    """The contact sheet of at least one run as PNG, 1,900 pixels wide.

    The renderer draws what the robots saw; without one, maps and pictures of a scan are left out.
    """
    walks = [trace for trace in traces if isinstance(trace.run, EpisodeRun)]
    answers = [trace for trace in traces if not isinstance(trace.run, EpisodeRun)]
    goal = goal_region(episode, scene.navigation)
    parts = [
        (head, group, floors_of(scene, goal, group, has_map=renderer is not None))
        for head, group in (("PAN", walks), ("POG", answers))
        if group
    ]
    most = _MAP_HEIGHT_IN if len(parts) == 1 else _SMALL_MAP_IN
    views = _views(walks, renderer) if renderer is not None else []
    query = wrap(" ".join(episode.record.query[0].split()), 105)[:3]
    view_in = (WIDTH_IN - 2 * _EDGE) / _PER_ROW - 0.06
    notes = wrap(_note(scene, has_map=renderer is not None), 130)
    height = 2 * _EDGE + 0.5 + _LINE_IN * (len(query) + len(notes))
    for _, group, floors in parts:
        height += _HEAD_IN + _LINE_IN + _map_height(floors, most) + _LINE_IN * (1 + (len(group) + 1) // 2) + 0.11
    height += -(-len(views) // _PER_ROW) * (view_in * 0.75 + _CAPTION_IN)
    sheet = _Sheet(height)
    _draw_head(sheet, scene, episode, query, notes)
    for head, group, floors in parts:
        _draw_part(sheet, head, scene, goal, group, floors, _map_height(floors, most))
    _draw_views(sheet, views, view_in)
    return png_bytes(_drawn(sheet.figure), label=scene_label(scene.kind), compress_level=4, dpi=(DPI, DPI))


def thumbnail_jpeg(scene: Scene, episode: Episode, traces: Sequence[Trace], *, has_map: bool) -> bytes:
    """The map of the goal's storey with all runs, small."""
    goal = goal_region(episode, scene.navigation)
    shown = [trace for trace in traces if isinstance(trace.run, EpisodeRun)] or traces
    floor = next(floor for floor in floors_of(scene, goal, shown, has_map=has_map) if floor.index in goal.storeys)
    inches = _THUMB_SIDE / 100
    size = (inches, inches / floor.aspect) if floor.aspect > 1 else (inches * floor.aspect, inches)
    figure = Figure(figsize=(max(0.6, size[0]), max(0.6, size[1])), dpi=100, facecolor="white")
    draw_floor(figure.add_axes((0, 0, 1, 1)), floor, scene, goal, shown, words=False)
    data = io.BytesIO()
    _drawn(figure).save(data, "JPEG", quality=85, subsampling=0)
    return data.getvalue()


def _note(scene: Scene, *, has_map: bool) -> str:
    """The note on a scan's terms of use, or on the kind of another home."""
    if scene.kind != "scan":
        return scene_label(scene.kind)
    return NOTICE.replace("This recording holds", "This sheet holds") if has_map else LEFT_OUT


def _draw_head(sheet: _Sheet, scene: Scene, episode: Episode, query: Sequence[str], notes: Sequence[str]) -> None:
    sheet.text(
        _EDGE, sheet.top, f"{episode.key.split} / {scene.label} / {episode.key.episode_id}", size=11, weight="bold"
    )
    sheet.top += 0.26
    for line in query:
        sheet.text(_EDGE, sheet.top, line, size=9.5)
        sheet.top += _LINE_IN
    for line in notes:
        sheet.text(_EDGE, sheet.top, line, size=8, style="italic", color=_SOFT)
        sheet.top += _LINE_IN
    sheet.top += 0.1


def _draw_part(
    sheet: _Sheet,
    head: str,
    scene: Scene,
    goal: GoalRegion,
    traces: Sequence[Trace],
    floors: Sequence[Floor],
    height: float,
) -> None:
    """Maps beside each other, their key, and a line per run."""
    left = _EDGE + (WIDTH_IN - 2 * _EDGE - sum(height * floor.aspect + 0.15 for floor in floors) + 0.15) / 2
    for floor in floors:
        width = height * floor.aspect
        storey = f", storey {floor.index + 1} of {floor.count}" if floor.count > 1 else ""
        sheet.text(left, sheet.top + 0.04, f"{head}{storey}", size=8.5, weight="bold")
        draw_floor(sheet.axes(left, sheet.top + _HEAD_IN, width, height), floor, scene, goal, traces, words=True)
        left += width + 0.15
    sheet.top += _HEAD_IN + height + 0.05
    _draw_key(sheet, is_walk=head == "PAN", has_path=floors[0].map is not None)
    sheet.top += _LINE_IN + 0.02
    column = (WIDTH_IN - 2 * _EDGE) / 2
    for left in (_EDGE, _EDGE + column)[: min(2, len(traces))]:
        for place, words in zip(_COLUMNS[1:], _HEADS[head], strict=False):
            sheet.text(left + place, sheet.top, words, size=7, ha="right", color=_SOFT)
    sheet.top += _LINE_IN - 0.03
    for index, trace in enumerate(traces):
        row, col = index % ((len(traces) + 1) // 2), index // ((len(traces) + 1) // 2)
        _draw_line(sheet, trace, style_of(traces, index), _EDGE + col * column, sheet.top + row * _LINE_IN)
    sheet.top += _LINE_IN * ((len(traces) + 1) // 2) + 0.07


def _draw_key(sheet: _Sheet, *, is_walk: bool, has_path: bool) -> None:
    gap = " " * 5
    parts = ["star = goal, dashed circle = success radius"]
    if is_walk:
        parts = ["arrow head = start", *parts, *(["dotted = shortest path"] if has_path else [])]
        parts.append("end of a run: circle = success, cross = no success")
    else:
        parts += ["cross = a person's click", "numbers = a grounder's ranked answers"]
    words = gap.join(parts)
    sheet.text(_EDGE, sheet.top, words, size=7, color=_SOFT)


def _draw_line(sheet: _Sheet, trace: Trace, style: LineStyle, left: float, top: float) -> None:
    """Sample of the run's line or mark, who, and how it went."""
    color, middle = color_of(trace), top + 0.06
    if isinstance(trace.run, EpisodeRun):
        effects = casing(2.4) if style == "solid" else None
        sheet.line([left + 0.02, left + 0.34], middle, color=color, lw=2.4, ls=style, path_effects=effects)
        marker, at = end_marker(success=success_of(trace)), left + 0.36
    else:
        marker, at = ("P" if trace.info.who_kind == "human" else "o"), left + 0.2
    sheet.line([at], middle, marker=marker, markersize=6.5, color=color, mec=INK, mew=0.8)
    sheet.text(left + 0.5, top, _short(trace.title, 24), size=8, weight="bold")
    sheet.text(left + _COLUMNS[0], top, mark_of(trace), size=8)
    for place, words in zip(_COLUMNS[1:], figures_of(trace), strict=False):
        sheet.text(left + place, top, words, size=8, ha="right")


def mark_of(trace: Trace) -> str:
    """Whether a run reached the goal, in a sign and a word."""
    return {True: "\u2713 success", False: "\u2717 no success", None: "not scored"}[success_of(trace)]


def figures_of(trace: Trace) -> tuple[str, ...]:
    """A run's SPL in percent, steps, metres and seconds; an answer's metres from the target and seconds."""
    if isinstance(trace.run, EpisodeRun):
        measures = trace.run.end.measures
        rule = measures.rules["paper"] if measures else None
        seconds = times(trace.run)
        return (
            "-" if rule is None else f"{100 * rule.spl:.0f}",
            str(len(trace.run.steps)),
            f"{path_lengths(trace.run)[-1]:.1f}",
            "-" if seconds is None else f"{seconds[-1]:.0f}",
        )
    assert isinstance(trace.run, Answer), "pages of compare are about episodes"
    found = trace.run.measures
    apart = found.planar_distance if found else None
    top3 = "-" if found is None or not trace.run.scores else "yes" if found.top3_success else "no"
    return (
        "-" if apart is None else f"{apart:.2f}",
        top3,
        "-" if trace.run.t_s is None else f"{trace.run.t_s:.0f}",
    )


_View = tuple[NDArray[np.uint8], str, Trace | None]
"""A picture, its caption, and its run; None = all runs."""


def _views(walks: Sequence[Trace], renderer: Renderer | None) -> list[_View]:
    """First and last view of each run; the first ones as one where all runs start alike."""
    if renderer is None or not walks:
        return []
    runs = [(trace, trace.run) for trace in walks if isinstance(trace.run, EpisodeRun)]
    firsts = [run.poses[0] for _, run in runs]
    is_shared = all(pose == firsts[0] for pose in firsts)
    wanted: list[tuple[object, str, Trace | None]] = []
    if is_shared:
        wanted.append((firsts[0], "First view of every run", None))
    for trace, run in runs:
        if not is_shared:
            wanted.append((run.poses[0], f"{trace.title}: first view", trace))
        wanted.append((run.poses[-1], trace.title, trace))
    poses = np.stack([T_world_camera(pose, _VIEW) for pose, _, _ in wanted])  # type: ignore[arg-type]
    frames = renderer.render_batch(poses, _VIEW)
    return [(frame.rgb, words, trace) for frame, (_, words, trace) in zip(frames, wanted, strict=True)]


def _draw_views(sheet: _Sheet, views: Sequence[_View], width: float) -> None:
    height = width * 0.75
    for index, (rgb, words, trace) in enumerate(views):
        left = _EDGE + index % _PER_ROW * (width + 0.06)
        top = sheet.top + index // _PER_ROW * (height + _CAPTION_IN)
        sheet.picture(rgb, left, top, width, height)
        color = INK if trace is None else color_of(trace)
        sheet.frame(left, top, width, height, color=color, lw=1.0 if trace is None else 2.6)
        sheet.text(left, top + height + 0.04, _short(words, 32), size=7.5, weight="bold")
        if trace is None:
            below = "all start here"
        else:
            below = "at the start" if words.endswith("first view") else f"last view: {mark_of(trace)}"
        sheet.text(left, top + height + 0.17, below, size=7, color=_SOFT)


def _map_height(floors: Sequence[Floor], most: float) -> float:
    """Inches: all maps fit beside each other, at one height."""
    wide = (WIDTH_IN - 2 * _EDGE - 0.15 * (len(floors) - 1)) / sum(floor.aspect for floor in floors)
    return min(most, wide)


def _drawn(figure: Figure) -> Image.Image:
    canvas = FigureCanvasAgg(figure)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing")  # a name in letters that the font lacks
        canvas.draw()
    return Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3])


def _short(text: str, most: int) -> str:
    """The text on one line, at most `most` letters."""
    line = " ".join(text.split())
    return line if len(line) <= most else f"{line[: most - 1]}\u2026"
