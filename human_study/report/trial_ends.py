"""How trials ended, people's and agents': failure has several kinds."""

from collections import Counter
from collections.abc import Sequence

from pydantic import BaseModel, ConfigDict

from sim.tasks.run_files import Answer, EpisodeRun
from sim.types import EndReason, TaskKind

from ..export.trial_table import NOT_A_RESULT, TrialRow
from .trial_groups import CountedTrial, TrialGroup

_MODEL = ConfigDict(frozen=True, extra="forbid")


class EndRow(BaseModel):
    """Trials of a row that ended in one way."""

    model_config = _MODEL
    task: TaskKind
    scene_kind: str
    who: str
    condition: str
    reason: EndReason
    k: int
    """Successes among them."""
    n: int


class AttentionCount(BaseModel):
    """Trials with a target in plain view."""

    model_config = _MODEL
    task: TaskKind
    num_trials: int
    num_passed: int
    num_people: int
    num_failing: int
    """People who failed more than one."""


class HiddenCount(BaseModel):
    """Counted trials whose page was in the background for longer than the study file allows without a flag."""

    model_config = _MODEL
    limit_s: float
    num_trials: int
    num_flagged: int
    """They count as all others."""
    num_people: int
    """With a flagged trial."""


def hidden_count(rows: Sequence[TrialRow], limit_s: float | None) -> HiddenCount | None:
    """The flagged ones among trials of phase `main` with a result; None where the study file has no limit."""
    if limit_s is None:
        return None
    done = [row for row in rows if row.phase == "main" and row.end_reason not in (None, *NOT_A_RESULT)]
    flagged = [row for row in done if row.is_long_hidden]
    num_people = len({row.participant for row in flagged})
    return HiddenCount(limit_s=limit_s, num_trials=len(done), num_flagged=len(flagged), num_people=num_people)


def end_rows(group: TrialGroup) -> list[EndRow]:
    """A row per way in which the group's trials ended, most frequent first."""
    counts: Counter[EndReason] = Counter()
    hits: Counter[EndReason] = Counter()
    for trial in group.trials:
        reason = _reason(trial)
        if reason is not None:
            counts[reason] += 1
            hits[reason] += trial.figures["sr"] == 100
    names = {"task": group.task, "scene_kind": group.scene_kind, "who": group.who, "condition": group.condition}
    found = sorted(counts.items(), key=lambda item: (-item[1], item[0]))
    return [EndRow.model_validate(names | {"reason": reason, "k": hits[reason], "n": n}) for reason, n in found]


def attention_counts(rows: Sequence[TrialRow]) -> list[AttentionCount]:
    """Per task, over attention trials that ended with a result."""
    found = []
    tasks: list[TaskKind] = ["pan", "pog"]
    for task in tasks:
        checks = [row for row in rows if (row.task, row.phase) == (task, "check") and row.success is not None]
        failed = Counter(row.participant for row in checks if not row.success)
        if checks:
            found.append(
                AttentionCount(
                    task=task,
                    num_trials=len(checks),
                    num_passed=sum(bool(row.success) for row in checks),
                    num_people=len({row.participant for row in checks}),
                    num_failing=sum(number > 1 for number in failed.values()),
                )
            )
    return found


def _reason(trial: CountedTrial) -> EndReason | None:
    if isinstance(trial.item, EpisodeRun):
        return trial.item.end.reason
    if isinstance(trial.item, Answer):
        return trial.item.reason
    return trial.row.end_reason if trial.row is not None else None
