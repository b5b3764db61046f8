"""Curves and dots of a POG report, as SVG for pages and PNG for slides; the same report gives the same bytes."""

import io
from collections.abc import Sequence

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from grounding.pog_statistics import Range
from grounding.pog_table import TOTAL, KnobCurve, PogTable

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#aa4499", "#7a5c00", "#332288", "#56b4e9", "#000000", "#6b6b6b")
_MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*", "h")
_DPI = 130
Drawn = dict[str, str | bytes]
"""Content by file ending."""


def distance_figure(table: PogTable) -> Drawn:
    """Share of first answers within so many metres, a line per method; bands are 95 % intervals by home."""
    figure = Figure(figsize=(8.5, 4), layout="constrained")
    axes = figure.subplots()
    for number, row in enumerate(table.rows):
        metres = [point.metres for point in row.curve]
        colour, dashes = COLOURS[number % len(COLOURS)], ("-", "--")[number // len(COLOURS) % 2]
        shares = [point.sr for point in row.curve]
        axes.plot(metres, shares, label=row.name, linewidth=1.6, color=colour, linestyle=dashes)
        _band(axes, metres, [point.by_home for point in row.curve], colour)
    axes.axvline(1.0, color="#888", linewidth=0.8, linestyle=":")
    axes.set_xlim(0, 5)
    axes.set_ylim(0, 101)
    axes.set_xlabel("metres from the right object's middle")
    axes.set_ylabel("first answers within, mean of splits (%)")
    figure.legend(fontsize=8, loc="outside right upper")
    return _drawn(figure)


def methods_figure(table: PogTable) -> Drawn:
    """Total success of each method, filled = first answer, open = any of three; lines are intervals by home."""
    rows = table.rows
    figure = Figure(figsize=(7, 1.2 + 0.42 * len(rows)), layout="constrained")
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
    axes.set_yticks(range(len(rows)), [row.name for row in rows])
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_xlim(-1, 101)
    axes.grid(axis="x", color="#ddd", linewidth=0.6)
    axes.set_xlabel("within 1 m, mean of splits (%); filled: first answer, open: any of three")
    return _drawn(figure)


def knob_figure(curves: Sequence[KnobCurve]) -> Drawn:
    """Total success over the values of one option, a line per method, all on one map variant but for the option."""
    figure = Figure(figsize=(8.5, 4), layout="constrained")
    axes = figure.subplots()
    for number, curve in enumerate(curves):
        colour = COLOURS[number % len(COLOURS)]
        values = [point.value for point in curve.points]
        marker = _MARKERS[number % len(_MARKERS)]
        axes.plot(values, [point.sr for point in curve.points], color=colour, marker=marker, label=curve.name)
        _band(axes, values, [point.by_home for point in curve.points], colour)
    axes.set_ylim(0, 101)
    axes.set_xticks(sorted({point.value for curve in curves for point in curve.points}))
    axes.set_xlabel(curves[0].knob.replace("_", " "))
    axes.set_ylabel("success within 1 m, mean of splits (%)")
    figure.legend(fontsize=8, loc="outside right upper")
    return _drawn(figure)


def _band(axes: Axes, places: Sequence[float], intervals: Sequence[Range | None], colour: str) -> None:
    known = [(place, *interval) for place, interval in zip(places, intervals, strict=True) if interval is not None]
    if known:
        at, low, high = zip(*known, strict=True)
        axes.fill_between(at, low, high, color=colour, alpha=0.15, linewidth=0)


def _drawn(figure: Figure) -> Drawn:
    """Both forms, without dates and versions."""
    vector, raster = io.StringIO(), io.BytesIO()
    with matplotlib.rc_context({"svg.hashsalt": "personal-viz", "svg.fonttype": "none"}):
        figure.savefig(vector, format="svg", metadata={"Date": None, "Creator": None})
    figure.savefig(raster, format="png", dpi=_DPI, metadata={"Software": None})
    return {"svg": vector.getvalue(), "png": raster.getvalue()}
