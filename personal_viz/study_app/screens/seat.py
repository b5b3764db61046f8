"""One participant at one browser connection: trials, and what is said between them. The session's own thread.

Nothing but the connection lives here: pages and trials are rebuilt from what is stored whenever a browser comes.
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
from human_study.store.stages import has_reached, last_detail
from human_study.store.store import SupersededError, TrialEndedError
from human_study.store.writer import StoreFullError
from human_study.texts.participants import practice_text

from ..gateway.device import IN_3D
from ..home.home import Home
from ..home.homes import HomeLibrary
from ..page_script import KeyAction, PageMessages
from ..store_link import StoreLink
from .cards import lost_picture_card
from .desk import Desk, GoneError, Item, Signal, WithdrawnError
from .pages import TrialPages
from .panels import Page
from .play import TrialPlay

_KEYS: dict[str, tuple[KeyAction, ...]] = {
    "paper4": ("forward", "left", "right", "stop"),
    "paper6": ("forward", "left", "right", "look_up", "look_down", "stop"),
}
"""What PAN participants have keys for."""
_ON_LEAVE = {
    "delete": "What you did in your searches will be deleted and cannot be brought back.",
    "keep": "What you did so far will be kept without your name. Nothing more will be asked of you.",
}
"""What happens to the data of somebody who withdraws (`privacy.on_withdraw`)."""


@dataclass(frozen=True, slots=True)
class Study:
    """What all seats of a worker share."""

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
            link: To the store.
            study: What all seats share.
            connection: The gateway's number of it: of a participant's connections the one with the highest is the
                newest, whichever comes first to what it waits for.
            took_over: Whether another tab of the participant was still open.
        """
        self.code, self.connection = code, connection
        self._took_over = took_over
        self._client, self._link, self._study = client, link, study
        self._desk = Desk(Page(client), code)
        self._desk.on_keys = self._keep_keys
        self._was_paused = False
        self._pages = TrialPages(self._desk, link, study.config)
        threading.Thread(target=self._run, daemon=True, name=f"seat-{code}").start()

    def leave(self) -> None:
        """The browser is gone: the thread ends after what it is doing."""
        self._desk.put(Item(Signal.GONE))

    def supersede(self) -> None:
        """A newer tab drives: this page says so and ends."""
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
        self._desk.page.tools(has_keys=bool(actions), on_leave=_ON_LEAVE[self._study.config.privacy.on_withdraw])

    def _until_stored(self, work: Callable[[], None]) -> None:
        """Does the work; when the store cannot write, the page waits, and all is rebuilt from what is stored."""
        while True:
            try:
                work()
                return
            except StoreFullError as error:
                print(f"personal-viz: {error}", file=sys.stderr)
                self._was_paused = True
                text = "Nothing that you did is lost. Please try again in a minute."
                self._desk.ask("The study is paused", text, "Try again")

    def _lead(self) -> None:
        """Trials until another page comes: the gateway has that one."""
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
        """Only a page that is loaded again draws in 3-D again; the connection ends with the old one."""
        self._desk.choose(lost_picture_card())
        self._desk.reload()
        self._until_gone()

    def _go_on(self) -> None:
        """What comes next is no part of viser's: the browser opens the page that the gateway has."""
        self._desk.go_on()
        self._until_gone()

    def _until_gone(self) -> None:
        while True:
            self._desk.wait()

    def _withdraw(self) -> None:
        self._link.withdraw(self.code)
        self._desk.go_on()

    def _play(self, place: AssignedTrial) -> None:
        """One trial to its stored outcome, then a word on it."""
        with self._study.homes.use(place.key.scene) as home:
            self._desk.require_here()  # nobody's trial begins: the page may have been left while the home was opened
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
        self._link.next_trial(self.code)  # gives out what comes next, if anything: the pages before it know of it then
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
