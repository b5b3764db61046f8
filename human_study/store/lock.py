"""`study.lock`: who writes to a study, and how many rows are stored, so that a log that was taken away is noticed.

SQLite keeps the newest rows in `study.db-wal` until it copies them into `study.db`. Without that file the database
looks whole and only older. The lock's second line says how much there was, and `StudyReader.check` compares.
"""

import fcntl
import os
from contextlib import suppress
from pathlib import Path
from typing import IO

from sim.errors import StudyError

from ..private_files import private_folder

LOCK_FILE = "study.lock"
_WIDTH = 20
"""Characters of each line, so that a new number is written over the old one in one call."""


class StudyInUseError(StudyError):
    """Another process has the study open for writing."""

    def __init__(self, folder: Path, holder: str) -> None:
        """Takes the study's folder and the process that holds it."""
        super().__init__(
            f"{folder}: is in use by process {holder}; expected a study that no other process serves. "
            "Stop that process first."
        )
        self.holder = holder


class StudyLock:
    """A held lock; closing it or ending the process releases it."""

    def __init__(self, file: IO[str]) -> None:
        """Takes the open, locked file and writes this process's id into it; the noted rows stay."""
        self._file = file
        os.pwrite(file.fileno(), _line(os.getpid()), 0)

    def note(self, num_rows: int) -> None:
        """Writes down how many rows are stored for good. A full disk changes nothing: the number before it stays."""
        with suppress(OSError):
            os.pwrite(self._file.fileno(), _line(num_rows), len(_line(0)))

    def close(self) -> None:
        """Releases the lock; a second call does nothing."""
        self._file.close()


def take_lock(folder: Path) -> StudyLock:
    """Locks a study's folder, which is made if there is none. Raises StudyInUseError if another process holds it."""
    path = folder / LOCK_FILE
    try:
        private_folder(folder)
        file = os.fdopen(os.open(path, os.O_CREAT | os.O_RDWR, 0o600), "r+", encoding="utf-8")
    except OSError as error:
        raise StudyError(
            f"{path}: cannot be written ({error.strerror}); expected a folder that you can write. Give another folder."
        ) from None
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        holder = file.readline().strip() or "unknown"
        file.close()
        raise StudyInUseError(folder, holder) from None
    return StudyLock(file)


def rows_noted(folder: Path) -> int:
    """The number of rows that a study's database had at least; 0 where nothing (readable) was noted."""
    with suppress(OSError, ValueError, IndexError):
        return int((folder / LOCK_FILE).read_text().splitlines()[1])
    return 0


def _line(number: int) -> bytes:
    return f"{number:<{_WIDTH}}\n".encode()
