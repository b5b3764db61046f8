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
    figure = Figure(figsize=(11.5, 4.3), layout="constrained")
    first, best = figure.subplots(1, 2, sharex=True, sharey=True)
    for number, row in enumerate(table.rows):
        metres = [point.metres for point in row.curve]
        colour, dashes = COLOURS[number % len(COLOURS)], ("-", "--")[number // len(COLOURS) % 2]
        firsts, first_ranges = [point.sr for point in row.curve], [point.by_home for point in row.curve]
        first.plot(metres, firsts, label=row.name, linewidth=1.6, color=colour, linestyle=dashes)
        _band(first, metres, first_ranges, colour)
        threes = [point.top3 for point in row.curve if point.top3 is not None]
        if threes:
            best.plot(metres, threes, linewidth=1.6, color=colour, linestyle=dashes)
            _band(best, metres, [point.top3_by_home for point in row.curve], colour)
    if not best.lines:
        _say(best, "These run files hold\nthe first answer's distance only.")
    for axes, title in ((first, "first answer (top-1)"), (best, "best of the first three (top-3)")):
        axes.set_title(title, fontsize=10)
        axes.axvline(1.0, color="#666", linewidth=0.9, linestyle=":")
        axes.annotate("1 m", (1.0, 1.5), xytext=(3, 0), textcoords="offset points", fontsize=8, color="#444")
        axes.grid(color="#e4e4e4", linewidth=0.6)
    first.set_xlim(0, table.rows[0].curve[-1].metres)
    first.set_xticks(range(0, int(table.rows[0].curve[-1].metres) + 1))
    first.set_ylim(0, 101)
    first.set_ylabel("episodes within d, mean of splits (%)")
    totals = [cell for row in table.rows for cell in row.cells if cell.split == TOTAL]
    counts = points_text([cell.n for cell in totals], [cell.num_homes for cell in totals])
    has_ranges = any(point.by_home or point.top3_by_home for row in table.rows for point in row.curve)
    figure.suptitle(_over(table.title, table.scene_label, counts, has_ranges=has_ranges, drawn="bands"), fontsize=10)
    axis = "d: planar distance from the right object's middle (m)"
    figure.supxlabel("\n".join([axis, *_lines(table.notes, 150)]), fontsize=8)
    figure.legend(fontsize=8, loc="outside right upper")
    return _drawn(figure, table.scene_label)


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
    figure.supxlabel("\n".join(_lines(table.notes, 105)), fontsize=7)
    if table.scene_label:
        figure.suptitle(table.scene_label, fontsize=8)
    return _drawn(figure, table.scene_label)


def knob_figure(curves: Sequence[KnobCurve], notes: Sequence[str] = ()) -> Drawn:
    """Total success over the values of one option: first answers on the left, any of three on the right.

    A line per method, all on one map variant but for the option; bars are 95 % intervals by home; `notes` of the
    tables that the points come from stand below.
    """
    figure = Figure(figsize=(11.5, 4.3), layout="constrained")
    first, three = figure.subplots(1, 2, sharex=True, sharey=True)
    values = sorted({point.value for curve in curves for point in curve.points})
    aside = 0.008 * (values[-1] - values[0])  # so that bars stand beside each other
    for number, curve in enumerate(curves):
        style = {"color": COLOURS[number % len(COLOURS)], "marker": _MARKERS[number % len(_MARKERS)], "markersize": 5}
        shift = aside * (number - (len(curves) - 1) / 2)
        firsts = [(point.value + shift, point.sr, point.by_home) for point in curve.points]
        threes = [(point.value + shift, point.top3, point.top3_by_home) for point in curve.points]
        _bars(first, firsts, label=curve.name, **style)
        _bars(three, threes, **style)
    for axes, title in ((first, "first answer (top-1)"), (three, "any of the first three (top-3)")):
        axes.set_title(title, fontsize=10)
        axes.set_xticks(values, knob_ticks(curves[0].knob, values))
        axes.grid(color="#e4e4e4", linewidth=0.6)
    first.set_ylim(0, 101)
    first.set_ylabel("success within 1 m, mean of splits (%)")
    points = [point for curve in curves for point in curve.points]
    has_ranges = any(point.by_home or point.top3_by_home for point in points)
    counts = points_text([point.n for point in points], [point.num_homes for point in points])
    figure.suptitle(
        _over(curves[0].title, scene_label(curves[0].scene_kind), counts, has_ranges=has_ranges, drawn="bars"),
        fontsize=10,
    )
    figure.supxlabel("\n".join([knob_axis(curves[0].knob), *_lines(notes, 150)]), fontsize=8)
    figure.legend(fontsize=8, loc="outside right upper")
    return _drawn(figure, scene_label(curves[0].scene_kind))


def _bars(
    axes: Axes,
    points: Sequence[tuple[float, float | None, Range | None]],
    *,
    color: str,
    marker: str,
    markersize: float,
    label: str | None = None,
) -> None:
    """A line through (place, value, interval), with a bar for each interval; nothing where values are unknown."""
    known = [(place, value, interval) for place, value, interval in points if value is not None]
    if not known:
        return
    places, shares, _ = zip(*known, strict=True)
    axes.plot(places, shares, color=color, marker=marker, markersize=markersize, linewidth=1.6, label=label)
    for place, _, interval in known:
        if interval is not None:
            axes.plot([place, place], interval, color=color, linewidth=1.2, alpha=0.75)


def knob_axis(knob: str) -> str:
    """What an option's axis says, with its unit."""
    return _KNOB_AXES.get(knob, knob.replace("_", " "))


def knob_ticks(knob: str, values: Sequence[float]) -> list[str]:
    """What an option's values are called on its axis."""
    if knob == "paraphrase":
        return [_PARAPHRASES[int(value)] for value in values]  # settings know 0 to 3 only
    return [f"{value:g}" for value in values]


def points_text(episodes: Sequence[int], homes: Sequence[int]) -> str:
    """`2000 episodes in 31 homes`; `40 to 46 episodes in 1 home` where points differ."""
    parts = []
    for counts, noun in ((episodes, "episode"), (homes, "home")):
        low, high = min(counts), max(counts)
        parts.append((f"{low}" if low == high else f"{low} to {high}") + f" {noun}{'' if high == 1 else 's'}")
    return " in ".join(parts)


def _over(title: str, label: str, counts: str, *, has_ranges: bool, drawn: str) -> str:
    """What stands over a figure: the map, what must be said of the homes, how much it is of, and its intervals."""
    ranges = f"{drawn}: 95 % intervals by home" if has_ranges else "no intervals by home"
    return "\n".join([title, *([label] if label else []), f"n = {counts}; {ranges}"])


def _lines(notes: Sequence[str], width: int) -> list[str]:
    """Notes as lines of a figure."""
    return [line for note in notes for line in textwrap.wrap(note, width)]


def _say(axes: Axes, text: str) -> None:
    """Words in the middle of an empty panel."""
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", va="center", fontsize=9, color="#555")


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
