"""Rows of the exported tables other than the trials' table: events, participants, exclusions, verifications.

Nothing in them leads back to a person: codes are new, the store's ids are left out, times count from the trial's or
the person's start, and window sizes are rounded.
"""

import json
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, JsonValue

from sim.types import TaskKind

from ..design.study import Condition
from ..journey import Stage
from ..store.records import VerificationStatus
from ..trial.events import Event, event_from_json
from .data_dictionary import Unit
from .survey import SurveyRow
from .trial_table import AttemptName, Metres, Seconds


class EventRow(AttemptName):
    """One event of one attempt."""

    seq: int
    """Place in the attempt, from 1, without gaps."""
    epoch: int
    """Opening of the page that it came from, numbered from 1; each new tab or reload counts one more."""
    kind: str
    """Kind of event; the closed list is in human_study/trial/events.py of the version that wrote it."""
    t_s: Seconds | None
    """From the trial's start on the session's clock, without time away; empty for events of the store itself."""
    t_cli_ms: Annotated[float, Unit("ms")] | None
    """The browser's own clock, from its first event of the epoch; use differences within an epoch only."""
    t_srv_s: Seconds
    """Time at which the server stored it, from the attempt's first event; for order, not for reaction times."""
    payload: dict[str, JsonValue]
    """All other fields of the event."""

    @property
    def event(self) -> Event:
        """The event itself.

        Raises:
            StudyError: This version does not know such an event.
        """
        fields = {"kind": self.kind, "t_s": self.t_s, "t_cli_ms": self.t_cli_ms, **self.payload}
        return event_from_json(json.dumps(fields), where=f"{self.attempt_name}, event {self.seq}")


class StageRow(BaseModel):
    """A stage of a person, inside `ParticipantRow`."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    stage: Stage
    t_s: float
    """Seconds from the person's first stage."""
    detail: dict[str, int | float | bool]
    """Numbers and yes-or-no answers only; for a list its length."""


class ParticipantRow(BaseModel):
    """One person with a link."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)
    participant: str
    """Code of the person; exports number people anew."""
    task: TaskKind
    """Everybody does one task."""
    arm: int
    """Number that decides which group of homes has which condition for this person."""
    conditions: tuple[Condition, ...]
    """Conditions among the person's trials of phase `main`."""
    has_come: bool
    """Whether somebody used the link."""
    has_consented: bool | None
    """The last answer about consent; empty when not asked."""
    consent_text: str | None
    """sha256 of the text that was agreed to or declined."""
    is_withdrawn: bool
    """Whether the person withdrew from a study that keeps the records; deleted people are in no table."""
    last_stage: Stage | None
    """The last stage that the person reached."""
    left_by: Stage | None
    """The stage by which the person left for good; empty when there is none."""
    num_assigned: Annotated[int, Unit("trials")]
    """Trials of phase `main`, released ones included."""
    num_ended: Annotated[int, Unit("trials")]
    """Trials among these that ended in any way."""
    time_in_study_s: Seconds | None
    """From the first stage to the last, breaks and days between sittings included."""
    stages: tuple[StageRow, ...]
    """Every stage with its time from the first; numbers and yes-or-no answers, sizes rounded."""


class ExclusionRow(BaseModel):
    """One use of a rule that leaves out a trial or a person; nothing is deleted by it."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)
    target_kind: Literal["trial", "participant"]
    """Whether a trial or a whole person is left out."""
    participant: str
    """Code of the person."""
    order_no: int | None
    """Place in the person's order; empty for a whole person."""
    attempt: int | None
    """Attempt; empty for a whole person."""
    rule_id: str
    """Name of the rule."""
    is_planned: bool
    """Whether the rule was written down before the first trial."""
    reason: str
    """The researcher's reason for using the rule here."""
    is_undone: bool
    """Whether it was taken back."""


class CommentRow(BaseModel):
    """The comment of one person, in the person's own words; read it before you publish it."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)
    participant: str
    """Code of the person."""
    comment: str
    """What the person wrote at the end of the study; the newest one."""


class VerificationRow(AttemptName):
    """The result of doing one attempt again."""

    run_no: int
    """Number of the verification, from 1 in order of time."""
    status: VerificationStatus
    """`verified`: all agrees; `drift`: a step leads elsewhere; `failed`: the events give another outcome;
    `unsupported`: the home is not that of the trial."""
    max_position_error: Metres
    """Largest distance between a stored and a simulated position."""
    first_bad_step: int | None
    """First step that leads elsewhere, 0 = the start; empty unless `drift`."""
    detail: str
    """One sentence about what differs."""
    sim_hash: str
    """Hash of the program and the home with which it was done again."""


OPTIONAL_TABLES: dict[str, tuple[str, type[BaseModel]]] = {
    "survey": (
        "One row per answer to the survey. People were told that single answers are not published: keep it apart.",
        SurveyRow,
    ),
    "comments": ("One row per person who wrote a comment. Read all of them before you publish this table.", CommentRow),
}
"""(meaning of one row, row model) of the tables that only studies with a survey, or with comments, have.

They may be moved out of an export before it is published.
"""
