"""The figures of a study: people and agents on the same episodes, each number with its interval (`study report`)."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from sim.homes.kind import scene_labels
from sim.tasks.metrics import made_for_warning, metric_rows
from sim.tasks.run_files import Run
from sim.types import SuccessRule
from sim.words.english import how_many

from ..design.study import StudyConfig
from .agreement import (
    AgreementRow,
    HomeObjects,
    PlaceRow,
    SuspectEpisode,
    agreement_row,
    place_row,
    suspect_episodes,
)
from .checklist import ChecklistItem, checklist
from .counts import (
    AttentionCount,
    EndRow,
    ExclusionCount,
    FlowCount,
    HiddenCount,
    SpreadRow,
    VerificationCount,
    attention_counts,
    end_rows,
    exclusion_counts,
    flow_counts,
    hidden_count,
    spread_rows,
    verification_counts,
)
from .effects import BlockRow, EffectRow, memory_effects, order_blocks, order_effects
from .hypotheses import AgentPairRow, HypothesisRow, agent_pairs, hypothesis_rows
from .rows import Aggregate, RandomKind, ReportRow, TotalKind, require_totals, rows_of
from .sensitivity import SensitivityRow, sensitivity_rows
from .source import ReportSource, StudyRecords, source_of
from .statistics import Weight
from .trials import GroupRow, LeftOut, LeftOutRun, ReportValue, TrialGroup, averaged_agent, difference, trial_groups
from .ways import ShortestPaths, WayPair, WayRow, way_pairs, way_rows, with_ways

NOBODY_YET = "no person has done the episode in this condition yet"
"""Trials of agents that ran on the study."""
NOT_SHARED = "no person has a counted trial at these episodes"
"""Trials of other agents."""


class PersonOutcome(GroupRow):
    """The success of one person at one episode, or of an agent, averaged over its runs."""

    participant: str
    episode: str
    success: float
    """0 or 1; a value between them for an agent with several runs."""


class StudyReport(ReportValue):
    """The output of `study report --json`."""

    study: str | None
    """Name in the study file; None = the runs came without one."""
    study_version: str | None
    is_pilot: bool
    """Whether the study was served without an ethics id."""
    num_open: int
    """Assigned counted trials that nobody has ended; while there are any, the study is still running."""
    information: tuple[str, ...] | None
    """The information that people were shown besides the task; None = not known."""
    rule: SuccessRule
    """Success rule of the PAN rows."""
    total: TotalKind
    weight: Weight
    intervals: RandomKind
    """What the intervals take for random: `homes` beside people and episodes, or people and `episodes` alone."""
    scene_kinds: tuple[str, ...]
    """Kinds of the homes. A human baseline for PersONAL is claimed on scans only."""
    scene_labels: tuple[str, ...]
    """Labels that results in these homes must carry; () for scans."""
    warnings: tuple[str, ...]
    """One line per row name whose runs were made for another success rule than the report's."""
    rows: tuple[ReportRow, ...]
    spreads: tuple[SpreadRow, ...]
    ends: tuple[EndRow, ...]
    """Ends of trials; for agents, of all runs on the people's episodes."""
    hypotheses: tuple[HypothesisRow, ...]
    """The primary hypotheses; everything else in the report is exploratory."""
    memory: tuple[EffectRow, ...]
    order: tuple[EffectRow, ...]
    blocks: tuple[BlockRow, ...]
    agent_pairs: tuple[AgentPairRow, ...]
    sensitivity: tuple[SensitivityRow, ...]
    agreement: tuple[AgreementRow, ...]
    places: tuple[PlaceRow, ...]
    ways: tuple[WayRow, ...]
    """Ways of two people at one episode, and of a person and an agent; PAN only."""
    suspects: tuple[SuspectEpisode, ...]
    flow: tuple[FlowCount, ...]
    """Counts of people at each point of the study; () = the study's records are missing."""
    verification: tuple[VerificationCount, ...]
    attention: tuple[AttentionCount, ...]
    hidden: HiddenCount | None
    """Counted trials with the page in the background; None = the study file has no limit, or is missing."""
    exclusions: tuple[ExclusionCount, ...]
    left_out: tuple[LeftOut, ...]
    left_out_runs: tuple[LeftOutRun, ...]
    checklist: tuple[ChecklistItem, ...]
    outcomes: tuple[PersonOutcome, ...]
    """Every counted trial; agents on the people's episodes."""
    dataset_digest: str
    edition: str
    versions: tuple[str, ...]
    """Programs that made the runs, with their versions."""
    runs: tuple[str, ...]
    """Ids of the runs, in order."""


