"""A study's report as text: Markdown for people, CSV for programs, LaTeX in the layout of the paper's tables."""

import csv
import io
from collections.abc import Sequence

from sim.types import SPLITS, TaskKind

from .report import TOTAL, ReportRow, StudyReport
from .statistics import LEVEL, NUM_RESAMPLES

_TITLES: dict[TaskKind, str] = {"pan": "PAN", "pog": "POG"}
_HEADS = {
    "sr": "SR (%)",
    "spl": "SPL (%)",
    "soft_spl": "soft SPL (%)",
    "dtg": "DTG (m)",
    "distance": "distance to the goal's centre (m)",
    "steps": "steps",
    "t_s": "seconds",
}
_PAPER: dict[TaskKind, tuple[str, ...]] = {"pan": ("sr", "spl", "dtg"), "pog": ("sr",)}
"""Measures of the paper's tables."""
_FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""What a spreadsheet takes for a formula at the start of a text."""


def markdown(report: StudyReport) -> str:
    """The whole report for a reader."""
    parts = [_intro(report)]
    for task, kind, rows in _tables(report):
        title = f"{_TITLES[task]}, rule {report.rule}" if task == "pan" else _TITLES[task]
        parts.append(f"## {title}, scenes: {kind}\n\n" + "\n\n".join(_measure_tables(rows)))
        anytime = [row for row in rows if row.measure.startswith("sr_within_") and row.split == TOTAL]
        if anytime:
            parts.append(_anytime(anytime))
    parts.append(_agreement(report))
    if report.suspects:
        parts.append(_suspects(report))
    if report.left_out:
        lines = [f"| {cell.who} | {_TITLES[cell.task]} | {cell.reason} | {cell.n} |" for cell in report.left_out]
        parts.append("## Left out of all numbers\n\n" + _table(("who", "task", "reason", "trials"), lines))
    parts.append("## Runs\n\n" + "\n".join(f"- {run}" for run in report.runs))
    return "\n\n".join(parts) + "\n"


def csv_text(report: StudyReport) -> str:
    """Every row with all its fields; numbers as Python writes them, texts safe in a spreadsheet."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(ReportRow.model_fields)
    for row in report.rows:
        writer.writerow([_cell(value) for value in row.model_dump().values()])
    return out.getvalue()


def latex(report: StudyReport) -> str:
    """The paper's columns per split, intervals below the figures."""
    parts = []
    for task, kind, rows in _tables(report):
        splits = _splits(rows)
        columns = [(split, measure) for split in splits for measure in _PAPER[task]]
        heads = " & ".join(f"{split} {measure.upper()}" for split, measure in columns)
        body = []
        for who, condition in _names(rows):
            cells = [_find(rows, who, condition, split, measure) for split, measure in columns]
            body.append(f"{_tex(_label(who, condition))} & " + " & ".join(_tex_cell(cell) for cell in cells) + r" \\")
        parts.append(
            f"% {_TITLES[task]}, scenes: {kind}, rule {report.rule if task == 'pan' else 'planar'}; "
            f"intervals at {LEVEL:g}, participants and episodes random\n"
            f"\\begin{{tabular}}{{l{'c' * len(columns)}}}\n\\hline\n & {heads} \\\\\n\\hline\n"
            + "\n".join(body)
            + "\n\\hline\n\\end{tabular}\n"
        )
    return "\n".join(parts)


def _intro(report: StudyReport) -> str:
    kinds = ", ".join(report.scene_kinds)
    lines = [
        "# Study report",
        "",
        f"Scenes: {kinds}. Episode files: {report.dataset_digest[:12]}. Agents are shown on the episodes that people "
        "did; differences are people minus agent, trial by trial on the same episodes. Total = plain mean of the "
        "splits.",
        "",
        f"Brackets hold {LEVEL:.0%} intervals that take participants and episodes for random (two-way; success rates "
        "on the logit scale); n is trials. The CSV has the methods and, as a second, the two-way bootstrap "
        f"({NUM_RESAMPLES} resamples).",
    ]
    if any(kind not in ("scan", "oracle-map") for kind in report.scene_kinds):
        lines += ["", "**These homes are no scans: the figures are no human baseline for PersONAL.**"]
    return "\n".join(lines)


