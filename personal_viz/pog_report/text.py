"""A POG report for readers, as Markdown: the words are in report.md.j2, the cells of its tables are made here."""

from collections.abc import Sequence
from pathlib import Path

from grounding.methods.joint import FROZEN
from grounding.report.curves import KnobCurve, KnobPoint
from grounding.report.failures import KINDS
from grounding.report.sources import PAPER_IS
from grounding.report.statistics import FEWEST_HOMES, NUM_RESAMPLES, Range
from grounding.report.table import TOTAL, PogCell, PogDifference, PogReport, PogRow, PogTable
from human_study.report.page import filled
from sim.words.english import how_many

from .figures import knob_axis, knob_ticks, points_text
from .gallery import DrawnFailure, Gallery

Cells = tuple[Sequence[str], Sequence[Sequence[str]]]
"""Heads and lines of a table."""


def report_markdown(report: PogReport, gallery: Gallery | None) -> str:
    """The whole report; the files of its pictures are named by the functions below."""
    return filled(
        "report.md.j2",
        folder=Path(__file__).parent,
        report=report,
        knob_groups=knob_groups(report),
        has_joint=any(row.name.startswith("joint") for table in report.tables for row in table.rows),
        frozen=FROZEN,
        paper_is=PAPER_IS,
        num_resamples=f"{NUM_RESAMPLES:,}",
        fewest_homes=FEWEST_HOMES,
        kinds=KINDS,
        runs_table=_runs_table(report),
        success_table=_success_table,
        without_three=_without_three,
        difference_table=_difference_table,
        failure_table=lambda table: _failure_table(table, gallery),
        failures_of=lambda table: _failures_by_method(table, gallery),
        failure_caption=_failure_caption,
        knob_table=_knob_table,
        knob_differences=lambda curves: _knob_differences(curves, report),
        knob_counts=_knob_counts,
        has_ranges=lambda curves: any(_has_range(point) for curve in curves for point in curve.points),
        knob_axis=knob_axis,
        how_many=how_many,
        methods_name=methods_name,
        distance_name=distance_name,
        knob_name=knob_name,
    )


def knob_groups(report: PogReport) -> list[list[KnobCurve]]:
    """The curves that share a figure: one option, one map variant."""
    groups: dict[tuple[str, str, str], list[KnobCurve]] = {}
    for curve in report.curves:
        groups.setdefault((curve.knob, curve.title, curve.dataset_digest), []).append(curve)
    return list(groups.values())


def distance_name(number: int) -> str:
    """File of the distance curves of the table with this number, without its ending."""
    return f"distance-{number}"


def methods_name(number: int) -> str:
    """File of the methods' dots of the table with this number, without its ending."""
    return f"methods-{number}"


def knob_name(number: int, knob: str) -> str:
    """File of the curves with this number over an option, without its ending."""
    return f"over-{knob.replace('_', '-')}-{number}"


def paper_text(row: PogRow) -> str:
    """The paper's figures of a method."""
    return "" if row.paper is None else " / ".join(f"{value:.1f}" for value in row.paper)


def count_text(cell: PogCell) -> str:
    """`k/n`."""
    return f"{cell.k:g}/{cell.n}"


def _with_range(value: float | None, interval: Range | None, *, brackets: str = "{}") -> str:
    """`value [low, high]`, without brackets where there is no interval; `-` for no value."""
    if value is None:
        return "-"
    return f"{value:.1f}" + ("" if interval is None else " " + _range_text(interval, brackets))


def _range_text(interval: Range, brackets: str = "{}") -> str:
    low, high = (f"{round(value, 1) + 0.0:.1f}" for value in interval)
    return f"{brackets[0]}{low}, {high}{brackets[1]}"


def _runs_table(report: PogReport) -> Cells:
    lines = []
    for number, table in enumerate(report.tables, start=1):
        for row in table.rows:
            seeds = ", ".join(map(str, row.seeds)) or "-"
            commits = ", ".join(commit[:12] for commit in row.commits)
            without = f" ({row.num_fallbacks} without the language model)" if row.num_fallbacks else ""
            lines.append((row.name, str(number), ", ".join(row.run_ids), seeds, commits, f"{row.num_trials}{without}"))
    return ("method", "table", "runs", "seeds", "code at commit", "answers"), lines


def _success_table(table: PogTable) -> Cells:
    splits = dict.fromkeys(cell.split for row in table.rows for cell in row.cells if cell.split != TOTAL)
    lines = []
    for row in table.rows:
        cells = {cell.split: cell for cell in row.cells}
        shown = [_cell_text(cells[split]) if split in cells else "-" for split in (*splits, TOTAL)]
        best = _with_range(cells[TOTAL].top3, cells[TOTAL].top3_by_home)
        lines.append((row.name, *shown, best, paper_text(row)))
    return ("SR (%)", *splits, TOTAL, "top-3, total", PAPER_IS), lines


def _cell_text(cell: PogCell) -> str:
    by_home = "" if cell.by_home is None else f" {_range_text(cell.by_home)}"
    return f"{_with_range(cell.sr, cell.by_episode, brackets='[]')}{by_home} {count_text(cell)}"


