"""Writes a report's numbers for readers: Markdown and HTML from `templates`, CSV with every field, LaTeX as the paper.

Every function takes the finished report; nothing is computed here.
"""

from collections.abc import Iterable, Sequence
from typing import Any

from sim.homes.kind import scene_label
from sim.types import RULE_NOTES, SPLITS, TaskKind

from ..design.analysis import LEVEL
from ..export.text_tables import csv_lines, tex, tex_table
from .agreement import SUSPECT_SHARE
from .measures import MEASURES, WITHIN
from .page import NOBODY, count_text, filled, html_page, interval_text
from .power import PowerReport
from .report import StudyReport
from .rows import TOTAL, ReportRow
from .trials import row_label

_PAPER: dict[TaskKind, tuple[str, ...]] = {"pan": ("sr", "spl", "dtg"), "pog": ("sr",)}
"""Measures of the paper's tables."""


def markdown(report: StudyReport, pictures: Iterable[str] = ()) -> str:
    """The whole report as Markdown, with the named pictures where they belong."""
    kinds = _table_kinds(report)
    notes = [f"{task.upper()}: {_verification_note(report, task, kind)}" for task, kind in kinds]
    words = {
        "report": report,
        "pictures": list(pictures),
        "table_kinds": kinds,
        "notes": " ".join(notes),
        "verification_note": lambda task, kind: _verification_note(report, task, kind),
        "of_homes": _of_homes,
        "splits_of": _splits,
        "grid": lambda rows, splits, measures: _cells(rows, [(split, m) for split in splits for m in measures]),
        "with_counts": _with_counts,
        "measures": MEASURES,
        "within": WITHIN,
        "level": f"{LEVEL:.0%}",
        "num_intervals": num_intervals(report),
        "one_in": round(1 / (1 - LEVEL)),
        "rule_notes": RULE_NOTES,
        "suspect_share": f"{SUSPECT_SHARE:.0%}",
    }
    return filled("report.md.j2", **words)


def html_text(report: StudyReport, pictures: dict[str, str]) -> str:
    """The whole report as one HTML page with its pictures (SVG text by name)."""
    return html_page(markdown(report, pictures), pictures)


def num_intervals(report: StudyReport) -> int:
    """How many intervals the report prints."""
    shown = [row for row in report.rows if row.measure not in WITHIN or row.split == TOTAL]
    effects = [row.effect for row in (*report.memory, *report.order)]
    blocks = report.blocks if report.order else ()
    found = (*shown, *report.hypotheses, *effects, *blocks, *report.sensitivity)
    return sum(row.low is not None for row in found)


def power_markdown(report: PowerReport) -> str:
    """One table per spread of people, and the design that is best for as many trials where people differ most."""
    by_spread = {
        spread: [row for row in report.rows if row.person_sd == spread] for spread in report.assumptions.person_sds
    }
    first, *others = by_spread[max(by_spread)]
    best = min([first, *(row for row in others if row.trials <= 1.05 * first.trials)], key=lambda row: row.width_total)
    return filled("power.md.j2", told=report.assumptions, designs=by_spread, first=first, best=best)


def csv_text(report: StudyReport) -> str:
    """Every row with all its fields, as CSV."""
    return csv_lines(ReportRow.model_fields, [tuple(row.model_dump().values()) for row in report.rows])


def latex(report: StudyReport) -> str:
    """LaTeX tables with the paper's columns per split, and intervals and k/n beside the figures."""
    parts = []
    for task, kind in _table_kinds(report):
        rows = _of_homes(report.rows, task, kind)
        columns = [(split, measure) for split in _splits(rows) for measure in _PAPER[task]]
        heads = ["", *(f"{split} {measure.upper()}" for split, measure in columns)]
        lines = [[tex(label), *map(_tex_cell, cells)] for label, cells in _cells(rows, columns)]
        rule = report.rule if task == "pan" else "planar"
        random = "people, episodes and homes" if report.intervals == "homes" else "people and episodes"
        said = [
            f"{task.upper()}, scenes: {kind}, rule {rule}; intervals at {LEVEL:g}, {random} random",
            *([label] if (label := scene_label(kind)) else []),
            *(["A pilot"] if report.is_pilot else []),
            *(warning.split(". ")[0] for warning in report.warnings if task == "pan"),
        ]
        parts.append(tex_table(heads, lines, below=said))
    return "\n".join(parts)


def _with_counts(cells: Sequence[ReportRow | None]) -> list[str]:
    """A line of splits and their total; the total names the number of splits where some are missing."""
    shown = [NOBODY if c is None else f"{interval_text(c, MEASURES[c.measure].digits)} {count_text(c)}" for c in cells]
    num_done, num_splits = sum(cell is not None for cell in cells[:-1]), len(cells) - 1
    if num_done < num_splits and cells[-1] is not None:
        shown[-1] += f" ({num_done} of {num_splits} splits)"
    return shown


def _table_kinds(report: StudyReport) -> list[tuple[TaskKind, str]]:
    """The task and kind of homes of each table of people's rows; kinds never share a table."""
    return list(dict.fromkeys((row.task, row.scene_kind) for row in report.rows if row.kind == "human"))


def _of_homes(rows: Iterable[Any], task: TaskKind, kind: str) -> list[Any]:
    """The rows of one task and kind of home; answers on oracle maps stand in every table of their task."""
    return [row for row in rows if row.task == task and row.scene_kind in (kind, "oracle-map")]


def _splits(rows: Sequence[ReportRow]) -> list[str]:
    """Splits that occur, the total last."""
    return [split for split in (*SPLITS, TOTAL) if any(row.split == split for row in rows)]


def _cells(rows: Sequence[ReportRow], columns: Sequence[tuple[str, str]]) -> list[tuple[str, list[ReportRow | None]]]:
    """Label and cells of each row name; columns are (split, measure)."""
    found = {(row.who, row.condition, row.split, row.measure): row for row in rows}
    names = dict.fromkeys((row.who, row.condition) for row in rows)
    return [(row_label(*name), [found.get((*name, *column)) for column in columns]) for name in names]


def _verification_note(report: StudyReport, task: TaskKind, kind: str) -> str:
    """A note below a table: how many of the people's trials were done again and agree."""
    parts = [
        f"{row_label('human', row.condition)}: {row.num_verified} of {row.n} verified, {row.num_drift} drift, "
        f"{row.num_failed} failed, {row.num_unsupported} unsupported, {row.num_not_yet} not yet"
        for row in report.verification
        if (row.task, row.scene_kind) == (task, kind)
    ]
    return "Done again step by step: " + ("; ".join(parts) if parts else "not known, only runs are at hand") + "."


def _tex_cell(row: ReportRow | None) -> str:
    if row is None:
        return "--"
    digits = MEASURES[row.measure].digits
    count = "" if row.k is None else f" ({row.k}/{row.n})"
    if row.low is None or row.high is None:
        return f"${row.value:.{digits}f}${count}"
    return f"${row.value:.{digits}f}$ {{\\scriptsize [${row.low:.{digits}f}$, ${row.high:.{digits}f}$]{count}}}"
