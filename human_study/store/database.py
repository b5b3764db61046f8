"""Opens a study's database for writing: settings, migrations, the study's own row; checks a study's files."""

import hashlib
import os
import platform
import shutil
import sqlite3
import time
from collections.abc import Sequence
from contextlib import closing
from importlib.metadata import version as package_version
from pathlib import Path

from sim.errors import StudyError

from ..design.plan import PLAN_FILE, StudyPlan, load_plan
from ..design.study import STUDY_FILE, StudyConfig, load_study
from ..private_files import PRIVATE_FILE, make_private, private_folder
from .lock import LOCK_FILE, take_lock
from .migrations import APPLICATION_ID, FIRST_VERSION, MIGRATIONS, SCHEMA_VERSION
from .records import DATABASE_FILE, StudyReader, require_known_version, store_error
from .vault import KEYS_FILE, Vault

BACKUP_FOLDER = "backups"
_PART = ".part"
"""Suffix of an unfinished copy."""
MIN_FREE_MB = 500
"""Free space needed to serve a study, MB; thousands of trials and their copies take less."""


def open_database(path: Path, config: StudyConfig, plan: StudyPlan) -> sqlite3.Connection:
    """The database, up to date and in autocommit mode, for one thread at a time; it is made when there is none.

    Raises:
        StudyError: The file cannot be written, is damaged, or belongs to another program, a newer version or another
            study.
    """
    try:
        _private_database(path)
        database = sqlite3.connect(path, isolation_level=None, check_same_thread=False)
        try:
            require_known_version(database, path)
            _apply_settings(database, path)
            for version in migrate(database, path):
                audit(database, "migrate", f"schema version {version}")
            _require_same_study(database, path, config, plan)
        except BaseException:
            database.close()
            raise
    except sqlite3.Error as error:
        raise store_error(path, error) from None
    except OSError as error:
        raise StudyError(
            f"{path}: cannot be written ({error.strerror}); expected a file that you can write. Give another folder."
        ) from None
    return database


def bring_up_to_date(folder: Path) -> list[int]:
    """Migrates a study's database of an earlier version; returns the versions that it passed, () for none.

    Raises:
        StudyError: There is no database, another process uses it, or a step failed and the database is unchanged.
    """
    path = folder / DATABASE_FILE
    if not path.is_file():
        raise StudyError(f"{path}: found no such file; expected a study. Run personal-viz study serve first.")
    try:
        with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as database:
            if require_known_version(database, path) == SCHEMA_VERSION:
                return []
        with closing(take_lock(folder)), closing(sqlite3.connect(path, isolation_level=None)) as database:
            _apply_settings(database, path)
            return migrate(database, path)
    except sqlite3.Error as error:
        raise store_error(path, error) from None


def free_mb(folder: Path) -> int:
    """Free space on the disk of a folder, MB. Raises StudyError if it cannot be read."""
    try:
        return shutil.disk_usage(folder).free // 2**20
    except OSError as error:
        raise StudyError(
            f"{folder}: cannot be asked for its free space ({error.strerror}); expected a study's folder. "
            "Give another folder."
        ) from None


def require_free_space(folder: Path, *, least_mb: int = MIN_FREE_MB) -> None:
    """Refuses to serve a study from a disk that is nearly full.

    Raises:
        StudyError: Less than `least_mb` is free.
    """
    found = free_mb(folder)
    if found < least_mb:
        raise StudyError(
            f"{folder}: its disk has {found} MB free; expected at least {least_mb} MB before a study is served. "
            "Free some space, or move the folder to a larger disk."
        )


def close_to_others(folder: Path) -> None:
    """Sets a study's folder to mode 0700, and its database, plan, lock and backups to 0600. Earlier versions did not.

    SQLite gives `-wal` and `-shm` the database's mode when it makes them.
    """
    files = [f"{DATABASE_FILE}{end}" for end in ("", "-wal", "-shm", "-journal")]
    backups = folder / BACKUP_FOLDER
    for path in (folder, backups, *(folder / name for name in (*files, PLAN_FILE, LOCK_FILE)), *backups.glob("*.db*")):
        make_private(path)


def require_same_files(reader: StudyReader) -> None:
    """Refuses a folder whose `study.yaml` or `plan.json` was changed after the start; a missing file is ignored.

    Raises:
        StudyError: A file is damaged, has another format version, or is not the original one.
    """
    if not (reader.folder / STUDY_FILE).is_file():
        return
    config = load_study(reader.folder)
    _require_same(reader, STUDY_FILE, "study_version", config.study_version, reader.study_version)
    if (reader.folder / PLAN_FILE).is_file():
        found = load_plan(reader.folder, config).plan_version
        _require_same(reader, PLAN_FILE, "plan_version", found, reader.plan.plan_version)


def require_keys(reader: StudyReader) -> None:
    """Refuses a folder whose `keys.json` does not open each participant's records, unless they were deleted.

    Raises:
        StudyError: The file is missing or damaged, or a participant's key is missing or wrong.
    """
    vault, codes = Vault(reader.folder), reader.codes()
    of_trial = "JOIN trial USING(trial_id) JOIN assignment USING(assignment_id)"
    sealed = reader.rows(
        f"SELECT code, trial_id || '/' || seq, payload FROM event {of_trial} WHERE seq = 1 UNION ALL"
        f" SELECT code, trial_id || '/outcome', payload FROM outcome {of_trial}"
        " UNION ALL SELECT code, code || '/' || kind, payload FROM personal_answer"
    )
    withdrew = {code for (code,) in reader.rows("SELECT code FROM stage WHERE stage = 'withdrawn'")}
    deleted = withdrew if reader.config.privacy.on_withdraw == "delete" else set()
    lost = sorted({code for code in codes if not (vault.has_key(code) or vault.is_shredded(code) or code in deleted)})
    if lost:
        path = reader.folder / KEYS_FILE
        found = f"has no key of {', '.join(lost[:3])}" if path.exists() else "found no such file"
        more = f" and {len(lost) - 3} more" if path.exists() and len(lost) > 3 else ""
        raise StudyError(
            f"{path}: {found}{more}; expected a key of each participant who has not withdrawn. Restore the file: "
            "without it nothing that they did can be read."
        )
    for code, where, payload in sealed:
        if vault.has_key(code):
            vault.open(code, payload, where=where)


