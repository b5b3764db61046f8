"""What a study's database holds, read-only and in one consistent snapshot; also checks that nobody changed it."""

import hashlib
import json
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from sim.errors import StudyError, line_from_validation_error
from sim.tasks.run_files import Answer, EpisodeEnd
from sim.types import EpisodeKey, TaskKind

from .events import Event, event_from_json
from .migrations import APPLICATION_ID, MIGRATIONS
from .outcome import Outcome
from .study import StudyConfig
from .tickets import token_matches

DATABASE_FILE = "study.db"
_RESTORE = "Restore the folder from a backup."


@dataclass(frozen=True, slots=True)
class StoredEvent:
    """An event with what the server added."""

    seq: int
    """Place in the trial, from 1, without gaps."""
    epoch: int
    """Of the tab that sent it."""
    event: Event
    t_srv_ns: int
    """Server's wall clock; a label only."""
    t_srv_mono_ns: int
    """Server's monotonic clock; comparable within one boot."""


@dataclass(frozen=True, slots=True)
class TrialStatus:
    """One planned trial and how far it is."""

    code: str
    """The participant."""
    order_no: int
    """Place in the participant's order, from 1."""
    task: TaskKind
    key: EpisodeKey
    trial_id: str | None
    """None while it was never opened."""
    outcome: Outcome | None
    """None while it has not ended."""


class _OutcomeLine(BaseModel):
    model_config = ConfigDict(frozen=True)
    outcome: EpisodeEnd | Answer = Field(discriminator="kind")


class StudyReader:
    """Reads one snapshot of a study; made by `read_study`."""

    def __init__(self, database: sqlite3.Connection, path: Path) -> None:
        """Reads through a connection that somebody else closes.

        Args:
            database: Connection with an open read transaction.
            path: Of the database, for messages.
        """
        self._database, self._path = database, path

    @property
    def config(self) -> StudyConfig:
        """The study that the records were made under."""
        try:
            return StudyConfig.model_validate_json(self._one("SELECT config FROM study")[0], strict=True)
        except ValidationError as error:
            raise StudyError(line_from_validation_error(f"{self._path}: study", error, advice=_RESTORE)) from None

    @property
    def created_ns(self) -> int:
        """When the study was made: nanoseconds since 1970."""
        return self._one("SELECT created_ns FROM study")[0]

    @property
    def app_version(self) -> str:
        """Version of personal-viz that made the study."""
        return self._one("SELECT app_version FROM study")[0]

    def codes(self) -> tuple[str, ...]:
        """Public codes of all participants, in order."""
        return tuple(row[0] for row in self._all("SELECT code FROM participant ORDER BY code"))

    def code_of_token(self, token: str) -> str | None:
        """The participant who holds this personal token; None if nobody does."""
        found = None
        for code, stored in self._all("SELECT code, token_hash FROM participant ORDER BY code"):
            found = code if token_matches(token, stored) else found
        return found

    def trials(self, code: str) -> tuple[TrialStatus, ...]:
        """All planned trials of a participant in order, each with its latest attempt.

        Raises:
            StudyError: There is no such participant.
        """
        if code not in self.codes():
            raise StudyError(f"{self._path}: found no participant {code!r}; expected one of {list(self.codes())}.")
        rows = self._all(
            "SELECT order_no, task, split, scene, episode_id, trial_id, payload FROM slot"
            " LEFT JOIN trial USING(slot_id) LEFT JOIN outcome USING(trial_id)"
            " WHERE code = ? AND attempt IS (SELECT max(attempt) FROM trial WHERE trial.slot_id = slot.slot_id)"
            " ORDER BY order_no",
            code,
        )
        return tuple(
            TrialStatus(code, row[0], row[1], EpisodeKey(row[2], row[3], row[4]), row[5], self._outcome(row[6]))
            for row in rows
        )

    def events(self, trial_id: str) -> tuple[StoredEvent, ...]:
        """All events of a trial in order; () for an unknown trial.

        Raises:
            StudyError: An event is not one that this version knows.
        """
        rows = self._all(
            "SELECT seq, epoch, payload, t_srv_ns, t_srv_mono_ns FROM event WHERE trial_id = ? ORDER BY seq", trial_id
        )
        return tuple(
            StoredEvent(row[0], row[1], event_from_json(row[2], where=f"{self._path}: {trial_id}/{row[0]}"), *row[3:])
            for row in rows
        )

    def outcome(self, trial_id: str) -> Outcome | None:
        """How the trial ended; None while it has not."""
        rows = self._all("SELECT payload FROM outcome WHERE trial_id = ?", trial_id)
        return self._outcome(rows[0][0]) if rows else None

    def head_hash(self, trial_id: str) -> str | None:
        """Hash of the trial's last event, which stands for all before it; None without events."""
        rows = self._all("SELECT hash FROM event WHERE trial_id = ? ORDER BY seq DESC LIMIT 1", trial_id)
        return rows[0][0] if rows else None

    def check(self) -> int:
        """Check SQLite's own structure and every trial's hash chain; returns the number of events.

        Raises:
            StudyError: Something was damaged or changed; names the first place.
        """
        found = self._one("PRAGMA integrity_check")[0]
        if found != "ok":
            raise StudyError(f"{self._path}: SQLite found damage ({found}); expected 'ok'. {_RESTORE}")
        broken = self._all("PRAGMA foreign_key_check")
        if broken:
            raise StudyError(f"{self._path}: table {broken[0][0]} names a row that is missing. {_RESTORE}")
        heads = self._check_chains(self._one("SELECT study_version FROM study")[0])
        for trial_id, head in self._all("SELECT trial_id, head_hash FROM outcome"):
            if heads.get(trial_id) != head:
                raise StudyError(
                    f"{self._path}: trial {trial_id} ends with another event than when it was finished. {_RESTORE}"
                )
        return self._one("SELECT count(*) FROM event")[0]

    def _check_chains(self, study_version: str) -> dict[str, str]:
        """Last hash of each trial; raises StudyError at the first event that is missing or changed."""
        heads: dict[str, str] = {}
        counts: dict[str, int] = {}
        columns = "trial_id, seq, epoch, kind, t_srv_ns, t_srv_mono_ns, boot_id, payload, prev_hash, hash"
        for row in self._database.execute(f"SELECT {columns} FROM event ORDER BY trial_id, seq"):
            trial_id, seq, *_, prev_hash, stored = row
            expected_prev = heads.get(trial_id, first_hash(study_version, trial_id))
            counts[trial_id] = counts.get(trial_id, 0) + 1
            if (seq, prev_hash, stored) != (counts[trial_id], expected_prev, event_hash(expected_prev, row[:8])):
                raise StudyError(
                    f"{self._path}: trial {trial_id}, event {seq} does not continue the chain after event "
                    f"{counts[trial_id] - 1}; expected rows as they were written. {_RESTORE}"
                )
            heads[trial_id] = stored
        return heads

    def _outcome(self, payload: str | None) -> Outcome | None:
        if payload is None:
            return None
        try:
            return _OutcomeLine.model_validate_json(f'{{"outcome": {payload}}}', strict=True).outcome
        except ValidationError as error:
            raise StudyError(line_from_validation_error(f"{self._path}: outcome", error, advice=_RESTORE)) from None

    def _all(self, query: str, *values: str) -> list[tuple]:
        return self._database.execute(query, values).fetchall()

    def _one(self, query: str) -> tuple:
        rows = self._all(query)
        if not rows:
            raise StudyError(f"{self._path}: found a database without a study; expected one. {_RESTORE}")
        return rows[0]


