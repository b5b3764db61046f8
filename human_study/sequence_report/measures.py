"""The report of a study of home sequences: people beside agents on the same sequences, by kind of search.

The measures are those of agents (`sim.sequences.figures`); `intervals` has those of people.
"""

from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence

from sim.episodes.sequences import SubtaskKind
from sim.homes.kind import scene_labels
from sim.sequences.figures import SequenceFigures
from sim.sequences.rows import RunOfSequences, SequenceRow, rows_of_runs
from sim.sequences.runs import SequenceRun
from sim.types import SuccessRule, TaskKind, WhoKind

from ..export.runs import run_condition
from ..export.search_table import SearchRow
from ..export.trial_table import NOT_A_RESULT
from ..report.counts import (
    AttentionCount,
    ExclusionCount,
    FlowCount,
    HiddenCount,
    VerificationCount,
    attention_counts,
    exclusion_counts,
    flow_counts,
    hidden_count,
    verification_counts,
)
from ..report.trials import LeftOutRun, ReportValue
from ..trial.terms import HIDDEN
from .intervals import agent_difference, people_difference, people_figures
from .source import SequenceSource

NOT_SHOWN = (
    "Sequences have no part about primary hypotheses, spread, order, earlier visits, sensitivity, agreement, chosen "
    "objects, shortest ways, the reporting checklist, overlays, or R's lme4: the report of episodes has them."
)
KINDS: tuple[SubtaskKind, ...] = ("fresh", "revisit", "changed", "stale")
HUMAN = "human"


class SequenceReportRow(ReportValue):
    """The figures of people in one condition, or of an agent in one, on the people's sequences."""

    row: SequenceRow
    who_kind: WhoKind
    num_people: int
    """0 for agents."""
    num_sequences: int
    """Different ones."""
    num_homes: int


class DifferenceRow(ReportValue):
    """A difference of success rates over searches of one kind, on sequences that both did; shares."""

    task: TaskKind
    scene_kind: str
    first: str
    second: str
    """The row that is taken away from the first."""
    kind: str
    """A kind of search, or `all`."""
    value: float
    low: float | None
    high: float | None
    num_first: int
    num_second: int
    """Searches of each."""


class ExposureRow(ReportValue):
    """The messages that people could read during searches of one kind, and their success."""

    task: TaskKind
    scene_kind: str
    condition: str
    kind: str
    """A kind of search, or `all`."""
    n: int
    num_told: int
    """Searches during which the message that decides the answer could be read."""
    right_told: int
    """Right ones among these."""
    right_untold: int
    """Right ones among the others; like all here, of searches whose success is defined."""
    mean_notes: float
    """Mean number of messages that could be read."""


class EndCount(ReportValue):
    """Searches of people that ended in one way."""

    task: TaskKind
    scene_kind: str
    condition: str
    reason: str
    n: int


class SequenceStudyReport(ReportValue):
    """The output of `study report --json` for a study of home sequences."""

    study: str
    study_version: str
    is_pilot: bool
    num_open: int
    """Assigned counted trials that nobody has ended."""
    information: tuple[str, ...]
    rule: SuccessRule
    scene_kinds: tuple[str, ...]
    scene_labels: tuple[str, ...]
    """Labels that results in these homes must carry."""
    rows: tuple[SequenceReportRow, ...]
    differences: tuple[DifferenceRow, ...]
    """History visible less hidden, and people less each agent."""
    exposure: tuple[ExposureRow, ...]
    ends: tuple[EndCount, ...]
    flow: tuple[FlowCount, ...]
    verification: tuple[VerificationCount, ...]
    attention: tuple[AttentionCount, ...]
    hidden: HiddenCount | None
    """Trials with the page in the background; None = the study file has no limit."""
    exclusions: tuple[ExclusionCount, ...]
    num_unscored: dict[str, int]
    """Counted trials without a result, by their end."""
    left_out_runs: tuple[LeftOutRun, ...]
    not_shown: str = NOT_SHOWN
    dataset_digest: str
    sequences_digest: str
    edition: str
    runs: tuple[str, ...]
    """Ids of the runs, in order."""


