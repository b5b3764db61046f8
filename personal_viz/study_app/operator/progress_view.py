"""A study's progress in words, as the dashboard and `study status` show it."""

from typing import Literal

import msgspec

from human_study.journey import Place
from human_study.store.database import MIN_FREE_MB
from human_study.store.progress import PersonProgress, State, StudyProgress

_PLACES: dict[Place, str] = {
    "not_arrived": "not arrived",
    "device": "device check",
    "consent": "consent",
    "instructions": "instructions",
    "quiz": "questions",
    "practice": "practice",
    "trial": "trials",
    "break": "break",
    "pause": "between two sittings",
    "ending": "last page",
    "finished": "finished",
    "dropped_out": "dropped out",
    "declined": "declined",
    "withdrawn": "withdrawn",
    "screened_out": "screened out",
    "full": "came to a full study",
}
STATES: dict[State, str] = {
    "active": "active",
    "stuck": "stuck?",
    "away": "away",
    "finished": "finished",
    "out": "out",
    "not_arrived": "not arrived",
}
"""Words for states of participants; states that may need attention come first."""
WorkerState = Literal["serving", "starting", "ended"]


class ShownWorker(msgspec.Struct, frozen=True):
    """A viser process."""

    number: int
    state: WorkerState
    people: int
    """Number of participants connected to it."""


class Serving(msgspec.Struct, frozen=True):
    """Facts that only the process that serves the study knows."""

    workers: tuple[ShownWorker, ...] = ()
    here: frozenset[str] | None = None
    """Participants with an open page; None = not known."""


class ShownPerson(msgspec.Struct, frozen=True):
    """A row of the table of people."""

    code: str
    task: str
    state: State
    state_words: str
    where: str
    trial: str
    """Name of the trial for `study exclude`, such as `p03/12`; empty outside the trials."""
    done: int
    planned: int
    heard: str
    """Time since the last record, in words."""
    here: bool | None
    """Whether a page is open; None = not known."""
    reconnects: int
    technical: int
    abandoned: int


class ShownSlots(msgspec.Struct, frozen=True):
    """A row of the table of episodes."""

    name: str
    split: str
    done: int
    held: int
    free: int
    failed: int


class ShownTime(msgspec.Struct, frozen=True):
    """A point of the timeline."""

    at_ms: int
    """Milliseconds since 1970, as browsers count."""
    done: int


class ShownCount(msgspec.Struct, frozen=True):
    """The number of people in a state."""

    state: State
    words: str
    n: int


class ShownStudy(msgspec.Struct, frozen=True):
    """The whole page."""

    study: str
    version: str
    is_pilot: bool
    now_ms: int
    done: int
    planned: int
    counts: tuple[ShownCount, ...]
    people: tuple[ShownPerson, ...]
    slots: tuple[ShownSlots, ...]
    timeline: tuple[ShownTime, ...]
    free: str
    is_nearly_full: bool
    backups: str
    workers: tuple[ShownWorker, ...]


def shown_study(found: StudyProgress, serving: Serving | None = None) -> ShownStudy:
    """The study's page as of now; `serving` is None outside the process that serves it."""
    serving = serving or Serving()
    disk = found.disk
    return ShownStudy(
        study=found.study,
        version=found.study_version[:12],
        is_pilot=found.is_pilot,
        now_ms=found.now_ns // 10**6,
        done=found.num_done,
        planned=found.num_all,
        counts=tuple(ShownCount(state, words, found.num_in(state)) for state, words in STATES.items()),
        people=tuple(_person(person, serving) for person in found.people),
        slots=tuple(
            ShownSlots(
                f"{slot.task.upper()} {slot.condition}",
                slot.split,
                slot.num_done,
                slot.num_held,
                slot.num_free,
                slot.num_failed,
            )
            for slot in found.slots
        ),
        timeline=tuple(ShownTime(point.at_ns // 10**6, point.num_done) for point in found.timeline),
        free=disk_words(disk.free_mb),
        is_nearly_full=disk.free_mb < MIN_FREE_MB,
        backups=f"{disk.num_backups}, newest {age_words(disk.last_backup_s)} ago" if disk.num_backups else "none yet",
        workers=serving.workers,
    )


def place_words(person: PersonProgress) -> str:
    """The participant's place in words: `trial 3 of 10`."""
    if person.place == "trial" and person.trial_no is not None:
        words = f"trial {person.trial_no} of {person.num_planned}"
        return words if person.is_in_trial else f"before {words}"
    return _PLACES[person.place]


def age_words(seconds: float | None) -> str:
    """A past time in words, in its largest unit; a dash for never."""
    if seconds is None:
        return "–"
    for unit, length_s in (("d", 86_400), ("h", 3600), ("min", 60)):
        if seconds >= 2 * length_s:
            return f"{seconds / length_s:.0f} {unit}"
    return f"{seconds:.0f} s"


def disk_words(free_mb: int) -> str:
    """Free disk space in words."""
    return f"{free_mb / 1024:.1f} GB" if free_mb >= 1024 else f"{free_mb} MB"


def _person(person: PersonProgress, serving: Serving) -> ShownPerson:
    return ShownPerson(
        code=person.code,
        task=person.task.upper(),
        state=person.state,
        state_words=STATES[person.state],
        where=place_words(person),
        trial=f"{person.code}/{person.order_no}" if person.order_no is not None else "",
        done=person.num_done,
        planned=person.num_planned,
        heard=age_words(person.last_activity_s),
        here=None if serving.here is None else person.code in serving.here,
        reconnects=person.num_reconnects,
        technical=person.num_technical,
        abandoned=person.num_abandoned,
    )
