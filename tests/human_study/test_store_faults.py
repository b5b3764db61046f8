"""Disks that are full or broken, and writes that fail: only what is stored is acknowledged, and all goes on later."""

import shutil
import sqlite3
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from human_study.journey import has_reached
from human_study.store import people as people_module
from human_study.store.records import VerificationEntry, read_study
from human_study.store.store import StudyStore, Trial, TrialEndedError
from human_study.store.writer import StoreFullError
from sim.errors import StudyError
from sim.tasks.run_files import EpisodeEnd

from .stores import KEY, OPEN, checked, filled, opened

STOP = EpisodeEnd(reason="stop")


WRITES: dict[str, Callable[[StudyStore, Trial], object]] = {
    "append": lambda store, trial: store.append(trial.trial_id, trial.epoch, KEY),
    "finish": lambda store, trial: store.finish_trial(trial.trial_id, STOP),
    "open": lambda store, _: store.open_trial("p02", 2),
    "stage": lambda store, _: store.enter_stage("p02", "instructed"),
    "consent": lambda store, _: store.give_consent("p02", "text", given=True),
    "claim": lambda store, _: store.claim_person(None),
    "drop out": lambda store, _: store.drop_out("p02", "away"),
    "withdraw": lambda store, _: store.withdraw("p02"),
    "exclude": lambda store, _: store.exclude("participant", "p02", rule_id="r1", reason="because"),
}
TABLES = ("event", "outcome", "sitting", "trial", "stage", "consent", "claim", "release", "exclusion", "audit")


def counts(folder: Path) -> dict[str, int]:
    """Rows of every table that these writes concern."""
    with read_study(folder) as reader:
        return {table: reader.rows(f"SELECT count(*) FROM {table}")[0][0] for table in TABLES}


class BrokenDisk:
    """A connection whose commits fail with an error of SQLite, with or without rolling back."""

    def __init__(self, database: sqlite3.Connection, code: int, *, rolls_back: bool) -> None:
        self._database, self._code, self._rolls_back = database, code, rolls_back

    def __getattr__(self, name: str) -> Any:
        return getattr(self._database, name)

    def execute(self, sql: str, *values: Any) -> sqlite3.Cursor:
        if sql != "COMMIT":
            return self._database.execute(sql, *values)
        if self._rolls_back:
            self._database.execute("ROLLBACK")
        error = sqlite3.OperationalError("disk I/O error")
        error.sqlite_errorcode = self._code
        raise error


ERRORS = {
    "no space": sqlite3.SQLITE_FULL,
    "fsync failed": sqlite3.SQLITE_IOERR_FSYNC,
    "write failed": sqlite3.SQLITE_IOERR_WRITE,
    "read-only": sqlite3.SQLITE_READONLY,
    "held by another program": sqlite3.SQLITE_BUSY,
}


@pytest.mark.parametrize("rolls_back", [True, False])
@pytest.mark.parametrize("fault", ERRORS)
def test_a_commit_that_fails_acknowledges_nothing_and_works_later(tmp_path: Path, fault: str, rolls_back: bool) -> None:
    with opened(tmp_path) as (store, trial):
        before = counts(tmp_path)
        whole = store._writer._database
        store._writer._database = BrokenDisk(whole, ERRORS[fault], rolls_back=rolls_back)
        for name, write in WRITES.items():
            with pytest.raises(StoreFullError, match="Nothing was lost") as caught:
                write(store, trial)
            assert "\n" not in str(caught.value), name
            assert counts(tmp_path) == before
        store._writer._database = whole
        assert store.append(trial.trial_id, trial.epoch, KEY) == 2
        assert store.finish_trial(trial.trial_id, STOP) == STOP
        assert checked(store) == 2


def test_on_a_full_disk_every_write_is_whole_or_refused(tmp_path: Path) -> None:
    with opened(tmp_path) as (store, trial):
        store._database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        pages = store._database.execute("PRAGMA page_count").fetchone()[0]
        store._database.execute(f"PRAGMA max_page_count = {pages}")
        other = store.open_trial("p01", 1)
        with pytest.raises(StoreFullError, match="expected free space on the disk"):
            _write_on_and_on(store, other)
        for write in WRITES.values():
            before, refused = counts(tmp_path), False
            try:
                write(store, trial)
            except StoreFullError:
                refused = True
            except StudyError:  # the trial ended by an earlier one of these writes
                refused = True
            assert (counts(tmp_path) == before) == refused
        store._database.execute("PRAGMA max_page_count = 100000")
        num_events = len(store.events(other.trial_id))
        assert store.append(other.trial_id, other.epoch, KEY) == num_events + 1
        checked(store)


def _write_on_and_on(store: StudyStore, trial: Trial) -> None:
    for _ in range(1000):
        store.append(trial.trial_id, trial.epoch, OPEN)


