"""Annotations: every edit is a line, two annotators cannot overwrite each other, and a crash loses nothing."""

import contextlib
import datetime
import json
import multiprocessing
from pathlib import Path

import pytest
from pydantic import ValidationError

from sim.authoring.annotations import (
    AnnotatedObject,
    Box,
    Change,
    Edit,
    annotated_scenes,
    annotation_path,
    append_edit,
    changes_since,
    fold,
    read_edits,
    undo_of,
)
from sim.errors import DatasetError

NOON = datetime.datetime(2026, 1, 2, 12, 0, 0, tzinfo=datetime.UTC)
LAMP = AnnotatedObject(id=7, category="lamp", captions=("red lamp near the door",), room="hall")
BOX = Box(centre=(1.0, 0.5, -2.0), size=(0.4, 1.0, 0.4))


def edit(before: AnnotatedObject | None, after: AnnotatedObject | None, *, who: str = "ada") -> Edit:
    item = before or after
    assert item is not None
    return Edit(who=who, utc=NOON, id=item.id, before=before, after=after)


def changed(item: AnnotatedObject, **changes: object) -> AnnotatedObject:
    return AnnotatedObject.model_validate({**item.model_dump(), **changes})


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return annotation_path(tmp_path, "Home")


def test_edits_are_lines_that_are_read_back_and_folded(path: Path, tmp_path: Path) -> None:
    boxed = changed(LAMP, id=70_000, box=BOX.model_dump(), storey=1)
    edits = [edit(None, boxed), edit(None, LAMP), edit(LAMP, changed(LAMP, room="kitchen"), who="bo")]
    for one in edits:
        append_edit(path, one)
    assert path == tmp_path / "annotations" / "Home.jsonl"
    assert annotated_scenes(tmp_path) == ("Home",)
    assert read_edits(path) == tuple(edits)
    assert list(fold(edits).items()) == [(7, changed(LAMP, room="kitchen")), (70_000, boxed)]
    first = json.loads(path.read_text().splitlines()[0])
    assert first == {
        "version": 1,
        "who": "ada",
        "utc": "2026-01-02T12:00:00Z",
        "id": 70_000,
        "before": None,
        "after": {
            "id": 70_000,
            "category": "lamp",
            "captions": ["red lamp near the door"],
            "room": "hall",
            "storey": 1,
            "flagged": False,
            "box": {"centre": [1.0, 0.5, -2.0], "size": [0.4, 1.0, 0.4]},
        },
        "is_undo": False,
    }


def test_a_scene_without_a_file_has_no_edits(path: Path, tmp_path: Path) -> None:
    assert read_edits(path) == ()
    assert annotated_scenes(tmp_path) == ()
    with pytest.raises(DatasetError, match=r"scene '\.\./x': .*expected 1-64 letters"):
        annotation_path(tmp_path, "../x")


def test_the_second_of_two_annotators_is_told_to_load_the_object_again(path: Path) -> None:
    append_edit(path, edit(None, LAMP))
    append_edit(path, edit(LAMP, changed(LAMP, room="kitchen"), who="bo"))
    with pytest.raises(DatasetError) as error:
        append_edit(path, edit(LAMP, changed(LAMP, room="study")))
    line = str(error.value)
    assert "\n" not in line
    assert f"{path}: edit of 'ada': object 7 is " in line
    assert '"room":"kitchen"' in line
    assert "Load object 7 again, then repeat the edit; 'bo' edited it at 2026-01-02 12:00:00 UTC." in line
    assert fold(read_edits(path))[7].room == "kitchen"
    with pytest.raises(DatasetError, match=r"object 8 is not there; expected {"):
        append_edit(path, edit(changed(LAMP, id=8), None))


def test_undo_is_an_edit_too_and_can_be_undone(path: Path) -> None:
    made, moved = edit(None, LAMP), edit(LAMP, changed(LAMP, room="kitchen"))
    append_edit(path, made)
    append_edit(path, moved)
    with pytest.raises(DatasetError, match="object 7 is"):
        append_edit(path, undo_of(made, who="bo", utc=NOON))
    undone = undo_of(moved, who="bo", utc=NOON)
    append_edit(path, undone)
    assert fold(read_edits(path)) == {7: LAMP}
    append_edit(path, undo_of(undone, who="bo", utc=NOON))
    assert fold(read_edits(path))[7].room == "kitchen"
    assert len(path.read_text().splitlines()) == 4


