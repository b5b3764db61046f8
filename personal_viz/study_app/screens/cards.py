"""The cards before, between and after trials, while the browser stays with viser."""

from collections.abc import Awaitable, Callable

from human_study.design.study import StudyConfig
from human_study.journey import (
    AssignedTrial,
    Journey,
    Person,
    Place,
    ended_trial,
    has_rested,
    journey_of,
    trial_before,
    trial_name,
)
from human_study.texts.participants import PARTS, parts_of
from human_study.trial.commands import Command, Rate
from human_study.trial.views import RateView

from ..markdown import html_from_markdown
from ..store_link import StoreLink
from .desk import Desk
from .panels import Card, Choice, Page, paragraphs, progress_html

_WORDS = {1: "guessed", 2: "rather unsure", 3: "half and half", 4: "rather sure", 5: "certain"}


def practice_card(num_practice: int) -> Card:
    """The card before the first practice trial."""
    what = "one practice search" if num_practice == 1 else f"{num_practice} practice searches"
    text = (
        f"You begin with {what} in a home that is not part of the study.\n"
        "Practice does not count. Take your time and try every key or button.\n"
        "After each practice search you are told whether your answer was right."
    )
    return Card("Practice", paragraphs(text), (Choice("begin", "Begin to practise"),))


def real_card(journey: Journey) -> Card:
    """The card after the practice, before the first counted trial."""
    text = "The practice is over. From now on every search counts.\nYou will not be told whether an answer was right."
    body = paragraphs(text) + progress_html(journey.num_done, journey.num_all, unit="searches")
    return Card("Now it counts", body, (Choice("begin", "Begin"),))


def saved_card(journey: Journey, name: str, word: str = "") -> Card:
    """The card between two trials: it names the stored one and, after practice, gives feedback (Markdown)."""
    bar = progress_html(journey.num_done, journey.num_all, unit="searches") if journey.num_all else ""
    return Card(
        "Saved", paragraphs(f"{name} is stored.") + html_from_markdown(word) + bar, (Choice("next", "Next search"),)
    )


def interrupted_card(journey: Journey) -> Card:
    """The card after a trial without result: it failed, or its participant was away for too long."""
    bar = progress_html(journey.num_done, journey.num_all, unit="searches") if journey.num_all else ""
    text = "This search was interrupted, so it does not count. Everything else that you did is stored."
    return Card("Interrupted", paragraphs(text) + bar, (Choice("next", "Go on"),))


def paused_card() -> Card:
    """The card while the store cannot write."""
    text = "Nothing that you did is lost. Please try again in a minute."
    return Card("The study is paused", paragraphs(text), (Choice("again", "Try again"),))


def lost_picture_card() -> Card:
    """The card after the browser lost its WebGL context."""
    text = (
        "Your browser stopped drawing in 3-D. That is not your fault. The search that was open does not count; you "
        "will get it again. Everything else is stored."
    )
    return Card("The 3-D picture was lost", paragraphs(text), (Choice("reload", "Load the page again"),))


class TrialCards:
    """The cards of one participant at one connection."""

    def __init__(self, desk: Desk, link: StoreLink, config: StudyConfig) -> None:
        """Shows nothing yet.

        Args:
            desk: The participant's page and queue.
            link: The link to the store.
            config: The study.
        """
        self._desk, self._link, self._config = desk, link, config

    def journey(self, person: Person) -> Journey:
        """The participant's present journey."""
        return journey_of(self._config, person)

    def welcome_back(self) -> None:
        """Tells somebody who left or reloaded the page between two trials which one is stored; shows others nothing."""
        person = self._link.person(self._desk.code)
        journey, before = self.journey(person), trial_before(person)
        if journey.place in ("practice", "trial") and before is not None and not has_rested(person, journey):
            self._desk.choose(saved_card(journey, trial_name(person, before)))

    def after(self, played: AssignedTrial, *, word: str = "") -> None:
        """Shows the card after a trial, by the store's record of it; shows nothing where a break comes.

        Args:
            played: The trial.
            word: Feedback on a practice trial.
        """
        person = self._link.person(self._desk.code)
        journey = self.journey(person)
        if journey.place not in ("practice", "trial"):
            return
        ended = ended_trial(person, played.order_no)
        if ended is None:
            self._desk.choose(interrupted_card(journey))
        else:
            self._desk.choose(saved_card(journey, trial_name(person, ended), word))

    def introduce(self, person: Person, journey: Journey) -> None:
        """Shows the card before the first practice trial, or before the first counted trial after practice."""
        practice = [trial for trial in person.kept if trial.phase == "practice"]
        if journey.place == "practice" and not any(trial.is_begun for trial in practice):
            self._desk.choose(self._on_its_way(practice_card(len(practice)), person, "practice"))
        others = [trial for trial in person.kept if trial.phase != "practice"]
        if journey.place == "trial" and practice and not any(trial.is_begun for trial in others):
            self._desk.choose(self._on_its_way(real_card(journey), person, "trial"))

    def _on_its_way(self, card: Card, person: Person, place: Place) -> Card:
        """The card with the names of the study's parts above it."""
        parts = parts_of(self._config, person)
        if PARTS[place] not in parts:
            return card
        return Card(card.title, card.body, card.choices, parts, parts.index(PARTS[place]))


class RateApp:
    """Draws the question how sure the participant is, and turns presses into commands."""

    def __init__(self, page: Page, view: RateView, send: Callable[[Command], Awaitable[None]]) -> None:
        """Builds the screen."""

        async def chosen(name: str) -> None:
            await send(Rate(int(name)))

        choices = tuple(Choice(str(value), f"{value}: {_WORDS[value]}", hotkey=str(value)) for value in view.choices)
        body = "<p>How sure are you of your answer? Press a button, or a key from 1 to 5.</p>"
        page.card(Card("How sure are you?", body, choices), chosen)

    def show(self, view: RateView) -> None:
        """Does nothing, because the question never changes."""

    def close(self) -> None:
        """Does nothing, because `Page.clear` ends the screen."""
