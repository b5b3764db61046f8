"""The progress of a running study: places of participants, finished and free trials. It never shows results.

Outcomes stay hidden until the collection is over, so that nobody stops it at a convenient moment (HUMAN_STUDY.md,
section 8). Ages use the server's wall clock: people read them, no code decides by them.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from sim.types import SPLITS, Split, TaskKind

from ..design.study import Condition, StudyConfig
from ..journey import GONE, Person, Place, is_refused, journey_of
from .database import BACKUP_FOLDER, free_mb
from .records import DATABASE_FILE, StudyReader

MOST_TIMES = 120
"""Most points of the timeline."""
STUCK_AFTER_S = 180.0
"""Seconds without stored events in a trial after which the participant may need help."""
State = Literal["not_arrived", "refused", "active", "stuck", "away", "finished", "out"]
"""`refused`: the check of the device has failed so far, also for people who went away since, as in the report;
`active`: a record was stored within `lease_s`; `stuck`: in a trial, but silent; `away`: silent for longer."""
# The newest event is read only for running trials: an outcome is newer than the events before it.
_LATEST = """
SELECT code, max(at_ns) FROM (
    SELECT code, at_ns FROM stage
    UNION ALL SELECT code, at_ns FROM consent
    UNION ALL SELECT code, at_ns FROM claim
    UNION ALL SELECT code, max(
        opened_ns,
        coalesce(outcome.at_ns, 0),
        coalesce((SELECT max(sitting.opened_ns) FROM sitting WHERE sitting.trial_id = trial.trial_id), 0),
        CASE WHEN outcome.at_ns IS NULL THEN coalesce((
            SELECT t_srv_ns FROM event WHERE event.trial_id = trial.trial_id ORDER BY seq DESC LIMIT 1
        ), 0) ELSE 0 END
    ) FROM trial JOIN assignment USING(assignment_id) LEFT JOIN outcome USING(trial_id)
) GROUP BY code
"""


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
    """Number of the running or next counted trial, from 1; None outside the trials."""
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


@dataclass(frozen=True, slots=True)
class SlotCount:
    """Counts of the planned trials of one split in one condition."""

    task: TaskKind
    condition: Condition
    split: Split
    num_done: int
    num_held: int
    """Trials that a participant holds and has not finished."""
    num_free: int
    """Trials that were given back and have no new holder."""
    num_failed: int
    """Trials that our failures ended twice, or that were left twice without another taker; nobody gets them again."""

    @property
    def num_all(self) -> int:
        """Number of all planned trials."""
        return self.num_done + self.num_held + self.num_free + self.num_failed


@dataclass(frozen=True, slots=True)
class TimePoint:
    """State of the collection at one time."""

    at_ns: int
    num_done: int
    """Counted trials that were over."""


@dataclass(frozen=True, slots=True)
class DiskState:
    """Disk space of the study, and its backups."""

    free_mb: int
    used_mb: float
    """Space used by the database and its log, MB."""
    num_backups: int
    last_backup_s: float | None
    """Seconds since the newest backup; None = there is none."""


@dataclass(frozen=True, slots=True)
class StudyProgress:
    """The progress of a study; holds no outcome of any trial."""

    study: str
    study_version: str
    is_pilot: bool
    now_ns: int
    num_done: int
    """Counted trials that are over."""
    num_all: int
    """Counted trials in the plan."""
    people: tuple[PersonProgress, ...]
    slots: tuple[SlotCount, ...]
    timeline: tuple[TimePoint, ...]
    """Points in time, oldest first; at most MOST_TIMES."""
    disk: DiskState

    def num_in(self, *states: State) -> int:
        """Number of participants in any of these states."""
        return sum(person.state in states for person in self.people)


def study_progress(reader: StudyReader, *, now_ns: int, stuck_after_s: float = STUCK_AFTER_S) -> StudyProgress:
    """The progress in a snapshot of the study.

    A participant in a trial without stored events for `stuck_after_s` is stuck.
    """
    config = reader.config
    people = reader.participants()
    slots = _slots(people)
    return StudyProgress(
        study=config.study,
        study_version=reader.study_version,
        is_pilot=reader.is_pilot,
        now_ns=now_ns,
        num_done=sum(slot.num_done for slot in slots),
        num_all=sum(slot.num_all for slot in slots),
        people=_people_progress(reader, people, now_ns=now_ns, stuck_after_s=stuck_after_s),
        slots=slots,
        timeline=_timeline(people),
        disk=_disk(reader.folder, now_ns),
    )


def _people_progress(
    reader: StudyReader, people: Sequence[Person], *, now_ns: int, stuck_after_s: float
) -> tuple[PersonProgress, ...]:
    """The progress of each participant; `stuck_after_s` as for `study_progress`."""
    config, ends = reader.config, _ends(reader)
    reconnects = dict(
        reader.rows(
            "SELECT code, count(*) - count(DISTINCT trial_id) FROM sitting JOIN trial USING(trial_id)"
            " JOIN assignment USING(assignment_id) GROUP BY code"
        )
    )
    latest = dict(reader.rows(_LATEST))
    found = []
    for person in people:
        code, journey = person.code, journey_of(config, person)
        due = person.due if journey.place in ("practice", "trial") else None
        is_in_trial = due is not None and due.is_open
        has_next = journey.place == "trial" and journey.num_done < journey.num_all
        silent_s = max(0.0, (now_ns - latest[code]) / 1e9) if code in latest else None
        found.append(
            PersonProgress(
                code=code,
                task=person.task,
                place=journey.place,
                state="refused"
                if is_refused({entry.stage for entry in person.stages})
                else _state(config, journey.place, silent_s, stuck_after_s if is_in_trial else None),
                num_done=sum(trial.is_done for trial in person.trials if trial.phase == "main"),
                num_planned=journey.num_all,
                trial_no=journey.num_done + 1 if has_next else None,
                order_no=due.order_no if due is not None else None,
                is_in_trial=is_in_trial,
                last_activity_s=silent_s,
                num_reconnects=reconnects.get(code, 0),
                num_technical=ends.get((code, "technical"), 0),
                num_abandoned=ends.get((code, "abandoned"), 0),
            )
        )
    return tuple(found)


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


def _ends(reader: StudyReader) -> dict[tuple[str, str], int]:
    """Number of each participant's attempts that failed for technical reasons or were abandoned."""
    rows = reader.rows(
        "SELECT code, end_reason, count(*) FROM outcome JOIN trial USING(trial_id) JOIN assignment USING(assignment_id)"
        " WHERE end_reason IN ('technical', 'abandoned') GROUP BY code, end_reason"
    )
    return {(code, reason): count for code, reason, count in rows}