def _without_three(table: PogTable) -> list[str]:
    """Names of the rows that have no curve for three answers, though they rank some."""
    return [row.name for row in table.rows if row.curve[0].top3 is None and row.cells[-1].top3 is not None]


def _difference_table(table: PogTable) -> Cells:
    lines = [
        (
            f"{item.first} - {item.second}",
            _difference_text(item),
            f"{item.only_first:g}",
            f"{item.only_second:g}",
            str(item.n),
        )
        for item in table.differences
    ]
    heads = ("methods", "difference in SR, total (points)", "only the first right", "only the second right", "episodes")
    return heads, lines


def _difference_text(item: PogDifference) -> str:
    return f"{item.first_minus_second:+.1f}" + (f" {_range_text(item.by_home)}" if item.by_home else "")


def _failure_table(table: PogTable, gallery: Gallery | None) -> Cells | None:
    """Failures by method and kind; the columns are the kinds that occur. None without failures."""
    own = (table.title, table.dataset_digest)
    counts = [count for count in gallery.counts if (count.table, count.dataset_digest) == own] if gallery else []
    if not counts:
        return None
    kinds = [kind for kind in KINDS if any(count.kind == kind for count in counts)]
    lines = []
    for row in table.rows:
        of_kind = {count.kind: count for count in counts if count.method == row.name}
        if of_kind:
            total = next(iter(of_kind.values())).of
            found = [of_kind[kind].n if kind in of_kind else 0 for kind in kinds]
            lines.append((row.name, *(f"{n} ({100 * n / total:.0f} %)" for n in found), str(total)))
    return ("method", *kinds, "all"), lines


def _failures_by_method(table: PogTable, gallery: Gallery | None) -> dict[str, list[DrawnFailure]]:
    """The drawn failures of each method that has some."""
    own = (table.title, table.dataset_digest)
    drawn = [item for item in gallery.drawn if (item.table, item.info.dataset_digest) == own] if gallery else []
    by_method = {row.name: [item for item in drawn if item.method == row.name] for row in table.rows}
    return {method: items for method, items in by_method.items() if items}


def _failure_caption(item: DrawnFailure) -> str:
    """Which answer it is and why it is wrong."""
    far = "" if item.failure.distance == float("inf") else f" {item.failure.distance:.1f} m away"
    names = ", ".join(target.object_name for target in item.episode.targets)
    at = f", at {item.failure.object_name}" if item.failure.object_name else ""
    why = " ".join(item.reasons)
    query, caption = item.episode.record.query[0], " ".join(item.episode.record.captions_per_object[0]).strip()
    return (
        f"{item.method}, {item.episode.key}: “{query}”, right: {names}{f' ({caption})' if caption else ''}. "
        f"{item.failure.kind.capitalize()}{at}{far}. {why}".strip()
    )


def _knob_table(curves: Sequence[KnobCurve]) -> Cells:
    """First answers and any of three, a column for each value."""
    values = _knob_values(curves)
    lines = []
    for curve in curves:
        points = {point.value: point for point in curve.points}
        cells = [points.get(value) for value in values]
        firsts = ["-" if cell is None else _with_range(cell.sr, cell.by_home) for cell in cells]
        threes = ["-" if cell is None else _with_range(cell.top3, cell.top3_by_home) for cell in cells]
        lines += [(curve.name, "top-1", *firsts), (curve.name, "top-3", *threes)]
    return ("success, total (%)", "", *_knob_heads(curves)), lines


def _knob_counts(curves: Sequence[KnobCurve]) -> str:
    points = [point for curve in curves for point in curve.points]
    counts = points_text([point.n for point in points], [point.num_homes for point in points])
    has_ranges = any(point.by_home for point in points)
    return f"{counts}; {'in braces the interval by home' if has_ranges else 'no intervals by home'}."


def _has_range(point: KnobPoint) -> bool:
    return point.by_home is not None or point.top3_by_home is not None


def _knob_differences(curves: Sequence[KnobCurve], report: PogReport) -> Cells:
    """Paired differences of first answers, from the table of each value."""
    values = _knob_values(curves)
    titles = {point.value: point.table for curve in curves for point in curve.points}
    digest = curves[0].dataset_digest
    tables = {table.title: table for table in report.tables if table.dataset_digest == digest}
    found: dict[tuple[str, str], dict[float, str]] = {}
    for value in values:
        for item in tables[titles[value]].differences:
            if {item.first, item.second} <= {curve.name for curve in curves}:
                found.setdefault((item.first, item.second), {})[value] = _difference_text(item)
    lines = [(f"{a} - {b}", *(texts.get(value, "-") for value in values)) for (a, b), texts in found.items()]
    return ("difference in top-1 (points)", *_knob_heads(curves)), lines


def _knob_heads(curves: Sequence[KnobCurve]) -> list[str]:
    return [text.replace("\n", " ") for text in knob_ticks(curves[0].knob, _knob_values(curves))]


def _knob_values(curves: Sequence[KnobCurve]) -> list[float]:
    return sorted({point.value for curve in curves for point in curve.points})