def test_a_database_that_became_read_only_pauses_the_study(tmp_path: Path) -> None:
    with opened(tmp_path) as (store, trial):
        store._database.execute("PRAGMA query_only = ON")
        with pytest.raises(StoreFullError, match=r"expected a disk that can be written\. Nothing was lost: look at"):
            store.append(trial.trial_id, trial.epoch, KEY)
        store._database.execute("PRAGMA query_only = OFF")
        assert store.append(trial.trial_id, trial.epoch, KEY) == 2


def test_a_row_that_the_database_refuses_does_not_stop_the_others_of_its_commit(tmp_path: Path) -> None:
    with opened(tmp_path) as (store, trial):
        entry = VerificationEntry(trial.trial_id, "v1", "verified", 0.0, None, "", "s" * 64, 1)
        store.add_verification(entry)
        found = _between_two_keys(store, trial, lambda: store.add_verification(entry))
        assert isinstance(found, StudyError)
        assert not isinstance(found, StoreFullError)
        assert len(store.events(trial.trial_id)) == 3


@pytest.mark.parametrize(
    ("bug", "kind"),
    [(lambda _: {}["missing"], KeyError), (lambda found: found.execute("SELECT * FROM nothing"), StudyError)],
)
def test_a_write_with_a_bug_does_not_stop_the_others_of_its_commit(
    tmp_path: Path, bug: Callable[[sqlite3.Connection], object], kind: type[Exception]
) -> None:
    def half(database: sqlite3.Connection) -> object:
        database.execute("INSERT INTO audit(at_ns, action, target) VALUES (1, 'half', 'done')")
        return bug(database)

    with opened(tmp_path) as (store, trial):
        assert type(_between_two_keys(store, trial, lambda: store._writer.write(half))) is kind
        with read_study(tmp_path) as reader:
            assert reader.rows("SELECT 1 FROM audit WHERE action = 'half'") == []


def _between_two_keys(store: StudyStore, trial: Trial, job: Callable[[], object]) -> object:
    """The result of a write in one commit with a key press before it and one after it, which are both stored."""
    results: dict[str, object] = {}

    def write(name: str, job: Callable[[], object]) -> None:
        try:
            results[name] = job()
        except (StudyError, KeyError) as error:
            results[name] = error

    def press() -> int:
        return store.append(trial.trial_id, trial.epoch, KEY)

    jobs = {"before": press, "between": job, "after": press}
    _together(store, [threading.Thread(target=write, args=item) for item in jobs.items()])
    assert sorted([results["before"], results["after"]]) == [2, 3]
    return results["between"]


def _together(store: StudyStore, threads: list[threading.Thread]) -> None:
    """Runs the threads so that their writes are in one commit."""
    writer, is_free, has_begun = store._writer, threading.Event(), threading.Event()

    def hold(_: sqlite3.Connection) -> None:
        has_begun.set()
        is_free.wait(30)

    holder = threading.Thread(target=writer.write, args=(hold,))
    holder.start()
    assert has_begun.wait(30)
    queued = threading.Semaphore(0)
    submit = writer._thread.submit

    def counted(*work: Any) -> Any:
        queued.release()
        return submit(*work)

    writer._thread.submit = counted
    for number, thread in enumerate(threads, start=1):
        thread.start()
        assert queued.acquire(timeout=30), number
    is_free.set()
    for thread in [holder, *threads]:
        thread.join(30)


def test_a_backup_that_fails_keeps_nobody_from_finishing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise sqlite3.OperationalError("database or disk is full")

    with filled(tmp_path) as store:
        monkeypatch.setattr(people_module, "backup", full)
        store.enter_stage("p02", "finished")
        assert has_reached(store.participant("p02").stages, "finished")
        with pytest.raises(StudyError, match=r"database or disk is full.*The study goes on\."):
            store.back_up()


def test_a_backup_without_room_leaves_no_half_file(tmp_path: Path) -> None:
    with filled(tmp_path) as store:
        (tmp_path / "backups").mkdir()
        (tmp_path / "backups" / "study-1.db.part").write_text("half")
        assert store.back_up().is_file()
        shutil.rmtree(tmp_path / "backups")
        (tmp_path / "backups").write_text("no folder")
        with pytest.raises(StudyError, match="expected space for a copy"):
            store.back_up()


def test_a_result_that_comes_after_the_withdrawal_is_refused_even_if_it_was_stored_before(tmp_path: Path) -> None:
    with opened(tmp_path) as (store, trial):
        store.finish_trial(trial.trial_id, STOP)
        store.withdraw("p02")
        with pytest.raises(TrialEndedError, match="the participant withdrew"):
            store.finish_trial(trial.trial_id, STOP)
