"""A study folder of another version, or changed behind the program's back: one clear line from whatever opens it."""

import json
import re
import sqlite3
import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from human_study.design.plan import load_plan
from human_study.design.study import StudyPractice, load_study
from human_study.store.store import open_store
from personal_viz.__main__ import main

from .flow_studies import plan_small


@pytest.fixture(scope="module")
def begun(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a study that was served once, beside its `dataset`."""
    root = tmp_path_factory.mktemp("begun")
    folder = plan_small(root, flow=("instructions",), practice=StudyPractice(pan=0, pog=0))
    config = load_study(folder)
    with open_store(folder, config, load_plan(folder, config)):
        return folder


@pytest.fixture
def kept(begun: Path) -> Iterator[Path]:
    """That folder, which is again as it was after the test."""
    files = {path: path.read_bytes() for path in begun.iterdir() if path.is_file()}
    try:
        yield begun
    finally:
        for path, was in files.items():
            path.write_bytes(was)


def line_of(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """The one line by which the program refuses a study."""
    monkeypatch.setattr(sys, "argv", ["personal-viz", "study", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    said = capsys.readouterr()
    assert (ended.value.code, said.err.count("\n")) == (1, 1), said
    return said.err


def arguments_of(verb: str, folder: Path) -> list[str]:
    """The command line of a verb."""
    served = ["--dataset", str(folder.parent / "dataset"), "--port", "0", "--pilot"]
    return [verb, str(folder), *(served if verb == "serve" else [])]


@pytest.mark.parametrize("verb", ["serve", "status", "check-db", "export"])
def test_a_database_of_a_newer_program_is_refused_by_name(
    kept: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], verb: str
) -> None:
    with closing(sqlite3.connect(kept / "study.db")) as database:
        database.execute("PRAGMA user_version = 99")
    said = line_of(monkeypatch, capsys, *arguments_of(verb, kept))
    assert "study.db: has schema version 99; expected at most 2. It was written by a newer personal-viz" in said


@pytest.mark.parametrize("verb", ["serve", "check-db"])
@pytest.mark.parametrize(
    ("was", "by", "expected"),
    [
        ("version: 1", "version: 2", "study.yaml: version is 2; .*another version of personal-viz: use that one"),
        ("lease_s: 900.0", "lease_s: 901.0", r"study.yaml.*changed after the .*: restore it"),
    ],
)
def test_a_study_file_that_was_changed_or_is_newer_is_refused(
    kept: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    verb: str,
    was: str,
    by: str,
    expected: str,
) -> None:
    text = (kept / "study.yaml").read_text()
    assert text.count(was) == 1
    (kept / "study.yaml").write_text(text.replace(was, by))
    assert re.search(expected, line_of(monkeypatch, capsys, *arguments_of(verb, kept)))


@pytest.mark.parametrize("verb", ["serve", "check-db"])
def test_a_plan_that_was_changed_or_is_newer_is_refused(
    kept: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], verb: str
) -> None:
    plan = json.loads((kept / "plan.json").read_text())
    plan["participants"].reverse()
    (kept / "plan.json").write_text(json.dumps(plan))
    assert "changed after the start: restore it" in line_of(monkeypatch, capsys, *arguments_of(verb, kept))
    (kept / "plan.json").write_text(json.dumps({**plan, "schema_version": 3}))
    said = line_of(monkeypatch, capsys, *arguments_of(verb, kept))
    assert "plan.json: schema_version is 3" in said
    assert "another version of personal-viz: use that one" in said


def test_a_folder_as_it_was_is_whole(kept: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["personal-viz", "study", "check-db", str(kept)])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 0
