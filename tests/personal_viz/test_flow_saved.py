"""What is said between two trials is what the store has of them, on the page that was open and on a new one."""

from typing import cast

import pytest

from human_study.design.study import StudyBreaks, StudyConfig, StudyDataset
from human_study.journey import AssignedTrial, Person
from human_study.store.record_types import StageEntry
from personal_viz.study_app.screens.cards import TrialCards
from personal_viz.study_app.screens.desk import Desk
from personal_viz.study_app.screens.panels import Card
from personal_viz.study_app.store_link import StoreLink
from sim.types import EpisodeKey

PLAYED = AssignedTrial(2, "main", "pan", "none", EpisodeKey("easy", "Home", "2"), is_begun=True)


class StoredPerson:
    """A store that has one participant."""

    def __init__(self, trials: list[AssignedTrial], stages: list[StageEntry]) -> None:
        self._person = Person("p01", "pan", True, tuple(stages), tuple(trials))

    def person(self, code: str) -> Person:
        assert code == "p01"
        return self._person


class ReadingDesk:
    """A participant who presses the first button of every card."""

    code = "p01"

    def __init__(self) -> None:
        self.cards: list[Card] = []

    def choose(self, card: Card) -> str:
        self.cards.append(card)
        return card.choices[0].name


def stored(order_no: int, *, phase: str = "main", is_over: bool = False, is_begun: bool = False) -> AssignedTrial:
    key = EpisodeKey("easy", "Home", str(order_no))
    end = "done" if is_over else None
    return AssignedTrial(order_no, phase, "pan", "none", key, is_begun=is_begun or is_over, end=end)  # type: ignore[arg-type]


def said(trials: list[AssignedTrial], *, is_new_page: bool, word: str = "", rested_at: int | None = None) -> list[Card]:
    """The cards after a trial that this page played, or those of a new page."""
    stages = [] if rested_at is None else [StageEntry("break_ended", {"done": rested_at}, 1)]
    config = StudyConfig(
        study="flow",
        dataset=StudyDataset(sha256="0" * 64),
        task=("pan",),
        flow=(),
        breaks=StudyBreaks(every=2, sitting_max=None),
    )
    desk = ReadingDesk()
    pages = TrialCards(cast(Desk, desk), cast(StoreLink, StoredPerson(trials, stages)), config)
    if is_new_page:
        pages.welcome_back()
    else:
        pages.after(PLAYED, word=word)
    return desk.cards


@pytest.mark.parametrize("is_new_page", [False, True])
def test_a_trial_is_said_to_be_saved_when_the_store_has_its_outcome(is_new_page: bool) -> None:
    trials = [stored(1, phase="practice", is_over=True), stored(2, is_over=True), stored(3)]
    (card,) = said(trials, is_new_page=is_new_page)
    assert (card.title, card.choices[0].label) == ("Saved", "Next search")
    assert "Search 1 of 2 is stored." in card.body
    assert "1 of 2 searches done" in card.body


@pytest.mark.parametrize(
    "trials",
    [[stored(1, is_over=True), stored(2, is_begun=True), stored(3)], [stored(1, is_over=True), stored(3)]],
    ids=["asked again", "given to somebody else"],
)
def test_a_trial_without_an_outcome_in_the_store_is_not_said_to_be_saved(trials: list[AssignedTrial]) -> None:
    (card,) = said(trials, is_new_page=False)
    assert card.title == "Interrupted"
    assert "does not count" in card.body
    assert f"1 of {len(trials)} searches done" in card.body


def test_practice_has_its_word_on_the_page_that_played_it() -> None:
    trials = [stored(2, phase="practice", is_over=True), stored(3)]
    (card,) = said(trials, is_new_page=False, word="It was only practice.")
    assert "Practice 1 of 1 is stored." in card.body
    assert "It was only practice." in card.body


def test_a_break_says_it_instead() -> None:
    trials = [stored(1, is_over=True), stored(2, is_over=True), stored(3)]
    assert said(trials, is_new_page=False) == []
    assert said(trials, is_new_page=True) == []


def test_a_new_page_says_nothing_to_who_has_read_it_who_is_in_a_trial_and_who_has_done_none() -> None:
    done = [stored(1, is_over=True), stored(2, is_over=True)]
    assert said([*done, stored(3)], is_new_page=True, rested_at=2) == []
    assert said([*done[:1], stored(2, is_begun=True)], is_new_page=True) == []
    assert said([stored(1), stored(2)], is_new_page=True) == []