@dataclass(frozen=True, slots=True)
class ReportGroups:
    """The trials behind a report, for its numbers and its pictures."""

    rule: SuccessRule
    """Success rule of the PAN trials."""
    people: tuple[TrialGroup, ...]
    agents: tuple[TrialGroup, ...]
    """All runs of agents, on the people's episodes."""
    averaged: tuple[TrialGroup, ...]
    """The agents with one trial per episode, the mean of their runs."""
    differences: tuple[TrialGroup, ...]
    pairs: tuple[WayPair, ...]
    """Two people, or a person and an agent, at the same episode of PAN."""
    left_out: tuple[LeftOut, ...]


def study_report(
    runs: Sequence[Run],
    *,
    rule: SuccessRule | None = None,
    records: StudyRecords | None = None,
    split_sizes: Mapping[str, int] | None = None,
    objects: HomeObjects | None = None,
) -> StudyReport:
    """The report: rows for people, for agents on the episodes that people did, and for people minus agents.

    Args:
        runs: Exported runs of people and, if wanted, runs of agents; those that cannot stand beside the people are
            left out, with their reasons in `left_out_runs`.
        rule: Success rule of the PAN rows; None = the study file's, or `paper`.
        records: Records of the people's study; None = there are only runs, and tables that need more are left out.
        split_sizes: Episodes of each split in the dataset, for `aggregate.total: dataset_weighted`.
        objects: Objects of the homes, for the agreement on the chosen object.

    Raises:
        StudyError: There is no run of people, their runs are of two studies, or totals need the splits' sizes.
        RunFileError: People's runs are on different episode files, in scans and other homes, or a trial occurs twice.
    """
    source = source_of(runs, records)
    return report_of(source, report_groups(source, rule=rule), split_sizes=split_sizes, objects=objects)


