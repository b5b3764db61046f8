"""Regular work while a study is served, in one thread: leases, backups, disk space, and the researcher's requests."""

import threading
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from human_study.store.database import MIN_FREE_MB, free_mb
from human_study.store.records import DATABASE_FILE
from human_study.store.requests import take_requests
from human_study.store.store import StudyStore
from sim.errors import StudyError

from .lease_keeper import LeaseKeeper

TICK_S = 15.0
BACKUP_EVERY_S = 600.0
"""Shortest time between two copies of the database."""


class Upkeep:
    """All regular work of a served study."""

    def __init__(
        self,
        store: StudyStore,
        keeper: LeaseKeeper,
        *,
        tell: Callable[[str], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Does nothing yet; the present state of the database counts as copied.

        Args:
            store: The open store.
            keeper: Knows who is connected.
            tell: Writes one line for the person at the terminal.
            clock: Seconds of a steady clock.
        """
        self._store, self._keeper, self._tell, self._clock = store, keeper, tell, clock
        self._copied, self._copied_s = self._state(), clock()
        self._has_warned = False

    def tick(self) -> None:
        """Does one round; a part that fails is reported and tried again in a later round."""
        for work in (
            self._look_after_log,  # first: what reads cannot open a database without its log
            self._do_requests,
            self._keeper.tick,
            self._back_up,
            self._look_at_disk,
        ):
            try:
                work()
            except StudyError as error:
                self._tell(str(error))
            except Exception as error:  # the thread's door: leases and backups must go on as long as the study does
                traceback.print_exc()
                self._tell(f"{self._store.folder}: looking after the study failed ({error!r}); it is tried again.")

    def end(self) -> None:
        """Looks after the log once more, and makes a last copy if anything was written since the one before."""
        try:
            self._look_after_log()
            self._copy()
        except StudyError as error:
            self._tell(str(error))

    def _do_requests(self) -> None:
        """Does the changes that the researcher requested with a command: withdrawals and exclusions."""
        for line in take_requests(self._store):
            self._tell(line)

    def _look_after_log(self) -> None:
        if line := self._store.look_after_log():
            self._tell(line)

    def _back_up(self) -> None:
        if self._clock() - self._copied_s >= BACKUP_EVERY_S:
            self._copy()

    def _copy(self) -> None:
        """Copies the database if anything was written since the last copy; raises StudyError if it cannot."""
        state = self._state()
        if state != self._copied:
            self._copied_s = self._clock()  # a copy that fails is tried again after the same time
            self._store.back_up()
            self._copied = state

    def _state(self) -> tuple[tuple[int, int], ...]:
        """A value that changes with every write."""
        path = self._store.folder / DATABASE_FILE
        files = [path, path.with_name(f"{path.name}-wal")]
        return tuple((stat.st_size, stat.st_mtime_ns) for stat in (file.stat() for file in files if file.exists()))

    def _look_at_disk(self) -> None:
        """Reports once each time that the disk gets nearly full."""
        found = free_mb(self._store.folder)
        is_low = found < MIN_FREE_MB
        if is_low and not self._has_warned:
            self._tell(f"{self._store.folder}: its disk has {found} MB free; free some space soon. The study goes on.")
        self._has_warned = is_low


@contextmanager
def upkeep(
    store: StudyStore, keeper: LeaseKeeper, *, tell: Callable[[str], None], tick_s: float = TICK_S
) -> Iterator[None]:
    """Looks after a study in a thread of its own until the end of the block."""
    rounds, is_over = Upkeep(store, keeper, tell=tell), threading.Event()

    def run() -> None:
        while not is_over.is_set():
            rounds.tick()
            is_over.wait(tick_s)

    thread = threading.Thread(target=run, daemon=True, name="upkeep")
    thread.start()
    try:
        yield
    finally:
        is_over.set()
        thread.join()
        rounds.end()
