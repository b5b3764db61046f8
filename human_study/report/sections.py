"""The whole report for a reader: the study, the tables, the tests, and their limits."""

from collections.abc import Iterable, Sequence

from sim.types import RULE_NOTES

from ..design.analysis import LEVEL, NUM_RESAMPLES
from .agreement import SUSPECT_SHARE
from .blocks import Block, Heading, Picture, Table, Text, html_text, markdown_text
from .effects import BlockRow, EffectRow
from .measures import MEASURES
from .report import StudyReport
from .tables import NOBODY, TITLES, result_tables, table_kinds, verification_note, with_interval
from .trials import row_label

_TOTALS = {
    "mean_of_splits": "the plain mean of the splits, as in the paper",
    "pooled": "all trials alike, whatever their split",
    "dataset_weighted": "the splits by their size in the dataset",
}
_WEIGHTS = {"trials": "each trial counts the same", "participants": "each person counts the same"}


def report_blocks(report: StudyReport, pictures: Iterable[str] = ()) -> list[Block]:
    """The report's blocks in order, with the named pictures where they belong."""
    shown = list(pictures)
    blocks = [*_intro(report), *_flow(report, shown), *_hypotheses(report)]
    for task, kind in table_kinds(report):
        rule = f", rule {report.rule}" if task == "pan" else ""
        blocks.append(Heading(f"{TITLES[task]}{rule}, scenes: {kind}"))
        blocks += result_tables(report, task, kind)
        blocks += _pictures(shown, (f"{task}-people.svg", f"{task}-episodes.svg", f"{task}-effort.svg"))
    blocks += _memory(report)
    blocks += _order(report, shown)
    blocks += _agent_pairs(report) + _sensitivity(report) + _agreement(report)
    blocks += _verification(report) + _left_out(report) + _checklist(report) + _origin(report)
    overlays = [name for name in shown if name.startswith("overlay-")]
    if overlays:
        blocks += [Heading("Where people and agents went and pointed"), *_pictures(shown, overlays)]
    return blocks


def markdown(report: StudyReport, pictures: Iterable[str] = ()) -> str:
    """The whole report as Markdown."""
    return markdown_text(report_blocks(report, pictures))


def html_page(report: StudyReport, pictures: dict[str, str]) -> str:
    """The whole report as one HTML page with its pictures (SVG text by name)."""
    return html_text(report_blocks(report, pictures), pictures)


def _intro(report: StudyReport) -> list[Block]:
    name = f": {report.study}" if report.study else ""
    information = ", ".join(report.information) if report.information else "not in the runs"
    blocks: list[Block] = [Heading(f"Study report{name}", 1)]
    if report.is_pilot:
        blocks.append(Text("Pilot: served without an ethics id. These figures are for planning only.", is_strong=True))
    if report.num_open:
        interim = (
            f"Interim: {report.num_open} counted trials are not done. Do not let these figures decide when to stop."
        )
        blocks.append(Text(interim, is_strong=True))
    strong = (*(f"{label}." for label in report.scene_labels), *report.warnings)
    rule = f" Success in PAN: rule {RULE_NOTES[report.rule]}." if any(row.task == "pan" for row in report.rows) else ""
    return [
        *blocks,
        *(Text(text, is_strong=True) for text in strong),
        Text(
            f"Scenes: {', '.join(report.scene_kinds)}. Episode files: {report.dataset_digest[:12]}. Agents are shown "
            "on the episodes that people did, several runs of one agent averaged per episode; differences are people "
            f"minus agent, trial by trial on the same episodes. People have: {information}. "
            f"Total = {_TOTALS[report.total]}; within a split {_WEIGHTS[report.weight]}.{rule}"
        ),
        Text(
            f"Brackets hold {LEVEL:.0%} intervals that take participants and episodes for random (two-way; success "
            "rates on the logit scale); with few people they are wide because there are few people. n is trials. The "
            f"CSV has the methods and, as a second, the two-way bootstrap ({NUM_RESAMPLES} resamples). Every trial "
            "with a result counts (intention to treat). What is not under Primary hypotheses is exploratory."
        ),
    ]


def _flow(report: StudyReport, shown: Sequence[str]) -> list[Block]:
    if not report.flow:
        return []
    lines = tuple((f"- {count.point}" if count.is_aside else count.point, str(count.n)) for count in report.flow)
    return [
        Heading("Flow of participants"),
        Table(("point", "people"), lines, "Indented by -: ways out and detours."),
        *_pictures(shown, ("flow.svg",)),
    ]


def _hypotheses(report: StudyReport) -> list[Block]:
    heading = Heading("Primary hypotheses")
    if not report.hypotheses:
        return [heading, Text("The study file names none, or is not at hand: everything here is exploratory.")]
    lines = []
    for row in report.hypotheses:
        found = NOBODY if row.value is None else with_interval(row.value, row.low, row.high, digits=2)
        said = "not tested" if row.p is None else "difference shown" if row.is_shown else "no difference shown"
        lines.append((row.name, found, _p(row.p), _p(row.p_holm), str(row.n), said, row.method))
    heads = ("hypothesis", "difference", "p", "p (Holm)", "trials", "at 5 %", "how")
    return [heading, Table(heads, tuple(lines))]


