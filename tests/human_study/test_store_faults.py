"""Power loss, kills at chosen instants, disks that are full or broken: nothing acknowledged is lost."""

import json
import multiprocessing
import os
import shutil
import signal
import sqlite3
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from human_study import database as database_module
from human_study import people as people_module
from human_study import store as store_module
from human_study.events import Shown
from human_study.record_types import VerificationEntry
from human_study.records import read_study
from human_study.stages import has_reached
from human_study.store import StudyStore, Trial, TrialEndedError
from human_study.vault import KEYS_FILE, Vault
from human_study.writer import StoreFullError
from sim.errors import StudyError
from sim.tasks.run_files import EpisodeEnd

from .stores import KEY, OPEN, filled, open_small, opened

STOP = EpisodeEnd(reason="stop")
SECTOR = 512


def shown(step: int) -> Shown:
    """An event that can be told from all others."""
    return Shown(step=step, frame_hash=None)


def steps_in(folder: Path, trial: Trial) -> list[int]:
    """The steps that a study holds, in order; also checks the database and all chains."""
    with read_study(folder) as reader:
        reader.check()
        return [line.event.step for line in reader.events(trial.trial_id) if isinstance(line.event, Shown)]


@dataclass
class Written:
    """A study's files after each acknowledged write."""

    trial: Trial
    database: bytes
    wal: bytes
    keys: bytes
    wal_sizes: list[int]
    """After each write."""

    def num_acknowledged(self, length: int) -> int:
        """How many writes were acknowledged when the log had this length."""
        return sum(size <= length for size in self.wal_sizes)

    def lay_out(self, folder: Path, *, wal: bytes, database: bytes | None = None) -> Path:
        """A study folder as a power loss may leave it: no shared memory, no lock."""
        folder.mkdir()
        (folder / "study.db").write_bytes(self.database if database is None else database)
        (folder / "study.db-wal").write_bytes(wal)
        (folder / KEYS_FILE).write_bytes(self.keys)
        return folder


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Written:
    """Thirty acknowledged events, of which the database file itself holds none."""
    folder = tmp_path_factory.mktemp("written")
    store, trial = opened(folder)
    with store:
        store._database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        wal, sizes = folder / "study.db-wal", []
        for step in range(30):
            store.append(trial.trial_id, trial.epoch, shown(step))
            sizes.append(wal.stat().st_size)
        return Written(
            trial, (folder / "study.db").read_bytes(), wal.read_bytes(), (folder / KEYS_FILE).read_bytes(), sizes
        )


def test_a_power_loss_leaves_what_was_acknowledged_when_the_log_was_so_long(tmp_path: Path, written: Written) -> None:
    rng = np.random.default_rng(1)
    lengths = sorted({0, len(written.wal), *(int(n) for n in rng.integers(0, len(written.wal), 40))})
    found = []
    for length in lengths:
        folder = written.lay_out(tmp_path / str(length), wal=written.wal[:length])
        open_small(folder).close()
        found.append(steps_in(folder, written.trial))
    assert found == [list(range(written.num_acknowledged(length))) for length in lengths]
    assert len(found[-1]) == 30


def test_a_power_loss_that_leaves_anything_in_the_last_sectors_loses_nothing_before(
    tmp_path: Path, written: Written
) -> None:
    rng = np.random.default_rng(2)
    for number in range(30):
        length = int(rng.integers(SECTOR, len(written.wal)))
        torn = bytearray(written.wal)
        for start in range(length, len(torn), SECTOR):
            fate = rng.integers(3)
            if fate:  # old zeros or noise where a sector was not written yet
                size = len(torn[start : start + SECTOR])
                torn[start : start + SECTOR] = bytes(size) if fate == 1 else rng.bytes(size)
        folder = written.lay_out(tmp_path / str(number), wal=bytes(torn))
        open_small(folder).close()
        steps = steps_in(folder, written.trial)
        assert steps == list(range(len(steps)))
        assert len(steps) >= written.num_acknowledged(length)