@contextmanager
def read_study(folder: Path) -> Iterator[StudyReader]:
    """One consistent snapshot of a study, also while another process writes to it.

    Raises:
        StudyError: There is no database, or it cannot be read by this version.
    """
    path = folder / DATABASE_FILE
    if not path.is_file():
        raise StudyError(f"{path}: found no such file; expected a study. Run personal-viz study init first.")
    try:
        database = sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True, isolation_level=None)
        try:
            database.execute("PRAGMA trusted_schema = OFF")
            database.execute("PRAGMA busy_timeout = 5000")
            database.execute("BEGIN")
            version = require_known_version(database, path)
            if version < len(MIGRATIONS):
                raise StudyError(
                    f"{path}: has schema version {version}; expected {len(MIGRATIONS)}. "
                    "Open it once with personal-viz study serve, which brings it up to date."
                )
            yield StudyReader(database, path)
        finally:
            database.close()
    except sqlite3.Error as error:
        raise store_error(path, error) from None


def require_known_version(database: sqlite3.Connection, path: Path) -> int:
    """Schema version of a database of ours; 0 = empty.

    Raises:
        StudyError: Another program's database, or written by a newer version.
    """
    application = database.execute("PRAGMA application_id").fetchone()[0]
    version = database.execute("PRAGMA user_version").fetchone()[0]
    is_empty = database.execute("SELECT count(*) FROM sqlite_schema").fetchone()[0] == 0
    if application != APPLICATION_ID and not (application == 0 and version == 0 and is_empty):
        raise StudyError(
            f"{path}: found a database of another program (application_id {application:#x}); "
            f"expected {APPLICATION_ID:#x}. Give the folder of a study."
        )
    if version > len(MIGRATIONS):
        raise StudyError(
            f"{path}: has schema version {version}; expected at most {len(MIGRATIONS)}. "
            "It was written by a newer personal-viz: use that one."
        )
    return version


def store_error(path: Path, error: sqlite3.Error) -> StudyError:
    """An error of SQLite as one line that says what to do."""
    code = getattr(error, "sqlite_errorcode", 0) & 0xFF
    if code in (sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_CORRUPT):
        return StudyError(f"{path}: found a damaged file ({error}); expected a study's database. {_RESTORE}")
    return StudyError(
        f"{path}: cannot be used ({error}); expected a database on a local disk that you can write. "
        "Check the folder's permissions."
    )


def first_hash(study_version: str, trial_id: str) -> str:
    """What the first event of a trial is chained to."""
    return hashlib.sha256(f"{study_version}/{trial_id}".encode()).hexdigest()


def event_hash(prev_hash: str, row: tuple) -> str:
    """sha256 over the hash before and (trial_id, seq, epoch, kind, t_srv_ns, t_srv_mono_ns, boot_id, payload)."""
    text = json.dumps([prev_hash, *row], separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()