def report_of(
    source: ReportSource,
    groups: ReportGroups,
    *,
    split_sizes: Mapping[str, int] | None = None,
    objects: HomeObjects | None = None,
) -> StudyReport:
    """The report on these groups of the source; the other arguments are those of `study_report`."""
    runs, records = source.runs, source.records
    config, people, rule = records.config, groups.people, groups.rule
    # without records, the runs say which study they are of
    told = {name: str(value) for run in runs if run.info.who_kind == "human" for name, value in run.info.config.items()}
    aggregate = _aggregate_of(config, split_sizes)
    rows = _rows(groups, aggregate)
    memory = memory_effects(people, aggregate)
    flow = flow_counts(records.people, records.rows, num_deleted=records.num_deleted) if records.people else []
    exclusions = exclusion_counts(records.rows, records.exclusions)
    is_pilot = records.is_pilot or (config is None and told.get("pilot") == "True")
    versions = {f"{name} {version}" for run in runs for name, version in run.info.versions.items()}
    information = tuple(told["information"].split(",")) if told.get("information") else None
    return StudyReport(
        study=config.study if config else told.get("study"),
        study_version=config.study_version if config else told.get("study_version"),
        is_pilot=is_pilot,
        num_open=sum(row.phase == "main" and row.end_reason is None and not row.is_released for row in records.rows),
        information=_with_labels(config.information if config else information, runs),
        rule=rule,
        total=aggregate.total,
        weight=aggregate.weight,
        intervals=aggregate.intervals,
        scene_kinds=tuple(sorted({run.info.scene_kind for run in runs})),
        scene_labels=scene_labels(run.info.scene_kind for run in runs),
        warnings=_warnings(runs, rule),
        rows=tuple(rows),
        spreads=tuple(row for group in (*people, *groups.averaged) for row in spread_rows(group)),
        ends=tuple(row for group in (*people, *groups.agents) for row in end_rows(group)),
        hypotheses=tuple(hypothesis_rows(config.primary if config else (), groups.differences, memory, aggregate)),
        memory=tuple(memory),
        order=tuple(order_effects(people, aggregate)),
        blocks=tuple(order_blocks(people, aggregate)),
        agent_pairs=tuple(agent_pairs(groups.agents, _episodes_of(people))),
        sensitivity=tuple(_sensitivity(groups, records, aggregate)),
        agreement=tuple(agreement_row(group) for group in people),
        places=tuple(place_row(group, objects) for group in people),
        ways=tuple(way_rows(groups.pairs)),
        suspects=tuple(suspect for group in people for suspect in suspect_episodes(group, objects)),
        flow=tuple(flow),
        verification=tuple(verification_counts(records.rows)),
        attention=tuple(attention_counts(records.rows)),
        hidden=hidden_count(records.rows, config.hidden_max_s) if config else None,
        exclusions=tuple(exclusions),
        left_out=groups.left_out,
        left_out_runs=source.left_out,
        checklist=tuple(checklist(records, rows=rows, flow=flow, exclusions=exclusions, is_pilot=is_pilot, runs=runs)),
        outcomes=tuple(outcome for group in (*people, *groups.averaged) for outcome in _outcomes(group)),
        dataset_digest=runs[0].info.dataset_digest,
        edition=runs[0].info.edition,
        versions=tuple(sorted(versions)),
        runs=tuple(run.info.run_id for run in runs),
    )


def _sensitivity(groups: ReportGroups, records: StudyRecords, aggregate: Aggregate) -> Iterator[SensitivityRow]:
    for group in (*groups.people, *groups.differences):
        yield from sensitivity_rows(group, records.rows, aggregate, splits=_splits_beside(group, groups.people))


def _aggregate_of(config: StudyConfig | None, split_sizes: Mapping[str, int] | None) -> Aggregate:
    """How the study file wants numbers averaged; as the paper does without one."""
    found = Aggregate(split_sizes=split_sizes)
    if config is not None:
        chosen = config.aggregate
        found = Aggregate(chosen.total, chosen.weight, split_sizes, chosen.intervals)
    found.require_sizes()
    return found


def _with_labels(information: Sequence[str] | None, runs: Sequence[Run]) -> tuple[str, ...] | None:
    """The information that people had, with the words on objects if their pictures had them."""
    has_labels = any(run.info.labels for run in runs if run.info.who_kind == "human")
    words = ("categories written on objects",) if has_labels else ()
    return None if information is None else (*information, *words)


def _warnings(runs: Sequence[Run], rule: SuccessRule) -> tuple[str, ...]:
    """One line per row name whose PAN runs were made for another rule, and one about homes of several versions."""
    others: dict[str, set[SuccessRule]] = {}
    for run in runs:
        if run.episodes and run.info.made_for not in (None, rule):
            others.setdefault(run.info.who, set()).add(run.info.made_for)
    lines = [made_for_warning(who, sorted(rules), rule=rule) for who, rules in sorted(others.items())]
    versions: dict[str, dict[str, str]] = {}
    for run in runs:
        for item in run.episodes:
            if item.end.measures is not None:
                versions.setdefault(item.key.scene, {}).setdefault(item.end.measures.scene_digest, run.info.run_id)
    several = sorted(scene for scene, found in versions.items() if len(found) > 1)
    if several:
        names = ", ".join(f"{digest[:12]} ({run_id})" for digest, run_id in sorted(versions[several[0]].items()))
        lines.append(
            f"Warning: runs in {how_many(len(several), 'home')} are on several versions of the home, whose distances "
            f"may differ; in {several[0]}: {names}."
        )
    return tuple(lines)