def test_changes_since_an_edition_are_those_that_remain() -> None:
    kitchen, study = changed(LAMP, room="kitchen"), changed(LAMP, room="study")
    desk = changed(LAMP, id=9, category="desk")
    edits = [edit(None, LAMP), edit(LAMP, kitchen), edit(None, desk, who="bo"), edit(kitchen, study, who="bo")]
    assert changes_since(edits, 1) == (Change(7, ("ada", "bo"), LAMP, study), Change(9, ("bo",), None, desk))
    assert changes_since(edits, 4) == ()
    assert changes_since([*edits, edit(study, LAMP), edit(desk, None)], 1) == ()


@pytest.mark.parametrize("kept", [1, 40, -1])
def test_a_line_that_was_cut_off_is_ignored_and_removed_by_the_next_edit(path: Path, kept: int) -> None:
    append_edit(path, edit(None, LAMP))
    whole = path.read_bytes()
    append_edit(path, edit(LAMP, None))
    path.write_bytes(whole + path.read_bytes()[len(whole) :][:kept])
    with pytest.warns(UserWarning, match="line 2 is cut off and was never acknowledged"):
        assert fold(read_edits(path)) == {7: LAMP}
    with pytest.warns(UserWarning, match="line 2 is cut off"):
        append_edit(path, edit(LAMP, changed(LAMP, room="study"), who="bo"))
    assert [one.who for one in read_edits(path)] == ["ada", "bo"]
    assert path.read_bytes().startswith(whole)


def test_damage_inside_the_file_is_an_error_that_names_the_line(path: Path) -> None:
    append_edit(path, edit(None, LAMP))
    good = path.read_text()
    path.write_text(good + '{"version": 1}\n')
    with pytest.raises(DatasetError, match=r"Home\.jsonl: line 2: who is nothing; expected: Field required"):
        read_edits(path)
    path.write_text(good + good)
    with pytest.raises(DatasetError, match=r"Home\.jsonl: line 2: object 7 is {.*}; expected not there"):
        read_edits(path)
    with pytest.raises(DatasetError, match="line 2"):
        append_edit(path, edit(LAMP, None))
    assert path.read_text() == good + good


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"id": 0}, "id"),
        ({"category": "Lamp"}, "category"),
        ({"category": "lamp\n"}, "category"),
        ({"captions": ["two\nlines"]}, "captions"),
        ({"captions": ["a"] * 4}, "captions"),
        ({"box": {"centre": (0, 0, 0), "size": (1, 0, 1)}}, "box"),
        ({"box": {"centre": (0, float("nan"), 0), "size": (1, 1, 1)}}, "box"),
        ({"storey": 20}, "storey"),
        ({"colour": "red"}, "colour"),
    ],
)
def test_an_object_with_a_wrong_value_is_refused(changes: dict[str, object], field: str) -> None:
    with pytest.raises(ValidationError) as error:
        changed(LAMP, **changes)
    assert error.value.errors()[0]["loc"][0] == field


def test_an_edit_is_about_one_object_and_changes_it() -> None:
    for before, after in ((LAMP, LAMP), (None, None)):
        with pytest.raises(ValidationError, match="changes something"):
            Edit(who="ada", utc=NOON, id=7, before=before, after=after)
    with pytest.raises(ValidationError, match="same id before and after"):
        Edit(who="ada", utc=NOON, id=7, before=LAMP, after=changed(LAMP, id=8))
    with pytest.raises(ValidationError, match="utc"):
        Edit.model_validate({"who": "ada", "utc": "2026-01-02T12:00:00", "id": 7, "before": None, "after": LAMP})


def _annotate(path: Path, first: int, count: int) -> None:
    """Adds objects, and fights with the other process for object 1, which only one of the two can edit at a time."""
    for number in range(first, first + count):
        append_edit(path, edit(None, changed(LAMP, id=number)))
        present = fold(read_edits(path))[1]
        with contextlib.suppress(DatasetError):
            append_edit(path, edit(present, changed(present, room=f"room {number}"), who=f"process {first}"))


def test_two_processes_at_once_lose_no_edit(path: Path) -> None:
    append_edit(path, edit(None, changed(LAMP, id=1)))
    context = multiprocessing.get_context("fork")
    workers = [context.Process(target=_annotate, args=(path, first, 15)) for first in (100, 200)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join(60)
    assert [worker.exitcode for worker in workers] == [0, 0]
    objects = fold(read_edits(path))
    assert set(objects) == {1, *range(100, 115), *range(200, 215)}


def test_a_folder_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "annotations").write_text("a file where a folder must be")
    with pytest.raises(DatasetError, match=r"Home\.jsonl: cannot be written .*Give another folder"):
        append_edit(annotation_path(tmp_path, "Home"), edit(None, LAMP))
