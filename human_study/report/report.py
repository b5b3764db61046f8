"""The figures of a study: people and agents on the same episodes, each number with its interval (`study report`)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from pydantic import BaseModel, ConfigDict

from sim.errors import StudyError
from sim.homes.kind import scene_labels
from sim.tasks.metrics import made_for_warning, metric_rows, require_comparable
from sim.tasks.run_files import Run
from sim.types import SuccessRule, TaskKind

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
from .rows import Aggregate, ReportRow, TotalKind, require_totals, rows_of
from .sensitivity import SensitivityRow, sensitivity_rows
from .source import ReportSource, StudyRecords
from .statistics import Weight
from .trials import LeftOut, TrialGroup, averaged_agent, difference, trial_groups

_MODEL = ConfigDict(frozen=True, extra="forbid")


class PersonOutcome(BaseModel):
    """Whether one person succeeded at one episode, or an agent, whose runs are averaged."""

    model_config = _MODEL
    task: TaskKind
    scene_kind: str
    who: str
    condition: str
    participant: str
    episode: str
    success: float
    """0 or 1; between them for an agent with several runs."""


class StudyReport(BaseModel):
    """What `study report --json` prints."""

    model_config = _MODEL
    study: str | None
    """Name in the study file; None = the runs came without one."""
    study_version: str | None
    is_pilot: bool
    """Served without an ethics id."""
    num_open: int
    """Assigned counted trials that nobody has ended: the study is still running."""
    information: tuple[str, ...] | None
    """What people had to go by; None = not known."""
    rule: SuccessRule
    """Of the PAN rows."""
    total: TotalKind
    weight: Weight
    scene_kinds: tuple[str, ...]
    """A human baseline for PersONAL is claimed on scans only."""
    scene_labels: tuple[str, ...]
    """What must be said of these homes; () for scans."""
    warnings: tuple[str, ...]
    """Runs that were made for another rule than the report's."""
    rows: tuple[ReportRow, ...]
    spreads: tuple[SpreadRow, ...]
    ends: tuple[EndRow, ...]
    """Of all runs of agents, on the people's episodes."""
    hypotheses: tuple[HypothesisRow, ...]
    """The primary ones; everything else in the report is exploratory."""
    memory: tuple[EffectRow, ...]
    order: tuple[EffectRow, ...]
    blocks: tuple[BlockRow, ...]
    agent_pairs: tuple[AgentPairRow, ...]
    sensitivity: tuple[SensitivityRow, ...]
    agreement: tuple[AgreementRow, ...]
    places: tuple[PlaceRow, ...]
    suspects: tuple[SuspectEpisode, ...]
    flow: tuple[FlowCount, ...]
    """() = the study's records are not at hand."""
    verification: tuple[VerificationCount, ...]
    attention: tuple[AttentionCount, ...]
    hidden: HiddenCount | None
    """None = the study file has no limit, or is not at hand."""
    exclusions: tuple[ExclusionCount, ...]
    left_out: tuple[LeftOut, ...]
    checklist: tuple[ChecklistItem, ...]
    outcomes: tuple[PersonOutcome, ...]
    """Of every counted trial, agents on the people's episodes."""
    dataset_digest: str
    versions: tuple[str, ...]
    """Of the programs that made the runs."""
    runs: tuple[str, ...]
    """Ids of the runs, in order."""


@dataclass(frozen=True, slots=True)
class ReportGroups:
    """The trials behind a report, for pictures and for other programs."""

    people: tuple[TrialGroup, ...]
    agents: tuple[TrialGroup, ...]
    """All runs, on the people's episodes."""
    averaged: tuple[TrialGroup, ...]
    """One trial per episode."""
    differences: tuple[TrialGroup, ...]
    left_out: tuple[LeftOut, ...]


