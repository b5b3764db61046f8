"""The state of each participant, from stored records alone, so that an operator sees who needs help."""

from dataclasses import dataclass
from typing import Literal

from sim.types import TaskKind

from ..design.study import StudyConfig
from ..journey import GONE, Place, journey_of
from .progress_rows import PersonRow

STUCK_AFTER_S = 180.0
"""Seconds without stored events in a trial after which the participant may need help."""
State = Literal["not_arrived", "active", "stuck", "away", "finished", "out"]
"""`active`: an event was stored within `lease_s`; `stuck`: in a trial, but silent; `away`: silent for longer."""


@dataclass(frozen=True, slots=True)
class PersonProgress:
    """The progress of one participant."""

    code: str
    task: TaskKind
    place: Place
    state: State
    num_done: int
    """Counted trials that are over and kept."""
    num_planned: int
    """Counted trials that the participant has, done or not."""
    trial_no: int | None
    """Number of the next or running counted trial, from 1; None outside the trials."""
    order_no: int | None
    """Number of this trial over all phases, as in `study exclude`: `p03/12`."""
    is_in_trial: bool
    """Whether a trial is open."""
    last_activity_s: float | None
    """Seconds since the last stored record; None = there is none."""
    num_reconnects: int
    """Number of times a trial was opened again."""
    num_technical: int
    """Trials that our failures ended."""
    num_abandoned: int
    """Trials to which the participant came back too late, or never."""


def person_progress(config: StudyConfig, row: PersonRow, *, now_ns: int, stuck_after_s: float) -> PersonProgress:
    """The progress of one participant.

    Args:
        config: The study.
        row: The stored facts.
        now_ns: The server's wall clock.
        stuck_after_s: A participant in a trial without stored events for this long is stuck.
    """
    person = row.person
    journey = journey_of(config, person)
    place = journey.place
    due = person.due if place in ("practice", "trial") else None
    is_in_trial = due is not None and due.is_open
    silent_s = None if row.last_ns is None else max(0.0, (now_ns - row.last_ns) / 1e9)
    return PersonProgress(
        code=person.code,
        task=person.task,
        place=place,
        state=_state(config, place, silent_s, stuck_after_s if is_in_trial else None),
        num_done=sum(trial.is_done for trial in person.trials if trial.phase == "main"),
        num_planned=journey.num_all,
        trial_no=journey.num_done + 1 if place == "trial" and journey.num_done < journey.num_all else None,
        order_no=due.order_no if due is not None else None,
        is_in_trial=is_in_trial,
        last_activity_s=silent_s,
        num_reconnects=row.num_reconnects,
        num_technical=row.num_technical,
        num_abandoned=row.num_abandoned,
    )


def _state(config: StudyConfig, place: Place, silent_s: float | None, stuck_after_s: float | None) -> State:
    """The participant's state; `stuck_after_s` is None outside a trial."""
    if place == "finished":
        return "finished"
    if place in GONE:
        return "out"
    if silent_s is None:
        return "not_arrived"
    if silent_s > config.lease_s:
        return "away"
    return "stuck" if stuck_after_s is not None and silent_s > stuck_after_s else "active"
