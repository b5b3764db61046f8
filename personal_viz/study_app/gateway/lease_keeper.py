"""Gives the episodes of people who have left to others: counts connections, and asks the store who still has work."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from human_study.journey import GONE, Person, Place, journey_of
from human_study.store.leases import Leases
from human_study.store.progress_rows import person_rows
from human_study.store.records import read_study
from human_study.store.store import StudyStore
from sim.errors import StudyError

AWAY = "away"
"""Reason of a release by the keeper."""


class LeaseKeeper:
    """Who is connected, and who has been away for too long; any thread."""

    def __init__(
        self,
        store: StudyStore,
        *,
        tell: Callable[[str], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Nobody is connected; absences count from the first `tick`.

        Args:
            store: Who has which episode.
            tell: One line for the person at the terminal.
            clock: Steady seconds.
        """
        self._store, self._tell, self._clock = store, tell, clock
        config = store.config
        self._lease_s = max(config.lease_s, config.resume_within_s)  # who may still go on keeps the place
        self._leases = Leases(self._lease_s)
        self._lock = threading.Lock()
        has_spare = any(all(trial.phase != "main" for trial in person.trials) for person in store.plan.participants)
        # where everybody does everything, only a spare person could take what is left
        self._can_give = config.design.kind == "house-once" or has_spare

    @contextmanager
    def present(self, code: str) -> Iterator[None]:
        """A participant's connection, from its opening to its end."""
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
        """Look once, and give away what people who have left had."""
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
        """Who has left in the middle of the study."""
        with read_study(self._store.folder) as reader:
            people = [row.person for row in person_rows(reader)]
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
        """Longest absence; whoever was asked to come back later may take that long more."""
        gap_s = self._store.config.breaks.sitting_gap_s if place == "pause" else 0.0
        return self._lease_s + gap_s


def _has_work(person: Person) -> bool:
    return any(trial.phase == "main" and trial.is_due for trial in person.trials)
