"""Writes the report of a study of home sequences for readers: Markdown, HTML, and CSV with every figure."""

from typing import Any

from sim.homes.kind import scene_label
from sim.sequences.figures import SequenceFigures
from sim.types import RULE_NOTES

from ..design.analysis import LEVEL
from ..export.text_tables import csv_lines
from ..report.page import filled, html_page, label_lines
from ..report.trials import row_label
from .measures import KINDS, DifferenceRow, SequenceReportRow, SequenceStudyReport, share_of

_WHOLE = {
    "progress": "progress",
    "partial": "partial",
    "composite": "all right",
    "csr": "CSR",
    "cgt": "CGT",
    "spl": "SPL",
    "ppl": "PPL",
    "interference": "interference",
    "recall": "recall",
    "precision": "precision",
    "steps": "steps (number)",
    "dtg": "DTG (m)",
    "lag": "lag (searches)",
}
"""Heads of the measures of whole sequences."""
_NUMBERS = ("steps", "dtg", "lag")
"""Measures that are no shares."""
_ENDS = {
    "found": "FOUND, or a confirmed answer",
    "steps": "step limit",
    "giveup": "given up",
    "timeout": "time limit",
}


def sequence_markdown(report: SequenceStudyReport) -> str:
    """The whole report as Markdown."""
    kinds = dict.fromkeys((row.row.task, row.row.scene_kind) for row in report.rows)
    tables = [
        (task, kind, [row for row in report.rows if (row.row.task, row.row.scene_kind) == (task, kind)])
        for task, kind in kinds
    ]
    return filled(
        "sequences.md.j2",
        report=report,
        labels=label_lines(report.scene_labels, is_pilot=report.is_pilot, num_open=report.num_open),
        tables=tables,
        success_cells=_success_cells,
        whole=list(_WHOLE.values()),
        whole_cells=_whole_cells,
        points=_points,
        label_of=_label_of,
        rule_notes=RULE_NOTES,
        end_names=_ENDS,
        level=f"{LEVEL:.0%}",
    )


def sequence_html(report: SequenceStudyReport) -> str:
    """The whole report as one HTML page."""
    return html_page(sequence_markdown(report), {})


def sequence_csv(report: SequenceStudyReport) -> str:
    """Every figure of the rows and every difference, one a line; shares in [0, 1].

    Rows tell their sequences and all their searches, differences the searches of the kind on both sides.
    """
    sizes = "n_sequences", "n_searches"
    heads = ("task", "scenes", "label", "who", "condition", "searches", "measure", "value", "low", "high", *sizes)
    lines: list[tuple[Any, ...]] = []
    for one in report.rows:
        row, found = one.row, one.row.sequence_measures
        names = row.task, row.scene_kind, row.scene_label, row.who, row.condition
        for measure, value in found.model_dump(exclude={"n", "searches", "intervals"}).items():
            kind = measure.removeprefix("sr_") if measure.startswith("sr_") else "all"
            low, high = found.intervals.get(measure, (None, None))
            name = "sr" if measure.startswith("sr") else measure
            lines.append((*names, kind, name, value, low, high, found.n, found.searches))
    for row in report.differences:
        names = row.task, row.scene_kind, scene_label(row.scene_kind), f"{row.first} - {row.second}", ""
        lines.append((*names, row.kind, "sr", row.value, row.low, row.high, "", row.num_first + row.num_second))
    return csv_lines(heads, lines)


def summary_lines(report: SequenceStudyReport) -> list[tuple[str, ...]]:
    """A line for each row: its name, its number of sequences, and success by kind of search, percent."""
    lines = []
    for one in report.rows:
        row, found = one.row, one.row.sequence_measures
        shares = (*(share_of(found, kind) for kind in ("all", *KINDS)), found.stale)
        name = f"{row.task.upper()}: {row_label(row.who, row.condition)}"
        lines.append((name, str(found.n), *map(_percent, shares)))
    return lines


def _label_of(rows: list[SequenceReportRow]) -> str:
    label = rows[0].row.scene_label
    return f"{label}. " if label else ""


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:.1f}"


def _success_cells(one: SequenceReportRow) -> list[str]:
    """The cells of the table of success by kind of search."""
    found = one.row.sequence_measures
    sizes = (str(one.num_people or ""), str(one.num_sequences), str(one.num_homes))
    shares = [_measure("sr" if kind == "all" else f"sr_{kind}", found) for kind in ("all", *KINDS)]
    return [row_label(one.row.who, one.row.condition), *sizes, *shares, _percent(found.stale)]


def _whole_cells(one: SequenceReportRow) -> list[str]:
    """The cells of the table of measures of whole sequences."""
    found = one.row.sequence_measures
    return [row_label(one.row.who, one.row.condition), *(_measure(name, found) for name in _WHOLE)]


def _measure(name: str, found: SequenceFigures) -> str:
    """A measure, with its interval where it has one."""
    value, interval = getattr(found, name), found.intervals.get(name)
    if name in _NUMBERS:
        return "-" if value is None else f"{value:.2f}"
    text = _percent(value)
    return text if interval is None else f"{text} [{', '.join(_percent(min(1, max(0, end))) for end in interval)}]"


def _points(row: DifferenceRow) -> str:
    text = f"{100 * row.value:+.1f}"
    if row.low is None or row.high is None:
        return text
    return f"{text} [{100 * max(-1, row.low):.1f}, {100 * min(1, row.high):.1f}]"
