"""Counts and spreads beside the figures: ends, quartiles, attention, the flow of people, verifications, exclusions."""

from collections import Counter, defaultdict
from collections.abc import Sequence, Set

import numpy as np

from sim.types import SPLITS, EndReason, TaskKind

from ..export.rows import ExclusionRow, ParticipantRow
from ..export.runs import run_condition
from ..export.trial_table import TrialRow
from ..journey import Stage, is_refused
from .measures import MEASURES
from .trials import GroupRow, PeopleRow, ReportValue, TrialGroup, is_first_condition

NO_REASON = "not in the export"


class SpreadRow(GroupRow):
    """Quartiles of a measure over all trials of a row, in one split or all."""

    split: str
    """A split, or `all` for all trials together."""
    measure: str
    lower: float
    median: float
    upper: float
    n: int
    """Trials with a value."""
    num_missing: int
    """Trials without a value: for `dtg`, those that ended where no way leads to the goal (unreachable)."""


class EndRow(GroupRow):
    """Trials of a row that ended in one way."""

    reason: EndReason
    k: int
    """Successes among them."""
    n: int


class AttentionCount(ReportValue):
    """Attention trials, which have their target in plain view."""

    task: TaskKind
    num_trials: int
    num_passed: int
    num_people: int
    num_failing: int
    """People who failed more than one attention trial."""


class HiddenCount(ReportValue):
    """Counted trials whose page was in the background for longer than the study file allows without a flag."""

    limit_s: float
    num_trials: int
    num_flagged: int
    """Flagged trials; they count like all others."""
    num_people: int
    """People with a flagged trial."""


class FlowCount(ReportValue):
    """The number of people who reached a point of the study."""

    point: str
    n: int
    is_aside: bool
    """Whether it is a way out or a detour, not a step of the study itself."""


class VerificationCount(PeopleRow):
    """Results of doing the counted trials again."""

    num_verified: int = 0
    num_drift: int = 0
    num_failed: int = 0
    num_unsupported: int = 0
    num_not_yet: int = 0

    @property
    def n(self) -> int:
        """Counted trials."""
        return self.num_verified + self.num_drift + self.num_failed + self.num_unsupported + self.num_not_yet


class ExclusionCount(ReportValue):
    """People and trials that one rule leaves out."""

    rule_id: str
    is_planned: bool | None
    """Whether the rule was written down before the first trial; None = not known."""
    reason: str
    num_participants: int
    """People whose trials the rule leaves out."""
    num_trials: int
    """Trials with a result; they stay in the tables (intention to treat)."""


def spread_rows(group: TrialGroup) -> list[SpreadRow]:
    """Quartiles per split and of all trials, for every measure of the group that has a spread worth showing."""
    rows = []
    for measure in (name for name in group.measures if MEASURES[name].has_spread):
        for split in (*SPLITS, "all"):
            values = group.trials[measure] if split == "all" else group.trials[measure][group.trials["split"] == split]
            known = values.dropna()
            if len(known):
                lower, median, upper = np.quantile(known, [0.25, 0.5, 0.75])
                names = {**group.names, "measure": measure, "split": split, "num_missing": len(values) - len(known)}
                rows.append(SpreadRow(**names, lower=lower, median=median, upper=upper, n=len(known)))
    return rows


def end_rows(group: TrialGroup) -> list[EndRow]:
    """A row per way in which the group's trials ended, most frequent first."""
    counts = Counter(group.trials["end"].dropna())
    hits = Counter(group.trials["end"][group.trials["sr"] == 100])
    found = sorted(counts.items(), key=lambda item: (-item[1], item[0]))
    return [EndRow(**group.names, reason=end, k=hits[end], n=n) for end, n in found]


def attention_counts(rows: Sequence[TrialRow]) -> list[AttentionCount]:
    """Counts per task, over attention trials that ended with a result."""
    hits: dict[TaskKind, dict[str, list[bool]]] = defaultdict(lambda: defaultdict(list))
    for row in rows:
        if row.phase == "check" and row.success is not None:
            hits[row.task][row.participant].append(row.success)
    return [
        AttentionCount(
            task=task,
            num_trials=sum(map(len, people.values())),
            num_passed=sum(map(sum, people.values())),
            num_people=len(people),
            num_failing=sum(one.count(False) > 1 for one in people.values()),
        )
        for task, people in sorted(hits.items())
    ]


