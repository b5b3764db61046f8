"""The database's log is taken away, copies are restored, and faults of all kinds come one after another."""

import os
import shutil
import sqlite3
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from human_study.store.lock import LOCK_FILE, StudyInUseError, rows_noted
from human_study.store.records import num_rows, read_study
from human_study.store.store import StudyStore, Trial
from human_study.store.writer import StoreFullError
from human_study.trial.events import Shown
from sim.errors import StudyError

from .stores import begun_trial, checked, open_small, opened

LOG = "study.db-wal"


def write(store: StudyStore, trial: Trial, *steps: int) -> None:
    """Stores events that can be told from all others, each in its own commit."""
    for step in steps:
        store.append(trial.trial_id, trial.epoch, Shown(step=step, frame_hash=None))


def steps_in(folder: Path) -> list[int]:
    """The steps that a study holds, after a check of everything."""
    with read_study(folder) as reader:
        reader.check()
        trial_id = reader.trials("p02")[0].trial_id
        assert trial_id is not None
        return [line.event.step for line in reader.events(trial_id) if isinstance(line.event, Shown)]


def as_killed(folder: Path, copy: Path, *, without: str = "") -> Path:
    """The files as a kill leaves them, without one of them."""
    left_out = shutil.ignore_patterns("*-shm", *([without] if without else []))
    return Path(shutil.copytree(folder, copy, ignore=left_out))


def remove(path: Path) -> None:
    path.unlink()


def replace(path: Path) -> None:
    path.unlink()
    path.touch()


@pytest.mark.parametrize("take_away", [remove, replace])
def test_a_log_that_is_taken_away_while_the_study_is_served_is_reported_and_nothing_is_lost(
    tmp_path: Path, take_away: Callable[[Path], None]
) -> None:
    folder = tmp_path / "study"
    with opened(folder) as (store, trial):
        write(store, trial, *range(5))
        for number in range(3):
            take_away(folder / LOG)
            write(store, trial, 5 + 2 * number)
            write(store, trial, 6 + 2 * number)
            assert steps_in(as_killed(folder, tmp_path / f"killed-{number}")) == list(range(7 + 2 * number))
            assert "study.db-wal: was taken away while the study is served" in (store.look_after_log() or "")
        take_away(folder / LOG)
        assert "nothing is lost: find out which program" in (store.look_after_log() or "")
        assert store.look_after_log() is None
        assert steps_in(folder) == list(range(11))


def test_a_log_taken_away_while_somebody_reads_an_older_snapshot_is_acknowledged_later(tmp_path: Path) -> None:
    with opened(tmp_path) as (store, trial):
        write(store, trial, 0)
        with read_study(tmp_path) as reader:
            reader.codes()
            store._database.execute("PRAGMA busy_timeout = 0")
            (tmp_path / LOG).unlink()
            with pytest.raises(StoreFullError, match=r"study\.db-wal was taken away while others read"):
                write(store, trial, 1)
        write(store, trial, 2)
        assert store.look_after_log() is not None
        assert steps_in(tmp_path) == [0, 1, 2]  # what was not acknowledged may be there


@pytest.mark.parametrize("copy_back", [True, False])
def test_a_log_taken_away_after_a_kill_is_noticed_at_every_door(tmp_path: Path, copy_back: bool) -> None:
    folder = tmp_path / "study"
    with opened(folder) as (store, trial):
        store._database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        write(store, trial, *range(8))
        killed = as_killed(folder, tmp_path / "killed", without=LOG)
        log = (folder / LOG).read_bytes()
    message = (
        r"study\.db: holds (\d+) rows; expected at least (\d+), .*study\.db-wal was taken away.*"
        r"to go on with what is left, delete study\.lock"
    )
    for door in (open_small, steps_in, open_small):
        with pytest.raises(StudyError, match=message) as caught:
            door(killed)
        assert "\n" not in str(caught.value)
    if copy_back:
        for name in ("study.db-wal", "study.db-shm"):
            (killed / name).unlink(missing_ok=True)
        (killed / LOG).write_bytes(log)
    else:
        (killed / LOCK_FILE).unlink()
    open_small(killed).close()
    assert steps_in(killed) == (list(range(8)) if copy_back else [])


