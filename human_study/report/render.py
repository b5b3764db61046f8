"""Writes a report's numbers for readers: Markdown and HTML from `templates`, CSV with every field, LaTeX as the paper.

Every function takes the finished report; nothing is computed here.
"""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

from sim.homes.kind import scene_label
from sim.types import RULE_NOTES, SPLITS, TaskKind
from sim.words.english import how_many

from ..design.analysis import LEVEL
from ..export.text_tables import csv_lines, tex, tex_table
from .agreement import SUSPECT_SHARE
from .hypotheses import HypothesisRow
from .measures import MEASURES, WITHIN
from .page import NOBODY, count_text, filled, html_page, interval_text, label_lines, p_text
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
        "summary": summary(report),
        "of_homes": _of_homes,
        "comparable": _comparable,
        "splits_of": _splits,
        "grid": lambda rows, splits, measures: _cells(rows, [(split, m) for split in splits for m in measures]),
        "with_counts": _with_counts,
        "measures": MEASURES,
        "skewed": _skewed(report),
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


class Summary(NamedTuple):
    """The first page of a report, and what the command prints."""

    labels: list[str]
    """Sentences without which no number may be read."""
    heads: tuple[str, ...]
    rows: list[tuple[str, ...]]
    """The total success of people, agents, and people minus agents."""
    remarks: list[str]
    """Results of the primary hypotheses, and everything that is left out."""


def summary(report: StudyReport) -> Summary:
    """The totals, the primary hypotheses, and what is left out."""
    labels = label_lines(report.scene_labels, is_pilot=report.is_pilot, num_open=report.num_open)
    labels += report.warnings
    rows = []
    for task, kind in _table_kinds(report):
        of_task = _of_homes([row for row in report.rows if row.measure == "sr"], task, kind)
        for label, cells in _cells(_comparable(of_task), [(split, "sr") for split in _splits(of_task)]):
            total = cells[-1]
            if total is None:
                rows.append((f"{task.upper()}: {label}", _with_counts(cells)[-1], "", "", "", ""))
            else:
                people = "" if total.kind == "agent" else str(total.num_participants)
                counts = (count_text(total), people, str(total.num_episodes), str(total.num_homes))
                rows.append((f"{task.upper()}: {label}", interval_text(total), *counts))
    remarks = [_result_of(row) for row in report.hypotheses]
    remarks += [f"Left out: {left.run}: {left.reason}." for left in report.left_out_runs]
    remarks += [
        f"Left out: {how_many(left.n, 'trial')} of {left.who} ({left.task.upper()}): {left.reason}."
        for left in report.left_out
    ]
    heads = ("who", "SR, total (%)", "count", "people", "episodes", "homes")
    return Summary(labels, heads, rows, [" ".join(remark.split()) for remark in remarks])


def _result_of(row: HypothesisRow) -> str:
    """A primary hypothesis and its result in one line."""
    if row.p is None or row.p_holm is None:
        return f"{row.name}: {row.method}."
    found = "difference shown" if row.is_shown else "no difference shown"
    where = f" in {' and '.join(row.splits)}" if row.splits else ""
    return f"{row.name}: {found}{where}; {interval_text(row)}, p {p_text(row.p_holm)} (Holm)."


def num_intervals(report: StudyReport) -> int:
    """How many intervals the tables of the report hold; the summary repeats some of them."""
    tables = [_comparable(_of_homes(report.rows, task, kind)) for task, kind in _table_kinds(report)]
    shown = [row for table in tables for row in table if row.measure not in WITHIN or row.split == TOTAL]
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
    return filled(
        "power.md.j2", told=report.assumptions, num_homes=report.num_homes, designs=by_spread, first=first, best=best
    )


def csv_text(report: StudyReport) -> str:
    """Every row of the tables with all its fields, as CSV."""
    tables = [_comparable(_of_homes(report.rows, task, kind)) for task, kind in _table_kinds(report)]
    shown = {id(row) for table in tables for row in table}
    lines = [tuple(row.model_dump().values()) for row in report.rows if id(row) in shown]
    return csv_lines(ReportRow.model_fields, lines)


def latex(report: StudyReport) -> str:
    """LaTeX tables with the paper's columns per split, and intervals and k/n beside the figures."""
    parts = []
    for task, kind in _table_kinds(report):
        rows = _comparable(_of_homes(report.rows, task, kind))
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


def _skewed(report: StudyReport) -> list[str]:
    """The measures of this report whose intervals are built on the log scale, in words."""
    tasks = {row.task for row in report.rows}
    steps = ["steps", "paths"] if "pan" in tasks else []
    return ["times", *steps, *(["distances to a goal's centre"] if "pog" in tasks else [])]


def _with_counts(cells: Sequence[ReportRow | None]) -> list[str]:
    """A line of splits and their total."""
    shown = [NOBODY if c is None else f"{interval_text(c, MEASURES[c.measure].digits)} {count_text(c)}" for c in cells]
    if cells[-1] is None:
        shown[-1] = f"no total: {sum(cell is not None for cell in cells)} of {len(cells) - 1} splits"
    return shown


def _table_kinds(report: StudyReport) -> list[tuple[TaskKind, str]]:
    """The task and kind of homes of each table of people's rows; kinds never share a table."""
    return list(dict.fromkeys((row.task, row.scene_kind) for row in report.rows if row.kind == "human"))


def _of_homes(rows: Iterable[Any], task: TaskKind, kind: str) -> list[Any]:
    """The rows of one task and kind of home; answers on oracle maps stand in every table of their task."""
    return [row for row in rows if row.task == task and row.scene_kind in (kind, "oracle-map")]


def _comparable(rows: Sequence[Any]) -> list[Any]:
    """Rows of figures or spreads without the totals of row names that lack a split of others, which would differ."""
    splits: dict[str, dict[tuple[str, str], set[str]]] = {}
    for row in rows:
        splits.setdefault(row.measure, {}).setdefault((row.who, row.condition), set()).add(row.split)
    most = {measure: set().union(*found.values()) for measure, found in splits.items()}
    whole = [(row, splits[row.measure][row.who, row.condition] == most[row.measure]) for row in rows]
    return [row for row, is_whole in whole if is_whole or row.split in SPLITS]


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
