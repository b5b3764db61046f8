"""Reads a study's database in one consistent snapshot, and checks that nobody changed it."""

import hashlib
import json
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from sim.errors import StudyError, line_from_validation_error
from sim.tasks.run_files import Answer, EpisodeEnd
from sim.types import EpisodeKey

from ..design.plan import StudyPlan
from ..design.secrets import token_matches
from ..design.study import StudyConfig
from ..trial.events import Event, event_from_json
from ..trial.outcome import Outcome
from .migrations import APPLICATION_ID, FIRST_VERSION, SCHEMA_VERSION
from .record_types import (
    ConsentEntry,
    ExclusionEntry,
    ParticipantRecord,
    StageEntry,
    StoredEvent,
    StoredTrial,
    VerificationEntry,
)
from .vault import Vault

DATABASE_FILE = "study.db"
AUDIT_PILOT = "served as a pilot"
_RESTORE = "Restore the folder from a backup."


class _OutcomeLine(BaseModel):
    model_config = ConfigDict(frozen=True)
    outcome: EpisodeEnd | Answer = Field(discriminator="kind")


class StudyReader:
    """Reads one snapshot of a study; made by `read_study`."""

    def __init__(self, database: sqlite3.Connection, path: Path) -> None:
        """Takes a connection that the caller closes.

        Args:
            database: Connection with an open read transaction.
            path: Path of the database, for messages.
        """
        self._database, self._path = database, path

    @property
    def folder(self) -> Path:
        """The study's folder."""
        return self._path.parent

    def rows(self, query: str, *values: str) -> list[tuple]:
        """Rows of one of our queries, for summaries without decrypted data."""
        return self._all(query, *values)

    @property
    def config(self) -> StudyConfig:
        """The study of these records."""
        try:
            return StudyConfig.model_validate_json(self._one("SELECT config FROM study")[0], strict=True)
        except ValidationError as error:
            raise StudyError(line_from_validation_error(f"{self._path}: study", error, advice=_RESTORE)) from None

    @property
    def study_version(self) -> str:
        """Hash of the frozen study; all chains begin with it."""
        return self._one("SELECT study_version FROM study")[0]

    @property
    def plan(self) -> StudyPlan:
        """The plan that was frozen with the study."""
        try:
            return StudyPlan.model_validate_json(self._one("SELECT plan FROM study")[0], strict=True)
        except ValidationError as error:
            raise StudyError(line_from_validation_error(f"{self._path}: plan", error, advice=_RESTORE)) from None

    @property
    def is_pilot(self) -> bool:
        """Whether the study was planned as a pilot, or ever served without an ethics id."""
        return self.plan.is_pilot or bool(self._all("SELECT 1 FROM audit WHERE action = ?", AUDIT_PILOT))

    @property
    def created_ns(self) -> int:
        """Time at which the study was made: nanoseconds since 1970."""
        return self._one("SELECT created_ns FROM study")[0]

    @property
    def app_version(self) -> str:
        """Version of personal-viz that made the study."""
        return self._one("SELECT app_version FROM study")[0]

    def codes(self) -> tuple[str, ...]:
        """Public codes of all participants, in order."""
        return tuple(row[0] for row in self._all("SELECT code FROM participant ORDER BY code"))

    def code_of_token(self, token: str) -> str | None:
        """Code of the participant with this personal token; None if there is none."""
        found = None
        for code, stored in self._all("SELECT code, token_hash FROM participant ORDER BY code"):
            found = code if token_matches(token, stored) else found
        return found

    def participant(self, code: str) -> ParticipantRecord:
        """One participant with all stages and answers about consent.

        Raises:
            StudyError: There is no such participant.
        """
        rows = self._all(
            "SELECT task, arm, participant.created_ns, claim.code IS NOT NULL FROM participant LEFT JOIN claim"
            " USING(code) WHERE participant.code = ?",
            code,
        )
        if not rows:
            raise StudyError(f"{self._path}: found no participant {code!r}; expected one of {list(self.codes())}.")
        task, arm, created_ns, is_claimed = rows[0]
        stages = self._all("SELECT stage, detail, at_ns FROM stage WHERE code = ? ORDER BY seq", code)
        consents = self._all("SELECT text_hash, given, at_ns FROM consent WHERE code = ? ORDER BY seq", code)
        return ParticipantRecord(
            code=code,
            task=task,
            arm=arm,
            created_ns=created_ns,
            is_claimed=bool(is_claimed) or bool(stages),
            is_shredded=self._is_shredded(code),
            stages=tuple(StageEntry(stage, json.loads(detail), at_ns) for stage, detail, at_ns in stages),
            consents=tuple(ConsentEntry(text_hash, bool(given), at_ns) for text_hash, given, at_ns in consents),
        )

    def trials(self, code: str) -> tuple[StoredTrial, ...]:
        """All assigned trials of a participant in order, each with all its attempts.

        Raises:
            StudyError: There is no such participant.
        """
        if not self._all("SELECT 1 FROM participant WHERE code = ?", code):
            raise StudyError(f"{self._path}: found no participant {code!r}; expected one of {list(self.codes())}.")
        rows = self._all(
            "SELECT order_no, phase, task, condition, split, scene, episode_id, rep, made_by, attempt, trial_id,"
            " outcome.payload, release.at_ns IS NOT NULL, opened_ns, prior_visits_scene, prior_visits_split,"
            " secs_in_scene_before FROM assignment LEFT JOIN trial USING(assignment_id) LEFT JOIN outcome"
            " USING(trial_id) LEFT JOIN release ON release.assignment_id = assignment.assignment_id"
            " WHERE code = ? ORDER BY order_no, attempt",
            code,
        )
        is_shredded = self._is_shredded(code)
        return tuple(
            StoredTrial(
                code=code,
                order_no=row[0],
                phase=row[1],
                task=row[2],
                condition=row[3],
                key=EpisodeKey(*row[4:7]),
                rep=row[7],
                made_by=row[8],
                attempt=row[9] or 0,
                trial_id=row[10],
                outcome=None if is_shredded else self._outcome(code, row[10], row[11]),
                has_ended=row[11] is not None,
                is_released=bool(row[12]),
                is_shredded=is_shredded,
                opened_ns=row[13],
                prior_visits_scene=row[14],
                prior_visits_split=row[15],
                secs_in_scene_before=row[16],
            )
            for row in rows
        )

    def events(self, trial_id: str) -> tuple[StoredEvent, ...]:
        """All events of a trial in order; () for an unknown trial, and where the participant's key is deleted.

        Raises:
            StudyError: An event is unknown to this version.
        """
        code = self._code_of_trial(trial_id)
        if code is None or self._is_shredded(code):
            return ()
        rows = self._all(
            "SELECT seq, epoch, payload, t_srv_ns, t_srv_mono_ns FROM event WHERE trial_id = ? ORDER BY seq", trial_id
        )
        return tuple(
            StoredEvent(seq, epoch, self._event(code, f"{trial_id}/{seq}", payload), wall_ns, mono_ns)
            for seq, epoch, payload, wall_ns, mono_ns in rows
        )

    def outcome(self, trial_id: str) -> Outcome | None:
        """The trial's outcome; None until it has ended, and where the participant's key is deleted."""
        rows = self._all("SELECT payload FROM outcome WHERE trial_id = ?", trial_id)
        code = self._code_of_trial(trial_id)
        if not rows or code is None or self._is_shredded(code):
            return None
        return self._outcome(code, trial_id, rows[0][0])

    def verifications(self) -> tuple[VerificationEntry, ...]:
        """All results of doing trials again, oldest first."""
        columns = "trial_id, run_id, status, max_position_error, first_bad_step, detail, sim_hash, at_ns"
        return tuple(
            VerificationEntry(*row)
            for row in self._all(f"SELECT {columns} FROM verification ORDER BY at_ns, trial_id, run_id")
        )

    def exclusions(self) -> tuple[ExclusionEntry, ...]:
        """All exclusions, oldest first, including undone ones."""
        rows = self._all(
            "SELECT exclusion_id, target_kind, target, rule_id, reason, exclusion.at_ns, exclusion_undone.at_ns IS NOT"
            " NULL FROM exclusion LEFT JOIN exclusion_undone USING(exclusion_id) ORDER BY exclusion.rowid"
        )
        return tuple(ExclusionEntry(*row[:6], is_undone=bool(row[6])) for row in rows)

    def num_events(self, code: str) -> int:
        """Number of events in a participant's trials."""
        query = "SELECT count(*) FROM event JOIN trial USING(trial_id) JOIN assignment USING(assignment_id)"
        return self._all(f"{query} WHERE code = ?", code)[0][0]

    def head_hash(self, trial_id: str) -> str | None:
        """Hash of the trial's last event, which covers all events before it; None without events."""
        rows = self._all("SELECT hash FROM event WHERE trial_id = ? ORDER BY seq DESC LIMIT 1", trial_id)
        return rows[0][0] if rows else None

    def check(self) -> int:
        """Checks SQLite's own structure and every trial's hash chain; returns the number of events.

        Raises:
            StudyError: A record was damaged or changed; the message names the first place.
        """
        found = self._one("PRAGMA integrity_check")[0]
        if found != "ok":
            raise StudyError(f"{self._path}: SQLite found damage ({found}); expected 'ok'. {_RESTORE}")
        broken = self._all("PRAGMA foreign_key_check")
        if broken:
            raise StudyError(f"{self._path}: table {broken[0][0]} names a row that is missing. {_RESTORE}")
        heads = self._check_chains(self.study_version)
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

    @cached_property
    def _vault(self) -> Vault:
        return Vault(self._path.parent)

    def _is_shredded(self, code: str) -> bool:
        """Whether the participant's data was deleted; a key that is merely lost is an error when data is read."""
        if self._vault.has_key(code):
            return False
        withdrew = self._all("SELECT 1 FROM stage WHERE code = ? AND stage = 'withdrawn'", code)
        return self._vault.is_shredded(code) or bool(withdrew)

    def _code_of_trial(self, trial_id: str) -> str | None:
        rows = self._all("SELECT code FROM trial JOIN assignment USING(assignment_id) WHERE trial_id = ?", trial_id)
        return rows[0][0] if rows else None

    def _event(self, code: str, place: str, payload: str) -> Event:
        return event_from_json(self._vault.open(code, payload, where=place), where=f"{self._path}: {place}")

    def _outcome(self, code: str, trial_id: str, payload: str | None) -> Outcome | None:
        if payload is None:
            return None
        payload = self._vault.open(code, payload, where=f"{trial_id}/outcome")
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
    """One consistent snapshot of a study, even while another process writes to it.

    Raises:
        StudyError: There is no database, or this version cannot read it.
    """
    path = folder / DATABASE_FILE
    if not path.is_file():
        raise StudyError(
            f"{path}: found no such file; expected a study that was served. Run personal-viz study serve first."
        )
    try:
        database = sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True, isolation_level=None)
        try:
            database.execute("PRAGMA trusted_schema = OFF")
            database.execute("PRAGMA busy_timeout = 5000")
            database.execute("BEGIN")
            version = require_known_version(database, path)
            if version < SCHEMA_VERSION:
                raise StudyError(
                    f"{path}: has schema version {version}; expected {SCHEMA_VERSION}. "
                    "personal-viz study check-db brings it up to date, with a backup."
                )
            yield StudyReader(database, path)
        finally:
            database.close()
    except sqlite3.Error as error:
        raise store_error(path, error) from None


