"""A POG report as headings, texts, tables and pictures, in the order in which they are read."""

from collections.abc import Sequence

from grounding.methods.joint import FROZEN
from grounding.report.curves import KnobCurve
from grounding.report.failures import KINDS, NEAR_MISS, FailureKind
from grounding.report.sources import PAPER_IS
from grounding.report.statistics import FEWEST_HOMES, NUM_RESAMPLES, Range
from grounding.report.table import TOTAL, PogCell, PogDifference, PogReport, PogRow, PogTable

from .blocks import Block, Heading, Picture, Table, Text
from .figures import knob_axis, knob_ticks, points_text
from .gallery import DrawnFailure, Gallery

_WHAT = (
    "An answer is right within 1 m (planar, on its storey) of a right object's middle. SR is the share of right first "
    "answers, top-3 of right ones among three; Total is the plain mean of the splits. The first interval is by episode "
    "(Wilson; in Total put together from the splits), the second, in braces, by home: whole homes drawn again "
    f"{NUM_RESAMPLES:,} times, none with fewer than {FEWEST_HOMES} homes. Only the second speaks of other homes."
)
_NOT_MIXED = (
    "Oracle maps, schematic homes, invented homes and scans have tables of their own, and so has each kind of map. "
    f"The column “{PAPER_IS}” repeats what the paper prints (easy / medium / hard / total): its maps were made from "
    "renders of HM3D, so no figure of ours is better or worse than those."
)


def report_blocks(report: PogReport, gallery: Gallery | None) -> list[Block]:
    """All of the report; pictures have the names of `picture_names`."""
    blocks: list[Block] = [Heading("POG: grounding on maps", 1), Text(_WHAT), Text(_NOT_MIXED)]
    blocks += [Heading("Runs"), _runs_table(report)]
    if any(row.name.startswith("joint") for table in report.tables for row in table.rows):
        blocks.append(Text(FROZEN))
    for number, table in enumerate(report.tables, start=1):
        blocks += _table_blocks(table, number)
        if gallery is not None:
            blocks += _failure_blocks(table, gallery)
    groups = knob_groups(report)
    if groups:
        blocks.append(Heading("Success over noise and wording"))
        blocks.append(
            Text("Runs that differ in one option alone; each kind of homes and of map has curves of its own.")
        )
        for number, curves in enumerate(groups, start=1):
            blocks += _knob_blocks(curves, report, number)
    return blocks


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
    """File of the methods' dots of the table with this number."""
    return f"methods-{number}"


def knob_name(number: int, knob: str) -> str:
    """File of the curves with this number over an option."""
    return f"over-{knob.replace('_', '-')}-{number}"


def with_range(value: float, interval: Range | None, *, brackets: str = "[]") -> str:
    """`value [low, high]`, without brackets where there is none."""
    return f"{value:.1f}" + ("" if interval is None else " " + range_text(interval, brackets))


def range_text(interval: Range, brackets: str = "[]") -> str:
    """`[low, high]`."""
    low, high = (f"{round(value, 1) + 0.0:.1f}" for value in interval)
    return f"{brackets[0]}{low}, {high}{brackets[1]}"


def paper_text(row: PogRow) -> str:
    """The paper's figures of a method."""
    return "" if row.paper is None else " / ".join(f"{value:.1f}" for value in row.paper)


def count_text(cell: PogCell) -> str:
    """`k/n`."""
    return f"{cell.k:g}/{cell.n}"


def _runs_table(report: PogReport) -> Table:
    lines = []
    for number, table in enumerate(report.tables, start=1):
        for row in table.rows:
            seeds = ", ".join(map(str, row.seeds)) or "-"
            commits = ", ".join(commit[:12] for commit in row.commits)
            by_rules = f" ({row.num_fallbacks} with phrases by rules)" if row.num_fallbacks else ""
            answers = f"{row.num_trials}{by_rules}"
            lines.append((row.name, str(number), ", ".join(row.run_ids), seeds, commits, answers))
    heads = ("method", "table", "runs", "seeds", "code at commit", "answers")
    return Table(heads, tuple(lines), "The commit is the one that the program stood at when the run was made.")


def _table_blocks(table: PogTable, number: int) -> list[Block]:
    splits = list(dict.fromkeys(cell.split for row in table.rows for cell in row.cells))
    splits = [split for split in splits if split != TOTAL] + [TOTAL]
    lines = []
    for row in table.rows:
        cells = {cell.split: cell for cell in row.cells}
        shown = [_cell_text(cells[split]) if split in cells else "-" for split in splits]
        top3 = cells[TOTAL].top3
        best = "-" if top3 is None else with_range(top3, cells[TOTAL].top3_by_home, brackets="{}")
        lines.append((row.name, *shown, best, paper_text(row)))
    heads = ("SR (%)", *splits, "top-3, total", PAPER_IS)
    homes = "1 home" if table.num_homes == 1 else f"{table.num_homes} homes"
    note = " ".join([f"{homes}; dataset digest {table.dataset_digest[:12]}.", *table.notes])
    note += f" {table.scene_label}." if table.scene_label else ""
    blocks: list[Block] = [Heading(f"Table {number}. {table.title}"), Table(heads, tuple(lines), note)]
    is_by_home = table.has_home_intervals
    lines_are = "by home" if is_by_home else f"by episode: fewer than {FEWEST_HOMES} homes"
    blocks.append(Picture(f"{methods_name(number)}.svg", f"Total per method; lines are intervals {lines_are}."))
    bands = "bands are intervals by home, " if is_by_home else ""
    caption = (
        "Share of episodes whose first answer, and whose best of the first three, lies within d; "
        f"{bands}the dotted line is the 1 m of success."
    )
    blocks.append(Picture(f"{distance_name(number)}.svg", caption))
    blocks += _without_three(table)
    if table.differences:
        blocks += [Heading("Differences on the same episodes", 3), _difference_table(table)]
    return blocks


