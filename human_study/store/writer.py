"""The one thread that writes to a study's database; it commits waiting writes together."""

import os
import sqlite3
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Generic, TypeVar

from sim.errors import StudyError

from .lock import StudyLock
from .records import store_error

_LARGEST_BATCH = 256
"""Most writes in one commit (HUMAN_STUDY.md, section 5)."""
_NO_SPACE = sqlite3.SQLITE_FULL
_LATER = (
    sqlite3.SQLITE_IOERR,
    sqlite3.SQLITE_READONLY,  # a disk with errors, which the system then mounts read-only
    sqlite3.SQLITE_CANTOPEN,
    sqlite3.SQLITE_NOMEM,
    sqlite3.SQLITE_BUSY,  # another program holds the file for longer than busy_timeout
    sqlite3.SQLITE_LOCKED,
)
"""Errors that may be over when the same write is tried again: the study pauses."""
_WRITABLE = ("a disk that can be written", "look at the disk and its free space")
T = TypeVar("T")


class StoreFullError(StudyError):
    """The disk is full or cannot be written: nothing of this write was stored; it can be tried again later."""


class _Write(Generic[T]):
    """One waiting write and, later, its result."""

    def __init__(self, job: Callable[[sqlite3.Connection], T]) -> None:
        self.job = job
        self.answer: list[T] = []
        self.error: Exception | None = None
        self.is_stored = False


class GroupWriter:
    """Runs writes from any thread, one after the other, in transactions that may hold several."""

    def __init__(self, database: sqlite3.Connection, path: Path, lock: StudyLock, *, num_rows: int) -> None:
        """Starts the thread; from now on only this writer uses the connection, which is in autocommit mode.

        Notes the number of rows, which it takes from the caller, in the lock after each commit.
        """
        self._database, self._path, self._lock, self._num_rows = database, path, lock, num_rows
        self._log_path = path.with_name(f"{path.name}-wal")
        self._log_id: tuple[int, int] | None = None
        """Device and number of the database's log; None before the first commit."""
        self.num_lost_logs = 0
        """How often the log was taken away and the database saved anew."""
        lock.note(num_rows)
        self._waiting: deque[_Write] = deque()
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="study-writer")
        self._is_open = True

    def close(self) -> None:
        """Finishes waiting writes and ends the thread; a second call does nothing."""
        self._is_open = False
        self._thread.shutdown(wait=True)

    def write(self, job: Callable[[sqlite3.Connection], T]) -> T:
        """Runs a write in the writer's thread, together with other waiting ones; returns when it is on disk.

        An error of the job is raised only here: the other writes are stored.
        """
        if not self._is_open:
            raise StudyError(f"{self._path}: found a store that is closed; expected an open one. Open it again.")
        write = _Write(job)
        self._waiting.append(write)
        # One writer thread: when this call of _commit_waiting is done, this write was in it or in one before.
        self._thread.submit(self._commit_waiting).result()
        if write.error is not None:
            raise write.error
        if not write.is_stored:
            raise StudyError(f"{self._path}: another write of the same commit failed; nothing was stored. Try again.")
        return write.answer[0]

    def _commit_waiting(self) -> None:
        while self._waiting:
            batch = [self._waiting.popleft() for _ in range(min(len(self._waiting), _LARGEST_BATCH))]
            try:
                self._database.execute("BEGIN IMMEDIATE")
                added = sum(self._run(write) for write in batch)
                self._database.execute("COMMIT")
                self._num_rows += added
                self._keep_log()
                self._lock.note(self._num_rows)
                for write in batch:
                    write.is_stored = True
            except sqlite3.Error as error:
                for write in batch:
                    write.error = self._stopped(error)
            finally:
                # SQLite may have rolled back by itself; a second ROLLBACK would raise.
                if self._database.in_transaction:
                    self._database.execute("ROLLBACK")

    def _keep_log(self) -> None:
        """Saves the database anew if its log was taken away: rows that are only in the log would end with this process.

        Raises:
            sqlite3.Error: They cannot be saved now.
        """
        found = None
        with suppress(OSError):
            stat = os.stat(self._log_path)
            found = (stat.st_dev, stat.st_ino)
        if found is not None and self._log_id in (None, found):
            self._log_id = found
            return
        if self._database.execute("PRAGMA wal_checkpoint(FULL)").fetchone()[0]:
            error = sqlite3.OperationalError(f"{self._log_path.name} was taken away while others read the database")
            error.sqlite_errorcode = sqlite3.SQLITE_BUSY
            raise error
        with suppress(sqlite3.OperationalError):  # somebody reads just now: all is in the file, the log comes later
            self._database.execute("PRAGMA journal_mode = DELETE")
            self._database.execute("PRAGMA journal_mode = WAL")
            self._log_id = None
        self.num_lost_logs += 1

    def _run(self, write: _Write) -> int:
        """Runs one write inside the transaction and returns the number of its new rows.

        A refused write leaves no trace and does not stop the others.
        """
        before = self._database.total_changes
        self._database.execute("SAVEPOINT one_write")
        try:
            write.answer.append(write.job(self._database))
            added = self._database.total_changes - before
        except sqlite3.Error as error:
            if not isinstance(error, sqlite3.IntegrityError) and self._concerns_all(error):
                raise
            self._database.execute("ROLLBACK TO one_write")
            write.error, added = store_error(self._path, error), 0
        except Exception as error:  # a plug-in call: only the job's own caller gets the error
            self._database.execute("ROLLBACK TO one_write")
            write.error, added = error, 0
        self._database.execute("RELEASE one_write")
        return added

    def _concerns_all(self, error: sqlite3.Error) -> bool:
        """Whether no write of the transaction can be stored, because the disk is the reason and not this write."""
        code = getattr(error, "sqlite_errorcode", 0) & 0xFF
        return code == _NO_SPACE or code in _LATER or not self._database.in_transaction

    def _stopped(self, error: sqlite3.Error) -> StudyError:
        code = getattr(error, "sqlite_errorcode", 0) & 0xFF
        if code == _NO_SPACE or code in _LATER:
            wanted, advice = ("free space on the disk", "free some space") if code == _NO_SPACE else _WRITABLE
            return StoreFullError(
                f"{self._path}: cannot be written now ({error}); expected {wanted}. "
                f"Nothing was lost: {advice} and go on."
            )
        return store_error(self._path, error)