def test_a_power_loss_while_the_log_is_copied_into_the_database_loses_nothing(tmp_path: Path, written: Written) -> None:
    whole = written.lay_out(tmp_path / "whole", wal=written.wal)
    with open_small(whole) as store:
        store._database.execute("PRAGMA wal_checkpoint(FULL)")
        after = (whole / "study.db").read_bytes()
    size = 4096
    rng = np.random.default_rng(3)
    for number in range(10):
        mixed = bytearray(written.database.ljust(len(after), b"\0"))
        for start in range(0, len(after), size):
            if rng.random() < 0.5:
                mixed[start : start + size] = after[start : start + size]
        folder = written.lay_out(tmp_path / str(number), wal=written.wal, database=bytes(mixed))
        open_small(folder).close()
        assert steps_in(folder, written.trial) == list(range(30))


def test_the_study_goes_on_after_a_power_loss(tmp_path: Path, written: Written) -> None:
    folder = written.lay_out(tmp_path / "cut", wal=written.wal[: written.wal_sizes[9] + 100])
    with open_small(folder) as store:
        trial = store.open_trial("p02", 1)
        store.append_many(trial.trial_id, trial.epoch, [shown(100), shown(101)])
        store.finish_trial(trial.trial_id, STOP)
    assert steps_in(folder, written.trial) == [*range(10), 100, 101]


# --- kills at chosen instants, each in a process of its own


def die(*_: object, **__: object) -> None:
    """End this process as the system would, with nothing tidied up."""
    os.kill(os.getpid(), signal.SIGKILL)


def _finish_and_die_after_the_commit(folder: Path) -> None:
    store = open_small(folder)
    trial = store.open_trial("p02", 1)
    store_module.read_study = die  # type: ignore[assignment]  # the answer is read back after the commit
    store.finish_trial(trial.trial_id, STOP)


def _finish_and_die_before_the_commit(folder: Path) -> None:
    store = open_small(folder)
    trial = store.open_trial("p02", 1)
    store_module.queue_again = die  # type: ignore[assignment]  # the last step of the transaction
    store.finish_trial(trial.trial_id, STOP)


def _reach_the_end_and_die_in_the_backup(folder: Path) -> None:
    database_module.os.replace = die  # type: ignore[assignment]
    open_small(folder).enter_stage("p02", "finished")


def _withdraw_and_die_before_the_key_is_deleted(folder: Path) -> None:
    Vault.shred = die  # type: ignore[assignment,method-assign]
    open_small(folder).withdraw("p02")


def killed(work: Callable[[Path], None], folder: Path) -> None:
    """Run it in a process that it does not survive."""
    context = multiprocessing.get_context("forkserver")
    process = context.Process(target=work, args=(folder,))
    process.start()
    process.join(60)
    assert process.exitcode == -signal.SIGKILL


@pytest.mark.slow
def test_who_was_cut_off_between_commit_and_reply_finds_the_same_outcome_once(tmp_path: Path) -> None:
    store, trial = opened(tmp_path)
    store.close()
    killed(_finish_and_die_after_the_commit, tmp_path)
    with open_small(tmp_path) as store:
        for reason in ("stop", "giveup"):
            assert store.finish_trial(trial.trial_id, EpisodeEnd(reason=reason)) == STOP  # type: ignore[arg-type]
        assert store.trials("p02")[0].outcome == STOP
        due = store.next_trial("p02")
        assert due is not None
        assert due.order_no == 2
        assert store.check() >= 1


@pytest.mark.slow
def test_who_was_cut_off_before_the_commit_finds_the_trial_running(tmp_path: Path) -> None:
    store, trial = opened(tmp_path)
    store.close()
    killed(_finish_and_die_before_the_commit, tmp_path)
    with open_small(tmp_path) as store:
        assert not store.trials("p02")[0].has_ended
        again = store.open_trial("p02", 1)
        assert (again.trial_id, again.epoch) == (trial.trial_id, 3)
        assert store.finish_trial(trial.trial_id, EpisodeEnd(reason="giveup")).reason == "giveup"


@pytest.mark.slow
def test_a_kill_in_a_backup_leaves_the_end_stored_and_no_half_copy(tmp_path: Path) -> None:
    opened(tmp_path)[0].close()
    killed(_reach_the_end_and_die_in_the_backup, tmp_path)
    assert not list((tmp_path / "backups").glob("*.db"))
    with open_small(tmp_path) as store:
        assert has_reached(store.participant("p02").stages, "finished")
        store.back_up()
    assert [path.suffix for path in (tmp_path / "backups").iterdir()] == [".db"]