def test_a_restored_copy_has_all_that_was_acknowledged_before_it_and_the_study_goes_on(tmp_path: Path) -> None:
    folder = tmp_path / "study"
    with opened(folder) as (store, trial):
        write(store, trial, *range(4))
        copy = store.back_up()
        write(store, trial, *range(4, 9))
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    shutil.copy(folder / "keys.json", elsewhere)
    shutil.copy(copy, elsewhere / "study.db")
    shutil.copy(copy, folder / "study.db")  # over newer rows: never in silence
    with pytest.raises(StudyError, match="an older copy was put here"):
        open_small(folder)
    (folder / LOCK_FILE).unlink()
    for place in (elsewhere, folder):
        assert steps_in(place) == list(range(4))
        with open_small(place) as store:
            again = store.open_trial("p02", 1)
            write(store, again, 9)
            assert again.trial_id == trial.trial_id
        assert steps_in(place) == [*range(4), 9]


def test_a_database_that_only_opens_for_reading_acknowledges_nothing(tmp_path: Path) -> None:
    with opened(tmp_path) as (store, trial):
        whole = store._writer._database
        uri = f"{(tmp_path / 'study.db').as_uri()}?mode=ro"
        store._writer._database = sqlite3.connect(uri, uri=True, isolation_level=None, check_same_thread=False)
        with pytest.raises(StoreFullError, match=r"attempt to write a readonly database\); expected a disk that can"):
            write(store, trial, 0)
        store._writer._database.close()
        store._writer._database = whole
        write(store, trial, 1)
        assert steps_in(tmp_path) == [1]


def test_the_lock_notes_every_stored_row_and_keeps_the_number_for_the_next_process(tmp_path: Path) -> None:
    trial = begun_trial(tmp_path)
    noted = rows_noted(tmp_path)
    with open_small(tmp_path) as store:
        assert (tmp_path / LOCK_FILE).read_text().split() == [str(os.getpid()), str(noted)]
        again = store.open_trial("p02", 1)  # a sitting and the event `reconnect`
        store.keep_answer("p02", "comment", "fine")
        with pytest.raises(StudyError):
            store.open_trial("p02", 99)
        store.append_many(trial.trial_id, again.epoch, [Shown(step=step, frame_hash=None) for step in range(3)])
        assert rows_noted(tmp_path) == noted + 6 == num_rows(store._database)
    (tmp_path / LOCK_FILE).write_text("no number\nat all")
    assert rows_noted(tmp_path) == 0
    open_small(tmp_path).close()
    assert rows_noted(tmp_path) == noted + 6


@pytest.mark.parametrize("rounds", [8, pytest.param(60, marks=pytest.mark.release)])
def test_faults_of_all_kinds_one_after_another_lose_nothing_acknowledged(tmp_path: Path, rounds: int) -> None:
    rng = np.random.default_rng(4)
    folder, number, steps = tmp_path / "study-0", 0, list[int]()
    begun_trial(folder)
    store = open_small(folder)
    trial = store.open_trial("p02", 1)
    for place in range(rounds):
        for _ in range(int(rng.integers(1, 12))):
            write(store, trial, number)
            steps.append(number)
            number += 1
        fault = ("log", "full", "read-only", "second server", "copy", "kill")[place % 6]
        if fault == "log":
            (folder / LOG).unlink()
            assert store.look_after_log() is not None
        elif fault in ("full", "read-only"):
            number = _written_until_refused(store, trial, steps, number, fault)
        elif fault == "second server":
            with pytest.raises(StudyInUseError, match=f"is in use by process {os.getpid()}; expected a study that no"):
                open_small(folder)
        elif fault == "copy":
            restored = tmp_path / f"restored-{place}"
            restored.mkdir()
            shutil.copy(folder / "keys.json", restored)
            shutil.copy(store.back_up(), restored / "study.db")
            assert steps_in(restored) == steps
        else:
            folder = as_killed(folder, tmp_path / f"study-{place}")
            store.close()
            store = open_small(folder)
            trial = store.open_trial("p02", 1)
        assert steps_in(folder) == steps, fault
    assert checked(store) > rounds
    store.close()


def _written_until_refused(store: StudyStore, trial: Trial, steps: list[int], number: int, fault: str) -> int:
    """Writes until the disk is full or at once refuses; returns the next number."""
    pages = store._database.execute("PRAGMA page_count").fetchone()[0]
    limit = f"PRAGMA max_page_count = {pages + 1}" if fault == "full" else "PRAGMA query_only = ON"
    store._database.execute(limit)

    def write_on() -> None:
        for step in range(number, number + 1000):
            write(store, trial, step)
            steps.append(step)

    with pytest.raises(StoreFullError, match=r"cannot be written now .* Nothing was lost"):
        write_on()
    store._database.execute("PRAGMA max_page_count = 1000000")
    store._database.execute("PRAGMA query_only = OFF")
    return steps[-1] + 1
