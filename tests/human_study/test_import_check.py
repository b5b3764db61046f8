"""Reading an export back: every outcome is recomputed from the exported events, every change is named."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from human_study.export.import_check import import_check
from human_study.export.manifest import exported_file, read_manifest
from sim.errors import StudyError

from .finished import room, table_of


def change(folder: Path, name: str, edit: Callable[[str], str]) -> None:
    """Change a file and make the manifest agree, as somebody who wants other results would."""
    path = folder / name
    before = path.read_text()
    path.write_text(edit(before))
    assert path.read_text() != before
    manifest = read_manifest(folder)
    entry = exported_file(path.read_bytes(), manifest.files[name].num_rows)
    changed = manifest.model_copy(update={"files": manifest.files | {name: entry}})
    (folder / "manifest.json").write_text(changed.model_dump_json(indent=2))


def walker(folder: Path) -> str:
    """Run folder of the participant who walked."""
    (found,) = (path for path in folder.glob("pilot-*-pan"))
    return found.name


def test_an_honest_export_agrees(out: Path) -> None:
    report = import_check(out, room)
    assert report.agrees
    assert (report.num_attempts, report.num_agreeing, report.num_unsupported, report.problems) == (3, 3, 0, ())
    assert report.num_files == len(read_manifest(out).files)


def test_a_changed_byte_is_named(out: Path) -> None:
    path = out / "events.parquet"
    content = bytearray(path.read_bytes())
    content[100] ^= 1
    path.write_bytes(content)
    with pytest.raises(StudyError, match=r"events\.parquet: has sha256 [0-9a-f]{12} .* It was changed after"):
        import_check(out, room)


def test_a_missing_file_and_one_too_many_are_named(out: Path) -> None:
    (out / "extra.csv").write_text("")
    with pytest.raises(StudyError, match=r"extra\.csv: is not in manifest\.json"):
        import_check(out, room)
    (out / "extra.csv").unlink()
    (out / "trials.csv").unlink()
    with pytest.raises(StudyError, match=r"trials\.csv: cannot be read \(No such file or directory\)"):
        import_check(out, room)


def test_a_folder_that_is_no_export_is_refused(tmp_path: Path, out: Path) -> None:
    with pytest.raises(StudyError, match=r"manifest\.json: cannot be read .* expected an export"):
        import_check(tmp_path, room)
    (out / "manifest.json").write_text('{"schema_version": 4}')
    with pytest.raises(StudyError, match=r"manifest\.json: schema_version is 4; expected"):
        import_check(out, room)


@pytest.mark.parametrize(
    ("file", "was", "by", "problem"),
    [
        ("trials.jsonl", '"spl":0.8', '"spl":1.0', "row.spl is stored as 1.0, recomputed as 0.8"),
        (
            "RUN/steps.jsonl",
            '"path_m":1.25',
            '"path_m":1.0',
            "run.end.measures.path_m is stored as 1.0, recomputed as 1.25",
        ),
        ("events.jsonl", '"position":[-1.25,', '"position":[-2.25,', "row.spl is stored as 0.8, recomputed as 0.444"),
    ],
    ids=["a better outcome in the table", "a better outcome in the run folder", "a changed step"],
)
def test_a_change_is_found(out: Path, file: str, was: str, by: str, problem: str) -> None:
    change(out, file.replace("RUN", walker(out)), lambda text: text.replace(was, by))
    report = import_check(out, room)
    assert not report.agrees
    (found,) = report.problems
    assert found.startswith(f"{walker(out)[6:9]}/1/1: {problem}")


def test_a_result_without_a_row_and_a_row_without_a_result_are_found(out: Path) -> None:
    rows = table_of(out, "trials")
    place = next(number for number, row in enumerate(rows) if row["task"] == "pan" and row["end_reason"] == "stop")
    rows[place]["episode_id"] = "7"
    change(out, "trials.jsonl", lambda _: "".join(json.dumps(row, separators=(",", ":")) + "\n" for row in rows))
    problems = import_check(out, room).problems
    assert problems[0].endswith("is in no run folder, though nothing leaves it out")
    assert problems[1].endswith("is of no row in trials.jsonl")


def test_lost_events_and_rows_are_named(out: Path) -> None:
    change(out, "events.jsonl", lambda text: "".join(text.splitlines(keepends=True)[1:]))
    with pytest.raises(StudyError, match=r"events\.jsonl: has 44 rows; expected 45"):
        import_check(out, room)
    (out / "events.jsonl").write_text("")
    change(out, "events.jsonl", lambda _: "{}\n")
    with pytest.raises(StudyError, match=r"events\.jsonl:1: participant is nothing; expected"):
        import_check(out, room)


def test_events_of_another_home_are_unsupported_not_wrong(out: Path) -> None:
    report = import_check(out, lambda _: room(scene_digest="e" * 64))
    assert (report.num_unsupported, report.num_agreeing, report.problems) == (3, 0, ())
    assert not report.agrees


def test_an_export_of_version_1_which_knew_no_paper_strict_agrees(out: Path) -> None:
    def without_strict(text: str) -> str:
        lines = [json.loads(line) for line in text.splitlines()]
        for line in lines:
            if line["kind"] == "episode":
                line["schema_version"] = 1
            if line["kind"] == "end":
                del line["measures"]["rules"]["paper-strict"]
        return "".join(json.dumps(line) + "\n" for line in lines)

    change(out, f"{walker(out)}/steps.jsonl", without_strict)
    change(out, f"{walker(out)}/run.json", lambda text: text.replace('"schema_version": 3', '"schema_version": 1'))
    report = import_check(out, room)
    assert report.agrees
    assert report.num_agreeing == 3

    change(out, f"{walker(out)}/steps.jsonl", lambda text: text.replace('"path_m": 1.25', '"path_m": 1.0'))
    (problem,) = import_check(out, room).problems
    assert "run.end.measures.path_m is stored as 1.0, recomputed as 1.25" in problem
