"""Gives the episodes of people who have left to others: counts connections, and asks the store who still has work.

Absences are kept in memory and counted by a steady clock: jumps of the wall clock change nothing, and a restarted
program counts from its start, so a restart takes no participant's place away.
"""

import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from human_study.journey import GONE, Person, journey_of
from human_study.store.records import read_study
from human_study.store.store import StudyStore
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
        self._lock = threading.Lock()
        self._num_open: Counter[str] = Counter()
        """Open connections of each participant who has any."""
        self._away_since_s: dict[str, float] = {}
        """Start of the absence of each participant who is awaited but not connected."""
        has_spare = any(all(trial.phase != "main" for trial in person.trials) for person in store.plan.participants)
        # where everybody does everything, only a spare person could take the remaining trials
        self._can_give = config.design.kind == "house-once" or has_spare

    @contextmanager
    def present(self, code: str) -> Iterator[None]:
        """Counts a participant's connection until the end of the block; the absence begins when the last one ends."""
        with self._lock:
            self._num_open[code] += 1
            self._away_since_s.pop(code, None)
        try:
            yield
        finally:
            with self._lock:
                self._num_open[code] -= 1
                if not self._num_open[code]:
                    del self._num_open[code]
                    self._away_since_s[code] = self._clock()

    def people_here(self) -> frozenset[str]:
        """Participants with an open connection."""
        with self._lock:
            return frozenset(self._num_open)

    def tick(self) -> None:
        """Looks once, and gives the episodes of people who have left to others."""
        if not self._can_give:
            return
        try:
            for code, allowed_s in self._awaited().items():
                with self._lock:  # only now, because people may come back while we look at the others
                    since_s = self._away_since_s.get(code)
                    if since_s is None or self._clock() - since_s <= allowed_s:
                        continue
                if self._store.drop_out(code, AWAY):
                    self._tell(f"{code} has been away for {self._lease_s / 60:.0f} minutes: others get what is left")
                with self._lock:
                    self._away_since_s.pop(code, None)
        except StudyError as error:
            self._tell(str(error))

    def _awaited(self) -> dict[str, float]:
        """Everybody in the middle of the study, with the longest absence (seconds); other absences are forgotten."""
        with read_study(self._store.folder) as reader:
            people = reader.participants()
        allowed_s = {person.code: self._allowed_s(person) for person in people}
        awaited = {code: seconds for code, seconds in sorted(allowed_s.items()) if seconds is not None}
        with self._lock:
            now_s = self._clock()
            known = self._away_since_s
            self._away_since_s = {code: known.get(code, now_s) for code in awaited if code not in self._num_open}
        return awaited

    def _allowed_s(self, person: Person) -> float | None:
        """The longest absence of a participant, seconds; None where nobody waits for the participant's trials.

        People who were asked to come back later have that much more time.
        """
        place = journey_of(self._store.config, person).place
        has_work = any(trial.phase == "main" and trial.is_due for trial in person.trials)
        if not has_work or place == "not_arrived" or place in GONE:
            return None
        return self._lease_s + (self._store.config.breaks.sitting_gap_s if place == "pause" else 0.0)