def require_known_version(database: sqlite3.Connection, path: Path) -> int:
    """Schema version of one of our databases; 0 = empty.

    Raises:
        StudyError: The database is of another program, of a newer version, or of before the first release.
    """
    application = database.execute("PRAGMA application_id").fetchone()[0]
    version = database.execute("PRAGMA user_version").fetchone()[0]
    is_empty = database.execute("SELECT count(*) FROM sqlite_schema").fetchone()[0] == 0
    if application != APPLICATION_ID and not (application == 0 and version == 0 and is_empty):
        raise StudyError(
            f"{path}: found a database of another program (application_id {application:#x}); "
            f"expected {APPLICATION_ID:#x}. Give the folder of a study."
        )
    if version > SCHEMA_VERSION:
        raise StudyError(
            f"{path}: has schema version {version}; expected at most {SCHEMA_VERSION}. "
            "It was written by a newer personal-viz: use that one."
        )
    if 0 < version < FIRST_VERSION:
        raise StudyError(
            f"{path}: has schema version {version}; expected at least {FIRST_VERSION}. "
            "It was written before the first release: use the personal-viz that wrote it."
        )
    return version


def store_error(path: Path, error: sqlite3.Error) -> StudyError:
    """An error of SQLite as one line with advice."""
    code = getattr(error, "sqlite_errorcode", 0) & 0xFF
    if code in (sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_CORRUPT):
        return StudyError(f"{path}: found a damaged file ({error}); expected a study's database. {_RESTORE}")
    return StudyError(
        f"{path}: cannot be used ({error}); expected a database on a local disk that you can write. "
        "Check the folder's permissions."
    )


def first_hash(study_version: str, trial_id: str) -> str:
    """The hash to which the first event of a trial is chained."""
    return hashlib.sha256(f"{study_version}/{trial_id}".encode()).hexdigest()


def event_hash(prev_hash: str, row: tuple) -> str:
    """sha256 over the previous hash and (trial_id, seq, epoch, kind, t_srv_ns, t_srv_mono_ns, boot_id, payload)."""
    text = json.dumps([prev_hash, *row], separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()
