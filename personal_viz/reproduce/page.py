"""The page of `reproduce`: the paper's two tables with our figures, and in words what differs.

Run folders -> `MetricRow`s -> Markdown -> one HTML file, and the same figures as JSON.
"""

from collections.abc import Sequence
from itertools import chain
from pathlib import Path
from typing import Any

from grounding.encoders.protocol import ORACLE_SUFFIX
from grounding.report.sources import pog_notes
from human_study.report.page import filled, html_page
from sim.homes.kind import scene_labels, scene_terms
from sim.tasks.metrics import MetricRow, metric_rows, paper_table, reading_notes, require_comparable, rule_warnings
from sim.tasks.provenance import program_release
from sim.tasks.run_files import Run
from sim.types import TaskKind

from .paper import paper_cells

_FOLDER = Path(__file__).parent
PAPER = "paper: "
"""Begins the name of a line with the paper's figures."""


def rows_of(runs: Sequence[Run]) -> list[MetricRow]:
    """Rows of all runs by rule `paper`.

    Raises:
        RunFileError: Runs cannot stand in one table: other homes or episodes, never scored, or a trial twice.
    """
    require_comparable(run.info for run in runs)
    return metric_rows(runs)


def page_of(runs: Sequence[Run], rows: Sequence[MetricRow]) -> str:
    """The HTML page of these runs."""
    kinds = sorted({row.scene_kind for row in rows})
    text = filled(
        "page.md.j2",
        folder=_FOLDER,
        release=program_release(),
        edition=rows[0].edition,
        kinds=kinds,
        labels=scene_labels(kinds),
        terms=[terms for kind in kinds if (terms := scene_terms(kind))],
        has_paper=_has_paper(rows),
        pan=_table(rows, "pan"),
        pog=_table(rows, "pog"),
        pan_notes=[*reading_notes(_of(rows, "pan")), *rule_warnings(rows)],
        pog_notes=[*reading_notes(_of(rows, "pog")), *pog_notes([run.info for run in runs if run.answers])],
        runs=[(run.info.run_id, len(run.episodes) + len(run.reported) + len(run.answers)) for run in runs],
    )
    return html_page(text, {})


def document_of(runs: Sequence[Run], rows: Sequence[MetricRow]) -> dict[str, Any]:
    """The figures of the page."""
    return {
        "program": program_release(),
        "edition": rows[0].edition,
        "dataset_digest": runs[0].info.dataset_digest,
        "scene_kinds": sorted({row.scene_kind for row in rows}),
        "scene_labels": list(scene_labels(row.scene_kind for row in rows)),
        "rows": [row.model_dump() for row in rows],
        "paper": _has_paper(rows),
        "runs": [run.info.run_id for run in runs],
    }


def _of(rows: Sequence[MetricRow], task: TaskKind) -> list[MetricRow]:
    return [row for row in rows if row.task == task]


def _has_paper(rows: Sequence[MetricRow]) -> bool:
    """Whether the paper's figures may stand beside these: only on scans."""
    return all(row.scene_kind == "scan" for row in rows)


def _table(rows: Sequence[MetricRow], task: TaskKind) -> tuple[list[str], list[list[str]]] | None:
    """Heads and lines of a task's table, in the paper's order; its line follows the last of ours with its method."""
    found = sorted(_of(rows, task), key=_place)
    if not found:
        return None
    table = paper_table(found)
    heads = ["method", "condition", *(f"{split} {head}" for split in table.splits for head in table.heads)]
    lines: list[list[str]] = []
    for index, line in enumerate(table.lines):
        condition = "" if line.condition == "none" else line.condition
        lines.append([line.who, condition, *chain(*line.cells)])
        row = next(row for row in found if (row.who, row.condition) == (line.who, line.condition))
        printed = paper_cells(row, columns=table.splits) if _has_paper(rows) and _sees(line.condition) else None
        later = [other.who for other in table.lines[index + 1 :] if _sees(other.condition)]
        if printed is not None and (line.who == "human" or line.who not in later):
            name, cells = printed
            lines.append([PAPER + name, "", *chain(*cells)])
    return heads, lines


def _sees(condition: str) -> bool:
    """Whether a row's map is made of pictures: no figure of the paper stands beside maps of captions."""
    return ORACLE_SUFFIX not in condition


def _place(row: MetricRow) -> int:
    """People first, then the paper's methods in its order, then others in ours."""
    names = ("human", "random-frontier", "random", "center", "vlfm", "onemap", "qs", "rpg")
    return names.index(row.who.lower()) if row.who.lower() in names else len(names)
