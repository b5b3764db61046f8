"""Captions of an edition are refined by people who do not see each other's opinions; what they agree on counts."""

import datetime
from pathlib import Path

import pytest

from sim.authoring.annotations import AnnotatedObject, Change, Edit, append_edit, read_edits
from sim.authoring.refinement import (
    Agreement,
    adjudication_path,
    agreements,
    asked_objects,
    decision_of,
    opinion_path,
    read_opinions,
)
from sim.episodes.dataset import PersonalDataset
from sim.errors import DatasetError

UTC = datetime.datetime(2026, 1, 1, tzinfo=datetime.UTC)
ASKED = {
    number: AnnotatedObject(id=number, category="lamp", captions=(f"old lamp {number}",), room="hall")
    for number in (1, 2, 3, 4)
}


def write(path: Path, who: str, number: int, caption: str | None, *, flagged: bool = False) -> None:
    """Appends a decision; None keeps the old caption."""
    captions = ASKED[number].captions if caption is None else (caption,)
    after = ASKED[number].model_copy(update={"captions": captions, "flagged": flagged})
    append_edit(path, Edit(who=who, utc=UTC, id=number, before=None, after=after))


@pytest.fixture
def refined(tmp_path: Path) -> Path:
    """Ada and Bo agree on 1 and 2; they differ on 3 and 4; a third person has chosen on 4."""
    for who, third in (("ada", "tall red lamp"), ("bo", "tall green lamp")):
        path = opinion_path(tmp_path, who, "Home")
        write(path, who, 1, None)
        write(path, who, 2, "blue lamp")
        write(path, who, 3, third)
    write(opinion_path(tmp_path, "ada", "Home"), "ada", 4, None)
    write(opinion_path(tmp_path, "bo", "Home"), "bo", 4, None, flagged=True)
    write(adjudication_path(tmp_path, "Home"), "cy", 4, "lamp by the door")
    return tmp_path


def test_what_all_want_is_accepted_and_differences_wait_for_a_third_person(refined: Path) -> None:
    opinions = read_opinions(refined, "Home", ASKED)
    assert [one.differs for one in opinions.values()] == [False, False, True, True]
    assert opinions[1].accepted == ASKED[1]
    assert opinions[1].change is None
    assert opinions[2].change == Change(2, ("ada", "bo"), ASKED[2], opinions[2].said["bo"])
    assert (opinions[3].accepted, opinions[3].change) == (None, None)
    change = opinions[4].change
    assert change is not None
    assert change.after is not None
    assert (change.who, change.after.captions) == (("cy",), ("lamp by the door",))
    assert opinions[3].said["ada"].captions == ("tall red lamp",)  # each opinion is kept


def test_agreement_is_the_share_of_equal_decisions_and_of_common_words(refined: Path) -> None:
    (pair,) = agreements(read_opinions(refined, "Home", ASKED).values())
    # kept, changed, changed are equal, kept and flagged are not; 2 of 2 and 2 of 4 words are common
    assert pair == Agreement("ada", "bo", 4, 3, 2, 0.75)
    write(opinion_path(refined, "di", "Home"), "di", 1, "lamp")
    assert [(one.first, one.second, one.num_both, one.num_equal) for one in agreements(
        read_opinions(refined, "Home", ASKED).values()
    )] == [("ada", "bo", 4, 3), ("ada", "di", 1, 0), ("bo", "di", 1, 0)]  # fmt: skip


def test_nobody_decided_is_no_change_and_one_opinion_alone_counts(tmp_path: Path) -> None:
    assert read_opinions(tmp_path, "Home", ASKED)[1].accepted is None
    write(opinion_path(tmp_path, "ada", "Home"), "ada", 1, "lamp")
    one = read_opinions(tmp_path, "Home", ASKED)[1]
    assert one.accepted is not None
    assert decision_of(ASKED[1], one.accepted) == "changed"
    assert agreements([one]) == []


def test_annotators_have_files_of_their_own_and_names_that_fit(tmp_path: Path) -> None:
    path = opinion_path(tmp_path, "ada", "Home")
    assert path == tmp_path / "opinions" / "ada" / "annotations" / "Home.jsonl"
    assert read_edits(path) == ()
    for who in ("", "../x", "a b"):
        with pytest.raises(DatasetError, match=r"--who is '.*'; expected 1-64 letters"):
            opinion_path(tmp_path, who, "Home")


def test_the_objects_of_an_edition_are_those_that_it_asks_for(small_home_root: Path) -> None:
    dataset = PersonalDataset(small_home_root)
    asked = asked_objects(dataset, "Small")
    names = {name for episode in dataset.episodes() for name in episode.record.object_names}
    assert len(asked) == len(names)
    assert list(asked) == sorted(asked)
    assert all(item.is_complete for item in asked.values())
