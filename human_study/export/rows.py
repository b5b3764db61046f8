"""Rows of the exported tables other than the trials' table: events, participants, exclusions, verifications.

Nothing in them leads back to a person: codes are new, the store's ids are left out, times count from the trial's or
the person's start, and window sizes are rounded.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, JsonValue

from sim.types import TaskKind

from ..design.study import Condition, StudyConfig
from ..store.exclusions import rules_before_data
from ..store.record_types import (
    ExclusionEntry,
    ParticipantRecord,
    Stage,
    StageEntry,
    StoredEvent,
    StoredTrial,
    VerificationEntry,
    way_out,
)
from ..trial.events import Event, event_from_json, event_to_json
from .data_dictionary import Unit
from .trial_table import AttemptName, Metres, Seconds

SIZE_STEP = 100
"""Pixels to which window sizes are rounded."""
_COLUMNS = frozenset({"kind", "t_s", "t_cli_ms"})
"""Fields of an event that are columns of their own."""


class EventRow(AttemptName):
    """One event of one attempt."""

    seq: int
    """Place in the attempt, from 1, without gaps."""
    epoch: int
    """Which opening of the page it came from; each new tab or reload counts one more."""
    kind: str
    """What happened; the closed list is in human_study/trial/events.py of the version that wrote it."""
    t_s: Seconds | None
    """From the trial's start on the session's clock, without time away; empty for events of the store itself."""
    t_cli_ms: Annotated[float, Unit("ms")] | None
    """The browser's own clock, from its first event of the epoch; use differences within an epoch only."""
    t_srv_s: Seconds
    """When the server stored it, from the attempt's first event; for order, not for reaction times."""
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
    """Numbers and yes-or-no answers only; of a list how many it holds."""


class ParticipantRow(BaseModel):
    """One person with a link."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)
    participant: str
    """Code of the person; exports number people anew."""
    task: TaskKind
    """Everybody does one task."""
    arm: int
    """Which group of homes has which condition for this person."""
    conditions: tuple[Condition, ...]
    """Conditions among the person's trials of phase `main`."""
    has_come: bool
    """Whether somebody used the link."""
    has_consented: bool | None
    """The last answer about consent; empty when not asked."""
    consent_text: str | None
    """sha256 of the text that was agreed to or declined."""
    is_withdrawn: bool
    """Whether the person withdrew from a study that keeps what was done; deleted people are in no table."""
    last_stage: Stage | None
    """How far the person came."""
    left_by: Stage | None
    """The stage that ended it for good, if any."""
    num_assigned: Annotated[int, Unit("trials")]
    """Trials of phase `main`, released ones included."""
    num_ended: Annotated[int, Unit("trials")]
    """How many of these ended in any way."""
    time_in_study_s: Seconds | None
    """From the first stage to the last, breaks and days between sittings included."""
    stages: tuple[StageRow, ...]
    """Every stage with its time from the first; numbers and yes-or-no answers, sizes rounded."""


class ExclusionRow(BaseModel):
    """One use of a rule that leaves out a trial or a person; nothing is deleted by it."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)
    target_kind: Literal["trial", "participant"]
    """What is left out."""
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
    """Why the rule applies here, in the researcher's words."""
    is_undone: bool
    """Whether it was taken back."""


class VerificationRow(AttemptName):
    """What doing one attempt again found."""

    run_no: int
    """Which verification looked, from 1 in order of time."""
    status: Literal["verified", "drift", "failed", "unsupported"]
    """`verified`: all agrees; `drift`: a step leads elsewhere; `failed`: the outcome is not what the events give;
    `unsupported`: the home is not the one of the trial."""
    max_position_error: Metres
    """Largest distance between a stored and a simulated position."""
    first_bad_step: int | None
    """First step that leads elsewhere, 0 = the start; empty unless `drift`."""
    detail: str
    """One sentence about what differs."""
    sim_hash: str
    """Hash of the program and the home with which it was done again."""


def event_rows(name: AttemptName, events: Sequence[StoredEvent]) -> list[EventRow]:
    """One attempt's events with times from its start."""
    first_of_epoch: dict[int, float] = {}
    rows = []
    for stored in events:
        fields = json.loads(event_to_json(stored.event))
        t_cli_ms = fields["t_cli_ms"]
        if t_cli_ms is not None:
            t_cli_ms -= first_of_epoch.setdefault(stored.epoch, t_cli_ms)
        rows.append(
            EventRow(
                participant=name.participant,
                order_no=name.order_no,
                attempt=name.attempt,
                seq=stored.seq,
                epoch=stored.epoch,
                kind=stored.event.kind,
                t_s=fields["t_s"],
                t_cli_ms=t_cli_ms,
                t_srv_s=(stored.t_srv_ns - events[0].t_srv_ns) / 1e9,
                payload={key: _rounded(key, value) for key, value in fields.items() if key not in _COLUMNS},
            )
        )
    return rows


