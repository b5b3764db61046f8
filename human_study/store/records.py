"""Reads a study's database in one consistent snapshot, and checks that nobody changed it."""

import hashlib
import json
import sqlite3
from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from sim.errors import StudyError, did_you_mean, line_from_validation_error
from sim.sequences.runs import SequenceEnd
from sim.tasks.run_files import Answer, EpisodeEnd
from sim.types import EpisodeKey, TaskKind

from ..design.plan import Phase, StudyPlan
from ..design.secrets import token_matches
from ..design.study import STUDY_FILE, Condition, StudyConfig, load_study
from ..journey import AssignedTrial, ConsentEntry, Person, StageEntry
from ..trial.events import Event, event_from_json
from ..trial.outcome import Outcome
from .lock import LOCK_FILE, rows_noted
from .migrations import APPLICATION_ID, FIRST_VERSION, SCHEMA_VERSION
from .vault import Vault

DATABASE_FILE = "study.db"
AUDIT_PILOT = "served as a pilot"
_RESTORE = "Restore the folder from a backup."
_END = "CASE WHEN end_reason IS NULL OR end_reason IN ('technical', 'abandoned') THEN end_reason ELSE 'done' END"
"""The end of a trial without its result: all other reasons read as `done`."""
_Frozen = TypeVar("_Frozen", bound=BaseModel)
AnswerKind = Literal["survey", "comment"]
"""Kinds of answers in which people say something of themselves or about the study."""
VerificationStatus = Literal["verified", "drift", "failed", "unsupported"]


@dataclass(frozen=True, slots=True)
class StoredEvent:
    """An event with the server's additions."""

    seq: int
    """Place in the trial, from 1, without gaps."""
    epoch: int
    """Epoch of the tab that sent it."""
    event: Event
    t_srv_ns: int
    """Server's wall clock; only a label."""
    t_srv_mono_ns: int
    """Server's monotonic clock; comparable within one boot."""


@dataclass(frozen=True, slots=True)
class StoredTrial:
    """One attempt at an assigned trial, or an assigned trial that was never opened."""

    code: str
    """The participant."""
    order_no: int
    """Place in the participant's order over all phases, from 1."""
    phase: Phase
    task: TaskKind
    condition: Condition
    key: EpisodeKey
    rep: int
    """Number of the person among those with this episode and condition, from 1; 0 outside `main`."""
    made_by: Literal["plan", "fill"]
    """`fill`: given out while the study ran."""
    attempt: int
    """Number of the attempt, from 1; 0 = never opened."""
    trial_id: str | None
    """Id of the attempt; None if it was never opened."""
    outcome: Outcome | None
    """The outcome; None until the trial has ended, and when the participant withdrew."""
    has_ended: bool
    is_released: bool
    """Whether the participant gave the episode back to others."""
    is_shredded: bool
    """Whether the participant withdrew and the trial's data is deleted."""
    opened_ns: int | None
    prior_visits_scene: int | None
    """Earlier attempts of this participant at trials in this home, of any phase and with any end; None where the
    trial was never opened."""
    prior_visits_split: int | None
    """Those of these attempts that are in the same split."""
    secs_in_scene_before: float | None
    """Seconds that the participant spent in this home before."""

    @property
    def is_due(self) -> bool:
        """Whether the participant still has to do or finish the trial."""
        return not self.has_ended and not self.is_released


@dataclass(frozen=True, slots=True)
class VerificationEntry:
    """The result of doing a trial again."""

    trial_id: str
    run_id: str
    """Id of the verification."""
    status: VerificationStatus
    max_position_error: float
    """Largest error of a position, metres."""
    first_bad_step: int | None
    detail: str
    sim_hash: str
    """Hash of the program and the scene of the repetition."""
    at_ns: int


@dataclass(frozen=True, slots=True)
class StudyDates:
    """The days of a study by its records, UTC, as `2027-03-31`."""

    frozen: str
    """Study file and plan were written to the records."""
    num_begun: int
    """Counted trials that somebody has begun, those of people who withdrew included."""
    first: str | None
    """The first of these was begun; None where there is none."""
    last: str | None


@dataclass(frozen=True, slots=True)
class ExclusionEntry:
    """A trial or participant that a rule leaves out of the figures."""

    exclusion_id: str
    target_kind: Literal["trial", "participant"]
    target: str
    """Trial id or participant code."""
    rule_id: str
    reason: str
    at_ns: int
    is_undone: bool


class _OutcomeLine(BaseModel):
    model_config = ConfigDict(frozen=True)
    outcome: EpisodeEnd | Answer | SequenceEnd = Field(discriminator="kind")


