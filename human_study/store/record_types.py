"""A study's records as values: stages, stored events, trials, participants, verifications, exclusions.

A participant's stages are an append-only list, from which every page is derived.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

from sim.types import EpisodeKey, TaskKind

from ..design.plan import Phase
from ..design.study import Condition
from ..trial.events import Event
from ..trial.outcome import Outcome

Stage = Literal[
    "arrived",
    "device_ok",
    "device_failed",
    "consented",
    "declined",
    "instructed",
    "quiz_passed",
    "quiz_failed",
    "keys_changed",
    "sitting_started",
    "break_started",
    "break_ended",
    "finished",
    "withdrawn",
    "screened_out",
    "dropped_out",
    "returned",
    "full",
]
WayOut = Literal["declined", "withdrawn", "screened_out", "full"]
"""Stages after which a participant does nothing more."""
OUT: tuple[WayOut, ...] = get_args(WayOut)
VerificationStatus = Literal["verified", "drift", "failed", "unsupported"]


@dataclass(frozen=True, slots=True)
class StageEntry:
    """A stage that a participant reached."""

    stage: Stage
    detail: dict[str, Any]
    """Answers of the quiz, the coarse profile of the device and similar facts."""
    at_ns: int
    """Server's wall clock."""


@dataclass(frozen=True, slots=True)
class StoredEvent:
    """An event with the server's additions."""

    seq: int
    """Place in the trial, from 1, without gaps."""
    epoch: int
    """Epoch of the tab that sent it."""
    event: Event
    t_srv_ns: int
    """Server's wall clock; only a label."""
    t_srv_mono_ns: int
    """Server's monotonic clock; comparable within one boot."""


@dataclass(frozen=True, slots=True)
class StoredTrial:
    """One attempt at an assigned trial, or an assigned trial that was never opened."""

    code: str
    """The participant."""
    order_no: int
    """Place in the participant's order over all phases, from 1."""
    phase: Phase
    task: TaskKind
    condition: Condition
    key: EpisodeKey
    rep: int
    """Number of the person among those with this episode and condition, from 1; 0 outside `main`."""
    made_by: Literal["plan", "fill"]
    """`fill`: given out while the study ran."""
    attempt: int
    """Number of the attempt, from 1; 0 = never opened."""
    trial_id: str | None
    """Id of the attempt; None if it was never opened."""
    outcome: Outcome | None
    """The outcome; None until the trial has ended, and when the participant withdrew."""
    has_ended: bool
    is_released: bool
    """Whether the participant gave the episode back to others."""
    is_shredded: bool
    """Whether the participant withdrew and the trial's data is deleted."""
    opened_ns: int | None
    prior_visits_scene: int | None
    """Earlier attempts of this participant at trials in this home, of any phase and with any end; None where the
    trial was never opened."""
    prior_visits_split: int | None
    """Those of these attempts that are in the same split."""
    secs_in_scene_before: float | None
    """Seconds that the participant spent in this home before."""

    @property
    def is_due(self) -> bool:
        """Whether the participant still has to do or finish the trial."""
        return not self.has_ended and not self.is_released


@dataclass(frozen=True, slots=True)
class ConsentEntry:
    """An answer to the question for consent."""

    text_hash: str
    """sha256 of the text that was shown."""
    given: bool
    at_ns: int


@dataclass(frozen=True, slots=True)
class ParticipantRecord:
    """One participant."""

    code: str
    """Public code, such as p01."""
    task: TaskKind
    arm: int
    created_ns: int
    is_claimed: bool
    """Whether a person used this link, or got this place through an open link."""
    is_shredded: bool
    """Whether the participant's data is deleted."""
    stages: tuple[StageEntry, ...]
    consents: tuple[ConsentEntry, ...]

    @property
    def is_withdrawn(self) -> bool:
        """Whether the participant withdrew."""
        return has_reached(self.stages, "withdrawn")

    @property
    def is_out(self) -> bool:
        """Whether the participant left for good, or dropped out and did not return."""
        return way_out(self.stages) is not None or has_dropped_out(self.stages)


@dataclass(frozen=True, slots=True)
class VerificationEntry:
    """The result of doing a trial again."""

    trial_id: str
    run_id: str
    """Id of the verification."""
    status: VerificationStatus
    max_position_error: float
    """Largest error of a position, metres."""
    first_bad_step: int | None
    detail: str
    sim_hash: str
    """Hash of the program and the scene of the repetition."""
    at_ns: int


@dataclass(frozen=True, slots=True)
class ExclusionEntry:
    """A trial or participant that a rule leaves out of the figures."""

    exclusion_id: str
    target_kind: Literal["trial", "participant"]
    target: str
    """Trial id or participant code."""
    rule_id: str
    reason: str
    at_ns: int
    is_undone: bool


def has_reached(entries: Sequence[StageEntry], stage: Stage) -> bool:
    """Whether the stage is among the entries."""
    return any(entry.stage == stage for entry in entries)


def way_out(entries: Sequence[StageEntry]) -> WayOut | None:
    """The stage by which the participant left for good; None if there is none."""
    return next((entry.stage for entry in entries if entry.stage in OUT), None)


def has_dropped_out(entries: Sequence[StageEntry]) -> bool:
    """Whether the participant's trials were given to others and the participant has not returned since."""
    moves = [entry.stage for entry in entries if entry.stage in ("dropped_out", "returned")]
    return bool(moves) and moves[-1] == "dropped_out"


def last_detail(entries: Sequence[StageEntry], stage: Stage) -> dict:
    """The details stored with the newest entry of a stage; {} where there is none."""
    return next((entry.detail for entry in reversed(entries) if entry.stage == stage), {})