def _without_three(table: PogTable) -> list[Block]:
    """Which rows have no curve for three answers, though they rank some."""
    names = [row.name for row in table.rows if row.curve[0].top3 is None and row.cells[-1].top3 is not None]
    if not names:
        return []
    return [
        Text(
            f"No curve of three: the run files of {', '.join(names)} hold the distance of the first answer only, as "
            "earlier versions of this program wrote them. Their top-3 within 1 m is in the table; ground again for the "
            "curve."
        )
    ]


def _cell_text(cell: PogCell) -> str:
    by_home = "" if cell.by_home is None else f" {range_text(cell.by_home, '{}')}"
    return f"{with_range(cell.sr, cell.by_episode)}{by_home} {count_text(cell)}"


def _difference_text(item: PogDifference) -> str:
    return f"{item.first_minus_second:+.1f}" + (f" {range_text(item.by_home, '{}')}" if item.by_home else "")


def _difference_table(table: PogTable) -> Table:
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
    return Table(
        heads, tuple(lines), "Intervals by home, the same draws of homes for every pair; not corrected for many."
    )


def _failure_blocks(table: PogTable, gallery: Gallery) -> list[Block]:
    counts = [count for count in gallery.counts if count.table == table.title]
    if not counts:
        return []
    kinds: list[FailureKind] = [kind for kind in KINDS if any(count.kind == kind for count in counts)]
    lines = []
    methods = [row.name for row in table.rows if any(count.method == row.name for count in counts)]
    for method in methods:
        of_kind = {count.kind: count for count in counts if count.method == method}
        total = next(iter(of_kind.values())).of
        found = [of_kind[kind].n if kind in of_kind else 0 for kind in kinds]
        lines.append((method, *(f"{n} ({100 * n / total:.0f} %)" for n in found), str(total)))
    note = "; ".join(f"{kind}: {KINDS[kind]}" for kind in kinds) + ". In this order: the first that fits counts."
    blocks: list[Block] = [Heading("What wrong answers are", 3), Table(("method", *kinds, "all"), tuple(lines), note)]
    drawn = [item for item in gallery.drawn if item.table == table.title]
    if drawn:
        text = (
            "A sample of each method's failures, drawn with a seed. Colours of cells: their final score, yellow most; "
            "light grey: closed to the method. Numbers: answers by rank. Red cross and ring of 1 m: right objects. Red "
            "dots: other objects of the category."
        )
        blocks += [Heading("Failures", 3), Text(text)]
        for method in methods:
            found = [Picture(item.file_name, failure_caption(item)) for item in drawn if item.method == method]
            blocks += [Heading(method, 4), *found] if found else []
    return blocks


def failure_caption(item: DrawnFailure) -> str:
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


def _knob_blocks(curves: Sequence[KnobCurve], report: PogReport, number: int) -> list[Block]:
    knob = curves[0].knob
    name = knob.replace("_", " ")
    has_bars = any(point.by_home or point.top3_by_home for curve in curves for point in curve.points)
    bars = (
        "bars are 95 % intervals by home" if has_bars else f"no intervals by home with fewer than {FEWEST_HOMES} homes"
    )
    blocks: list[Block] = [
        Heading(f"{name.capitalize()}: {curves[0].title}", 3),
        _knob_table(curves),
        Picture(f"{knob_name(number, knob)}.svg", f"Success; {knob_axis(knob)}; {bars}."),
    ]
    differences = _knob_differences(curves, report)
    return [*blocks, differences] if differences.lines else blocks


def _knob_table(curves: Sequence[KnobCurve]) -> Table:
    """First answers and any of three, a column for each value."""
    values = _knob_values(curves)
    lines = []
    for curve in curves:
        points = {point.value: point for point in curve.points}
        cells = [points.get(value) for value in values]
        firsts = ["-" if cell is None else with_range(cell.sr, cell.by_home, brackets="{}") for cell in cells]
        threes = [
            "-" if cell is None or cell.top3 is None else with_range(cell.top3, cell.top3_by_home, brackets="{}")
            for cell in cells
        ]
        lines += [(curve.name, "top-1", *firsts), (curve.name, "top-3", *threes)]
    points = [point for curve in curves for point in curve.points]
    counts = points_text([point.n for point in points], [point.num_homes for point in points])
    note = "in braces the interval by home" if any(point.by_home for point in points) else "no intervals by home"
    return Table(("success, total (%)", "", *_knob_heads(curves)), tuple(lines), f"{counts}; {note}.")


def _knob_differences(curves: Sequence[KnobCurve], report: PogReport) -> Table:
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
    note = "On the same episodes; an interval in braces is by home, the same draws of homes for both methods."
    return Table(("difference in top-1 (points)", *_knob_heads(curves)), tuple(lines), note)


def _knob_heads(curves: Sequence[KnobCurve]) -> list[str]:
    return [text.replace("\n", " ") for text in knob_ticks(curves[0].knob, _knob_values(curves))]


def _knob_values(curves: Sequence[KnobCurve]) -> list[float]:
    return sorted({point.value for curve in curves for point in curve.points})


assert NEAR_MISS == 2.0, "KINDS says 1 to 2 m"
