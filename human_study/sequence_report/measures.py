"""The report of a study of home sequences: people beside agents on the same sequences, by kind of search.

The measures are those of agents (`sim.sequences.figures`); intervals take homes for random, with all else inside them.
"""

from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from sim.episodes.sequences import SubtaskKind
from sim.errors import RunFileError
from sim.homes.kind import scene_labels
from sim.sequences.figures import SequenceFigures, sr_difference
from sim.sequences.rows import RunOfSequences, SequenceRow, rows_of_runs
from sim.sequences.runs import SequenceRun, read_sequence_runs
from sim.tasks.run_files import RunInfo, read_run_info
from sim.tasks.run_folders import run_folders
from sim.types import EpisodeKey, SuccessRule, TaskKind, WhoKind

from ..design.study import STUDY_FILE, load_study
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
from ..report.source import StudyRecords, no_trial, records_folder, runs_and_records
from ..report.trials import LeftOutRun, ReportValue
from ..store.records import DATABASE_FILE, read_study
from ..trial.terms import HIDDEN

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
    """Right ones among the others."""
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


@dataclass(frozen=True, slots=True)
class SequenceSource:
    """People's records and runs, and the runs of agents that can stand beside them, cut to the people's sequences."""

    records: StudyRecords
    people: tuple[RunOfSequences, ...]
    agents: tuple[RunOfSequences, ...]
    left_out: tuple[LeftOutRun, ...]


def read_sequences(folders: Sequence[Path]) -> SequenceSource | None:
    """The study of home sequences among these folders, with runs of agents; None where there is none.

    Raises:
        StudyError: There are records of more than one study, they are damaged, or hold no counted trial with a result.
        RunFileError: A named folder holds no run.
    """
    folder, others = records_folder(folders)
    if folder is None or not _is_of_sequences(folder):
        return None
    _, records = runs_and_records(folder)
    people = records.sequences
    if not people:
        raise no_trial(folder)
    agents, left_out = [], []
    for one in run_folders(others) if others else []:
        try:
            info, runs = read_run_info(one), read_sequence_runs(one)
        except RunFileError as error:
            left_out.append(LeftOutRun(run=one.name, reason=str(error).removeprefix(f"{one}: ").partition("; ")[0]))
            continue
        same, why = _beside(info, runs, people)
        agents += [(info, same)] if same else []
        left_out += [] if same else [LeftOutRun(run=info.run_id, reason=why)]
    agents.sort(key=lambda run: run[0].run_id)
    return SequenceSource(records, people, tuple(agents), tuple(sorted(left_out, key=lambda left: left.run)))


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
        runs=tuple(info.run_id for info, _ in (*source.people, *source.agents)),
    )


def share_of(figures: SequenceFigures, kind: str) -> float | None:
    """The success rate over searches of a kind, or `all`."""
    return getattr(figures, "sr" if kind == "all" else f"sr_{kind}")


def _is_of_sequences(folder: Path) -> bool:
    if (folder / DATABASE_FILE).is_file():
        with read_study(folder) as reader:
            return reader.config.sequences is not None
    return (folder / STUDY_FILE).is_file() and load_study(folder).sequences is not None


def _beside(
    info: RunInfo, runs: Sequence[SequenceRun], people: Sequence[RunOfSequences]
) -> tuple[tuple[SequenceRun, ...], str]:
    """The sequences of a run that people did too; without one, the reason."""
    theirs = people[0][0]
    if info.who_kind == "human":
        return (), "is of people; those of the study come from its records"
    if not runs:
        return (), "holds no home sequence"
    for name, own, wanted in (
        ("sequences", str(info.config.get("sequences")), str(theirs.config["sequences"])),
        ("episode files", info.dataset_digest, theirs.dataset_digest),
    ):
        if own != wanted:
            return (), f"is on other {name} ({own[:12]}) than people ({wanted[:12]})"
    done = _keys_done(people)
    same = tuple(run for run in runs if (run.start.task, info.scene_kind, run.key) in done)
    had_labels = {one.labels for one, found in people for run in found if run.start.task == "pan"}
    if any(run.start.task == "pan" for run in same) and info.labels not in had_labels:
        return (), f"its pictures {'had' if info.labels else 'lacked'} the categories on objects, unlike people's"
    return same, f"did none of the {len(done)} sequences that people did in homes of kind {info.scene_kind}"


def _keys_done(people: Sequence[RunOfSequences]) -> set[tuple[TaskKind, str, EpisodeKey]]:
    return {(run.start.task, info.scene_kind, run.key) for info, runs in people for run in runs}


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
        found = rows_of_runs(runs, rule=rule)
        for row in sorted(found, key=lambda one: (one.scene_kind, one.who != HUMAN, one.who, _is_later(one.condition))):
            names = row.who, row.condition, row.scene_kind
            behind = [
                run for info, walks in runs for run in walks if (info.who, info.condition, info.scene_kind) == names
            ]
            yield SequenceReportRow(
                row=row,
                who_kind="human" if row.who == HUMAN else "agent",
                num_people=len({run.start.participant for run in behind}) if row.who == HUMAN else 0,
                num_sequences=len({run.key for run in behind}),
                num_homes=len({run.key.scene for run in behind}),
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
            pairs = [(human[0], human[1])] if len(human) == 2 else []
            pairs += [(person, agent) for person in human for agent in sorted(set(found) - people)]
            for first, second in pairs:
                for kind in (None, *KINDS):
                    less = sr_difference(found[first], found[second], rule=rule, kind=kind)
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
    trials = {row.attempt_name: row for row in source.records.rows if row.left_out is None}
    ends = {
        (run.start.participant, run.start.task, info.condition, run.key): run.end.searches
        for info, runs in source.people
        for run in runs
    }
    for search in source.records.searches:
        trial = trials.get(search.attempt_name)
        if trial is not None:
            found = ends[trial.participant, trial.task, run_condition(trial.condition), trial.key][search.search]
            names = trial.task, trial.scene_kind, trial.condition
            yield names, search.model_copy(update={"success": found.succeeds(rule)})


def _exposure(counted: Sequence[_CountedSearch]) -> Iterator[ExposureRow]:
    groups: dict[tuple[TaskKind, str, str], list[SearchRow]] = defaultdict(list)
    for names, search in counted:
        groups[names].append(search)
    for (task, scene_kind, condition), searches in sorted(groups.items(), key=_order_of):
        for kind in ("all", *KINDS):
            of_kind = [search for search in searches if kind in ("all", search.kind)]
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
