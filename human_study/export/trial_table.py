"""Every attempt of every trial as one row of plain figures: what is exported, tabulated and compared with agents."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from pydantic import BaseModel, ConfigDict

from sim.homes.kind import scene_label
from sim.types import EndReason, SceneKind, Split, TaskKind

from ..design.plan import Phase, StudyPlan
from ..design.study import Condition, StudyConfig
from ..store.record_types import TrialStatus, VerificationStatus
from ..store.records import StudyReader
from ..trial.events import Event
from .trial_figures import Seconds, TrialFigures, trial_figures

NOT_A_RESULT: tuple[EndReason, ...] = ("technical", "abandoned")
"""Ends that are not a result of the person (HUMAN_STUDY.md, section 4): kept, given out again, in no run folder."""


class AttemptName(BaseModel):
    """What names one attempt in every table."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)
    participant: str
    """Code of the person; exports number people anew."""
    order_no: int
    """Place in the person's order over all phases, from 1."""
    attempt: int
    """From 1; 0 = never opened."""

    @property
    def attempt_name(self) -> str:
        """The three in one text: p03/12/1."""
        return f"{self.participant}/{self.order_no}/{self.attempt}"


class AssignedTrial(AttemptName):
    """What the person was asked to do."""

    phase: Phase
    """`practice` is never counted, `check` shows attention, `main` is the study."""
    task: TaskKind
    """`pan`: steer the robot to the object. `pog`: point at it."""
    condition: Condition
    """What was seen of the home besides the task."""
    split: Split
    """Difficulty of the episode in the dataset."""
    scene: str
    """Name of the home."""
    scene_kind: SceneKind
    """Where the home comes from; tables never mix kinds."""
    episode_id: str
    """Of the dataset, unique within split and home."""
    rep: int
    """Which of the people with this episode and condition, from 1; 0 outside `main`."""


class TrialRow(TrialFigures, AssignedTrial):
    """One attempt at an assigned trial, or an assigned trial that was never opened."""

    prior_visits_scene: int | None
    """Attempts of this person at trials in this home before this one, of any phase and however they ended."""
    prior_visits_split: int | None
    """Of these, in the same split."""
    secs_in_scene_before: Seconds | None
    """Time that the person had spent in this home before."""
    is_long_hidden: bool
    """Whether the page was in the background for longer than the study file's `hidden_max_s`; leaves nothing out."""
    verification: VerificationStatus | None
    """What doing the trial again found, at the last time; empty when nobody looked."""
    excluded: tuple[str, ...]
    """Rules that leave this trial, or the whole person, out of the figures."""
    is_released: bool
    """Whether the person gave the episode back to others."""
    head_hash: str | None
    """Hash of the trial's last stored event, which stands for all before it."""
    scene_label: str = ""
    """What must be said of results in homes of this kind; empty for scans, and in exports of older programs."""

    @property
    def is_never_ended(self) -> bool:
        """Whether it is a counted trial that somebody began and nobody ended; also while it still runs."""
        return self.phase == "main" and self.end_reason is None and self.head_hash is not None

    @property
    def left_out(self) -> str | None:
        """Why the trial is in no run folder; None when it is a counted result."""
        if self.phase != "main":
            return self.phase
        if self.end_reason is None:
            return "released" if self.is_released else "not begun" if self.attempt == 0 else "not finished"
        if self.end_reason in NOT_A_RESULT:
            return self.end_reason
        return f"excluded: {', '.join(self.excluded)}" if self.excluded else None


@dataclass(frozen=True, slots=True)
class RowContext:
    """What rows of one study share."""

    config: StudyConfig
    plan: StudyPlan
    verifications: Mapping[str, VerificationStatus]
    """The latest, by trial id."""
    excluded_trials: Mapping[str, Sequence[str]]
    """Rule ids by trial id; undone exclusions are not in it."""
    excluded_people: Mapping[str, Sequence[str]]
    """Rule ids by participant code."""


def is_long_hidden(t_hidden_s: float, config: StudyConfig) -> bool:
    """Whether a page was in the background for longer than the study allows without a flag."""
    return config.hidden_max_s is not None and t_hidden_s > config.hidden_max_s


def row_context(reader: StudyReader) -> RowContext:
    """What `trial_row` needs besides a trial."""
    targets: dict[str, defaultdict[str, list[str]]] = {"trial": defaultdict(list), "participant": defaultdict(list)}
    for entry in reader.exclusions():
        if not entry.is_undone and entry.rule_id not in targets[entry.target_kind][entry.target]:
            targets[entry.target_kind][entry.target].append(entry.rule_id)
    return RowContext(
        config=reader.config,
        plan=reader.plan,
        verifications={entry.trial_id: entry.status for entry in reader.verifications()},
        excluded_trials=targets["trial"],
        excluded_people=targets["participant"],
    )


def trial_row(
    context: RowContext, status: TrialStatus, events: Sequence[Event], *, head_hash: str | None, code: str
) -> TrialRow:
    """One row.

    Args:
        context: Of the study.
        status: The attempt.
        events: All of the attempt, in order.
        head_hash: Of the last event.
        code: What the person is called in the row.
    """
    rules = dict.fromkeys(
        [*context.excluded_people.get(status.code, ()), *context.excluded_trials.get(status.trial_id or "", ())]
    )
    figures = trial_figures(events, status.outcome, rule=context.config.success)
    kind = context.plan.scene(status.key.scene).kind
    return TrialRow(
        **dict(figures),
        participant=code,
        order_no=status.order_no,
        phase=status.phase,
        task=status.task,
        condition=status.condition,
        split=status.key.split,
        scene=status.key.scene,
        scene_kind=kind,
        scene_label=scene_label(kind),
        episode_id=status.key.episode_id,
        rep=status.rep,
        attempt=status.attempt,
        prior_visits_scene=status.prior_visits_scene,
        prior_visits_split=status.prior_visits_split,
        secs_in_scene_before=status.secs_in_scene_before,
        is_long_hidden=is_long_hidden(figures.t_hidden_s, context.config),
        verification=context.verifications.get(status.trial_id or ""),
        excluded=tuple(rules),
        is_released=status.is_released,
        head_hash=head_hash,
    )
