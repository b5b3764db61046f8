"""Curves and dots of a POG report, as SVG for pages and PNG for slides; the same report gives the same bytes."""

import io
import textwrap
from collections.abc import Sequence

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from grounding.report.curves import KnobCurve
from grounding.report.sources import PAPER_IS
from grounding.report.statistics import Range
from grounding.report.table import TOTAL, PogTable
from sim.homes.kind import scene_label

_KNOB_AXES = {
    "view_noise": "view noise: error of each patch's cosine in each view (standard deviation)",
    "object_noise": "object noise: error of each object's cosine (standard deviation)",
    "cell_noise": "cell noise: error of each cell's cosine (standard deviation)",
    "confusion": "confusion: share of objects that are mistaken for another one",
    "paraphrase": "captions on the map side",
    "blur": "blur (m)",
}
_PARAPHRASES = ("0: as they\nare", "1: reworded", "2: half of the\nattributes", "3: category\nonly")
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#aa4499", "#7a5c00", "#332288", "#56b4e9", "#000000", "#6b6b6b")
_MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*", "h")
_DPI = 130
Drawn = dict[str, str | bytes]
"""Content by file ending."""


def distance_figure(table: PogTable) -> Drawn:
    """Share of episodes answered within each distance: by the first answer, and by the best of the first three.

    A line per method; bands are 95 % intervals by home. Rows without the distances of three have no line on the right.
    """
    figure, first, best = _panels("first answer (top-1)", "best of the first three (top-3)")
    for number, row in enumerate(table.rows):
        metres = [point.metres for point in row.curve]
        colour, dashes = COLOURS[number % len(COLOURS)], ("-", "--")[number // len(COLOURS) % 2]
        style = {"linewidth": 1.6, "color": colour, "linestyle": dashes}
        first.plot(metres, [point.sr for point in row.curve], label=row.name, **style)
        _band(first, metres, [point.by_home for point in row.curve], colour)
        threes = [point.top3 for point in row.curve if point.top3 is not None]
        if threes:
            best.plot(metres, threes, **style)
            _band(best, metres, [point.top3_by_home for point in row.curve], colour)
    if not best.lines:
        words = "These run files hold\nthe first answer's distance only."
        best.text(0.5, 0.5, words, transform=best.transAxes, ha="center", va="center", fontsize=9, color="#555")
    for axes in (first, best):
        axes.axvline(1.0, color="#666", linewidth=0.9, linestyle=":")
        axes.annotate("1 m", (1.0, 1.5), xytext=(3, 0), textcoords="offset points", fontsize=8, color="#444")
    farthest = table.rows[0].curve[-1].metres
    first.set_xlim(0, farthest)
    first.set_xticks(range(int(farthest) + 1))
    first.set_ylabel("episodes within d, mean of splits (%)")
    totals = [cell for row in table.rows for cell in row.cells if cell.split == TOTAL]
    counts = points_text([cell.n for cell in totals], [cell.num_homes for cell in totals])
    has_ranges = any(point.by_home or point.top3_by_home for row in table.rows for point in row.curve)
    over = [table.title, table.scene_label, f"n = {counts}; {_ranges_text('bands', has_ranges)}"]
    below = ["d: planar distance from the right object's middle (m)", *table.notes]
    return _drawn_panels(figure, over, below, label=table.scene_label)


def methods_figure(table: PogTable) -> Drawn:
    """Total success of each method, filled = first answer, open = any of three; lines are intervals by home."""
    rows = table.rows
    figure = Figure(figsize=(7, 1.7 + 0.42 * len(rows)), layout="constrained")
    axes = figure.subplots()
    for place, row in enumerate(rows):
        cell = next(cell for cell in row.cells if cell.split == TOTAL)
        colour = COLOURS[place % len(COLOURS)]
        for value, interval, is_filled, shift in (
            (cell.sr, cell.by_home if table.has_home_intervals else cell.by_episode, True, -0.1),
            (cell.top3, cell.top3_by_home, False, 0.1),
        ):
            if value is None:
                continue
            if interval is not None:
                axes.plot(interval, [place + shift] * 2, color=colour, linewidth=1.4)
            face = colour if is_filled else "white"
            axes.plot([value], [place + shift], "o", color=colour, markerfacecolor=face, markersize=6)
        if row.paper is not None:
            axes.plot([row.paper[-1]], [place], "x", color="#666", markersize=6)
    axes.set_yticks(range(len(rows)), [row.name for row in rows])
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_xlim(-1, 101)
    axes.grid(axis="x", color="#ddd", linewidth=0.6)
    axes.set_xlabel(f"within 1 m, mean of splits (%)\nfilled: first answer, open: any of three, x: {PAPER_IS}")
    figure.supxlabel("\n".join(_folded(table.notes, 105)), fontsize=7)
    if table.scene_label:
        figure.suptitle(table.scene_label, fontsize=8)
    return _drawn(figure, table.scene_label)


def knob_figure(curves: Sequence[KnobCurve], notes: Sequence[str] = ()) -> Drawn:
    """Total success over the values of one option: first answers on the left, any of three on the right.

    A line per method, all on one map variant but for the option; bars are 95 % intervals by home; `notes` of the
    tables that the points come from stand below.
    """
    figure, first, three = _panels("first answer (top-1)", "any of the first three (top-3)")
    values = sorted({point.value for curve in curves for point in curve.points})
    aside = 0.008 * (values[-1] - values[0])  # so that bars stand beside each other
    for number, curve in enumerate(curves):
        style = {"color": COLOURS[number % len(COLOURS)], "marker": _MARKERS[number % len(_MARKERS)]}
        shift = aside * (number - (len(curves) - 1) / 2)
        firsts = [(point.value + shift, point.sr, point.by_home) for point in curve.points]
        threes = [(point.value + shift, point.top3, point.top3_by_home) for point in curve.points]
        _bars(first, firsts, label=curve.name, **style)
        _bars(three, threes, **style)
    for axes in (first, three):
        axes.set_xticks(values, knob_ticks(curves[0].knob, values))
    first.set_ylabel("success within 1 m, mean of splits (%)")
    points = [point for curve in curves for point in curve.points]
    has_ranges = any(point.by_home or point.top3_by_home for point in points)
    counts = points_text([point.n for point in points], [point.num_homes for point in points])
    label = scene_label(curves[0].scene_kind)
    over = [curves[0].title, label, f"n = {counts}; {_ranges_text('bars', has_ranges)}"]
    return _drawn_panels(figure, over, [knob_axis(curves[0].knob), *notes], label=label)


def _panels(left: str, right: str) -> tuple[Figure, Axes, Axes]:
    """Two panels with these titles, side by side, on one scale of percent."""
    figure = Figure(figsize=(11.5, 4.3), layout="constrained")
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    for axes, title in zip(panels, (left, right), strict=True):
        axes.set_title(title, fontsize=10)
        axes.grid(color="#e4e4e4", linewidth=0.6)
        axes.set_ylim(0, 101)
    return figure, *panels


def _drawn_panels(figure: Figure, over: Sequence[str], below: Sequence[str], *, label: str) -> Drawn:
    """The figure with lines over it, lines below it, each of them folded, and its legend on the right."""
    figure.suptitle("\n".join(filter(None, over)), fontsize=10)
    figure.supxlabel("\n".join(_folded(below, 150)), fontsize=8)
    figure.legend(fontsize=8, loc="outside right upper")
    return _drawn(figure, label)


def _bars(
    axes: Axes,
    points: Sequence[tuple[float, float | None, Range | None]],
    *,
    color: str,
    marker: str,
    label: str | None = None,
) -> None:
    """A line through (place, value, interval), with a bar for each interval; nothing where values are unknown."""
    known = [(place, value, interval) for place, value, interval in points if value is not None]
    if not known:
        return
    places, shares, _ = zip(*known, strict=True)
    axes.plot(places, shares, color=color, marker=marker, markersize=5, linewidth=1.6, label=label)
    for place, _, interval in known:
        if interval is not None:
            axes.plot([place, place], interval, color=color, linewidth=1.2, alpha=0.75)


def knob_axis(knob: str) -> str:
    """Label of an option's axis, with its unit."""
    return _KNOB_AXES.get(knob, knob.replace("_", " "))


def knob_ticks(knob: str, values: Sequence[float]) -> list[str]:
    """Names of an option's values on its axis."""
    if knob == "paraphrase":
        return [_PARAPHRASES[int(value)] for value in values]  # settings know 0 to 3 only
    return [f"{value:g}" for value in values]


def points_text(episodes: Sequence[int], homes: Sequence[int]) -> str:
    """`2000 episodes in 31 homes`; `40 to 46 episodes in 1 home` where points differ."""
    parts = []
    for counts, noun in ((episodes, "episode"), (homes, "home")):
        low, high = min(counts), max(counts)
        parts.append((f"{low} to " if low < high else "") + f"{high} {noun}{'' if high == 1 else 's'}")
    return " in ".join(parts)


def _ranges_text(drawn: str, has_ranges: bool) -> str:
    return f"{drawn}: 95 % intervals by home" if has_ranges else "no intervals by home"


def _folded(notes: Sequence[str], width: int) -> list[str]:
    """Notes as lines of at most `width` letters."""
    return [line for note in notes for line in textwrap.wrap(note, width)]


def _band(axes: Axes, places: Sequence[float], intervals: Sequence[Range | None], colour: str) -> None:
    known = [(place, *interval) for place, interval in zip(places, intervals, strict=True) if interval is not None]
    if known:
        at, low, high = zip(*known, strict=True)
        axes.fill_between(at, low, high, color=colour, alpha=0.15, linewidth=0)


def _drawn(figure: Figure, label: str) -> Drawn:
    """Both forms, without dates and versions; the raster file's description says the label that is drawn too."""
    vector, raster = io.StringIO(), io.BytesIO()
    with matplotlib.rc_context({"svg.hashsalt": "personal-viz", "svg.fonttype": "none"}):
        figure.savefig(vector, format="svg", metadata={"Date": None, "Creator": None})
    figure.savefig(raster, format="png", dpi=_DPI, metadata={"Software": None, "Description": label or None})
    return {"svg": vector.getvalue(), "png": raster.getvalue()}
