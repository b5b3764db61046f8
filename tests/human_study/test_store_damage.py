"""Databases that are damaged, foreign, newer, too old, changed behind the store's back, or in need of a migration."""

import shutil
import sqlite3
from collections.abc import Callable
from pathlib import Path

import pytest

from human_study.store import database as database_module
from human_study.store.database import bring_up_to_date, migrate
from human_study.store.migrations import MIGRATIONS, SCHEMA_VERSION
from human_study.store.records import read_study
from human_study.trial.events import Moment, Shown
from sim.errors import StudyError
from sim.tasks.run_files import EpisodeEnd

from .small_world import study
from .stores import KEY, edit, filled, open_small, opened


@pytest.mark.parametrize(
    "content", [b"this is not a database at all, only some text\n" * 50, b"SQLite format 3\0" * 64]
)
def test_a_file_that_is_not_a_database_is_one_line(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "study.db").write_bytes(content)
    with pytest.raises(StudyError, match=r"study\.db: .*expected.*\. .*") as caught:
        open_small(tmp_path)
    assert "\n" not in str(caught.value)
    assert (tmp_path / "study.db").read_bytes() == content


def test_bytes_overwritten_inside_the_database_are_found_at_opening(tmp_path: Path) -> None:
    with opened(tmp_path) as (store, trial):
        store.append_many(trial.trial_id, trial.epoch, [Shown(step=0, frame_hash="a" * 64)] * 200)
    path = tmp_path / "study.db"
    data = bytearray(path.read_bytes())
    middle = len(data) * 3 // 4 // 4096 * 4096
    data[middle : middle + 4096] = b"\x55" * 4096
    path.write_bytes(bytes(data))
    with pytest.raises(StudyError, match=r"(found a damaged file|SQLite found damage).*Restore the folder"):
        open_small(tmp_path)


def test_a_database_of_another_program_is_left_alone(tmp_path: Path) -> None:
    database = sqlite3.connect(tmp_path / "study.db")
    database.execute("CREATE TABLE other(x)")
    database.close()
    before = (tmp_path / "study.db").read_bytes()
    with pytest.raises(StudyError, match="database of another program"):
        open_small(tmp_path)
    assert (tmp_path / "study.db").read_bytes() == before


@pytest.mark.parametrize(
    ("version", "message"),
    [
        pytest.param(99, r"has schema version 99; expected at most \d.*newer personal-viz", id="a newer one"),
        pytest.param(
            1,
            r"schema version 1; expected at least 2\..*use the personal-viz that",
            id="one from before the first release",
        ),
    ],
)
@pytest.mark.parametrize("use", [open_small, lambda folder: read_study(folder).__enter__(), bring_up_to_date])
def test_another_schema_version_is_refused(
    tmp_path: Path, version: int, message: str, use: Callable[[Path], object]
) -> None:
    filled(tmp_path).close()
    edit(tmp_path, f"PRAGMA user_version = {version}")
    with pytest.raises(StudyError, match=message):
        use(tmp_path)


def test_another_studys_store_is_refused(tmp_path: Path) -> None:
    filled(tmp_path).close()
    with pytest.raises(StudyError, match=r"study\.yaml was changed after the start"):
        open_small(tmp_path, study(dataset={"sha256": "0" * 64, "seed": 1}))


@pytest.mark.parametrize(
    "sql",
    [
        "UPDATE event SET payload = (SELECT payload FROM event AS other WHERE other.seq = 3) WHERE seq = 2",
        "UPDATE event SET t_srv_ns = t_srv_ns + 1 WHERE seq = 2",
        "UPDATE event SET epoch = 2 WHERE seq = 2",
        "DELETE FROM event WHERE seq = 2",
        "UPDATE event SET seq = seq + 10 WHERE seq = 3",
    ],
)
def test_a_changed_chain_is_found_at_opening(tmp_path: Path, sql: str) -> None:
    with opened(tmp_path) as (store, trial):
        store.append_many(trial.trial_id, trial.epoch, [KEY, KEY])
    edit(tmp_path, sql)
    with pytest.raises(StudyError, match=rf"trial {trial.trial_id}, event \d+ does not continue the chain"):
        open_small(tmp_path)


def test_an_event_cut_off_the_end_of_a_finished_trial_is_found(tmp_path: Path) -> None:
    with opened(tmp_path) as (store, trial):
        store.append(trial.trial_id, trial.epoch, Moment(kind="giveup"))
        store.finish_trial(trial.trial_id, EpisodeEnd(reason="giveup"))
    edit(tmp_path, "DELETE FROM event WHERE seq = 2")
    with pytest.raises(StudyError, match="ends with another event than when it was finished"):
        open_small(tmp_path)


def test_an_up_to_date_database_needs_no_migration(tmp_path: Path) -> None:
    filled(tmp_path).close()
    assert bring_up_to_date(tmp_path) == []
    assert not (tmp_path / database_module.BACKUP_FOLDER).exists()


def test_a_database_of_the_first_release_gets_the_later_tables(tmp_path: Path) -> None:
    with opened(tmp_path) as (store, trial):
        store.append(trial.trial_id, trial.epoch, KEY)
    edit(tmp_path, "DROP TABLE personal_answer; PRAGMA user_version = 2")
    assert bring_up_to_date(tmp_path) == [3]
    with open_small(tmp_path) as store:
        store.keep_answer("p01", "survey", "{}")
    with read_study(tmp_path) as reader:
        assert reader.answers("survey") == {"p01": "{}"}
        assert reader.check() == 2


def test_a_migration_keeps_a_copy_of_the_old_database_and_raises_the_version(tmp_path: Path) -> None:
    with opened(tmp_path) as (store, trial):
        store.append_many(trial.trial_id, trial.epoch, [KEY, KEY])
    path = tmp_path / "study.db"
    database = sqlite3.connect(path, isolation_level=None)
    steps = (*MIGRATIONS, "ALTER TABLE trial ADD COLUMN later TEXT", "ALTER TABLE trial ADD COLUMN last TEXT")
    assert migrate(database, path, steps=steps) == [SCHEMA_VERSION + 1, SCHEMA_VERSION + 2]
    assert database.execute("PRAGMA user_version").fetchone()[0] == SCHEMA_VERSION + 2
    assert database.execute("SELECT later, last FROM trial").fetchall() == [(None, None)]
    database.close()
    (copy,) = (tmp_path / database_module.BACKUP_FOLDER).iterdir()
    shutil.copy(copy, path)
    with read_study(tmp_path) as reader:
        assert reader.check() == 3


def test_a_migration_that_fails_leaves_the_database_as_it_was(tmp_path: Path) -> None:
    with opened(tmp_path) as (store, trial):
        store.append_many(trial.trial_id, trial.epoch, [KEY, KEY])
    path = tmp_path / "study.db"
    database = sqlite3.connect(path, isolation_level=None)
    bad = "ALTER TABLE trial ADD COLUMN later TEXT; INSERT INTO nowhere VALUES (1)"
    with pytest.raises(StudyError, match=f"cannot go from schema version {SCHEMA_VERSION} to {SCHEMA_VERSION + 1}"):
        migrate(database, path, steps=(*MIGRATIONS, bad))
    database.close()
    with read_study(tmp_path) as reader:
        assert reader.check() == 3
