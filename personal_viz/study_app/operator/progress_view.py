"""A study's progress in words, as the dashboard and `study status` show it."""

from typing import Literal

import msgspec

from human_study.journey import Place
from human_study.store.database import MIN_FREE_MB
from human_study.store.progress import PersonProgress, State, StudyProgress
from sim.words.english import age, disk_size

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
    "survey": "questions after the last trial",
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
    "refused": "device refused",
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


class PersonWords(msgspec.Struct, frozen=True):
    """A participant's progress in words."""

    state: str
    where: str
    trial: str
    """Name of the trial for `study exclude`, such as `p03/12`; empty outside the trials."""
    heard: str
    """Time since the last record."""
    here: bool | None
    """Whether a page is open; None = not known."""


class ShownStudy(msgspec.Struct, frozen=True):
    """The whole page: the progress, and what is said of it in words."""

    progress: StudyProgress
    people: tuple[PersonWords, ...]
    """As many as in `progress.people`, in the same order."""
    counts: tuple[tuple[State, str, int], ...]
    """Each state of participants, its words, and the number of people in it."""
    free: str
    is_nearly_full: bool
    backups: str
    workers: tuple[ShownWorker, ...]


def shown_study(found: StudyProgress, serving: Serving | None = None) -> ShownStudy:
    """The study's page as of now; `serving` is None outside the process that serves it."""
    serving = serving or Serving()
    disk = found.disk
    return ShownStudy(
        progress=found,
        people=tuple(_words(person, serving.here) for person in found.people),
        counts=tuple((state, words, found.num_in(state)) for state, words in STATES.items()),
        free=disk_size(disk.free_mb),
        is_nearly_full=disk.free_mb < MIN_FREE_MB,
        backups=f"{disk.num_backups}, newest {age(disk.last_backup_s)} ago" if disk.num_backups else "none yet",
        workers=serving.workers,
    )


def place_words(person: PersonProgress) -> str:
    """The participant's place in words: `trial 3 of 10`."""
    if person.place == "trial" and person.trial_no is not None:
        words = f"trial {person.trial_no} of {person.num_planned}"
        return words if person.is_in_trial else f"before {words}"
    return _PLACES[person.place]


def _words(person: PersonProgress, here: frozenset[str] | None) -> PersonWords:
    return PersonWords(
        state=STATES[person.state],
        where=place_words(person),
        trial=f"{person.code}/{person.order_no}" if person.order_no is not None else "",
        heard=age(person.last_activity_s),
        here=None if here is None else person.code in here,
    )
