"""A report's numbers as tables for readers, as CSV with every field, and as LaTeX in the paper's layout."""

from collections.abc import Sequence

from sim.homes.kind import scene_label
from sim.types import SPLITS, EndReason, TaskKind

from ..design.analysis import LEVEL
from ..export.formats import csv_lines
from .blocks import Block, Heading, Table, Text
from .measures import MEASURES, WITHIN
from .report import StudyReport
from .rows import TOTAL, ReportRow
from .trials import row_label

TITLES: dict[TaskKind, str] = {"pan": "PAN", "pog": "POG"}
NOBODY = "no such trials"
END_NAMES: dict[EndReason, str] = {
    "stop": "STOP",
    "steps": "step limit without STOP",
    "click": "confirmed mark",
    "giveup": "given up",
    "timeout": "time limit",
    "technical": "technical failure",
    "abandoned": "abandoned",
}

_PAPER: dict[TaskKind, tuple[str, ...]] = {"pan": ("sr", "spl", "dtg"), "pog": ("sr",)}
"""Measures of the paper's tables."""


def result_tables(report: StudyReport, task: TaskKind, kind: str) -> list[Block]:
    """One table per measure, row names by splits, for one task and kind of home; with answers on oracle maps."""
    rows = [row for row in report.rows if row.task == task and row.scene_kind in (kind, "oracle-map")]
    note = verification_note(report, task, kind)
    if any(row.kind == "agent" for row in rows):
        note += f" People have: {', '.join(report.information) if report.information else 'not in the runs'}."
    blocks: list[Block] = []
    for measure in dict.fromkeys(row.measure for row in rows if MEASURES[row.measure].head):
        blocks.append(_measure_table(report, rows, measure, note))
    anytime = [row for row in rows if row.measure in WITHIN and row.split == TOTAL]
    if anytime:
        blocks += [Heading("Success within so many steps, total (%)", 3), _anytime(anytime, note)]
    spreads = [row for row in report.spreads if row.task == task and row.scene_kind in (kind, "oracle-map")]
    if spreads:
        lines = [
            (
                row_label(row.who, row.condition),
                MEASURES[row.measure].head,
                row.split,
                f"{row.median:.2f}",
                f"{row.lower:.2f} to {row.upper:.2f}",
                str(row.n),
                str(row.num_missing),
            )
            for row in spreads
        ]
        heads = ("who", "measure", "split", "median", "middle half", "trials", "without a value")
        text = (
            "Quartiles over trials. DTG without a value: no way leads from the last position to the goal (unreachable)."
        )
        blocks += [Heading("Spread", 3), Text(text), Table(heads, tuple(lines), note)]
    return blocks + _ends(report, task, kind, note)


def _ends(report: StudyReport, task: TaskKind, kind: str, note: str) -> list[Block]:
    lines = tuple(
        (row_label(row.who, row.condition), END_NAMES[row.reason], str(row.n), str(row.k))
        for row in report.ends
        if row.task == task and row.scene_kind in (kind, "oracle-map")
    )
    return [Heading("How trials ended", 3), Table(("who", "end", "trials", "successes among them"), lines, note)]


def verification_note(report: StudyReport, task: TaskKind, kind: str) -> str:
    """A note below a table: how many of the people's trials were done again and agree."""
    parts = [
        f"{row_label('human', row.condition)}: {row.num_verified} of {row.n} verified, {row.num_drift} drift, "
        f"{row.num_failed} failed, {row.num_unsupported} unsupported, {row.num_not_yet} not yet"
        for row in report.verification
        if (row.task, row.scene_kind) == (task, kind)
    ]
    return "Done again step by step: " + ("; ".join(parts) if parts else "not known, only runs are at hand") + "."


def table_kinds(report: StudyReport) -> list[tuple[TaskKind, str]]:
    """The task and kind of homes of each table of people's rows; kinds never share a table."""
    return list(dict.fromkeys((row.task, row.scene_kind) for row in report.rows if row.kind == "human"))


def names_of(rows: Sequence[ReportRow]) -> list[tuple[str, str]]:
    """The row name and condition of each row of a table, in order."""
    return list(dict.fromkeys((row.who, row.condition) for row in rows))


def splits_of(rows: Sequence[ReportRow]) -> list[str]:
    """Splits that occur, the total last."""
    return [split for split in (*SPLITS, TOTAL) if any(row.split == split for row in rows)]


def find_row(rows: Sequence[ReportRow], who: str, condition: str, split: str, measure: str) -> ReportRow | None:
    """The row with these names, or None."""
    names = (who, condition, split, measure)
    return next((row for row in rows if (row.who, row.condition, row.split, row.measure) == names), None)