def sequence_report(source: SequenceSource, *, rule: SuccessRule | None = None) -> SequenceStudyReport:
    """The report; without a rule, PAN counts by that of the study file."""
    records, config = source.records, source.records.config
    assert config is not None, "a study has its file"
    assert config.sequences is not None, "a study of sequences"
    rule = rule or config.success
    infos = [info for info, _ in source.people]
    open_trials = [row for row in records.rows if row.phase == "main" and row.end_reason is None]
    ends = Counter(row.end_reason for row in records.rows if row.phase == "main" and row.end_reason in NOT_A_RESULT)
    searches = tuple(_counted(source, rule))
    return SequenceStudyReport(
        study=config.study,
        study_version=config.study_version,
        is_pilot=records.is_pilot,
        num_open=sum(not row.is_released for row in open_trials),
        information=config.information,
        rule=rule,
        scene_kinds=tuple(sorted({info.scene_kind for info in infos})),
        scene_labels=scene_labels(info.scene_kind for info in infos),
        rows=tuple(_rows(source, rule)),
        differences=tuple(_differences(source, rule)),
        exposure=tuple(_exposure(searches)),
        ends=tuple(_ends(searches)),
        flow=tuple(flow_counts(records.people, records.rows, num_deleted=records.num_deleted)),
        verification=tuple(verification_counts(records.rows)),
        attention=tuple(attention_counts(records.rows)),
        hidden=hidden_count(records.rows, config.hidden_max_s),
        exclusions=tuple(exclusion_counts(records.rows, records.exclusions)),
        num_unscored={str(reason): number for reason, number in sorted(ends.items())},
        left_out_runs=source.left_out,
        dataset_digest=config.dataset.sha256,
        sequences_digest=config.sequences.sha256,
        edition=infos[0].edition,
        runs=tuple(dict.fromkeys(info.run_id for info, _ in (*source.people, *source.agents))),
    )


def share_of(figures: SequenceFigures, kind: str) -> float | None:
    """The success rate over searches of a kind, or `all`."""
    return getattr(figures, "sr" if kind == "all" else f"sr_{kind}")


def _by_task(runs: Sequence[RunOfSequences]) -> dict[TaskKind, list[RunOfSequences]]:
    """The runs by task; one of both tasks is in both, cut."""
    found: dict[TaskKind, list[RunOfSequences]] = defaultdict(list)
    for info, walks in runs:
        for task in ("pan", "pog"):
            if own := tuple(run for run in walks if run.start.task == task):
                found[task].append((info, own))
    return dict(sorted(found.items()))


def _rows(source: SequenceSource, rule: SuccessRule) -> Iterator[SequenceReportRow]:
    """People before agents, and history visible before hidden."""
    for runs in _by_task((*source.people, *source.agents)).values():
        behind: dict[tuple[str, str, str], list[SequenceRun]] = defaultdict(list)
        for info, walks in runs:
            behind[info.who, info.condition, info.scene_kind] += walks
        found = rows_of_runs(runs, rule=rule)
        for row in sorted(found, key=lambda one: (one.scene_kind, one.who != HUMAN, one.who, _is_later(one.condition))):
            own, is_human = behind[row.who, row.condition, row.scene_kind], row.who == HUMAN
            figures: dict[str, object] = {"beside_first": None}  # its interval is over homes alone
            if is_human:
                figures["sequence_measures"] = people_figures(own, rule)
                figures["goat_measures"] = row.goat_measures and people_figures(own, "goat")
            yield SequenceReportRow(
                row=row.model_copy(update=figures),
                who_kind="human" if is_human else "agent",
                num_people=len({run.start.participant for run in own}) if is_human else 0,
                num_sequences=len({run.key for run in own}),
                num_homes=len({run.key.scene for run in own}),
            )


def _is_later(condition: str) -> tuple[bool, str]:
    return condition == HIDDEN, condition


_Group = tuple[str, str]
"""(who, condition)."""