def study_report(
    runs: Sequence[Run],
    *,
    rule: SuccessRule | None = None,
    records: StudyRecords | None = None,
    split_sizes: Mapping[str, int] | None = None,
    objects: HomeObjects | None = None,
) -> StudyReport:
    """Rows for people, for agents on the episodes that people did, and for people minus agents.

    Args:
        runs: Exported runs of people and, if wanted, runs of agents.
        rule: Success rule of the PAN rows; None = the study file's, or `paper`.
        records: Of the people's study; None = only runs are at hand, and what needs more is left out.
        split_sizes: Episodes of each split in the dataset, for `aggregate.total: dataset_weighted`.
        objects: Of the homes, for the agreement on the chosen object.

    Raises:
        StudyError: No run is of people, an agent did none of their episodes, or totals need the splits' sizes.
        RunFileError: Runs are on different episode files, or scans and other homes are mixed.
    """
    config = records.config if records else None
    rule = rule or (config.success if config else "paper")
    aggregate = Aggregate(split_sizes=split_sizes)
    if config is not None:
        aggregate = Aggregate(config.aggregate.total, config.aggregate.weight, split_sizes)
    aggregate.require_sizes()
    runs = sorted(runs, key=lambda run: run.info.run_id)
    groups = report_groups(ReportSource(tuple(runs), records), rule=rule)
    people, trial_rows = groups.people, records.rows if records else ()
    rows = _rows(groups, aggregate)
    memory = memory_effects(people)
    sensitivity = [sensitivity_rows(group, trial_rows, aggregate) for group in (*people, *groups.differences)]
    versions = {f"{name} {version}" for run in runs for name, version in run.info.versions.items()}
    return StudyReport(
        **_of_records(records, rows, runs),
        rule=rule,
        total=aggregate.total,
        weight=aggregate.weight,
        scene_kinds=tuple(sorted({run.info.scene_kind for run in runs})),
        scene_labels=scene_labels(run.info.scene_kind for run in runs),
        warnings=_warnings(runs, rule),
        rows=tuple(rows),
        spreads=tuple(row for group in (*people, *groups.averaged) for row in spread_rows(group)),
        ends=tuple(row for group in (*people, *groups.agents) for row in end_rows(group)),
        hypotheses=tuple(hypothesis_rows(config.primary if config else (), groups.differences, memory, aggregate)),
        memory=tuple(memory),
        order=tuple(order_effects(people)),
        blocks=tuple(order_blocks(people)),
        agent_pairs=tuple(agent_pairs(groups.agents, _episodes_of(people))),
        sensitivity=tuple(row for found in sensitivity for row in found),
        agreement=tuple(agreement_row(group) for group in people),
        places=tuple(place_row(group, objects) for group in people),
        suspects=tuple(suspect for group in people for suspect in suspect_episodes(group, objects)),
        left_out=groups.left_out,
        outcomes=tuple(outcome for group in (*people, *groups.averaged) for outcome in _outcomes(group)),
        dataset_digest=runs[0].info.dataset_digest,
        versions=tuple(sorted(versions)),
        runs=tuple(run.info.run_id for run in runs),
    )


def _warnings(runs: Sequence[Run], rule: SuccessRule) -> tuple[str, ...]:
    """One line per row name whose PAN runs were made for another rule."""
    others: dict[str, set[SuccessRule]] = {}
    for run in runs:
        if run.episodes and run.info.made_for not in (None, rule):
            others.setdefault(run.info.who, set()).add(run.info.made_for)
    return tuple(made_for_warning(who, sorted(rules), rule=rule) for who, rules in sorted(others.items()))


def _rows(groups: ReportGroups, aggregate: Aggregate) -> list[ReportRow]:
    """People, agents where people were, and people minus agents; every total is what it is declared to be."""
    rows = [row for group in groups.people for row in rows_of(group, aggregate)]
    for full, same in zip(groups.agents, groups.averaged, strict=True):
        rows += rows_of(same, aggregate, behind=full)
    rows += [row for group in groups.differences for row in rows_of(group, aggregate, kind="difference")]
    require_totals(rows)
    return rows


