"""What a study's records say beside the figures: how far people came, what was verified, what a rule leaves out."""

from collections import Counter, defaultdict
from collections.abc import Sequence

from pydantic import BaseModel, ConfigDict

from sim.types import TaskKind

from ..export.rows import ExclusionRow, ParticipantRow
from ..export.runs import run_condition
from ..export.trial_table import NOT_A_RESULT, TrialRow
from .row_labels import is_first_condition

_MODEL = ConfigDict(frozen=True, extra="forbid")
NO_REASON = "not in the export"


class FlowCount(BaseModel):
    """How many people came to a point of the study."""

    model_config = _MODEL
    point: str
    n: int
    is_aside: bool
    """Whether it is beside the way through the study: a way out, or a detour."""


class VerificationCount(BaseModel):
    """What doing the counted trials again found."""

    model_config = _MODEL
    task: TaskKind
    scene_kind: str
    condition: str
    num_verified: int
    num_drift: int
    num_failed: int
    num_unsupported: int
    num_not_yet: int

    @property
    def n(self) -> int:
        """Counted trials."""
        return self.num_verified + self.num_drift + self.num_failed + self.num_unsupported + self.num_not_yet


class ExclusionCount(BaseModel):
    """What one rule leaves out."""

    model_config = _MODEL
    rule_id: str
    is_planned: bool | None
    """Whether the rule was written down before the first trial; None = not known."""
    reason: str
    num_participants: int
    """Whose trials are concerned."""
    num_trials: int
    """Trials with a result; they stay in the tables (intention to treat)."""


def flow_counts(people: Sequence[ParticipantRow], rows: Sequence[TrialRow], *, num_deleted: int) -> list[FlowCount]:
    """How far the participants came.

    Args:
        people: Of the export.
        rows: Their trials.
        num_deleted: Participants who withdrew and whose records were deleted: they are in no table.
    """
    opened: dict[str, set[str]] = defaultdict(set)
    for row in rows:
        if row.attempt > 0:
            opened[row.participant].add(row.phase)
    counts: Counter[str] = Counter({"places in the plan": num_deleted, "withdrew, records deleted": num_deleted})
    for person in people:
        reached = {entry.stage for entry in person.stages}
        left = [entry.stage for entry in person.stages if entry.stage in ("dropped_out", "returned")]
        counts["places in the plan"] += 1
        counts["came"] += bool(reached)
        counts["device refused"] += "device_failed" in reached and "device_ok" not in reached
        counts["declined consent"] += "declined" in reached
        counts["consented"] += "consented" in reached
        counts["screened out"] += "screened_out" in reached
        counts["failed the quiz at least once"] += "quiz_failed" in reached
        counts["passed the quiz"] += "quiz_passed" in reached
        counts["began practice"] += "practice" in opened[person.participant]
        counts["began counted trials"] += "main" in opened[person.participant]
        counts["withdrew"] += "withdrawn" in reached
        counts["dropped out"] += left[-1:] == ["dropped_out"] and person.left_by is None
        counts["study was full"] += "full" in reached
        counts["finished"] += "finished" in reached
    return [FlowCount(point=point, n=counts[point], is_aside=is_aside) for point, is_aside in _POINTS]


_POINTS: tuple[tuple[str, bool], ...] = (
    ("places in the plan", False),
    ("came", False),
    ("device refused", True),
    ("study was full", True),
    ("declined consent", True),
    ("consented", False),
    ("screened out", True),
    ("failed the quiz at least once", True),
    ("passed the quiz", False),
    ("began practice", False),
    ("began counted trials", False),
    ("dropped out", True),
    ("withdrew", True),
    ("withdrew, records deleted", True),
    ("finished", False),
)
"""In the order of the study, and whether it is beside the way."""


def verification_counts(rows: Sequence[TrialRow]) -> list[VerificationCount]:
    """Counts per task, scene kind and condition, over trials with a result."""
    groups: dict[tuple[TaskKind, str, str], Counter[str]] = defaultdict(Counter)
    for row in _results(rows):
        groups[row.task, row.scene_kind, run_condition(row.condition)][row.verification or "not_yet"] += 1
    return [
        VerificationCount(
            task=task,
            scene_kind=kind,
            condition=condition,
            num_verified=found["verified"],
            num_drift=found["drift"],
            num_failed=found["failed"],
            num_unsupported=found["unsupported"],
            num_not_yet=found["not_yet"],
        )
        for (task, kind, condition), found in sorted(groups.items(), key=_order)
    ]


def _order(item: tuple[tuple[TaskKind, str, str], Counter[str]]) -> tuple:
    """As in the tables: without memory before with it."""
    task, kind, condition = item[0]
    return task, kind, not is_first_condition(condition), condition


def exclusion_counts(rows: Sequence[TrialRow], uses: Sequence[ExclusionRow]) -> list[ExclusionCount]:
    """Counts per rule, with the reasons that were given.

    Args:
        rows: Of the study's trials.
        uses: Every use of a rule; those taken back do not count.
    """
    reasons: dict[str, set[str]] = defaultdict(set)
    is_planned: dict[str, bool] = {}
    for use in uses:
        if not use.is_undone:
            reasons[use.rule_id].add(use.reason)
            is_planned[use.rule_id] = use.is_planned
    trials = _results(rows)
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


def _results(rows: Sequence[TrialRow]) -> list[TrialRow]:
    return [
        row for row in rows if row.phase == "main" and row.end_reason is not None and row.end_reason not in NOT_A_RESULT
    ]
