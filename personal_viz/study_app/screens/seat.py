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

import viser

from human_study.design.plan import StudyPlan
from human_study.design.study import StudyConfig
from human_study.journey import AssignedTrial, Person, trial_name
from human_study.store.record_types import has_reached, last_detail
from human_study.store.store import SupersededError, TrialEndedError
from human_study.store.writer import StoreFullError
from human_study.texts.participants import leave_text, practice_text

from ..gateway.device import IN_3D
from ..home.homes import Home, HomeLibrary
from ..page_script import KeyAction, PageMessages
from ..store_link import StoreLink
from .cards import TrialCards, lost_picture_card, paused_card
from .desk import Desk, GoneError, Item, Signal, WithdrawnError
from .panels import Page
from .play import TrialPlay

_KEYS: dict[str, tuple[KeyAction, ...]] = {
    "paper4": ("forward", "left", "right", "stop"),
    "paper6": ("forward", "left", "right", "look_up", "look_down", "stop"),
}
"""Actions for which PAN participants have keys, by the study's set of actions."""


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
        self._client, self._link, self._study = client, link, study
        self._desk = Desk(Page(client), code)
        self._desk.on_keys = self._keep_keys
        self._was_paused = False
        self._pages = TrialCards(self._desk, link, study.config)
        threading.Thread(target=self._run, daemon=True, name=f"seat-{code}").start()

    def leave(self) -> None:
        """Tells the seat that the browser is gone; the thread ends after its present work."""
        self._desk.put(Item(Signal.GONE))

    def supersede(self) -> None:
        """Tells the seat that a newer tab took over; this page says so and ends."""
        self._desk.put(Item(Signal.SUPERSEDED))

    def _run(self) -> None:
        page = self._desk.page
        try:
            self._begin()
            self._until_stored(self._lead)
        except WithdrawnError:
            self._until_stored(self._withdraw)
        except SupersededError:
            page.notice("This page is no longer used", "You opened the study in another tab. Continue there.")
        except GoneError:
            pass
        except Exception:  # the live session's door: the participant is told, the operator sees everything
            traceback.print_exc()
            page.notice("Something went wrong", "Nothing that you did is lost. Open your personal link again.")

    def _begin(self) -> None:
        """Starts the page's script with the participant's own keys, and shows the tools."""
        person = self._person()
        actions = _KEYS[self._study.config.actions] if person.task == "pan" else ()
        messages = PageMessages(self._client, self._desk.heard, actions=actions)
        self._desk.own_keys = last_detail(person.stages, "keys_changed")
        messages.begin(self._desk.own_keys)
        self._desk.page.tools(has_keys=bool(actions), on_leave=leave_text(self._study.config))

    def _until_stored(self, work: Callable[[], None]) -> None:
        """Does the work. While the store cannot write, the page waits; then all is rebuilt from the stored records."""
        while True:
            try:
                work()
                return
            except StoreFullError as error:
                print(f"personal-viz: {error}", file=sys.stderr)
                self._was_paused = True
                self._desk.choose(paused_card())

    def _lead(self) -> None:
        """Leads through trials until another page comes next, which the gateway has."""
        self._pages.welcome_back()
        while True:
            person = self._person()
            journey = self._pages.journey(person)
            due = self._link.next_trial(self.code) if journey.place in ("practice", "trial") else None
            if due is None:
                self._go_on()
                return
            self._warm_next(person)
            if self._desk.has_lost_picture and due.condition in IN_3D:
                self._load_again()
            self._pages.introduce(person, journey)
            if not has_reached(person.stages, "sitting_started"):
                self._link.enter_stage(self.code, "sitting_started", {"done": journey.num_done})
            with contextlib.suppress(TrialEndedError):  # finished in another tab a moment ago
                self._play(due)

    def _load_again(self) -> None:
        """Asks the participant to load the page again, without which it cannot draw in 3-D; ends this connection."""
        self._desk.choose(lost_picture_card())
        self._desk.reload()
        self._until_gone()

    def _go_on(self) -> None:
        """Makes the browser open the gateway's next page, which is not part of viser."""
        self._desk.go_on()
        self._until_gone()

    def _until_gone(self) -> None:
        while True:
            self._desk.wait()

    def _withdraw(self) -> None:
        self._link.withdraw(self.code)
        self._desk.go_on()

    def _play(self, place: AssignedTrial) -> None:
        """Plays one trial to its stored outcome, then shows the card after it."""
        with self._study.homes.use(place.key.scene) as home:
            self._desk.require_here()  # no trial begins if the page was left while the home was opened
            trial = self._link.open_trial(self.code, place.order_no, connection=self.connection)
            progress = trial_name(self._person(), place)
            # time in which the study was not served, or could not store, is not the participant's absence
            away_s = 0.0 if self._was_paused else min(trial.away_s, time.monotonic() - self._study.opened_s)
            play = TrialPlay(self._desk, self._link, home, self._study.config)
            try:
                self._was_paused = False
                result = play.play(trial, progress=progress, away_s=away_s, took_over=self._took_over)
            finally:
                self._took_over = False
                play.leave()
        self._link.next_trial(self.code)  # assigns the next trial, if any, so that the pages before it know of it
        self._warm_next(self._person())
        if not self._desk.has_lost_picture:
            is_practice = place.phase == "practice"
            word = practice_text(self._study.config, place.task, result) if is_practice else ""
            self._pages.after(place, word=word)

    def _person(self) -> Person:
        return self._link.person(self.code)

    def _warm_next(self, person: Person) -> None:
        """Opens the next trial's home while the participant reads."""
        if person.due is not None:
            self._study.homes.warm(person.due.key.scene)

    def _keep_keys(self, keys: Mapping[KeyAction, str]) -> None:
        self._link.enter_stage(self.code, "keys_changed", {str(action): code for action, code in keys.items()})