@pytest.mark.slow
def test_a_withdrawal_that_was_cut_off_is_finished_at_the_next_start(tmp_path: Path) -> None:
    store, trial = opened(tmp_path)
    store.close()
    killed(_withdraw_and_die_before_the_key_is_deleted, tmp_path)
    assert json.loads((tmp_path / KEYS_FILE).read_text())["p02"] is not None
    with open_small(tmp_path) as store:
        assert store.participant("p02").is_shredded
        assert store.events(trial.trial_id) == ()
        store.check()
    assert json.loads((tmp_path / KEYS_FILE).read_text())["p02"] is None


# --- disks


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
    """A connection whose commits fail with an error of SQLite, in one of the two ways in which they do."""

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
    store, trial = opened(tmp_path)
    with store:
        before = counts(tmp_path)
        whole = store._writer._database
        store._writer._database = BrokenDisk(whole, ERRORS[fault], rolls_back=rolls_back)  # type: ignore[assignment]
        for name, write in WRITES.items():
            with pytest.raises(StoreFullError, match="Nothing was lost") as caught:
                write(store, trial)
            assert "\n" not in str(caught.value), name
            assert counts(tmp_path) == before
        store._writer._database = whole
        assert store.append(trial.trial_id, trial.epoch, KEY) == 2
        assert store.finish_trial(trial.trial_id, STOP) == STOP
        assert store.check() == 2


def test_on_a_full_disk_every_write_is_whole_or_refused(tmp_path: Path) -> None:
    store, trial = opened(tmp_path)
    with store:
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
        store.check()


def _write_on_and_on(store: StudyStore, trial: Trial) -> None:
    for _ in range(1000):
        store.append(trial.trial_id, trial.epoch, OPEN)


def test_a_database_that_became_read_only_pauses_the_study(tmp_path: Path) -> None:
    store, trial = opened(tmp_path)
    with store:
        store._database.execute("PRAGMA query_only = ON")
        with pytest.raises(StoreFullError, match=r"expected a disk that can be written\. Nothing was lost: look at"):
            store.append(trial.trial_id, trial.epoch, KEY)
        store._database.execute("PRAGMA query_only = OFF")
        assert store.append(trial.trial_id, trial.epoch, KEY) == 2


def test_a_row_that_the_database_refuses_does_not_stop_the_others_of_its_commit(tmp_path: Path) -> None:
    store, trial = opened(tmp_path)
    entry = VerificationEntry(trial.trial_id, "v1", "verified", 0.0, None, "", "s" * 64, 1)
    with store:
        store.add_verification(entry)
        results: dict[str, object] = {}

        def write(name: str, job: Callable[[], object]) -> None:
            try:
                results[name] = job()
            except StudyError as error:
                results[name] = error

        jobs: dict[str, Callable[[], object]] = {
            "before": lambda: store.append(trial.trial_id, trial.epoch, KEY),
            "twice": lambda: store.add_verification(entry),
            "after": lambda: store.append(trial.trial_id, trial.epoch, KEY),
        }
        _together(store, [threading.Thread(target=write, args=item) for item in jobs.items()])
        assert isinstance(results["twice"], StudyError)
        assert not isinstance(results["twice"], StoreFullError)
        assert sorted([results["before"], results["after"]]) == [2, 3]  # type: ignore[type-var]
        assert len(store.events(trial.trial_id)) == 3


def _together(store: StudyStore, threads: list[threading.Thread]) -> None:
    """Run the threads so that their writes are in one commit."""
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

    writer._thread.submit = counted  # type: ignore[method-assign]
    for number, thread in enumerate(threads, start=1):
        thread.start()
        assert queued.acquire(timeout=30), number
    is_free.set()
    for thread in [holder, *threads]:
        thread.join(30)


def test_a_backup_that_fails_keeps_nobody_from_the_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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


def test_a_result_that_comes_after_the_withdrawal_is_refused_also_when_it_was_stored_before(tmp_path: Path) -> None:
    store, trial = opened(tmp_path)
    with store:
        store.finish_trial(trial.trial_id, STOP)
        store.withdraw("p02")
        with pytest.raises(TrialEndedError, match="the participant withdrew"):
            store.finish_trial(trial.trial_id, STOP)
