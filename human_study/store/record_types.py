"""A study's records as values: stored events, trials, participants, verifications, exclusions."""

from dataclasses import dataclass
from typing import Literal

from sim.types import EpisodeKey, TaskKind

from ..design.plan import Phase
from ..design.study import Condition
from ..trial.events import Event
from ..trial.outcome import Outcome
from .stages import StageEntry, has_dropped_out, has_reached, way_out

VerificationStatus = Literal["verified", "drift", "failed", "unsupported"]


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
class TrialStatus:
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
    """Earlier attempts of this participant at trials in this home, of any phase and with any end; None in records of
    the first version."""
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
