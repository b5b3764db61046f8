"""A study's folder: only its owner reads it, and `check-db` says when its keys do not open the records."""

import json
import os
import stat
from collections.abc import Iterator
from pathlib import Path

import pytest

from human_study.design.plan import save_plan
from human_study.design.study import save_study
from personal_viz.cli.study.check_db import StudyCheckDb
from sim.errors import StudyError

from .finished import BEGUN, events_of, study_with_trials
from .small_world import plan, study
from .stores import filled, open_small


@pytest.fixture(params=[0o000, 0o022, 0o277], ids=lambda mask: f"umask {mask:03o}")
def umask(request: pytest.FixtureRequest) -> Iterator[None]:
    """Runs the test with this umask."""
    before = os.umask(request.param)
    yield
    os.umask(before)


def modes(folder: Path) -> dict[str, str]:
    """Mode of the folder and of everything in it, by name."""
    return {
        str(path.relative_to(folder.parent)): f"{stat.S_IMODE(path.stat().st_mode):03o}"
        for path in (folder, *sorted(folder.rglob("*")))
    }


@pytest.mark.usefixtures("umask")
def test_everything_of_a_study_is_its_owners_only_whatever_the_umask(tmp_path: Path) -> None:
    folder = tmp_path / "study"
    save_study(folder, study())
    save_plan(folder, plan(study()))
    with filled(folder) as store:
        trial = store.open_trial("p02", 1)
        store.append_many(trial.trial_id, trial.epoch, events_of(trial.key, BEGUN, task="pan"))
        store.back_up()
        found = modes(folder)
    assert found.pop("study/study.yaml")  # the choices, which are published, and their form
    assert found.pop("study/study.schema.json")
    backup = next(name for name in found if name.startswith("study/backups/"))
    assert found == {
        "study": "700",
        "study/backups": "700",
        backup: "600",
        "study/keys.json": "600",
        "study/plan.json": "600",
        "study/study.db": "600",
        "study/study.db-shm": "600",
        "study/study.db-wal": "600",
        "study/study.lock": "600",
    }


@pytest.mark.parametrize("door", ["opened", "checked"])
def test_a_folder_of_an_earlier_version_is_closed_to_others(tmp_path: Path, door: str) -> None:
    folder = tmp_path / "study"
    save_plan(folder, plan(study()))
    with filled(folder) as store:
        store.back_up()
    for path in folder.rglob("*"):
        path.chmod(0o755 if path.is_dir() else 0o644)
    folder.chmod(0o755)
    if door == "opened":
        open_small(folder).close()
    else:
        StudyCheckDb(study=folder).run()
    found = modes(folder)
    assert {found["study"], found["study/backups"]} == {"700"}
    assert {mode for name, mode in found.items() if name.endswith((".db", "plan.json", ".lock"))} == {"600"}


def test_whole_keys_pass(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    study_with_trials(tmp_path)
    assert StudyCheckDb(study=tmp_path).run() == 0
    assert "and the keys open them" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("damage", "line"),
    [
        (lambda keys: None, "keys.json: found no such file; expected a key of each participant"),
        (lambda keys: "", "keys.json: cannot be read"),
        (lambda keys: "[" * 100_000, "keys.json: cannot be read"),
        (lambda keys: "[]", "keys.json: cannot be read"),
        (lambda keys: "{}", "keys.json: has no key of p01, p02; expected"),
        (lambda keys: json.dumps({**keys, "p01": "AAAA"}), "keys.json: cannot be read"),
        (lambda keys: json.dumps({"p01": keys["p01"]}), "keys.json: has no key of p02; expected"),
        (lambda keys: json.dumps({"p01": keys["p02"], "p02": keys["p01"]}), "cannot be decrypted; expected"),
    ],
)
def test_missing_damaged_and_other_keys_are_reported_in_one_line(tmp_path: Path, damage, line: str) -> None:
    study_with_trials(tmp_path)
    keys = tmp_path / "keys.json"
    text = damage(json.loads(keys.read_text()))
    if text is None:
        keys.unlink()
    else:
        keys.write_text(text)
    with pytest.raises(StudyError) as caught:
        StudyCheckDb(study=tmp_path).run()
    assert line in str(caught.value)
    assert "estore" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_keys_of_people_who_withdrew_may_be_gone(tmp_path: Path) -> None:
    study_with_trials(tmp_path)
    with open_small(tmp_path) as store:
        store.withdraw("p02")
    keys = tmp_path / "keys.json"
    kept = {code: key for code, key in json.loads(keys.read_text()).items() if key}
    assert list(kept) == ["p01"]
    assert StudyCheckDb(study=tmp_path).run() == 0
    keys.write_text(json.dumps(kept))  # restored without the mark
    assert StudyCheckDb(study=tmp_path).run() == 0