def _slots(people: Sequence[Person]) -> tuple[SlotCount, ...]:
    """One count for each task, condition and split in the plan."""
    holders = defaultdict(list)
    for person in people:
        for trial in person.trials:
            if trial.phase == "main":
                holders[trial.slot].append(trial)
    counts: dict[tuple[TaskKind, Condition, Split], dict[str, int]] = defaultdict(lambda: defaultdict(int))
    for (task, condition, key, _), trials in holders.items():
        held = next((trial for trial in trials if not trial.is_released), None)
        state = "free" if held is None else "held" if held.is_due else "done" if held.is_done else "failed"
        counts[task, condition, key.split][state] += 1
    return tuple(
        SlotCount(*place, **{f"num_{state}": counts[place][state] for state in ("done", "held", "free", "failed")})
        for place in sorted(counts, key=lambda place: (place[0], place[1], SPLITS.index(place[2])))
    )


def _timeline(people: Sequence[Person]) -> tuple[TimePoint, ...]:
    """Counted trials over time, thinned out; the last point is always kept."""
    ends = sorted(
        trial.ended_ns
        for person in people
        for trial in person.trials
        if trial.phase == "main" and trial.is_done and trial.ended_ns is not None
    )
    points = [TimePoint(at_ns, number) for number, at_ns in enumerate(ends, start=1)]
    every = -(-len(points) // MOST_TIMES) or 1
    return tuple(reversed(points[::-1][::every]))


def _disk(folder: Path, now_ns: int) -> DiskState:
    sizes = [path.stat().st_size for path in (folder / DATABASE_FILE, folder / f"{DATABASE_FILE}-wal") if path.exists()]
    backups = [path.stat().st_mtime_ns for path in (folder / BACKUP_FOLDER).glob("*.db")]
    return DiskState(
        free_mb=free_mb(folder),
        used_mb=round(sum(sizes) / 2**20, 2),
        num_backups=len(backups),
        last_backup_s=max(0.0, (now_ns - max(backups)) / 1e9) if backups else None,
    )
