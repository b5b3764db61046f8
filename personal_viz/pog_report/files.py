"""A POG report's files: pages, tables for programs and papers, figures; the same runs give the same bytes."""

import json
from collections.abc import Sequence

from grounding.report.sources import PAPER_IS
from grounding.report.table import TOTAL, PogReport, PogTable
from human_study.export.text_tables import csv_lines, tex, tex_table
from human_study.report.page import html_page
from sim.episodes.editions import edition_of
from sim.homes.kind import scene_label

from .failure_map import failure_svg
from .figures import Drawn, distance_figure, knob_figure, methods_figure
from .gallery import DrawnFailure, Gallery
from .text import count_text, distance_name, knob_groups, knob_name, methods_name, paper_text, report_markdown

_BESIDE = 440
"""Pixels of a failure; they stand beside each other."""


def report_files(report: PogReport, gallery: Gallery | None) -> dict[str, str | bytes]:
    """Content by file name; without a gallery (the dataset is not at hand) no failures."""
    drawn = _figures(report)
    files: dict[str, str | bytes] = {
        f"{name}.{end}": body for name, both in drawn.items() for end, body in both.items()
    }
    failures = {} if gallery is None else {item.file_name: failure_svg(item) for item in gallery.drawn}
    pictures = {name: body for name, body in files.items() if isinstance(body, str)} | failures
    text = report_markdown(report, gallery)
    files |= failures | {
        "index.md": text,
        "index.html": html_page(text, pictures, beside_px=_BESIDE),
        "report.json": json.dumps(document(report, gallery), indent=2) + "\n",
        "table.tex": latex(report.tables),
        **_csv_files(report),
    }
    if gallery is not None:
        files["failures.csv"] = csv_lines(_FAILURE_HEADS, [_failure_line(item) for item in gallery.drawn])
    return files


def document(report: PogReport, gallery: Gallery | None) -> dict[str, object]:
    """The report as JSON holds it."""
    values: dict[str, object] = report.model_dump(mode="json")
    if gallery is not None:
        values["failure_counts"] = [
            {"table": c.table, "edition": edition_of(c.dataset_digest)}
            | {"method": c.method, "kind": c.kind, "n": c.n, "of": c.of}
            for c in gallery.counts
        ]
        values["failures"] = [dict(zip(_FAILURE_HEADS, _failure_line(item), strict=True)) for item in gallery.drawn]
    return values


def latex(tables: Sequence[PogTable]) -> str:
    """The paper's layout, one tabular per table."""
    parts = []
    for number, table in enumerate(tables, start=1):
        splits = [cell.split for cell in max(table.rows, key=lambda row: len(row.cells)).cells]
        heads = ["Method", *(split.capitalize() for split in splits), "Top-3", tex(PAPER_IS)]
        lines = []
        for row in table.rows:
            cells = {cell.split: cell for cell in row.cells}
            shown = [
                f"${cells[split].sr:.1f}$ {{\\scriptsize ({count_text(cells[split])})}}" if split in cells else "--"
                for split in splits
            ]
            by_home, top3 = cells[TOTAL].by_home, cells[TOTAL].top3
            if by_home is not None:
                shown[-1] += f" {{\\scriptsize [${by_home.low:.1f}$, ${by_home.high:.1f}$]}}"
            best = "--" if top3 is None else f"${top3:.1f}$"
            lines.append([tex(row.name), *shown, best, tex(paper_text(row)) or "--"])
        of_what = f"{table.title}, edition {table.edition}, scenes: {table.scene_kind}"
        said = [f"{of_what}; SR in percent within 1 m, 95% intervals by home"]
        said += [table.scene_label] if table.scene_label else []
        notes = "".join(f"\n{{\\footnotesize {tex(note)}}}\n" for note in table.notes)
        parts.append(f"% Table {number}\n{tex_table(heads, lines, below=said)}{notes}")
    return "\n".join(parts)


def _figures(report: PogReport) -> dict[str, Drawn]:
    drawn = {}
    for number, table in enumerate(report.tables, start=1):
        drawn[methods_name(number)] = methods_figure(table)
        drawn[distance_name(number)] = distance_figure(table)
    for number, curves in enumerate(knob_groups(report), start=1):
        shown = {(point.table, curve.dataset_digest) for curve in curves for point in curve.points}
        tables = [table for table in report.tables if (table.title, table.dataset_digest) in shown]
        notes = dict.fromkeys(note for table in tables for note in table.notes)
        drawn[knob_name(number, curves[0].knob)] = knob_figure(curves, list(notes))
    return drawn


def _csv_files(report: PogReport) -> dict[str, str]:
    cells, differences, distances, options = [], [], [], []
    for table in report.tables:
        home = (table.title, table.edition, table.scene_kind, table.scene_label)
        for row in table.rows:
            commits = " ".join(row.commits)
            for cell in row.cells:
                ranges = (*cell.by_episode, *_both(cell.by_home), cell.top3, *_both(cell.top3_by_home))
                known = (cell.split, cell.n, cell.k, cell.sr, *ranges, cell.num_homes)
                runs = (commits, " ".join(row.run_ids), " ".join(table.notes))
                cells.append((*home, row.name, *known, paper_text(row), *runs))
            for point in row.curve:
                both = (point.sr, *_both(point.by_home), point.top3, *_both(point.top3_by_home))
                distances.append((*home, row.name, point.metres, *both))
        for item in table.differences:
            pair = (item.first, item.second, item.n, item.first_minus_second)
            differences.append((*home, *pair, *_both(item.by_home), item.only_first, item.only_second))
    for curve in report.curves:
        for point in curve.points:
            firsts, threes = (point.sr, *_both(point.by_home)), (point.top3, *_both(point.top3_by_home))
            counts = (point.value, point.n, point.num_homes)
            kind = (edition_of(curve.dataset_digest), curve.scene_kind, scene_label(curve.scene_kind))
            options.append((curve.title, *kind, curve.name, curve.knob, *counts, *firsts, *threes))
    home = ("table", "edition", "scene_kind", "scene_label")
    of_homes = ("home_low", "home_high")
    found = ("split", "n", "k", "sr", "episode_low", "episode_high", *of_homes)
    top3 = ("top3", "top3_home_low", "top3_home_high")
    source = ("homes", "paper_hm3d_maps", "commits", "runs", "sources")
    pair = ("first", "second", "n", "first_minus_second", *of_homes, "only_first", "only_second")
    return {
        "table.csv": csv_lines((*home, "method", *found, *top3, *source), cells),
        "differences.csv": csv_lines((*home, *pair), differences),
        "distance.csv": csv_lines((*home, "method", "metres", "sr", *of_homes, *top3), distances),
        "options.csv": csv_lines((*home, "method", "option", "value", "n", "homes", "sr", *of_homes, *top3), options),
    }


_FAILURE_HEADS = (
    *("table", "method", "run", "split", "scene", "episode_id", "kind", "distance", "object", "why", "picture"),
    *("edition", "scene_kind", "scene_label"),
)


def _failure_line(item: DrawnFailure) -> tuple[object, ...]:
    found, info = item.failure, item.info
    distance = None if found.distance == float("inf") else found.distance
    names = (item.table, item.method, info.run_id, *item.episode.key)
    facts = (found.kind, distance, found.object_name, " ".join(item.reasons), item.file_name)
    return *names, *facts, info.edition, info.scene_kind, info.scene_label


def _both(interval: tuple[float, float] | None) -> tuple[float | None, float | None]:
    return (None, None) if interval is None else (interval[0], interval[1])