def hidden_count(rows: Sequence[TrialRow], limit_s: float | None) -> HiddenCount | None:
    """Counts of flagged trials of phase `main` with a result; None where the study file has no limit."""
    if limit_s is None:
        return None
    results = [row for row in rows if row.is_result]
    flagged = [row for row in results if row.is_long_hidden]
    num_people = len({row.participant for row in flagged})
    return HiddenCount(limit_s=limit_s, num_trials=len(results), num_flagged=len(flagged), num_people=num_people)


def flow_counts(people: Sequence[ParticipantRow], rows: Sequence[TrialRow], *, num_deleted: int) -> list[FlowCount]:
    """The number of participants at each point of the study; the `num_deleted` with deleted records are in no table."""
    opened: dict[str, set[str]] = defaultdict(set)
    for row in rows:
        if row.attempt > 0:
            opened[row.participant].add(row.phase)
    deleted = {"places in the plan": num_deleted, "withdrew, records deleted": num_deleted}
    passed = [_points_of(person, opened[person.participant]) for person in people]
    return [
        FlowCount(point=point, n=deleted.get(point, 0) + sum(point in points for points in passed), is_aside=is_aside)
        for point, (_, is_aside) in _POINTS.items()
    ]


def _points_of(person: ParticipantRow, opened: Set[str]) -> set[str]:
    """The points that one person passed, whose trials of these phases were opened; a person has one way out."""
    reached = {entry.stage for entry in person.stages}
    left = [entry.stage for entry in person.stages if entry.stage in ("dropped_out", "returned")]
    is_true = {
        "places in the plan": True,
        "came": bool(reached),
        "device refused": is_refused(reached),
        "screened out": "screened_out" in reached and not is_refused(reached),
        "began practice": "practice" in opened,
        "began counted trials": "main" in opened,
        "dropped out": left[-1:] == ["dropped_out"] and person.left_by is None and not is_refused(reached),
    }
    return {point for point, (stage, _) in _POINTS.items() if is_true.get(point, stage in reached)}


_POINTS: dict[str, tuple[Stage | None, bool]] = {
    "places in the plan": (None, False),
    "came": (None, False),
    "device refused": (None, True),
    "study was full": ("full", True),
    "declined consent": ("declined", True),
    "consented": ("consented", False),
    "screened out": (None, True),
    "failed the quiz at least once": ("quiz_failed", True),
    "passed the quiz": ("quiz_passed", False),
    "began practice": (None, False),
    "began counted trials": (None, False),
    "dropped out": (None, True),
    "withdrew": ("withdrawn", True),
    "withdrew, records deleted": (None, True),
    "finished": ("finished", False),
}
"""Points in study order: the stage that reaches it, if one does, and whether it is a way out or a detour."""


def verification_counts(rows: Sequence[TrialRow]) -> list[VerificationCount]:
    """Counts per task, scene kind and condition, over trials with a result; conditions without memory come first."""
    groups: dict[tuple[TaskKind, str, bool, str], Counter[str]] = defaultdict(Counter)
    for row in (row for row in rows if row.is_result):
        condition = run_condition(row.condition)
        name = (row.task, row.scene_kind, not is_first_condition(condition), condition)
        groups[name][f"num_{row.verification or 'not_yet'}"] += 1
    return [
        VerificationCount(task=task, scene_kind=kind, condition=condition, **found)
        for (task, kind, _, condition), found in sorted(groups.items())
    ]


def exclusion_counts(rows: Sequence[TrialRow], uses: Sequence[ExclusionRow]) -> list[ExclusionCount]:
    """Counts per rule, with the given reasons; undone uses do not count."""
    reasons: dict[str, set[str]] = defaultdict(set)
    is_planned: dict[str, bool] = {}
    for use in uses:
        if not use.is_undone:
            reasons[use.rule_id].add(use.reason)
            is_planned[use.rule_id] = use.is_planned
    trials = [row for row in rows if row.is_result]
    rules = sorted({rule for row in trials for rule in row.excluded} | set(reasons))
    return [
        ExclusionCount(
            rule_id=rule,
            is_planned=is_planned.get(rule),
            reason="; ".join(sorted(reasons[rule])) or NO_REASON,
            num_participants=len({row.participant for row in trials if rule in row.excluded}),
            num_trials=sum(rule in row.excluded for row in trials),
        )
        for rule in rules
    ]