def with_interval(value: float, low: float | None, high: float | None, *, digits: int = 1) -> str:
    """The text `value [low, high]`."""
    shown, *limits = (f"{round(x, digits) + 0.0:.{digits}f}" for x in (value, low, high) if x is not None)  # no -0.0
    return f"{shown} [{', '.join(limits)}]" if len(limits) == 2 else shown


def csv_text(report: StudyReport) -> str:
    """Every row with all its fields, as CSV."""
    return csv_lines(ReportRow.model_fields, [tuple(row.model_dump().values()) for row in report.rows])


def latex(report: StudyReport) -> str:
    """LaTeX tables with the paper's columns per split, and intervals and k/n beside the figures."""
    parts = []
    for task, kind in table_kinds(report):
        rows = [row for row in report.rows if row.task == task and row.scene_kind in (kind, "oracle-map")]
        columns = [(split, measure) for split in splits_of(rows) for measure in _PAPER[task]]
        heads = " & ".join(f"{split} {measure.upper()}" for split, measure in columns)
        body = []
        for who, condition in names_of(rows):
            cells = [find_row(rows, who, condition, split, measure) for split, measure in columns]
            body.append(f"{tex(row_label(who, condition))} & " + " & ".join(_tex_cell(cell) for cell in cells) + r" \\")
        rule = report.rule if task == "pan" else "planar"
        said = [
            f"{TITLES[task]}, scenes: {kind}, rule {rule}; intervals at {LEVEL:g}, participants and episodes random",
            *([label] if (label := scene_label(kind)) else []),
            *(["A pilot"] if report.is_pilot else []),
            *(warning.split(". ")[0] for warning in report.warnings if task == "pan"),
        ]
        parts.append(
            f"\\begin{{tabular}}{{l{'c' * len(columns)}}}\n\\hline\n & {heads} \\\\\n\\hline\n"
            + "\n".join(body)
            + f"\n\\hline\n{tex_lines(said, num_columns=len(columns) + 1)}\\end{{tabular}}\n"
        )
    return "\n".join(parts)


def tex_lines(texts: Sequence[str], *, num_columns: int) -> str:
    """LaTeX rows below a table that print these texts, so that a copy of the table keeps the remarks."""
    rows = [f"\\multicolumn{{{num_columns}}}{{l}}{{\\footnotesize {tex(text)}.}} \\\\\n" for text in texts]
    return "".join(rows)


def _tex_cell(row: ReportRow | None) -> str:
    if row is None:
        return "--"
    digits = MEASURES[row.measure].digits
    count = "" if row.k is None else f" ({row.k}/{row.n})"
    if row.low is None or row.high is None:
        return f"${row.value:.{digits}f}${count}"
    return f"${row.value:.{digits}f}$ {{\\scriptsize [${row.low:.{digits}f}$, ${row.high:.{digits}f}$]{count}}}"


def tex(text: str) -> str:
    """The text, escaped for LaTeX."""
    return "".join(f"\\{letter}" if letter in "#$%&_{}" else letter for letter in text)


def _measure_table(report: StudyReport, rows: Sequence[ReportRow], measure: str, note: str) -> Table:
    splits = splits_of(rows)
    lines = []
    for who, condition in names_of(rows):
        cells = [find_row(rows, who, condition, split, measure) for split in splits]
        if any(cells):
            done = sum(cell is not None for cell in cells[:-1])
            shown = [NOBODY if cell is None else _cell(cell) for cell in cells]
            if splits[-1] == TOTAL and done < len(splits) - 1 and cells[-1] is not None:
                shown[-1] += f" ({done} of {len(splits) - 1} splits)"
            lines.append((row_label(who, condition), *shown))
    return Table((MEASURES[measure].head, *splits), tuple(lines), note)


def _cell(row: ReportRow) -> str:
    count = f"n {row.n}" if row.k is None else f"{row.k}/{row.n}"
    return f"{with_interval(row.value, row.low, row.high, digits=MEASURES[row.measure].digits)} {count}"


def _anytime(rows: Sequence[ReportRow], note: str) -> Table:
    limits = list(dict.fromkeys(row.measure for row in rows))
    lines = []
    for who, condition in names_of(rows):
        cells = [find_row(rows, who, condition, TOTAL, measure) for measure in limits]
        shown = [NOBODY if cell is None else with_interval(cell.value, cell.low, cell.high) for cell in cells]
        lines.append((row_label(who, condition), *shown))
    heads = [measure.removeprefix("sr_within_") for measure in limits]
    return Table(("steps", *heads), tuple(lines), note)