def _memory(report: StudyReport) -> list[Block]:
    if not report.memory:
        return []
    text = (
        "Differences within people and within episodes, so neither who had which condition nor which episodes it fell "
        "on matters. Success and SPL in points. The intervals are on the wide side (conservative)."
    )
    return [
        Heading("Conditions within people (exploratory unless primary)"),
        Text(text),
        _effects(report, report.memory),
    ]


def _order(report: StudyReport, shown: Sequence[str]) -> list[Block]:
    heading = Heading("Order of trials and earlier visits (exploratory)")
    if not report.order:
        return [heading, Text("Not known: give the export folder of the study, which holds the order.")]
    return [
        heading,
        Text("Slopes within people and within episodes; per minute: of time spent in the home before the trial."),
        _effects(report, report.order),
        _blocks(report, report.blocks),
        *_pictures(shown, [name for name in shown if name.endswith("-order.svg")]),
    ]


def _effects(report: StudyReport, rows: Sequence[EffectRow]) -> Table:
    lines = []
    for row in rows:
        effect = row.effect
        found = (
            "cannot be told" if effect.value is None else with_interval(effect.value, effect.low, effect.high, digits=2)
        )
        where = "all" if row.condition == "all" else row_label("human", row.condition)
        names = (TITLES[row.task], row.what, where, row.split, MEASURES[row.measure].head)
        lines.append((*names, found, _p(effect.p), str(effect.n), effect.method))
    heads = ("task", "effect", "condition", "split", "measure", "by", "p", "trials", "how")
    return Table(heads, tuple(lines), _notes(report))


def _blocks(report: StudyReport, rows: Sequence[BlockRow]) -> Table:
    lines = []
    for row in rows:
        count = f"n {row.n}" if row.k is None else f"{row.k}/{row.n}"
        value = with_interval(row.value, row.low, row.high, digits=MEASURES[row.measure].digits)
        by = "place in the order" if row.by == "order" else "home"
        label = row_label("human", row.condition)
        lines.append((TITLES[row.task], label, f"{by}: {row.block}", MEASURES[row.measure].head, value, count))
    return Table(("task", "condition", "trials", "measure", "value", "count"), tuple(lines), _notes(report))


def _agent_pairs(report: StudyReport) -> list[Block]:
    if not report.agent_pairs:
        return []
    lines = []
    for row in report.agent_pairs:
        several = row.p is None
        counts = ("-", "-") if several else (str(row.num_only_first), str(row.num_only_second))
        p = "several runs: see the intervals" if several else _p(row.p)
        lines.append((TITLES[row.task], row.first, row.second, str(row.n), *counts, p))
    heads = ("task", "first", "second", "episodes", "only the first", "only the second", "p (McNemar, exact)")
    return [Heading("Agents against each other (exploratory)"), Table(heads, tuple(lines))]


def _sensitivity(report: StudyReport) -> list[Block]:
    lines = []
    for row in report.sensitivity:
        found = NOBODY if row.value is None else with_interval(row.value, row.low, row.high)
        count = f"n {row.n}" if row.k is None else f"{row.k}/{row.n}"
        lines.append((TITLES[row.task], row_label(row.who, row.condition), row.way, found, count, row.method))
    heads = ("task", "who", "counted", "total SR (%) or points", "count", "how")
    text = "The total success rate, and differences of it, when trials are counted otherwise."
    return [Heading("Sensitivity"), Text(text), Table(heads, tuple(lines), _notes(report))]


def _agreement(report: StudyReport) -> list[Block]:
    success = tuple(
        (
            *(TITLES[row.task], row_label("human", row.condition), str(row.num_episodes)),
            *(_figure(row.krippendorff_alpha), _figure(row.gwet_ac1)),
        )
        for row in report.agreement
    )
    places = []
    for row in report.places:
        apart = (
            "-"
            if row.spread_median is None
            else f"{row.spread_median:.2f} ({row.spread_lower:.2f} to {row.spread_upper:.2f})"
        )
        agreements = (row.place_alpha, row.place_ac1, row.object_alpha, row.object_ac1)
        names = (TITLES[row.task], row_label("human", row.condition), str(row.num_episodes))
        places.append((*names, apart, *(_figure(value) for value in agreements)))
    heads = ("task", "condition", "episodes with two or more people", "Krippendorff's alpha", "Gwet's AC1")
    place_heads = (
        *("task", "condition", "episodes with two or more people", "apart (m): median (middle half)"),
        *("place alpha", "place AC1", "object alpha", "object AC1"),
    )
    text = (
        "Where people pointed (POG) or stopped (PAN) at the same episode: mean distance from their middle, and whether "
        "it is the same place (within 1 m of each other) or the same object (nearest within 1 m; needs --dataset)."
    )
    return [
        Heading("Agreement between people on success"),
        Table(heads, success, _notes(report)),
        Heading("Agreement between people on the place"),
        Text(text),
        Table(place_heads, tuple(places), _notes(report)),
        *_suspects(report),
    ]