def _differences(source: SequenceSource, rule: SuccessRule) -> Iterator[DifferenceRow]:
    """History visible less hidden, then people in each condition less each agent on the same sequences."""
    for task, runs in _by_task((*source.people, *source.agents)).items():
        groups: dict[str, dict[_Group, list[SequenceRun]]] = defaultdict(lambda: defaultdict(list))
        for info, walks in runs:
            groups[info.scene_kind][info.who, info.condition] += walks
        people = {(info.who, info.condition) for info, _ in source.people}
        for scene_kind, found in sorted(groups.items()):
            human = sorted((name for name in found if name in people), key=lambda name: _is_later(name[1]))
            pairs = [(human[0], human[1], people_difference)] if len(human) == 2 else []
            agents = sorted(set(found) - people)
            pairs += [(person, agent, agent_difference) for person in human for agent in agents]
            for first, second, difference in pairs:
                for kind in (None, *KINDS):
                    less = difference(found[first], found[second], rule=rule, kind=kind)
                    if less is None:
                        continue
                    low, high = less.interval or (None, None)
                    yield DifferenceRow(
                        task=task,
                        scene_kind=scene_kind,
                        first=_name(first),
                        second=_name(second),
                        kind=kind or "all",
                        value=less.value,
                        low=low,
                        high=high,
                        num_first=less.num_first,
                        num_second=less.num_second,
                    )


def _name(group: _Group) -> str:
    who, condition = group
    return who if condition == "none" else f"{who} ({condition.replace('_', ' ')})"


_CountedSearch = tuple[tuple[TaskKind, str, str], SearchRow]
"""A search of a counted result, with its task, kind of homes and condition."""


def _counted(source: SequenceSource, rule: SuccessRule) -> Iterator[_CountedSearch]:
    """All of them; their rows have the success of the study file's rule, and get that of the report's."""
    trials = {row.attempt_name: row for row in source.records.rows if row.is_result}
    ends = {
        (run.start.participant, run.start.task, info.condition, run.key): run.end.searches
        for info, runs in source.people
        for run in runs
    }
    for search in source.records.searches:
        trial = trials.get(search.attempt_name)
        at = trial and (trial.participant, trial.task, run_condition(trial.condition), trial.key)
        if trial is not None and at in ends:  # exports of earlier versions hold no runs of excluded trials
            found = ends[at][search.search]
            names = trial.task, trial.scene_kind, trial.condition
            yield names, search.model_copy(update={"success": found.succeeds(rule)})


def _exposure(counted: Sequence[_CountedSearch]) -> Iterator[ExposureRow]:
    groups: dict[tuple[TaskKind, str, str], list[SearchRow]] = defaultdict(list)
    for names, search in counted:
        groups[names].append(search)
    for (task, scene_kind, condition), searches in sorted(groups.items(), key=_order_of):
        for kind in ("all", *KINDS):
            of_kind = [one for one in searches if kind in ("all", one.kind) and one.success is not None]
            told = [search for search in of_kind if search.is_told]
            if of_kind:
                right = sum(bool(search.success) for search in of_kind)
                right_told = sum(bool(search.success) for search in told)
                yield ExposureRow(
                    task=task,
                    scene_kind=scene_kind,
                    condition=condition,
                    kind=kind,
                    n=len(of_kind),
                    num_told=len(told),
                    right_told=right_told,
                    right_untold=right - right_told,
                    mean_notes=sum(len(search.notes) for search in of_kind) / len(of_kind),
                )


def _order_of(group: tuple[tuple[TaskKind, str, str], object]) -> tuple:
    task, scene_kind, condition = group[0]
    return task, scene_kind, _is_later(condition)


def _ends(counted: Sequence[_CountedSearch]) -> Iterator[EndCount]:
    counts = Counter((*names, search.reason) for names, search in counted)
    for (task, scene_kind, condition, reason), number in sorted(counts.items()):
        yield EndCount(task=task, scene_kind=scene_kind, condition=condition, reason=reason, n=number)
