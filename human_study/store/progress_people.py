"""Where a participant is and whether somebody should look after them, from what is stored alone."""

from dataclasses import dataclass
from typing import Literal

from sim.types import TaskKind

from ..design.study import StudyConfig
from .progress_rows import AssignedTrial, PersonRow
from .stages import has_dropped_out, has_reached, way_out

STUCK_AFTER_S = 180.0
"""Nothing stored for so long in a trial: the participant may need help."""
Place = Literal[
    "not_arrived",
    "device",
    "consent",
    "instructions",
    "quiz",
    "practice",
    "trial",
    "break",
    "pause",
    "ending",
    "finished",
    "dropped_out",
    "declined",
    "withdrawn",
    "screened_out",
    "full",
]
"""`trial`: in a counted or attention trial, or before the next; `pause`: between two sittings; `ending`: all given
trials are over, the last page was not reached yet."""
GONE: tuple[Place, ...] = ("finished", "dropped_out", "declined", "withdrawn", "screened_out", "full")
"""Nobody waits for these."""
State = Literal["not_arrived", "active", "stuck", "away", "finished", "out"]
"""`active`: something was stored within `lease_s`; `stuck`: in a trial, but silent; `away`: silent for longer."""


@dataclass(frozen=True, slots=True)
class PersonProgress:
    """Where one participant is."""

    code: str
    task: TaskKind
    place: Place
    state: State
    num_done: int
    """Counted trials that are over and kept."""
    num_planned: int
    """Counted trials that the participant has, done or not."""
    trial_no: int | None
    """Which of them is next or under way, from 1; None outside the trials."""
    order_no: int | None
    """The same over all phases, as `study exclude` names trials: `p03/12`."""
    is_in_trial: bool
    """Whether a trial is open."""
    last_activity_s: float | None
    """Seconds since anything was stored; None = nothing was."""
    num_reconnects: int
    """How often a trial was opened again."""
    num_technical: int
    """Trials that ended by a failure of ours."""
    num_abandoned: int
    """Trials to which the participant came back too late, or never."""


def place_of(config: StudyConfig, row: PersonRow) -> Place:
    """Where a participant is, from what is stored."""
    out = way_out(row.stages)
    if out is not None:
        return out  # type: ignore[return-value]
    if has_reached(row.stages, "finished"):
        return "finished"
    if has_dropped_out(row.stages):
        return "dropped_out"
    if not row.is_claimed:
        return "not_arrived"
    has_begun = any(trial.is_begun for trial in row.trials)
    passed = {
        "device": has_reached(row.stages, "device_ok"),
        "consent": has_reached(row.stages, "consented"),
        "instructions": has_reached(row.stages, "instructed") or has_begun,
        "quiz": has_reached(row.stages, "quiz_passed"),
    }
    for step in config.flow:
        if not passed[step]:
            return step
    due = _due(row)
    if due is None:
        return "ending"
    if due.phase == "practice":
        return "practice"
    rest = next(
        (entry for entry in reversed(row.stages) if entry.stage in ("break_started", "break_ended", "sitting_started")),
        None,
    )
    if due.is_begun or rest is None or rest.stage != "break_started":
        return "trial"
    return "pause" if rest.detail["sitting"] else "break"


def person_progress(config: StudyConfig, row: PersonRow, *, now_ns: int, stuck_after_s: float) -> PersonProgress:
    """How far one participant is.

    Args:
        config: The study.
        row: What is stored.
        now_ns: The server's wall clock.
        stuck_after_s: Who stores nothing for so long in a trial is stuck.
    """
    place = place_of(config, row)
    due = _due(row)
    counted = [trial for trial in row.trials if trial.phase == "main" and not trial.is_released]
    num_over = sum(trial.end is not None for trial in counted)
    is_in_trial = place in ("practice", "trial") and due is not None and due.is_begun
    silent_s = None if row.last_ns is None else max(0.0, (now_ns - row.last_ns) / 1e9)
    return PersonProgress(
        code=row.code,
        task=row.task,
        place=place,
        state=_state(config, place, silent_s, stuck_after_s if is_in_trial else None),
        num_done=sum(trial.is_done for trial in counted),
        num_planned=len(counted),
        trial_no=num_over + 1 if place == "trial" and num_over < len(counted) else None,
        order_no=due.order_no if due is not None and place in ("practice", "trial") else None,
        is_in_trial=is_in_trial,
        last_activity_s=silent_s,
        num_reconnects=row.num_reconnects,
        num_technical=row.num_technical,
        num_abandoned=row.num_abandoned,
    )


def _state(config: StudyConfig, place: Place, silent_s: float | None, stuck_after_s: float | None) -> State:
    """In a word; `stuck_after_s` is None outside a trial."""
    if place == "finished":
        return "finished"
    if place in GONE:
        return "out"
    if silent_s is None:
        return "not_arrived"
    if silent_s > config.lease_s:
        return "away"
    return "stuck" if stuck_after_s is not None and silent_s > stuck_after_s else "active"


def _due(row: PersonRow) -> AssignedTrial | None:
    return next((trial for trial in row.trials if trial.is_due), None)