def participant_row(record: ParticipantRecord, trials: Sequence[StoredTrial], *, code: str) -> ParticipantRow:
    """One person's row under a new code."""
    main = [trial for trial in trials if trial.phase == "main"]
    assigned = {trial.order_no for trial in main}
    start = record.stages[0].at_ns if record.stages else None
    return ParticipantRow(
        participant=code,
        task=record.task,
        arm=record.arm,
        conditions=tuple(sorted({trial.condition for trial in main})),
        has_come=record.is_claimed,
        has_consented=record.consents[-1].given if record.consents else None,
        consent_text=record.consents[-1].text_hash if record.consents else None,
        is_withdrawn=record.is_withdrawn,
        last_stage=record.stages[-1].stage if record.stages else None,
        left_by=way_out(record.stages),
        num_assigned=len(assigned),
        num_ended=len({trial.order_no for trial in main if trial.has_ended}),
        time_in_study_s=(record.stages[-1].at_ns - start) / 1e9 if start is not None else None,
        stages=tuple(_stage_row(entry, start or 0) for entry in record.stages),
    )


def exclusion_rows(
    config: StudyConfig, entries: Iterable[ExclusionEntry], names: Mapping[str, AttemptName], codes: Mapping[str, str]
) -> list[ExclusionRow]:
    """Rows of the exclusions of exported trials and people.

    Args:
        config: Names the rules that were written down before data.
        entries: All exclusions, oldest first.
        names: Exported name of each exported attempt, by trial id.
        codes: Exported code of each exported person.
    """
    planned = rules_before_data(config)
    rows = []
    for entry in entries:
        name = names.get(entry.target) if entry.target_kind == "trial" else None
        code = name.participant if name is not None else codes.get(entry.target)
        if code is not None:
            rows.append(
                ExclusionRow(
                    target_kind=entry.target_kind,
                    participant=code,
                    order_no=name.order_no if name is not None else None,
                    attempt=name.attempt if name is not None else None,
                    rule_id=entry.rule_id,
                    is_planned=entry.rule_id in planned,
                    reason=entry.reason,
                    is_undone=entry.is_undone,
                )
            )
    return sorted(rows, key=lambda row: (row.participant, row.order_no or 0, row.attempt or 0))


def verification_rows(entries: Iterable[VerificationEntry], names: Mapping[str, AttemptName]) -> list[VerificationRow]:
    """Rows of the verifications of exported attempts, by attempt and then by time."""
    numbers: dict[str, int] = {}
    rows = []
    for entry in entries:
        run_no = numbers.setdefault(entry.run_id, len(numbers) + 1)
        if entry.trial_id in names:
            name = names[entry.trial_id]
            rows.append(
                VerificationRow(
                    participant=name.participant,
                    order_no=name.order_no,
                    attempt=name.attempt,
                    run_no=run_no,
                    status=entry.status,
                    max_position_error=entry.max_position_error,
                    first_bad_step=entry.first_bad_step,
                    detail=entry.detail,
                    sim_hash=entry.sim_hash,
                )
            )
    return sorted(rows, key=lambda row: (row.participant, row.order_no, row.attempt, row.run_no))


def _stage_row(entry: StageEntry, start_ns: int) -> StageRow:
    flat = {name: inner for value in entry.detail.values() if isinstance(value, dict) for name, inner in value.items()}
    flat |= {name: value for name, value in entry.detail.items() if not isinstance(value, dict)}
    counted = {key: len(value) if isinstance(value, list) else value for key, value in flat.items()}
    detail = {key: _rounded(key, value) for key, value in counted.items() if isinstance(value, bool | int | float)}
    return StageRow(stage=entry.stage, t_s=(entry.at_ns - start_ns) / 1e9, detail=detail)


def _rounded(key: str, value: Any) -> Any:
    """The value, rounded if it is the size of a window."""
    is_size = key in ("width", "height") and isinstance(value, int | float)
    return SIZE_STEP * round(value / SIZE_STEP) if is_size else value