def _private_database(path: Path) -> None:
    """Makes an empty file that only its owner can read, if there is none; SQLite treats it as a new database."""
    os.close(os.open(path, os.O_CREAT | os.O_RDWR, PRIVATE_FILE))
    make_private(path)


def _apply_settings(database: sqlite3.Connection, path: Path) -> None:
    """SQLite's settings of HUMAN_STUDY.md, section 5; raises StudyError where WAL is not possible.

    `trusted_schema = OFF` is left to readers: with it, SQLite 3.40 refuses every insert into a table whose CHECK calls
    json_valid ("unsafe use of json_valid()").
    """
    mode = database.execute("PRAGMA journal_mode = WAL").fetchone()[0]
    if mode != "wal":
        raise StudyError(
            f"{path}: journal_mode is {mode!r}; expected 'wal'. Put the study on a local disk, not a network drive."
        )
    for setting in (
        "synchronous = FULL",
        "foreign_keys = ON",
        "busy_timeout = 5000",
        "cell_size_check = ON",
        "wal_autocheckpoint = 1000",
        f"journal_size_limit = {64 * 2**20}",
        f"fullfsync = {int(platform.system() == 'Darwin')}",
    ):
        database.execute(f"PRAGMA {setting}")


def _require_same_study(database: sqlite3.Connection, path: Path, config: StudyConfig, plan: StudyPlan) -> None:
    """Writes the study's row into a new database; raises StudyError when it holds another study's row."""
    row = database.execute("SELECT study_version, plan FROM study").fetchone()
    if row is None:
        version, at_ns = package_version("personal-viz"), time.time_ns()
        left_out = {"sequences"} if config.sequences is None else set[str]()  # as versions without them wrote it
        database.execute(
            "INSERT INTO study(study_version, config, app_version, created_ns, plan) VALUES (?, ?, ?, ?, ?)",
            (config.study_version, config.model_dump_json(exclude=left_out), version, at_ns, plan.canonical_json()),
        )
        return
    for name, found, expected, file in (
        ("study_version", row[0], config.study_version, STUDY_FILE),
        ("plan_version", hashlib.sha256(row[1].encode()).hexdigest(), plan.plan_version, PLAN_FILE),
    ):
        if found != expected:
            raise StudyError(
                f"{path}: holds {name} {found[:12]}; expected {expected[:12]}. "
                f"{file} was changed after the start: restore it, or begin a new study in another folder."
            )


def migrate(database: sqlite3.Connection, path: Path, *, steps: Sequence[str] = MIGRATIONS) -> list[int]:
    """Brings a database up to date, each step whole or not at all; returns the versions that it passed.

    A database with content is first copied to `backups/` beside it. The connection has no open transaction.

    Raises:
        StudyError: A step failed; the database is as it was before that step.
    """
    version = database.execute("PRAGMA user_version").fetchone()[0]
    num_done = max(0, version - FIRST_VERSION + 1)
    if 0 < num_done < len(steps):
        backup(database, path.parent / BACKUP_FOLDER / f"{path.stem}-v{version}-{time.time_ns()}.db")
    done = []
    for number, sql in enumerate(steps[num_done:], start=FIRST_VERSION + num_done):
        try:
            database.executescript(
                f"BEGIN IMMEDIATE; {sql}; PRAGMA application_id = {APPLICATION_ID};"
                f" PRAGMA user_version = {number}; COMMIT;"
            )
        except sqlite3.Error as error:
            if database.in_transaction:
                database.execute("ROLLBACK")
            raise StudyError(
                f"{path}: cannot go from schema version {number - 1} to {number} ({error}); expected a database as "
                "personal-viz wrote it. It is unchanged; use the version that wrote it."
            ) from None
        done.append(number)
    return done


def backup(database: sqlite3.Connection, path: Path) -> None:
    """Copies the whole database to a new file, even during use; one copy at a time, and never half a copy.

    Raises:
        OSError: The folder cannot be made, or the copy cannot be renamed.
        sqlite3.Error: The copy cannot be written.
    """
    private_folder(path.parent)
    for left in path.parent.glob(f"*{_PART}*"):  # remains of an interrupted copy
        left.unlink(missing_ok=True)
    beside = path.with_name(path.name + _PART)
    try:
        _private_database(beside)
        with closing(sqlite3.connect(beside)) as copy:
            database.backup(copy)
        os.replace(beside, path)
    finally:
        beside.unlink(missing_ok=True)  # frees the space of a failed copy


def audit(database: sqlite3.Connection, action: str, target: str) -> None:
    """Records a change to the study as a whole."""
    database.execute("INSERT INTO audit(at_ns, action, target) VALUES (?, ?, ?)", (time.time_ns(), action, target))


def _require_same(reader: StudyReader, name: str, what: str, found: str, expected: str) -> None:
    if found != expected:
        raise StudyError(
            f"{reader.folder / name}: {what} is {found[:12]}; expected {expected[:12]}, which the database holds. "
            "It was changed after the start: restore it. The records are whole, and say themselves how they were made."
        )