def _suspects(report: StudyReport) -> list[Block]:
    if not report.suspects:
        return []
    lines = tuple(
        (
            *(TITLES[row.task], row.episode, row_label("human", row.condition)),
            *(f"{row.num_agreeing} of {row.num_people}", f"({row.xz[0]:.2f}, {row.xz[1]:.2f})", row.object or "-"),
        )
        for row in report.suspects
    )
    heads = ("task", "episode", "condition", "people", "x, z (m)", "object")
    text = f"At least {SUSPECT_SHARE:.0%} chose the same wrong place: the label may be wrong. They stay in all numbers."
    return [Heading("Episodes where people agree on a wrong place"), Text(text), Table(heads, lines)]


def _verification(report: StudyReport) -> list[Block]:
    heading = Heading("Verification")
    if not report.verification:
        return [heading, Text("Not known: give the study or its export after personal-viz study verify.")]
    lines = tuple(
        (
            *(TITLES[row.task], row.scene_kind, row_label("human", row.condition), str(row.n), str(row.num_verified)),
            *(str(n) for n in (row.num_drift, row.num_failed, row.num_unsupported, row.num_not_yet)),
        )
        for row in report.verification
    )
    heads = ("task", "scenes", "condition", "trials", "verified", "drift", "failed", "unsupported", "not yet")
    return [heading, Text("Each logged trial done again, step by step."), Table(heads, lines)]


def _left_out(report: StudyReport) -> list[Block]:
    blocks: list[Block] = [Heading("Attention and exclusions")]
    for count in report.attention:
        blocks.append(
            Text(
                f"Attention trials, {TITLES[count.task]}: {count.num_passed} of {count.num_trials} passed; "
                f"{count.num_failing} of {count.num_people} people failed more than one."
            )
        )
    if report.hidden is not None:
        found = report.hidden
        blocks.append(
            Text(
                f"Page in the background for more than {found.limit_s:g} s: {found.num_flagged} of {found.num_trials} "
                f"counted trials, of {found.num_people} people. They are flagged in the trial table, and they count."
            )
        )
    if report.exclusions:
        planned = {True: "yes", False: "no", None: "not known"}
        lines = tuple(
            (row.rule_id, planned[row.is_planned], row.reason, str(row.num_participants), str(row.num_trials))
            for row in report.exclusions
        )
        heads = ("rule", "written before data", "reason", "people", "trials")
        blocks += [Text("They count in the tables, and not in the rows per protocol."), Table(heads, lines)]
    else:
        blocks.append(Text("No rule excludes anything." if report.flow else "Not known: only runs are at hand."))
    lines = tuple((row.who, TITLES[row.task], row.reason, str(row.n)) for row in report.left_out)
    if lines:
        blocks += [Heading("Left out of all numbers", 3), Table(("who", "task", "reason", "trials"), lines)]
    return blocks


def _checklist(report: StudyReport) -> list[Block]:
    if not report.checklist:
        return []
    lines = tuple((item.question, item.answer, f"{item.source}: {item.part}") for item in report.checklist)
    text = "Questions of two checklists in our words, answered from the study file where the answer is in it."
    return [Heading("Checklist"), Text(text), Table(("question", "answer", "list"), lines)]


def _origin(report: StudyReport) -> list[Block]:
    version = f"Study version {report.study_version}. " if report.study_version else ""
    text = (
        f"{version}Episode files {report.dataset_digest}. Made with {', '.join(report.versions) or 'unknown versions'}."
    )
    return [Heading("Versions and runs"), Text(text), Table(("run",), tuple((run,) for run in report.runs))]


def _pictures(shown: Sequence[str], names: Sequence[str]) -> list[Block]:
    return [Picture(name, _caption(name)) for name in names if name in shown]


def _caption(name: str) -> str:
    task, _, what = name.removesuffix(".svg").partition("-")
    captions = {
        "people": "Success rate of each person (dots) and of agents (dashed)",
        "episodes": "Who succeeded at which episode",
        "effort": f"{'Time' if task == 'pog' else 'Steps and time'} to decision, trial by trial",
        "order": "Success by place in the order, and by earlier visits",
    }
    if name == "flow.svg":
        return "From arrival to the end"
    return what if task == "overlay" else f"{TITLES.get(task, task)}: {captions.get(what, what)}"  # type: ignore[call-overload]


def _notes(report: StudyReport) -> str:
    return " ".join(f"{TITLES[task]}: {verification_note(report, task, kind)}" for task, kind in table_kinds(report))


def _p(value: float | None) -> str:
    return "-" if value is None else "< 0.001" if value < 0.001 else f"{value:.3f}"


def _figure(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"
