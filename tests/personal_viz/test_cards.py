"""The cards between two trials say what the store holds of the trials, on the page that was open and on a new one."""

import pytest

from human_study.design.study import StudyBreaks, StudyConfig, StudyDataset
from human_study.journey import AssignedTrial, Person, StageEntry
from personal_viz.study_app.screens.cards import Card, begin_card, card_after, welcome_back_card
from sim.types import EpisodeKey

CONFIG = StudyConfig(
    study="flow",
    dataset=StudyDataset(sha256="0" * 64),
    task=("pan",),
    flow=(),
    breaks=StudyBreaks(every=2, sitting_max=None),
)


def stored(order_no: int, *, phase: str = "main", is_over: bool = False, is_begun: bool = False) -> AssignedTrial:
    key = EpisodeKey("easy", "Home", str(order_no))
    end = "done" if is_over else None
    return AssignedTrial(order_no, phase, "pan", "none", key, is_begun=is_begun or is_over, end=end)


def person(trials: list[AssignedTrial], *, rested_at: int | None = None) -> Person:
    stages = () if rested_at is None else (StageEntry("break_ended", {"done": rested_at}, 1),)
    return Person("p01", "pan", True, stages, tuple(trials))


def after(trials: list[AssignedTrial], *, feedback: str = "") -> Card | None:
    """The card after the second trial, on the page that played it."""
    return card_after(CONFIG, person(trials), stored(2, is_begun=True), feedback=feedback)


@pytest.mark.parametrize("is_new_page", [False, True])
def test_a_trial_is_said_to_be_saved_when_the_store_has_its_outcome(is_new_page: bool) -> None:
    trials = [stored(1, phase="practice", is_over=True), stored(2, is_over=True), stored(3)]
    card = welcome_back_card(CONFIG, person(trials)) if is_new_page else after(trials)
    assert (card.title, card.choices[0].label) == ("Saved", "Next search")
    assert "Search 1 of 2 is stored." in card.body
    assert "1 of 2 searches done" in card.body


@pytest.mark.parametrize(
    "trials",
    [[stored(1, is_over=True), stored(2, is_begun=True), stored(3)], [stored(1, is_over=True), stored(3)]],
    ids=["asked again", "given to somebody else"],
)
def test_a_trial_without_an_outcome_in_the_store_is_not_said_to_be_saved(trials: list[AssignedTrial]) -> None:
    card = after(trials)
    assert card.title == "Interrupted"
    assert "does not count" in card.body
    assert f"1 of {len(trials)} searches done" in card.body


def test_practice_has_its_feedback_on_the_page_that_played_it() -> None:
    card = after([stored(2, phase="practice", is_over=True), stored(3)], feedback="It was only practice.")
    assert "Practice 1 of 1 is stored." in card.body
    assert "It was only practice." in card.body


def test_the_next_home_is_announced_only_where_there_is_one() -> None:
    config = StudyConfig.model_validate({**CONFIG.model_dump(), "sequences": {"sha256": "0" * 64}, "breaks": {}})
    done = [stored(number, phase="practice", is_over=True) for number in (1, 2)]
    practised = [*done[:1], stored(2, phase="practice"), stored(3)]
    labels = []
    for trials in (practised, [*done, stored(3)], [stored(1, is_over=True), stored(2)]):
        card = welcome_back_card(config, person(trials))
        assert card is not None
        labels.append(card.choices[0].label)
    assert labels == ["Next search", "Next home", "Next home"]


def test_a_break_has_its_page_instead_of_a_card() -> None:
    trials = [stored(1, is_over=True), stored(2, is_over=True), stored(3)]
    assert after(trials) is None
    assert welcome_back_card(CONFIG, person(trials)) is None


def test_a_new_page_has_no_card_for_people_who_have_read_it_are_in_a_trial_or_have_done_none() -> None:
    done = [stored(1, is_over=True), stored(2, is_over=True)]
    for somebody in (
        person([*done, stored(3)], rested_at=2),
        person([*done[:1], stored(2, is_begun=True)]),
        person([stored(1), stored(2)]),
    ):
        assert welcome_back_card(CONFIG, somebody) is None


def test_practice_and_the_first_counted_trial_are_announced_once() -> None:
    practice, done = stored(1, phase="practice"), stored(1, phase="practice", is_over=True)
    begun = stored(1, phase="practice", is_begun=True)
    announced = [
        begin_card(CONFIG, person(trials))
        for trials in ([practice, stored(2)], [begun, stored(2)], [done, stored(2)], [done, stored(2, is_begun=True)])
    ]
    assert [card and card.title for card in announced] == ["Practice", None, "Now it counts", None]