def _rows(groups: ReportGroups, aggregate: Aggregate) -> list[ReportRow]:
    """Rows for people, for agents on the people's episodes, and for people minus agents, with checked totals."""
    rows = [row for group in groups.people for row in rows_of(group, aggregate)]
    for full, same in zip(groups.agents, groups.averaged, strict=True):
        rows += rows_of(same, aggregate, behind=full)
    rows += [row for group in groups.differences for row in rows_of(group, aggregate)]
    require_totals(rows)
    return rows


def report_groups(
    source: ReportSource, *, rule: SuccessRule | None = None, shortest: ShortestPaths | None = None
) -> ReportGroups:
    """The trials that the report counts; without a rule, PAN counts by that of the study file, or else `paper`.

    With the shortest paths of the episodes, trials have the measures of their ways.

    Raises:
        RunFileError: A run was never scored, or a trial occurs twice.
    """
    runs, records = source.runs, source.records
    rule = rule or (records.config.success if records.config else "paper")
    metric_rows(runs, rule=rule)  # refuses runs that were never scored, and trials that would count twice
    row_rule = records.config.success if records.config else rule
    found, left_out = trial_groups(runs, rule, records.rows, row_rule=row_rule)
    found = [with_ways(group, shortest or {}) for group in found]
    people = [group for group in found if group.kind == "human"]
    pairs = [pair for group in people for pair in way_pairs(group, group)]
    agents, averaged, differences = [], [], []
    for agent in (group for group in found if group.kind != "human"):
        beside = [group for group in people if _may_stand_beside(group, agent)]
        same = averaged_agent(agent, _episodes_of(beside))
        if same.trials.empty:
            reason = NOBODY_YET if agent.beside else NOT_SHARED
            left_out.append(LeftOut(who=agent.who, task=agent.task, reason=reason, n=len(agent.trials)))
            continue
        agents.append(replace(agent, trials=agent.trials[agent.trials["episode"].isin(same.trials["episode"])]))
        averaged.append(same)
        differences += [difference(group, same) for group in beside]
        pairs += [pair for group in beside for pair in way_pairs(group, agent)]
    return ReportGroups(
        rule, tuple(people), tuple(agents), tuple(averaged), tuple(differences), tuple(pairs), tuple(left_out)
    )


def _may_stand_beside(people: TrialGroup, agent: TrialGroup) -> bool:
    """Whether the agent may be compared with the people; answers on oracle maps (no home) may be, with any people.

    An agent that ran on the study stands beside the people whose condition it had.
    """
    is_same = not agent.beside or people.condition in agent.beside.split(",")
    return is_same and people.task == agent.task and agent.scene_kind in (people.scene_kind, "oracle-map")


def _episodes_of(groups: Sequence[TrialGroup]) -> set[str]:
    return {episode for group in groups for episode in group.trials["episode"]}


def _splits_beside(group: TrialGroup, people: Sequence[TrialGroup]) -> set[str]:
    """Splits in the table of a group of people, or of people minus an agent."""
    beside = [other for other in people if (other.task, other.scene_kind) == (group.task, group.scene_kind)]
    return {split for other in beside for split in other.trials["split"][other.trials["sr"].notna()]}


def _outcomes(group: TrialGroup) -> list[PersonOutcome]:
    names = zip(group.trials["participant"], group.trials["episode"], group.trials["sr"], strict=True)
    return [
        PersonOutcome(**group.names, participant=participant, episode=episode, success=percent / 100)
        for participant, episode, percent in names
    ]
