"""The study's one writer: what it acknowledged is committed, synced to disk and can never be changed.

One process holds `study.lock`; one thread owns the only write connection and commits waiting writes together. Every
method may be called from any thread and blocks until its write is on disk.
"""

import fcntl
import os
import platform
import sqlite3
import time
import uuid
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import version as package_version
from pathlib import Path
from typing import IO, Generic, TypeVar

from sim.errors import StudyError
from sim.types import EpisodeKey, TaskKind

from .events import Event, Reconnect, event_to_json
from .migrations import APPLICATION_ID, MIGRATIONS
from .outcome import Outcome
from .plan import PlannedTrial
from .records import (
    DATABASE_FILE,
    StoredEvent,
    StudyReader,
    TrialStatus,
    event_hash,
    first_hash,
    read_study,
    require_known_version,
    store_error,
)
from .study import StudyConfig
from .tickets import new_id

LOCK_FILE = "study.lock"
BACKUP_FOLDER = "backups"
_LARGEST_BATCH = 256
"""Writes in one commit (HUMAN_STUDY.md, section 5)."""
T = TypeVar("T")


class StoreFullError(StudyError):
    """The disk is full or broken: nothing of this write was stored; the same write works once there is space."""


class SupersededError(StudyError):
    """A newer tab drives this trial; nothing was stored."""


class TrialEndedError(StudyError):
    """The trial has its outcome and takes no more events; nothing was stored."""


@dataclass(frozen=True, slots=True)
class Trial:
    """The right to write to a trial until somebody opens it again."""

    trial_id: str
    code: str
    """The participant."""
    order_no: int
    task: TaskKind
    key: EpisodeKey
    epoch: int
    """1 when first opened; pass it with every append."""
    away_s: float
    """Seconds since the trial's last event; 0 without events."""


class _Write(Generic[T]):
    """One waiting write and, later, its answer."""

    def __init__(self, job: Callable[[sqlite3.Connection], T]) -> None:
        self.job = job
        self.answer: list[T] = []
        self.error: StudyError | None = None