def _measure_tables(rows: Sequence[ReportRow]) -> list[str]:
    """A table per measure: who by split."""
    found = []
    for measure in dict.fromkeys(row.measure for row in rows if row.measure in _HEADS):
        splits = _splits(rows)
        lines = []
        for who, condition in _names(rows):
            cells = [_find(rows, who, condition, split, measure) for split in splits]
            if any(cells):
                shown = " | ".join("" if cell is None else _md_cell(cell) for cell in cells)
                lines.append(f"| {_escaped(_label(who, condition))} | {shown} |")
        found.append(_table((_HEADS[measure], *splits), lines))
    return found


def _anytime(rows: Sequence[ReportRow]) -> str:
    limits = list(dict.fromkeys(row.measure for row in rows))
    lines = []
    for who, condition in _names(rows):
        cells = [_find(rows, who, condition, TOTAL, measure) for measure in limits]
        shown = " | ".join("" if cell is None else f"{cell.value:.1f}" for cell in cells)
        lines.append(f"| {_escaped(_label(who, condition))} | {shown} |")
    heads = [measure.removeprefix("sr_within_") for measure in limits]
    return "### Success within so many steps, total (%)\n\n" + _table(("steps", *heads), lines)


def _agreement(report: StudyReport) -> str:
    lines = [
        f"| {_TITLES[row.task]} | {row.condition} | {row.num_episodes} | {_figure(row.krippendorff_alpha)} | "
        f"{_figure(row.gwet_ac1)} |"
        for row in report.agreement
    ]
    heads = ("task", "condition", "episodes with two or more people", "Krippendorff's alpha", "Gwet's AC1")
    return "## Agreement between people on success\n\n" + _table(heads, lines)


def _suspects(report: StudyReport) -> str:
    lines = [
        f"| {suspect.episode} | {suspect.condition} | {suspect.num_agreeing} of {suspect.num_people} | "
        f"({suspect.xz[0]:.2f}, {suspect.xz[1]:.2f}) |"
        for suspect in report.suspects
    ]
    return (
        "## Episodes where people agree on a wrong place\n\nTheir labels may be wrong; they stay in all numbers.\n\n"
        + _table(("episode", "condition", "people", "x, z (m)"), lines)
    )


def _tables(report: StudyReport) -> list[tuple[TaskKind, str, list[ReportRow]]]:
    """Rows by task and the people's scene kind; oracle maps stand beside them."""
    found = []
    for task, kind in dict.fromkeys((row.task, row.scene_kind) for row in report.rows if row.kind == "human"):
        rows = [row for row in report.rows if row.task == task and row.scene_kind in (kind, "oracle-map")]
        found.append((task, kind, rows))
    return found


def _splits(rows: Sequence[ReportRow]) -> list[str]:
    return [split for split in (*SPLITS, TOTAL) if any(row.split == split for row in rows)]


def _names(rows: Sequence[ReportRow]) -> list[tuple[str, str]]:
    return list(dict.fromkeys((row.who, row.condition) for row in rows))


def _label(who: str, condition: str) -> str:
    return who if condition == "none" else f"{who} ({condition})"


def _find(rows: Sequence[ReportRow], who: str, condition: str, split: str, measure: str) -> ReportRow | None:
    names = (who, condition, split, measure)
    return next((row for row in rows if (row.who, row.condition, row.split, row.measure) == names), None)


def _digits(row: ReportRow) -> int:
    return 2 if row.measure in ("dtg", "distance") else 1


def _md_cell(row: ReportRow) -> str:
    digits = _digits(row)
    interval = "" if row.low is None or row.high is None else f" [{row.low:.{digits}f}, {row.high:.{digits}f}]"
    count = f"n {row.n}" if row.k is None else f"{row.k}/{row.n}"
    return f"{row.value:.{digits}f}{interval} {count}"


def _tex_cell(row: ReportRow | None) -> str:
    if row is None:
        return "--"
    digits = _digits(row)
    if row.low is None or row.high is None:
        return f"${row.value:.{digits}f}$"
    return f"${row.value:.{digits}f}$ {{\\scriptsize [${row.low:.{digits}f}$, ${row.high:.{digits}f}$]}}"


def _table(heads: Sequence[str], lines: Sequence[str]) -> str:
    return "\n".join([f"| {' | '.join(heads)} |", "|" + "---|" * len(heads), *lines])


def _figure(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def _escaped(text: str) -> str:
    return text.replace("|", "\\|")


def _tex(text: str) -> str:
    return "".join(f"\\{letter}" if letter in "#$%&_{}" else letter for letter in text)


def _cell(value: object) -> object:
    if isinstance(value, str) and value.startswith(_FORMULA):
        return f"'{value}"
    return repr(value) if isinstance(value, float) else value
