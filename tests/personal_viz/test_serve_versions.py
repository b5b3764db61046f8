"""A study folder of another version, or changed behind the program's back: one clear line from any verb."""

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
from human_study.store.migrations import SCHEMA_VERSION
from human_study.store.store import open_store
from personal_viz.__main__ import main
from personal_viz.study_app import study_files
from sim.episodes.dataset import PersonalDataset
from sim.errors import StudyError
from sim.tasks.provenance import program_release

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
    """That folder, which is restored after the test."""
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
    assert f"has schema version 99; expected at most {SCHEMA_VERSION}. It was written by a newer personal-viz" in said


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
    (kept / "plan.json").write_text(json.dumps({**plan, "schema_version": 4}))
    said = line_of(monkeypatch, capsys, *arguments_of(verb, kept))
    assert "plan.json: schema_version is 4" in said
    assert "another version of personal-viz: use that one" in said


def test_a_study_of_another_version_of_homes_is_refused_by_the_release_that_serves_it(
    kept: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = load_plan(kept, load_study(kept))
    assert (plan.homes_version, plan.made_by) == (study_files.HOMES_VERSION, program_release())
    monkeypatch.setattr(study_files, "HOMES_VERSION", plan.homes_version + 1)
    said = line_of(monkeypatch, capsys, *arguments_of("serve", kept))
    assert f"home FlowHome: the study was planned on homes of version {plan.homes_version}, this program" in said
    assert f"makes version {plan.homes_version + 1}; expected the same" in said
    assert f"Serve and verify it with {program_release()}, or plan it again while nobody has taken part" in said
    assert line_of(monkeypatch, capsys, "status", str(kept / "nothing"))
    monkeypatch.setattr(sys, "argv", ["personal-viz", "study", "status", str(kept)])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 0, "records are read by any version"


def test_a_study_on_another_plan_of_its_home_is_refused(
    kept: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = kept.parent / "dataset" / "scenes" / "FlowHome.plan.json"
    was = path.read_text()
    home = json.loads(was)
    home["furniture"] = home["furniture"][1:]
    path.write_text(json.dumps(home))
    try:
        said = line_of(monkeypatch, capsys, *arguments_of("serve", kept))
    finally:
        path.write_text(was)
    assert "the plan of home FlowHome differs from the one on which the study was planned" in said
    assert "Restore scenes/FlowHome.plan.json" in said


def test_homes_are_compared_with_those_of_the_plan(kept: Path) -> None:
    plan, dataset = load_plan(kept, load_study(kept)), PersonalDataset(kept.parent / "dataset")
    study_files.require_same_homes(plan, plan.scenes, dataset, None)
    scans = [scene.model_copy(update={"kind": "scan"}) for scene in plan.scenes]
    with pytest.raises(StudyError, match=r"home FlowHome opens as 'invented' here; expected 'scan'.*--scenes-dir\."):
        study_files.require_same_homes(plan, scans, dataset, None)
    older = plan.model_copy(update={"homes_version": 1, "made_by": "personal-viz 0.0.9"})
    with pytest.raises(StudyError, match=r"homes of version 1, this program .*Serve and verify it with personal-viz 0"):
        study_files.require_same_homes(older, plan.scenes, dataset, None)
    study_files.require_same_homes(older, [], dataset, None)


def test_an_unchanged_folder_passes_the_check(kept: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["personal-viz", "study", "check-db", str(kept)])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 0
