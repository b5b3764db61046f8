"""One annotator's work without a browser: every save is an edit, nobody's text is lost or overwritten unseen."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from personal_viz.annotate.session import (
    Form,
    Session,
    box_between,
    last_not_undone,
    suggestions,
    with_height,
    with_side,
)
from sim.authoring.annotations import annotation_path, fold, read_edits
from sim.errors import DatasetError, PersonalVizError
from sim.mesh import SceneObject

LAMP = SceneObject(7, "lamp_7", "lamp", (1.0, 1.0, 0.0), (0.2, 0.4, 0.2))
CHAIR = SceneObject(9, "chair_9", "chair", (2.0, 3.5, 0.0), (0.5, 1.0, 0.5))
LINE = Form("lamp", ("red lamp near the door",), "hall")


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return annotation_path(tmp_path, "Home")


def session(path: Path, who: str = "ada") -> Session:
    return Session(path, [LAMP, CHAIR], storeys=(0.0, 3.0), who=who)


def write(one: Session, number: int, form: Form = LINE) -> str:
    one.select(number)
    one.keep(form)
    return one.save()


def test_an_object_starts_from_the_semantics_and_is_saved_as_an_appended_line(path: Path) -> None:
    ada = session(path)
    assert [(row.id, row.category, row.state) for row in ada.rows()] == [(7, "lamp", "new"), (9, "chair", "new")]
    ada.select(9)
    assert ada.form == Form("chair", storey=1)
    ada.select(7)
    ada.keep(Form(" Lamp ", ("", "red  lamp near the door "), "hall"))
    assert ada.is_unsaved
    assert not path.exists()
    assert ada.save() == "Saved object 7, lamp."
    (line,) = path.read_text().splitlines()
    edit = json.loads(line)
    assert (edit["who"], edit["before"], edit["after"]["captions"]) == ("ada", None, ["red lamp near the door"])
    assert ada.form == LINE
    assert ada.save() == "Object 7 is saved already."
    assert [row.state for row in session(path).rows()] == ["complete", "new"]


def test_drafts_stay_while_other_objects_are_looked_at_and_the_list_says_so(path: Path) -> None:
    ada = session(path)
    ada.select(7)
    ada.keep(replace(LINE, room=""))
    ada.step(1)
    assert ada.selected == 9
    assert [row.state for row in ada.rows()] == ["unsaved", "new"]
    ada.step(1)
    assert (ada.selected, ada.form.captions) == (7, LINE.captions)
    ada.save()
    assert [row.state for row in ada.rows("door")] == ["begun"]
    ada.keep(replace(LINE, flagged=True))
    ada.save()
    assert [(row.id, row.state) for row in ada.rows("flagged")] == [(7, "flagged")]
    ada.keep(replace(LINE, flagged=False))
    ada.keep(replace(LINE, flagged=True))
    assert not ada.is_unsaved  # typed and taken back


def test_undo_appends_and_goes_back_one_by_one_after_a_restart_too(path: Path) -> None:
    ada = session(path)
    write(ada, 7)
    write(ada, 7, replace(LINE, room="kitchen"))
    write(ada, 9, Form("chair", ("old chair",), "attic", 1))
    ada = session(path)
    ada.undo()
    assert (ada.selected, ada.form) == (9, Form("chair", storey=1))
    ada.undo()
    assert (ada.selected, ada.form) == (7, LINE)
    ada.undo()
    assert ada.form == Form("lamp")
    with pytest.raises(PersonalVizError, match="undo: found no edit of 'ada'"):
        ada.undo()
    assert len(read_edits(path)) == 6
    assert fold(read_edits(path)) == {}
    write(ada, 7)
    assert last_not_undone(read_edits(path), "ada") == read_edits(path)[-1]
    assert last_not_undone(read_edits(path), "bo") is None


def test_undo_first_drops_what_is_not_saved(path: Path) -> None:
    ada = session(path)
    write(ada, 7)
    ada.keep(replace(LINE, room="attic"))
    assert ada.undo() == "Dropped what was written on object 7 and not saved."
    assert (ada.form, len(read_edits(path))) == (LINE, 1)
    ada.draw_box()
    ada.click((4.0, 0.0, 5.0), 0)
    ada.click((5.0, 0.0, 6.0), 0)
    ada.undo()
    assert (ada.selected, [row.id for row in ada.rows()]) == (None, [7, 9])
    ada.undo()
    assert fold(read_edits(path)) == {}


def test_of_two_annotators_the_second_is_told_and_sees_what_the_first_wrote(path: Path) -> None:
    ada, bo = session(path), session(path, "bo")
    bo.select(7)
    bo.keep(replace(LINE, captions=("lamp of bo",)))
    write(ada, 7)
    assert bo.refresh()
    assert bo.form.captions == ("lamp of bo",)
    with pytest.raises(DatasetError) as raised:
        bo.save()
    text = str(raised.value)
    assert "\n" not in text
    assert "'ada' edited it at" in text
    assert "You wrote: lamp, lamp of bo, hall." in text
    assert bo.form == LINE
    write(bo, 7, replace(LINE, room="attic"))
    with pytest.raises(DatasetError, match="'bo' edited it"):
        ada.undo()
    assert ada.form.room == "attic"
    assert not ada.refresh()


def test_a_box_is_drawn_by_two_clicks_and_stands_above_the_floor(path: Path) -> None:
    ada = session(path)
    assert ada.click((5.0, 0.0, 5.0), 0) == "No object is known here. Draw a new box around it (B)."
    assert ada.click((1.0, 1.0, 0.0), 7) == ""
    assert ada.selected == 7
    ada.draw_box()
    assert ada.click((4.0, 3.01, 5.0), 7).startswith("Now click the opposite corner")
    assert ada.click((4.0, 3.01, 5.5), 0).startswith("That is less than 5 cm")
    assert ada.click((4.6, 3.0, 5.5), 0).startswith("Drag the arrows")
    box = ada.form.box
    assert box is not None
    assert (box.centre, box.size) == ((4.3, 3.43, 5.25), (0.6, 0.8, 0.5))
    assert (ada.selected, ada.form.storey) == (10, 1)
    ada.keep(Form("box", ("big box",), "attic", 1, box=with_height(box, 3.1, 0.4)))
    ada.save()
    saved = fold(read_edits(path))[10].box
    assert saved is not None
    assert (saved.centre, saved.size) == ((4.3, 3.3, 5.25), (0.6, 0.4, 0.5))
    ada.leave()
    ada.click((4.5, 3.5, 5.4), 0)
    assert ada.selected == 10
    assert ada.remove() == "Removed object 10."
    assert (ada.selected, [row.id for row in ada.rows()]) == (None, [7, 9])
    ada.undo()
    assert (ada.selected, ada.form.box) == (10, saved)


def test_boxes_that_two_annotators_draw_at_once_get_numbers_of_their_own(path: Path) -> None:
    both = session(path), session(path, "bo")
    for one in both:
        one.draw_box()
        one.click((4.0, 0.0, 5.0), 0)
        one.click((5.0, 0.0, 6.0), 0)
        one.keep(replace(one.form, category="box"))
    assert [one.save() for one in both] == ["Saved object 10, box.", "Saved object 11, box."]
    assert both[1].selected == 11


def test_what_cannot_be_saved_is_one_line_and_stays_a_draft(path: Path) -> None:
    ada = session(path, "")
    with pytest.raises(PersonalVizError, match="no object is selected; expected one"):
        ada.save()
    ada.select(7)
    ada.keep(LINE)
    with pytest.raises(PersonalVizError, match="your name is empty; expected one"):
        ada.save()
    ada.who = " Ada  L "
    ada.keep(replace(LINE, category="LAMP_2"))
    with pytest.raises(PersonalVizError, match="object 7: category") as raised:
        ada.save()
    assert "\n" not in str(raised.value)
    assert ada.is_unsaved
    ada.keep(LINE)
    ada.save()
    assert read_edits(path)[0].who == "Ada L"


def test_words_of_the_scan_and_of_the_lexicon_are_suggested(path: Path) -> None:
    ada = session(path)
    assert ada.categories("")[:2] == ["chair", "lamp"]
    assert ada.categories("refr")[0] == "refrigerator"
    assert suggestions("cha", ["desk chair", "chair", "char", ""]) == ["chair", "char", "desk chair"]
    assert ada.rooms("bed") == ["bedroom"]
    assert box_between((0, 0, 0), (0.01, 0, 1)) is None


def test_a_dragged_side_moves_alone_and_never_past_the_other() -> None:
    box = box_between((0, 0, 0), (1, 0, 1))
    assert box is not None
    higher = with_side(box, "top", 1.234)
    assert (higher.centre, higher.size) == ((0.5, 0.63, 0.5), (1, 1.2, 1))
    lower = with_side(higher, "bottom", 0.829)
    assert (lower.centre, lower.size) == ((0.5, 1.03, 0.5), (1, 0.4, 1))
    assert with_side(lower, "bottom", 9.0).size[1] == 0.02
    assert with_side(lower, "top", 9.0).size[1] == 3.0
