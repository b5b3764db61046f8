"""What is said before, between and after trials that follow each other, while the browser stays with viser."""

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

from ..parts import PARTS, parts_of
from ..store_link import StoreLink
from .cards import interrupted_card, practice_card, real_card, saved_card
from .desk import Desk
from .panels import Card


class TrialPages:
    """The cards of one participant at one connection."""

    def __init__(self, desk: Desk, link: StoreLink, config: StudyConfig) -> None:
        """Shows nothing yet.

        Args:
            desk: The participant's page and queue.
            link: To the store.
            config: The study.
        """
        self._desk, self._link, self._config = desk, link, config

    def journey(self, person: Person) -> Journey:
        """Where the participant is now."""
        return journey_of(self._config, person)

    def welcome_back(self) -> None:
        """Says which trial is stored to somebody who left or reloaded the page between two; nothing to others."""
        person = self._link.person(self._desk.code)
        journey, before = self.journey(person), trial_before(person)
        if journey.place in ("practice", "trial") and before is not None and not has_rested(person, journey):
            self._desk.choose(saved_card(journey, trial_name(person, before)))

    def after(self, played: AssignedTrial, *, word: str = "") -> None:
        """Says what the store has of the trial that was open, before the next one; nothing where a break comes.

        Args:
            played: The trial.
            word: What is said of one that was practice.
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
        """Says before the first practice trial, and before the first counted one after practice, what follows."""
        practice = [trial for trial in person.kept if trial.phase == "practice"]
        if journey.place == "practice" and not any(trial.is_begun for trial in practice):
            self._desk.choose(self._on_its_way(practice_card(len(practice)), person, "practice"))
        others = [trial for trial in person.kept if trial.phase != "practice"]
        if journey.place == "trial" and practice and not any(trial.is_begun for trial in others):
            self._desk.choose(self._on_its_way(real_card(journey), person, "trial"))

    def _on_its_way(self, card: Card, person: Person, place: Place) -> Card:
        """The card with the parts of the way above it."""
        parts = parts_of(self._config, person)
        if PARTS[place] not in parts:
            return card
        return Card(card.title, card.body, card.choices, parts, parts.index(PARTS[place]))
