"""One participant at one browser connection: trials and the cards between them, on a thread of its own.

Only the connection lives here: pages and trials are rebuilt from the stored records whenever a browser comes.
"""

import contextlib
import sys
import threading
import time
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import cast

import viser

from human_study.design.plan import StudyPlan
from human_study.design.study import StudyConfig
from human_study.journey import AssignedTrial, Person, has_reached, journey_of, last_detail
from human_study.store.store import SupersededError, TrialEndedError
from human_study.store.writer import StoreFullError
from human_study.texts.catalogue import catalogue_of
from human_study.texts.participants import leave_text, practice_text, trial_name
from sim.types import Action

from ..gateway.device import IN_3D
from ..home.homes import Home, HomeLibrary
from ..page_script import KeyAction, PageMessages
from ..store_link import StoreLink
from .cards import Card, begin_card, card_after, problem_card, welcome_back_card
from .page import GoneError, Page, WithdrawnError
from .play import TrialPlay


@dataclass(frozen=True, slots=True)
class Study:
    """The study, its plan and its homes, shared by all seats of a worker."""

    config: StudyConfig
    plan: StudyPlan
    homes: HomeLibrary[Home]
    opened_s: float
    """`time.monotonic()` when this worker began to serve."""


class Seat:
    """Leads one participant through the study on one page until the connection closes or a newer one takes over."""

    def __init__(
        self,
        client: viser.ClientHandle,
        code: str,
        link: StoreLink,
        study: Study,
        *,
        connection: int,
        took_over: bool = False,
    ) -> None:
        """Starts the seat's thread.

        Args:
            client: The connection.
            code: The participant.
            link: The link to the store.
            study: The study that all seats share.
            connection: The gateway's number of the connection. A participant's connection with the highest number is
                the newest, even if an older one gets ahead of it.
            took_over: Whether another tab of the participant was still open.
        """
        self.code, self.connection = code, connection
        self._took_over = took_over
        self._link, self._study = link, study
        self._page = Page(client, catalogue_of(study.config.language))
        self._page.on_keys = self._keep_keys
        self._was_paused = False
        threading.Thread(target=self._run, daemon=True, name=f"seat-{code}").start()

    def leave(self) -> None:
        """Tells the seat that the browser is gone; the thread ends after its present work."""
        self._page.end(GoneError())

    def supersede(self) -> None:
        """Tells the seat that a newer tab took over; this page says so and ends."""
        self._page.end(SupersededError(f"{self.code} opened the study in another tab."))

    def _run(self) -> None:
        try:
            self._begin()
            self._until_stored(self._lead)
        except WithdrawnError:
            self._until_stored(self._withdraw)
        except SupersededError:
            self._page.card(problem_card("taken_over", self._page.words))
        except GoneError:
            pass
        except Exception:  # the live session's door: the participant is told, the operator sees everything
            traceback.print_exc()
            self._page.card(problem_card("broken", self._page.words))

    def _begin(self) -> None:
        """Starts the page's script with the participant's own keys, and shows the tools."""
        person, page = self._person(), self._page
        config = self._study.config
        ends = (Action.STOP, Action.FOUND)
        used = sorted(config.action_set if person.task == "pan" else (), key=lambda action: action in ends)
        actions: list[KeyAction] = [cast(KeyAction, action.value) for action in used]
        messages = PageMessages(page.client, page.heard, actions=actions)
        page.own_keys = last_detail(person.stages, "keys_changed")
        messages.begin(page.own_keys)
        page.tools(has_keys=bool(actions), on_leave=leave_text(config))

    def _until_stored(self, work: Callable[[], None]) -> None:
        """Does the work. While the store cannot write, the page waits; then all is rebuilt from the stored records."""
        while True:
            try:
                work()
                return
            except StoreFullError as error:
                print(f"personal-viz: {error}", file=sys.stderr)
                self._was_paused = True
                self._page.choose(problem_card("paused", self._page.words))

    def _lead(self) -> None:
        """Leads through trials until another page comes next, which the gateway has."""
        config = self._study.config
        self._tell(welcome_back_card(config, self._person()))
        while True:
            person = self._person()
            journey = journey_of(config, person)
            due = self._link.next_trial(self.code) if journey.place in ("practice", "trial") else None
            if due is None:
                break
            self._warm_next(person)
            if self._page.has_lost_picture and config.view_in(due.task, due.condition) in IN_3D:
                of_sequences = config.sequences is not None
                self._page.choose(problem_card("lost_picture", self._page.words, of_sequences=of_sequences))
                self._page.reload()
                self._until_gone()
            self._tell(begin_card(config, person))
            if not has_reached(person.stages, "sitting_started"):
                self._link.enter_stage(self.code, "sitting_started", {"done": journey.num_done})
            with contextlib.suppress(TrialEndedError):  # finished in another tab a moment ago
                self._play(due)
        self._page.go_on()
        self._until_gone()

    def _tell(self, card: Card | None) -> None:
        if card is not None:
            self._page.choose(card)

    def _until_gone(self) -> None:
        while True:
            self._page.wait()

    def _withdraw(self) -> None:
        self._link.withdraw(self.code)
        self._page.go_on()

    def _play(self, place: AssignedTrial) -> None:
        """Plays one trial to its stored outcome, then shows the card after it."""
        config = self._study.config
        with self._study.homes.use(place.key.scene) as home:
            self._page.require_here()  # no trial begins if the page was left while the home was opened
            trial = self._link.open_trial(self.code, place.order_no, connection=self.connection)
            # time in which the study was not served, or could not store, is not the participant's absence
            away_s = 0.0 if self._was_paused else min(trial.away_s, time.monotonic() - self._study.opened_s)
            name = trial_name(config, self._person(), place)
            play = TrialPlay(self._page, self._link, home, config, trial, name=name)
            try:
                self._was_paused = False
                result = play.play(away_s=away_s, took_over=self._took_over)
            finally:
                self._took_over = False
                play.leave()
        self._link.next_trial(self.code)  # assigns the next trial, if any, so that the pages before it know of it
        person = self._person()
        self._warm_next(person)
        if not self._page.has_lost_picture:
            feedback = practice_text(config, place.task, result) if place.phase == "practice" else ""
            self._tell(card_after(config, person, place, feedback=feedback))

    def _person(self) -> Person:
        return self._link.person(self.code)

    def _warm_next(self, person: Person) -> None:
        """Opens the next trial's home while the participant reads."""
        if person.due is not None:
            self._study.homes.warm(person.due.key.scene)

    def _keep_keys(self, keys: Mapping[KeyAction, str]) -> None:
        self._link.enter_stage(self.code, "keys_changed", {str(action): code for action, code in keys.items()})