class StudyStore:
    """The open store of one study; made by `open_store`, a context manager."""

    def __init__(self, folder: Path, config: StudyConfig, database: sqlite3.Connection, lock: IO[str]) -> None:
        """Takes over a database that is up to date and a lock that is held."""
        self.folder = folder
        self.config = config
        self._path = folder / DATABASE_FILE
        self._database = database
        self._lock = lock
        self._boot_id = _boot_id()
        self._waiting: deque[_Write] = deque()
        self._writer = ThreadPoolExecutor(1, thread_name_prefix="study-store")
        self._is_open = True

    def __enter__(self) -> "StudyStore":
        """The store itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Closes it."""
        self.close()

    def close(self) -> None:
        """Finish waiting writes, close the database and let go of the lock; twice is once."""
        if self._is_open:
            self._is_open = False
            self._writer.shutdown(wait=True)
            self._database.close()
            self._lock.close()

    def add_participant(self, code: str, token_hash: str, trials: Sequence[PlannedTrial]) -> None:
        """Register a participant with the planned trials.

        Raises:
            StudyError: The code or the token is taken, or two trials share a place in the order.
        """

        def job(database: sqlite3.Connection) -> None:
            now_ns = time.time_ns()
            taken = database.execute(
                "SELECT code FROM participant WHERE code = ? OR token_hash = ?", (code, token_hash)
            ).fetchone()
            if taken or len({trial.order_no for trial in trials}) != len(trials):
                raise StudyError(
                    f"{self._path}: participant {code!r} is registered already or has two trials in one place; "
                    "expected a new code and an order without repeats. Make a new plan in a new folder."
                )
            database.execute("INSERT INTO participant VALUES (?, ?, ?)", (code, token_hash, now_ns))
            database.executemany(
                "INSERT INTO slot VALUES (?, ?, ?, ?, ?, ?, ?)",
                [(new_id(), code, trial.order_no, trial.task, *trial.key) for trial in trials],
            )
            _audit(database, "add participant", code)

        self._write(job)

    def open_trial(self, code: str, order_no: int) -> Trial:
        """Begin a planned trial, or take it over: the newest opening writes, older ones are refused from now on.

        A trial that already has events gets the event `reconnect`.

        Raises:
            TrialEndedError: It has its outcome.
            StudyError: The participant has no such trial.
        """
        now = self._now()

        def job(database: sqlite3.Connection) -> Trial:
            slot = database.execute(
                "SELECT slot_id, task, split, scene, episode_id FROM slot WHERE code = ? AND order_no = ?",
                (code, order_no),
            ).fetchone()
            if slot is None:
                raise StudyError(
                    f"{self._path}: participant {code!r} has no trial {order_no}; expected one of the plan's. "
                    "Check the code and the number."
                )
            slot_id, task, *key = slot
            trial_id = self._latest_attempt(database, slot_id, now.wall_ns)
            self._require_running(database, trial_id)
            last_epoch = database.execute("SELECT max(epoch) FROM sitting WHERE trial_id = ?", (trial_id,)).fetchone()[0]
            epoch = (last_epoch or 0) + 1
            database.execute("INSERT INTO sitting VALUES (?, ?, ?)", (trial_id, epoch, now.wall_ns))
            away_s = _seconds_since_last_event(database, trial_id, now)
            if away_s is not None:
                self._insert(database, trial_id, epoch, [Reconnect(epoch=epoch, away_s=away_s)], now)
            return Trial(trial_id, code, order_no, task, EpisodeKey(*key), epoch, away_s or 0.0)

        return self._write(job)

    def append(self, trial_id: str, epoch: int, event: Event) -> int:
        """Store one event; returns its number in the trial. Raises as `append_many`."""
        return self.append_many(trial_id, epoch, (event,))[0]

    def append_many(self, trial_id: str, epoch: int, events: Sequence[Event]) -> tuple[int, ...]:
        """Store events together, all or none; returns their numbers in the trial.

        Raises:
            SupersededError: The trial was opened again after `epoch`.
            TrialEndedError: The trial has its outcome.
            StoreFullError: The disk is full.
            StudyError: There is no such trial, or the store is closed.
        """
        now = self._now()

        def job(database: sqlite3.Connection) -> tuple[int, ...]:
            newest = database.execute("SELECT max(epoch) FROM sitting WHERE trial_id = ?", (trial_id,)).fetchone()[0]
            if newest is None:
                raise StudyError(f"{self._path}: found no trial {trial_id!r}; expected one that open_trial gave.")
            if epoch != newest:
                raise SupersededError(
                    f"trial {trial_id}: epoch is {epoch}; expected {newest}, the newest tab. Continue in that tab."
                )
            self._require_running(database, trial_id)
            return self._insert(database, trial_id, epoch, events, now)

        return self._write(job) if events else ()

    def finish_trial(self, trial_id: str, outcome: Outcome) -> Outcome:
        """Store how a trial ended and close it for good; returns what is stored, which is the first answer ever given.

        Args:
            trial_id: Of an open trial with at least one event.
            outcome: `EpisodeEnd` with measures for PAN, the whole `Answer` for POG.

        Raises:
            StoreFullError: The disk is full.
            StudyError: The trial has no events, or the store is closed.
        """
        now_ns = time.time_ns()
        reason = outcome.reason

        def job(database: sqlite3.Connection) -> None:
            if database.execute("SELECT 1 FROM outcome WHERE trial_id = ?", (trial_id,)).fetchone():
                return
            _, head = _last_event(database, trial_id)
            if head is None:
                raise StudyError(f"{self._path}: trial {trial_id!r} has no events; expected at least 'open'.")
            database.execute(
                "INSERT INTO outcome VALUES (?, ?, ?, ?, ?)",
                (trial_id, reason, outcome.model_dump_json(), head, now_ns),
            )

        self._write(job)
        with read_study(self.folder) as reader:
            stored = reader.outcome(trial_id)
        assert stored is not None
        return stored

    def events(self, trial_id: str) -> tuple[StoredEvent, ...]:
        """All stored events of a trial, in order."""
        with read_study(self.folder) as reader:
            return reader.events(trial_id)

    def trials(self, code: str) -> tuple[TrialStatus, ...]:
        """All planned trials of a participant, in order. Raises StudyError for an unknown participant."""
        with read_study(self.folder) as reader:
            return reader.trials(code)

    def code_of_token(self, token: str) -> str | None:
        """The participant who holds this personal token; None if nobody does."""
        with read_study(self.folder) as reader:
            return reader.code_of_token(token)

    def check(self) -> int:
        """Check the database and all hash chains; returns the number of events. Raises StudyError on damage."""
        with read_study(self.folder) as reader:
            return reader.check()

    def _write(self, job: Callable[[sqlite3.Connection], T]) -> T:
        """Run a write in the writer's thread, together with others that wait; returns when it is on disk."""
        if not self._is_open:
            raise StudyError(f"{self._path}: found a store that is closed; expected an open one. Open it again.")
        write = _Write(job)
        self._waiting.append(write)
        # One writer thread: when this call of _commit_waiting is done, this write was in it or in one before.
        self._writer.submit(self._commit_waiting).result()
        if write.error is not None:
            raise write.error
        return write.answer[0]

    def _commit_waiting(self) -> None:
        while self._waiting:
            batch = [self._waiting.popleft() for _ in range(min(len(self._waiting), _LARGEST_BATCH))]
            try:
                self._database.execute("BEGIN IMMEDIATE")
                for write in batch:
                    self._run(write)
                self._database.execute("COMMIT")
            except sqlite3.Error as error:
                # SQLite may have rolled back by itself; a second ROLLBACK would raise.
                if self._database.in_transaction:
                    self._database.execute("ROLLBACK")
                for write in batch:
                    write.error = self._stopped(error)

    def _run(self, write: _Write) -> None:
        """One write inside the transaction; a refused one leaves no trace and does not stop the others."""
        self._database.execute("SAVEPOINT one_write")
        try:
            write.answer.append(write.job(self._database))
        except StudyError as error:
            self._database.execute("ROLLBACK TO one_write")
            write.error = error
        self._database.execute("RELEASE one_write")

    def _stopped(self, error: sqlite3.Error) -> StudyError:
        if getattr(error, "sqlite_errorcode", 0) & 0xFF in (sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR):
            return StoreFullError(
                f"{self._path}: cannot be written now ({error}); expected free space on the disk. "
                "Nothing was lost: free some space and go on."
            )
        return store_error(self._path, error)

    def _now(self) -> "_Now":
        return _Now(time.time_ns(), time.monotonic_ns(), self._boot_id)

    def _latest_attempt(self, database: sqlite3.Connection, slot_id: str, now_ns: int) -> str:
        row = database.execute(
            "SELECT trial_id FROM trial WHERE slot_id = ? ORDER BY attempt DESC LIMIT 1", (slot_id,)
        ).fetchone()
        if row is not None:
            return row[0]
        trial_id = new_id()
        database.execute("INSERT INTO trial VALUES (?, ?, 1, ?)", (trial_id, slot_id, now_ns))
        return trial_id

    def _require_running(self, database: sqlite3.Connection, trial_id: str) -> None:
        row = database.execute("SELECT end_reason FROM outcome WHERE trial_id = ?", (trial_id,)).fetchone()
        if row is not None:
            raise TrialEndedError(
                f"trial {trial_id}: has ended ({row[0]}); expected a running trial. Open the participant's next trial."
            )

    def _insert(
        self, database: sqlite3.Connection, trial_id: str, epoch: int, events: Sequence[Event], now: "_Now"
    ) -> tuple[int, ...]:
        last_seq, head = _last_event(database, trial_id)
        prev = head or first_hash(self.config.study_version, trial_id)
        rows = []
        for seq, event in enumerate(events, start=last_seq + 1):
            row = (trial_id, seq, epoch, event.kind, now.wall_ns, now.mono_ns, now.boot_id, event_to_json(event))
            digest = event_hash(prev, row)
            rows.append((*row, prev, digest))
            prev = digest
        database.executemany("INSERT INTO event VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)", rows)
        return tuple(row[1] for row in rows)


@dataclass(frozen=True, slots=True)
class _Now:
    wall_ns: int
    mono_ns: int
    boot_id: str
