"""Gives the episodes of people who have left to others: counts connections, and asks the store who still has work.

Absences are kept in memory and counted by a steady clock: jumps of the wall clock change nothing, and a restarted
program counts from its start, so a restart takes no participant's place away.
"""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from human_study.journey import GONE, Person, Place, journey_of
from human_study.store.records import read_study
from human_study.store.store import StudyStore
from human_study.store.stored_people import stored_people
from sim.errors import StudyError

AWAY = "away"
"""Reason of a release by the keeper."""


class LeaseKeeper:
    """Knows who is connected and who has been away for too long; any thread may call it."""

    def __init__(
        self,
        store: StudyStore,
        *,
        tell: Callable[[str], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Starts with nobody connected; absences count from the first `tick`.

        Args:
            store: The study's store; it knows the holder of each episode.
            tell: Writes one line for the person at the terminal.
            clock: Seconds of a steady clock.
        """
        self._store, self._tell, self._clock = store, tell, clock
        config = store.config
        self._lease_s = max(config.lease_s, config.resume_within_s)  # a participant who may still go on keeps the place
        self._leases = Leases(self._lease_s)
        self._lock = threading.Lock()
        has_spare = any(all(trial.phase != "main" for trial in person.trials) for person in store.plan.participants)
        # where everybody does everything, only a spare person could take the remaining trials
        self._can_give = config.design.kind == "house-once" or has_spare

    @contextmanager
    def present(self, code: str) -> Iterator[None]:
        """Counts a participant's connection until the end of the block."""
        with self._lock:
            self._leases.here(code, self._clock())
        try:
            yield
        finally:
            with self._lock:
                self._leases.left(code, self._clock())

    def people_here(self) -> frozenset[str]:
        """Participants with an open connection."""
        with self._lock:
            return self._leases.present()

    def tick(self) -> None:
        """Looks once, and gives the episodes of people who have left to others."""
        if not self._can_give:
            return
        try:
            for code in self._find_expired():
                with self._lock:
                    if code not in self._leases.expired(self._clock()):
                        continue  # came back while we looked at the others
                if self._store.drop_out(code, AWAY):
                    self._tell(f"{code} has been away for {self._lease_s / 60:.0f} minutes: others get what is left")
                with self._lock:
                    self._leases.forget(code)
        except StudyError as error:
            self._tell(str(error))

    def _find_expired(self) -> tuple[str, ...]:
        """Codes of people who have left in the middle of the study."""
        with read_study(self._store.folder) as reader:
            people = stored_people(reader)
        waiting: dict[str, Place] = {}
        for person in people:
            place = journey_of(self._store.config, person).place
            if _has_work(person) and place != "not_arrived" and place not in GONE:
                waiting[person.code] = place
        with self._lock:
            now_s = self._clock()
            for person in people:
                if person.code in waiting:
                    self._leases.expect(person.code, now_s)
                else:
                    self._leases.forget(person.code)
            return tuple(
                code
                for code in self._leases.expired(now_s)
                if code in waiting and self._leases.away_s(code, now_s) > self._allowed_s(waiting[code])
            )

    def _allowed_s(self, place: Place) -> float:
        """Longest absence, seconds; people who were asked to come back later have that much more time."""
        gap_s = self._store.config.breaks.sitting_gap_s if place == "pause" else 0.0
        return self._lease_s + gap_s


def _has_work(person: Person) -> bool:
    return any(trial.phase == "main" and trial.is_due for trial in person.trials)


@dataclass(slots=True)
class _Lease:
    num_open: int
    away_since_s: float


class Leases:
    """Open connections of participants, and the start of each absence; for one thread at a time."""

    def __init__(self, lease_s: float) -> None:
        """Starts without participants.

        Args:
            lease_s: Longest absence in seconds; a participant who is away longer has left.
        """
        self._lease_s = lease_s
        self._leases: dict[str, _Lease] = {}

    def here(self, code: str, now_s: float) -> None:
        """A participant opened a connection; the participant's other open connections stay counted."""
        self._lease(code, now_s).num_open += 1

    def left(self, code: str, now_s: float) -> None:
        """A participant's connection ended; the participant is away only if it was the last one."""
        lease = self._lease(code, now_s)
        lease.num_open = max(0, lease.num_open - 1)
        lease.away_since_s = now_s

    def expect(self, code: str, now_s: float) -> None:
        """A participant has begun, so absences count from now on; changes nothing for a known participant."""
        self._lease(code, now_s)

    def forget(self, code: str) -> None:
        """The participant has finished or is out; after a return the count starts again."""
        if code in self._leases and not self._leases[code].num_open:
            del self._leases[code]

    def is_here(self, code: str) -> bool:
        """Whether the participant has an open connection."""
        return code in self._leases and self._leases[code].num_open > 0

    def present(self) -> frozenset[str]:
        """Codes of all participants with an open connection."""
        return frozenset(code for code, lease in self._leases.items() if lease.num_open)

    def away_s(self, code: str, now_s: float) -> float:
        """Seconds since the participant left; 0 for a connected or unknown participant."""
        lease = self._leases.get(code)
        return 0.0 if lease is None or lease.num_open else max(0.0, now_s - lease.away_since_s)

    def expired(self, now_s: float) -> tuple[str, ...]:
        """Codes of participants without an open connection whose lease has ended, in order."""
        return tuple(sorted(code for code in self._leases if self.away_s(code, now_s) > self._lease_s))

    def _lease(self, code: str, now_s: float) -> _Lease:
        return self._leases.setdefault(code, _Lease(0, now_s))