def _of_records(records: StudyRecords | None, rows: Sequence[ReportRow], runs: Sequence[Run]) -> dict[str, Any]:
    """The fields of a report that come from the study's records; without them, what the runs say."""
    if records is None:
        told = next(run.info.config for run in runs if run.info.who_kind == "human")
        information = str(told["information"]).split(",") if "information" in told else None
        return {
            **dict.fromkeys(("flow", "verification", "attention", "exclusions", "checklist"), ()),
            "study": told.get("study"),
            "study_version": told.get("study_version"),
            "is_pilot": bool(told.get("pilot")),
            "num_open": 0,
            "hidden": None,
            "information": tuple(information) if information else None,
        }
    config = records.config
    has_people = bool(records.people)
    flow = flow_counts(records.people, records.rows, num_deleted=records.num_deleted) if has_people else []
    exclusions = exclusion_counts(records.rows, records.exclusions)
    return {
        "study": config.study,
        "study_version": config.study_version,
        "is_pilot": records.is_pilot,
        "num_open": sum(row.phase == "main" and row.end_reason is None and not row.is_released for row in records.rows),
        "information": config.information,
        "flow": tuple(flow),
        "verification": tuple(verification_counts(records.rows)),
        "attention": tuple(attention_counts(records.rows)),
        "hidden": hidden_count(records.rows, config.hidden_max_s),
        "exclusions": tuple(exclusions),
        "checklist": tuple(
            checklist(
                config,
                rows=rows,
                flow=flow,
                exclusions=exclusions,
                is_pilot=records.is_pilot,
                plan_changes=records.plan_changes,
            )
        ),
    }


def report_groups(source: ReportSource, *, rule: SuccessRule) -> ReportGroups:
    """The trials that the report counts.

    Raises:
        StudyError: No run is of people, of two studies, or an agent did none of their episodes.
        RunFileError: Runs are on different episode files, scans and other homes are mixed, or a trial stands twice.
    """
    runs, records = source.runs, source.records
    require_comparable(run.info for run in runs)
    _require_one_study(runs)
    metric_rows(runs, rule=rule)  # refuses runs that were never scored, and trials that would count twice
    rows, row_rule = (records.rows, records.config.success) if records else ((), rule)
    found, left_out = trial_groups(runs, rule, rows, row_rule=row_rule)
    people = [group for group in found if group.kind == "human"]
    agents, averaged, differences = [], [], []
    for agent in (group for group in found if group.kind != "human"):
        beside = [group for group in people if _may_stand_beside(group, agent)]
        same = _on_the_same_episodes(agent, beside)
        agents.append(replace(agent, trials=agent.trials[agent.trials["episode"].isin(same.trials["episode"])]))
        averaged.append(same)
        differences += [difference(group, same) for group in beside]
    return ReportGroups(tuple(people), tuple(agents), tuple(averaged), tuple(differences), tuple(left_out))


def _require_one_study(runs: Sequence[Run]) -> None:
    people = [run.info for run in runs if run.info.who_kind == "human"]
    if not people:
        raise StudyError(
            f"found {len(runs)} runs of agents and none of people; expected at least one of people. "
            "Write them with personal-viz study export."
        )
    versions = {str(info.config.get("study_version", "")): info.run_id for info in people}
    if len(versions) > 1:
        names = ", ".join(f"{version[:12] or 'none'} ({run_id})" for version, run_id in sorted(versions.items()))
        raise StudyError(
            f"runs of people: found study versions {names}; expected one, because people's codes are those of one "
            "study. Make a report of each."
        )


def _may_stand_beside(people: TrialGroup, agent: TrialGroup) -> bool:
    """Answers on oracle maps (no home at all) may stand beside any people."""
    return people.task == agent.task and agent.scene_kind in (people.scene_kind, "oracle-map")


def _on_the_same_episodes(agent: TrialGroup, people: Sequence[TrialGroup]) -> TrialGroup:
    """The agent where people were, its runs averaged."""
    done = _episodes_of(people)
    same = averaged_agent(agent, done)
    if same.trials.empty:
        raise StudyError(
            f"{agent.who} ({agent.task}): did none of the {len(done)} episodes that people did; expected the same "
            "episodes. Run it on them, or leave it out."
        )
    return same


def _episodes_of(groups: Sequence[TrialGroup]) -> set[str]:
    return {episode for group in groups for episode in group.trials["episode"]}


def _outcomes(group: TrialGroup) -> list[PersonOutcome]:
    names = zip(group.trials["participant"], group.trials["episode"], group.trials["sr"], strict=True)
    return [
        PersonOutcome(**group.names, participant=participant, episode=episode, success=percent / 100)
        for participant, episode, percent in names
    ]
