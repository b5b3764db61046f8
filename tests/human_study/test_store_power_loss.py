"""Power loss and kills at chosen instants: nothing acknowledged is lost, nothing is half done."""

import json
import multiprocessing
import os
import signal
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from human_study.journey import has_reached
from human_study.store import database as database_module
from human_study.store import store as store_module
from human_study.store.records import read_study
from human_study.store.store import Trial
from human_study.store.vault import KEYS_FILE, Vault
from human_study.trial.events import Shown
from sim.tasks.run_files import EpisodeEnd

from .stores import begun_trial, checked, open_small, opened, trials_of

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
    with opened(folder) as (store, trial):
        store._database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        wal, sizes = folder / "study.db-wal", []
        for step in range(30):
            store.append(trial.trial_id, trial.epoch, shown(step))
            sizes.append(wal.stat().st_size)
        return Written(
            trial, (folder / "study.db").read_bytes(), wal.read_bytes(), (folder / KEYS_FILE).read_bytes(), sizes
        )


def test_a_log_cut_by_a_power_loss_holds_every_event_acknowledged_at_that_length(
    tmp_path: Path, written: Written
) -> None:
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


# Kills at chosen instants, each in a process of its own


def die(*_: object, **__: object) -> None:
    """Ends this process as the system would, with nothing tidied up."""
    os.kill(os.getpid(), signal.SIGKILL)


def _finish_and_die_after_the_commit(folder: Path) -> None:
    store = open_small(folder)
    trial = store.open_trial("p02", 1)
    store_module.read_study = die  # the answer is read back after the commit
    store.finish_trial(trial.trial_id, STOP)


def _finish_and_die_before_the_commit(folder: Path) -> None:
    store = open_small(folder)
    trial = store.open_trial("p02", 1)
    store_module.queue_again = die  # the last step of the transaction
    store.finish_trial(trial.trial_id, STOP)


def _reach_the_end_and_die_in_the_backup(folder: Path) -> None:
    database_module.os.replace = die
    open_small(folder).enter_stage("p02", "finished")


def _withdraw_and_die_before_the_key_is_deleted(folder: Path) -> None:
    Vault.shred = die
    open_small(folder).withdraw("p02")


def killed(work: Callable[[Path], None], folder: Path) -> None:
    """Runs the work in a process that it ends."""
    context = multiprocessing.get_context("forkserver")
    process = context.Process(target=work, args=(folder,))
    process.start()
    process.join(60)
    assert process.exitcode == -signal.SIGKILL


@pytest.mark.slow
def test_a_person_cut_off_between_commit_and_reply_finds_the_same_outcome_once(tmp_path: Path) -> None:
    trial = begun_trial(tmp_path)
    killed(_finish_and_die_after_the_commit, tmp_path)
    with open_small(tmp_path) as store:
        for reason in ("stop", "giveup"):
            assert store.finish_trial(trial.trial_id, EpisodeEnd(reason=reason)) == STOP
        assert trials_of(store, "p02")[0].outcome == STOP
        due = store.next_trial("p02")
        assert due.order_no == 2
        assert checked(store) >= 1


@pytest.mark.slow
def test_a_person_cut_off_before_the_commit_finds_the_trial_running(tmp_path: Path) -> None:
    trial = begun_trial(tmp_path)
    killed(_finish_and_die_before_the_commit, tmp_path)
    with open_small(tmp_path) as store:
        assert not trials_of(store, "p02")[0].has_ended
        again = store.open_trial("p02", 1)
        assert (again.trial_id, again.epoch) == (trial.trial_id, 3)
        assert store.finish_trial(trial.trial_id, EpisodeEnd(reason="giveup")).reason == "giveup"


@pytest.mark.slow
def test_a_kill_in_a_backup_leaves_the_end_stored_and_no_half_copy(tmp_path: Path) -> None:
    begun_trial(tmp_path)
    killed(_reach_the_end_and_die_in_the_backup, tmp_path)
    assert not list((tmp_path / "backups").glob("*.db"))
    with open_small(tmp_path) as store:
        assert has_reached(store.participant("p02").stages, "finished")
        store.back_up()
    assert [path.suffix for path in (tmp_path / "backups").iterdir()] == [".db"]


@pytest.mark.slow
def test_a_withdrawal_that_was_cut_off_is_finished_at_the_next_start(tmp_path: Path) -> None:
    trial = begun_trial(tmp_path)
    killed(_withdraw_and_die_before_the_key_is_deleted, tmp_path)
    assert json.loads((tmp_path / KEYS_FILE).read_text())["p02"] is not None
    with open_small(tmp_path) as store:
        assert trials_of(store, "p02")[0].is_shredded
        assert store.events(trial.trial_id) == ()
        checked(store)
    assert json.loads((tmp_path / KEYS_FILE).read_text())["p02"] is None
