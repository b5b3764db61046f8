"""A report's rows for programs and for papers: CSV with every field, LaTeX in the layout of the paper's tables."""

from collections.abc import Sequence

from sim.homes.kind import scene_label
from sim.types import TaskKind

from ..design.analysis import LEVEL
from ..export.csv_cells import csv_lines
from .report import StudyReport
from .row_labels import row_label
from .rows import ReportRow
from .tables import TITLES, digits_of, find_row, names_of, splits_of, table_kinds

_PAPER: dict[TaskKind, tuple[str, ...]] = {"pan": ("sr", "spl", "dtg"), "pog": ("sr",)}
"""Measures of the paper's tables."""


def csv_text(report: StudyReport) -> str:
    """Every row with all its fields."""
    return csv_lines(ReportRow.model_fields, [tuple(row.model_dump().values()) for row in report.rows])


def latex(report: StudyReport) -> str:
    """The paper's columns per split, intervals and k/n beside the figures."""
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
    """Rows below a table that print these texts: whoever copies the table copies what must be said of it."""
    rows = [f"\\multicolumn{{{num_columns}}}{{l}}{{\\footnotesize {tex(text)}.}} \\\\\n" for text in texts]
    return "".join(rows)


def _tex_cell(row: ReportRow | None) -> str:
    if row is None:
        return "--"
    digits = digits_of(row.measure)
    count = "" if row.k is None else f" ({row.k}/{row.n})"
    if row.low is None or row.high is None:
        return f"${row.value:.{digits}f}${count}"
    return f"${row.value:.{digits}f}$ {{\\scriptsize [${row.low:.{digits}f}$, ${row.high:.{digits}f}$]{count}}}"


def tex(text: str) -> str:
    """Text as LaTeX prints it."""
    return "".join(f"\\{letter}" if letter in "#$%&_{}" else letter for letter in text)