class StudyReader:
    """Reads one snapshot of a study; made by `read_study`."""

    def __init__(self, database: sqlite3.Connection, path: Path, *, least_rows: int = 0) -> None:
        """Takes a connection that the caller closes, with an open read transaction; the path is for messages.

        `least_rows` is what `rows_noted` said before that transaction.
        """
        self._database, self._path, self._least_rows = database, path, least_rows

    @property
    def folder(self) -> Path:
        """The study's folder."""
        return self._path.parent

    def rows(self, query: str, *values: str) -> list[tuple]:
        """Rows of one of our queries, as they are stored: people's data is ciphertext."""
        return self._database.execute(query, values).fetchall()

    @property
    def config(self) -> StudyConfig:
        """The study of these records."""
        return self._frozen("config", StudyConfig)

    def reported_config(self) -> StudyConfig:
        """The study of these records, with `reporting` as the folder's study file has it now.

        Raises:
            StudyError: The study file cannot be read.
        """
        if not (self.folder / STUDY_FILE).is_file():
            return self.config
        return self.config.model_copy(update={"reporting": load_study(self.folder).reporting})

    @property
    def study_version(self) -> str:
        """Hash of the frozen study; all chains begin with it."""
        return self._one("SELECT study_version FROM study")[0]

    @property
    def plan(self) -> StudyPlan:
        """The plan that was frozen with the study."""
        return self._frozen("plan", StudyPlan)

    @property
    def is_pilot(self) -> bool:
        """Whether the study was planned as a pilot, or ever served without an ethics id."""
        return self.plan.is_pilot or bool(self.rows("SELECT 1 FROM audit WHERE action = ?", AUDIT_PILOT))

    @property
    def created_ns(self) -> int:
        """Time at which the study was made: nanoseconds since 1970."""
        return self._one("SELECT created_ns FROM study")[0]

    def dates(self) -> StudyDates:
        """The days on which the study was frozen, and on which its counted trials were begun."""
        count, *ends = self._one(
            "SELECT count(DISTINCT assignment_id), min(opened_ns), max(opened_ns) FROM trial JOIN assignment"
            " USING(assignment_id) WHERE phase = 'main'"
        )
        first, last = (None if end is None else _day(end) for end in ends)
        return StudyDates(_day(self.created_ns), count, first, last)

    @property
    def app_version(self) -> str:
        """Version of personal-viz that made the study."""
        return self._one("SELECT app_version FROM study")[0]

    def codes(self) -> tuple[str, ...]:
        """Public codes of all participants, in order."""
        return tuple(row[0] for row in self.rows("SELECT code FROM participant ORDER BY code"))

    def code_of_token(self, token: str) -> str | None:
        """Code of the participant with this personal token; None if there is none."""
        found = None
        for code, stored in self.rows("SELECT code, token_hash FROM participant ORDER BY code"):
            found = code if token_matches(token, stored) else found
        return found

    def participant(self, code: str) -> Person:
        """One participant.

        Raises:
            StudyError: There is no such participant.
        """
        self._require_known(code)
        return self._people(code)[0]

    def participants(self) -> list[Person]:
        """All participants, p01 first."""
        return self._people()

    def trials(self, code: str) -> tuple[StoredTrial, ...]:
        """All assigned trials of a participant in order, each with all its attempts.

        Raises:
            StudyError: There is no such participant.
        """
        self._require_known(code)
        rows = self.rows(
            "SELECT order_no, phase, task, condition, split, scene, episode_id, rep, made_by, attempt, trial_id,"
            " outcome.payload, release.at_ns IS NOT NULL, opened_ns, prior_visits_scene, prior_visits_split,"
            " secs_in_scene_before FROM assignment LEFT JOIN trial USING(assignment_id) LEFT JOIN outcome"
            " USING(trial_id) LEFT JOIN release ON release.assignment_id = assignment.assignment_id"
            " WHERE code = ? ORDER BY order_no, attempt",
            code,
        )
        is_shredded = self.is_shredded(code)
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
        if code is None or self.is_shredded(code):
            return ()
        rows = self.rows(
            "SELECT seq, epoch, payload, t_srv_ns, t_srv_mono_ns FROM event WHERE trial_id = ? ORDER BY seq", trial_id
        )
        return tuple(
            StoredEvent(seq, epoch, self._event(code, f"{trial_id}/{seq}", payload), wall_ns, mono_ns)
            for seq, epoch, payload, wall_ns, mono_ns in rows
        )

    def outcome(self, trial_id: str) -> Outcome | None:
        """The trial's outcome; None until it has ended, and where the participant's key is deleted."""
        rows = self.rows("SELECT payload FROM outcome WHERE trial_id = ?", trial_id)
        code = self._code_of_trial(trial_id)
        if not rows or code is None or self.is_shredded(code):
            return None
        return self._outcome(code, trial_id, rows[0][0])

    def verifications(self) -> tuple[VerificationEntry, ...]:
        """All results of doing trials again, oldest first."""
        columns = "trial_id, run_id, status, max_position_error, first_bad_step, detail, sim_hash, at_ns"
        return tuple(
            VerificationEntry(*row)
            for row in self.rows(f"SELECT {columns} FROM verification ORDER BY at_ns, trial_id, run_id")
        )

    def exclusions(self) -> tuple[ExclusionEntry, ...]:
        """All exclusions, oldest first, including undone ones."""
        rows = self.rows(
            "SELECT exclusion_id, target_kind, target, rule_id, reason, exclusion.at_ns, exclusion_undone.at_ns IS NOT"
            " NULL FROM exclusion LEFT JOIN exclusion_undone USING(exclusion_id) ORDER BY exclusion.rowid"
        )
        return tuple(ExclusionEntry(*row[:6], is_undone=bool(row[6])) for row in rows)

    def answers(self, kind: AnswerKind) -> dict[str, str]:
        """The newest answer of this kind by participant; people whose key is deleted are left out."""
        rows = self.rows("SELECT code, payload FROM personal_answer WHERE kind = ? ORDER BY seq", kind)
        newest = {code: payload for code, payload in rows if not self.is_shredded(code)}
        return {
            code: self._vault.open(code, payload, where=answer_place(code, kind)) for code, payload in newest.items()
        }

    def is_shredded(self, code: str) -> bool:
        """Whether the participant's data was deleted; a key that is merely lost is an error when data is read."""
        if self._vault.has_key(code):
            return False
        withdrew = self.rows("SELECT 1 FROM stage WHERE code = ? AND stage = 'withdrawn'", code)
        return self._vault.is_shredded(code) or bool(withdrew)

    def num_events(self, code: str) -> int:
        """Number of events in a participant's trials."""
        query = "SELECT count(*) FROM event JOIN trial USING(trial_id) JOIN assignment USING(assignment_id)"
        return self.rows(f"{query} WHERE code = ?", code)[0][0]

    def head_hash(self, trial_id: str) -> str | None:
        """Hash of the trial's last event, which covers all events before it; None without events."""
        rows = self.rows("SELECT hash FROM event WHERE trial_id = ? ORDER BY seq DESC LIMIT 1", trial_id)
        return rows[0][0] if rows else None

    def check(self) -> int:
        """Checks that nothing is missing, SQLite's own structure and all hash chains; returns the number of events.

        Raises:
            StudyError: A record was damaged, changed or taken away; the message names the first place.
        """
        found = self._one("PRAGMA integrity_check")[0]
        if found != "ok":
            raise StudyError(f"{self._path}: SQLite found damage ({found}); expected 'ok'. {_RESTORE}")
        broken = self.rows("PRAGMA foreign_key_check")
        if broken:
            raise StudyError(f"{self._path}: table {broken[0][0]} names a row that is missing. {_RESTORE}")
        heads = self._check_chains(self.study_version)
        for trial_id, head in self.rows("SELECT trial_id, head_hash FROM outcome"):
            if heads.get(trial_id) != head:
                raise StudyError(
                    f"{self._path}: trial {trial_id} ends with another event than when it was finished. {_RESTORE}"
                )
        found = num_rows(self._database)
        if found < self._least_rows:
            raise StudyError(
                f"{self._path}: holds {found} rows; expected at least {self._least_rows}, which were stored: its "
                f"log {DATABASE_FILE}-wal was taken away, or an older copy was put here. Put the missing file back; "
                f"to go on with what is left, delete {LOCK_FILE}."
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

    def _require_known(self, code: str) -> None:
        if not self.rows("SELECT 1 FROM participant WHERE code = ?", code):
            raise unknown_participant(self._path, code, self.codes())

    def _people(self, code: str | None = None) -> list[Person]:
        """All participants, or the given one, without decrypting anything."""
        only, values = ("", ()) if code is None else (" WHERE code = ?", (code,))
        stages: dict[str, list[StageEntry]] = defaultdict(list)
        for owner, stage, detail, at_ns in self.rows(
            f"SELECT code, stage, detail, at_ns FROM stage{only} ORDER BY seq", *values
        ):
            stages[owner].append(StageEntry(stage, json.loads(detail), at_ns))
        answers = self.rows(f"SELECT code, text_hash, given FROM consent{only} ORDER BY seq", *values)
        consents = {owner: ConsentEntry(text_hash, bool(given)) for owner, text_hash, given in answers}
        trials = self._assigned_trials(only, values)
        people = self.rows(
            "SELECT code, task, arm, EXISTS(SELECT 1 FROM claim WHERE claim.code = participant.code)"
            f" FROM participant{only} ORDER BY length(code), code",
            *values,
        )
        return [
            Person(owner, task, bool(is_claimed), tuple(stages[owner]), tuple(trials[owner]), arm, consents.get(owner))
            for owner, task, arm, is_claimed in people
        ]

    def _assigned_trials(self, only: str, values: tuple[str, ...]) -> dict[str, list[AssignedTrial]]:
        rows = self.rows(
            "SELECT code, order_no, phase, task, condition, split, scene, episode_id, rep, release.at_ns IS NOT NULL,"
            " trial_id IS NOT NULL, EXISTS(SELECT 1 FROM sitting WHERE sitting.trial_id = trial.trial_id),"
            f" {_END}, outcome.at_ns FROM assignment"
            " LEFT JOIN trial ON trial.assignment_id = assignment.assignment_id AND attempt = (SELECT max(attempt)"
            " FROM trial AS other WHERE other.assignment_id = assignment.assignment_id)"
            " LEFT JOIN outcome USING(trial_id) LEFT JOIN release ON release.assignment_id = assignment.assignment_id"
            f"{only} ORDER BY order_no",
            *values,
        )
        found = defaultdict(list)
        for code, order_no, phase, task, condition, split, scene, episode_id, rep, *rest in rows:
            is_released, is_begun, is_open, end, ended_ns = rest
            key = EpisodeKey(split, scene, episode_id)
            flags = bool(is_released), bool(is_begun), bool(is_open)
            found[code].append(AssignedTrial(order_no, phase, task, condition, key, rep, *flags, end, ended_ns))
        return found

    def _code_of_trial(self, trial_id: str) -> str | None:
        rows = self.rows("SELECT code FROM trial JOIN assignment USING(assignment_id) WHERE trial_id = ?", trial_id)
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

    def _frozen(self, column: str, model: type[_Frozen]) -> _Frozen:
        try:
            return model.model_validate_json(self._one(f"SELECT {column} FROM study")[0], strict=True)
        except ValidationError as error:
            raise StudyError(line_from_validation_error(f"{self._path}: {column}", error, advice=_RESTORE)) from None

    def _one(self, query: str) -> tuple:
        rows = self.rows(query)
        if not rows:
            raise StudyError(f"{self._path}: found a database without a study; expected one. {_RESTORE}")
        return rows[0]


@contextmanager
def read_study(folder: Path) -> Iterator[StudyReader]:
    """One consistent snapshot of a study, even while another process writes to it.

    Raises:
        StudyError: There is no database, or this version cannot read it.
    """
    path, least_rows = folder / DATABASE_FILE, rows_noted(folder)  # noted before the snapshot: it holds these rows
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
            yield StudyReader(database, path, least_rows=least_rows)
        finally:
            database.close()
    except sqlite3.Error as error:
        raise store_error(path, error) from None


def num_rows(database: sqlite3.Connection) -> int:
    """Number of rows in all tables, which only grows."""
    names = database.execute("SELECT name FROM sqlite_schema WHERE type = 'table' AND name NOT LIKE 'sqlite%'")
    counts = [f"(SELECT count(*) FROM {name})" for (name,) in names]
    return database.execute(f"SELECT {' + '.join(counts)}").fetchone()[0]


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


def unknown_participant(path: Path, code: str, codes: Sequence[str]) -> StudyError:
    """The error for a participant whom a study, whose participants have these codes, does not have."""
    ends = " to ".join((*codes[:1], *codes[1:][-1:]))
    return StudyError(
        f"{path}: found no participant {code!r}; expected one of {ends}.{did_you_mean(code, codes)} See study status."
    )


def store_error(path: Path, error: sqlite3.Error) -> StudyError:
    """An error of SQLite as one line with advice."""
    code = getattr(error, "sqlite_errorcode", 0) & 0xFF
    if code in (sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_CORRUPT):
        return StudyError(f"{path}: found a damaged file ({error}); expected a study's database. {_RESTORE}")
    return StudyError(
        f"{path}: cannot be used ({error}); expected a database on a local disk that you can write. "
        "Check the folder's permissions."
    )


def _day(at_ns: int) -> str:
    return datetime.fromtimestamp(at_ns / 1e9, UTC).date().isoformat()


def answer_place(code: str, kind: AnswerKind) -> str:
    """The name of the place to which a personal answer's ciphertext is bound."""
    return f"{code}/{kind}"


def first_hash(study_version: str, trial_id: str) -> str:
    """The hash to which the first event of a trial is chained."""
    return hashlib.sha256(f"{study_version}/{trial_id}".encode()).hexdigest()


def event_hash(prev_hash: str, row: tuple) -> str:
    """sha256 over the previous hash and (trial_id, seq, epoch, kind, t_srv_ns, t_srv_mono_ns, boot_id, payload)."""
    text = json.dumps([prev_hash, *row], separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()
