"""What the dashboard's page is sent: a study's progress in words, and what only the serving process knows."""

from typing import Literal

import msgspec

from human_study.store.database import MIN_FREE_MB
from human_study.store.progress import StudyProgress
from human_study.store.progress_people import PersonProgress, State

from ..gateway.lease_keeper import LeaseKeeper
from ..gateway.workers import Worker, WorkerPool
from ..progress_words import STATES, age_words, disk_words, place_words

WorkerState = Literal["serving", "starting", "ended"]


class ShownWorker(msgspec.Struct, frozen=True):
    """A viser process."""

    number: int
    state: WorkerState
    people: int
    """Participants connected to it."""


class Serving(msgspec.Struct, frozen=True):
    """What only the process that serves the study knows."""

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
    done: int
    planned: int
    heard: str
    """How long ago."""
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
    """How many people are in a state."""

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


def shown_study(found: StudyProgress, serving: Serving) -> ShownStudy:
    """The page of one look."""
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


def serving_of(pool: WorkerPool, keeper: LeaseKeeper) -> Serving:
    """What the serving process knows now."""
    return Serving(tuple(_worker(worker) for worker in list(pool.workers)), keeper.people_here())


def _worker(worker: Worker) -> ShownWorker:
    process = worker.process
    is_alive = process is not None and process.poll() is None
    state = "ended" if not is_alive else "serving" if worker.door is not None else "starting"
    return ShownWorker(worker.number, state, len(worker.codes))


def _person(person: PersonProgress, serving: Serving) -> ShownPerson:
    return ShownPerson(
        code=person.code,
        task=person.task.upper(),
        state=person.state,
        state_words=STATES[person.state],
        where=place_words(person),
        done=person.num_done,
        planned=person.num_planned,
        heard=age_words(person.last_activity_s),
        here=None if serving.here is None else person.code in serving.here,
        reconnects=person.num_reconnects,
        technical=person.num_technical,
        abandoned=person.num_abandoned,
    )
