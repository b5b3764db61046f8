"""One participant at one browser connection: commands in, stored events, then the view. The session's own thread.

viser's callbacks only put commands on the queue; simulator, rendering and disk are never on viser's event loop.
"""

import contextlib
import enum
import queue
import sys
import threading
import time
import traceback
from collections.abc import Awaitable, Callable
from dataclasses import dataclass

import viser

from human_study.commands import Click, PanCommand, PogCommand, Resume, Start
from human_study.events import Error, Event
from human_study.outcome import pan_outcome, pog_outcome, technical_outcome
from human_study.session import (
    STOP_WITHIN_S,
    PanSession,
    PogSession,
    pan_session_from_events,
    pog_session_from_events,
)
from human_study.store import SupersededError, Trial, TrialEndedError
from human_study.study import StudyConfig
from human_study.views import PanView, PogView, SessionUpdate
from human_study.writer import StoreFullError
from sim.episodes.schema import Episode
from sim.scenes.scene import Scene
from sim.tasks.pan import PanEnv
from sim.tasks.pog import PogScene
from sim.tasks.run_files import Answer, ClickRay, EpisodeRun
from sim.types import EpisodeKey
from sim.world.renderer import Renderer

from .pan_app import PanApp
from .panels import Page
from .pog_app import PogApp
from .scene_view import StoreyCopies
from .store_link import StoreLink, TrialPlace
from .watch import TrialWatch, Watches

WELCOME = {
    "pan": (
        "You steer a small robot through a home that you do not know. A text says who owns what; above it stands "
        "what to find.\nWalk to that object and press STOP when you stand within one metre of it. You have {max_steps} "
        "steps. Keys: W or Up walks 25 cm, A and D (or Left and Right) turn 30 degrees, Enter twice stops."
    ),
    "pog": (
        "You see a home from outside, without its ceiling. A text says who owns what; the line above it says what to "
        "find.\nTurn and zoom the home, click the object, and confirm your mark. You can move the mark as often as you "
        "like before you confirm."
    ),
}

MAX_WAITING = 200
"""Commands that may wait for a seat; a person never has more than a few."""


@dataclass(frozen=True, slots=True)
class Home:
    """What all seats of a worker share."""

    scene: Scene
    renderer: Renderer
    pog_scene: PogScene
    copies: StoreyCopies
    episodes: dict[EpisodeKey, Episode]
    storeys: list[tuple[float, float]]
    """(lowest, highest) floor of each storey, from the episodes."""
    config: StudyConfig
    opened_s: float
    """`time.monotonic()` when this worker began to serve."""
    watches: Watches
    """What a researcher sees meanwhile."""


def pan_env(episode: Episode, scene: Scene, renderer: Renderer, config: StudyConfig) -> PanEnv:
    """What a PAN participant walks in."""
    camera, max_steps = config.robot_camera, config.max_steps
    return PanEnv(episode.start, scene.navigation, renderer=renderer, camera=camera, max_steps=max_steps)


class _Signal(enum.Enum):
    """What a seat is told besides the participant's commands."""

    NEXT = enum.auto()
    """The participant pressed the button of a notice."""
    GONE = enum.auto()
    """The browser closed the connection."""
    SUPERSEDED = enum.auto()
    """The participant opened the study in another tab."""


class _GoneError(Exception):
    """The browser closed the connection."""


@dataclass(frozen=True, slots=True)
class _Item:
    """One thing on a seat's queue."""

    content: PanCommand | PogCommand | ClickRay | _Signal
    screen: int | None = None
    """The screen whose button, key or canvas it came from; None for signals that always count."""
    is_busy: bool = False
    """Whether the frame of an earlier command was under way."""


class Seat:
    """Runs one participant's trials on one page until the connection closes or a newer one takes over."""

    def __init__(self, client: viser.ClientHandle, code: str, link: StoreLink, home: Home) -> None:
        """Starts the seat's thread."""
        self.code = code
        self._link, self._home = link, home
        self._queue: queue.Queue[_Item] = queue.Queue(MAX_WAITING)
        self._screen = 0
        self._is_busy = False
        self._page = Page(client)
        self._watch = TrialWatch()
        threading.Thread(target=self._run, daemon=True, name=f"seat-{code}").start()

    def leave(self) -> None:
        """The browser is gone: the thread ends after what it is doing."""
        self._put(_Item(_Signal.GONE))

    def supersede(self) -> None:
        """A newer tab drives: this page says so and ends."""
        self._put(_Item(_Signal.SUPERSEDED))

    def _put(self, item: _Item) -> None:
        """Queues an item; a browser that floods its seat loses what is over MAX_WAITING."""
        with contextlib.suppress(queue.Full):
            self._queue.put_nowait(item)

    def _new_screen(self) -> Callable[[PanCommand | PogCommand | ClickRay | _Signal], Awaitable[None]]:
        """Begins a screen; returns where its callbacks send, and what older screens still send is dropped."""
        self._screen += 1
        self._is_busy = False
        screen = self._screen

        async def send(content: PanCommand | PogCommand | ClickRay | _Signal) -> None:
            if screen != self._screen:
                return
            is_busy, self._is_busy = self._is_busy, True
            self._put(_Item(content, screen, is_busy))

        return send

    def _run(self) -> None:
        try:
            self._welcome()
            while (place := self._next_place()) is not None:
                self._play_until_stored(place)
            self._page.notice("Thank you!", "All your answers are stored. You can close this page.")
        except SupersededError:
            self._page.notice("This page is no longer used", "You opened the study in another tab. Continue there.")
        except _GoneError:
            pass
        except Exception:  # the live session's door: the participant is told, the operator sees everything
            traceback.print_exc()
            self._page.notice("Something went wrong", "Nothing that you did is lost. Open your personal link again.")
        finally:
            self._watch.leave()

    def _welcome(self) -> None:
        """Instructions before a participant's first trial; whoever comes back goes on at once."""
        places = self._link.trials(self.code)
        if places and not any(place.is_over or place.is_begun for place in places):
            text = WELCOME[places[0].task].format(max_steps=self._home.config.max_steps)
            self._ask("Welcome", f"{text}\nThis home: {self._home.scene.label}.", "Start")

    def _next_place(self) -> TrialPlace | None:
        return next((place for place in self._link.trials(self.code) if not place.is_over), None)

    def _play_until_stored(self, place: TrialPlace) -> None:
        """One trial; when the store cannot write, the page waits and the trial is rebuilt from what is stored."""
        was_paused = False
        while True:
            try:
                self._play(place, was_paused=was_paused)
                return
            except TrialEndedError:
                return  # finished in another tab a moment ago
            except StoreFullError as error:
                print(f"personal-viz: {error}", file=sys.stderr)
                was_paused = True
                text = "Nothing that you did is lost. Please try again in a minute."
                self._ask("The study is paused", text, "Try again")

    def _play(self, place: TrialPlace, *, was_paused: bool) -> None:
        """One trial from its opening to its stored outcome; a failure of ours ends it as `technical`."""
        trial = self._link.open_trial(self.code, place.order_no)
        progress = f"Trial {place.order_no} of {len(self._link.trials(self.code))}"
        # time in which the study was not served, or could not store, is not the participant's absence
        away_s = 0.0 if was_paused else min(trial.away_s, time.monotonic() - self._home.opened_s)
        result: EpisodeRun | Answer | None = None
        try:
            episode = self._home.episodes[trial.key]
            play = self._play_pan if trial.task == "pan" else self._play_pog
            play(trial, episode, progress, away_s)
            result = self._result(trial, episode)
            outcome = result.end if isinstance(result, EpisodeRun) else result
        except (StoreFullError, SupersededError, TrialEndedError, _GoneError):
            raise
        except Exception as error:  # the live session's door: the same trial must not fail for ever
            traceback.print_exc()
            self._link.append_many(trial.trial_id, trial.epoch, (Error(message=repr(error)[:500], is_fatal=True),))
            outcome = technical_outcome(trial.key, trial.task, participant=self.code)
        self._link.finish_trial(trial.trial_id, outcome)
        self._watch.end(result)
        if self._next_place() is not None:
            self._ask("Saved", f"{progress} is stored.", "Next trial")

    def _play_pan(self, trial: Trial, episode: Episode, progress: str, away_s: float) -> None:
        session, update, stored = self._begin_pan(trial, episode, away_s)
        app = PanApp(self._page, update.view, self._new_screen(), scene_label=self._home.scene.label, progress=progress)
        self._watch = self._home.watches.begin(trial, episode, stored, session.observation)
        while not session.is_over:
            try:
                item = self._wait(timeout_s=STOP_WITHIN_S if update.view.is_armed else None)
            except queue.Empty:
                update = SessionUpdate((), session.view(time.monotonic()))
            else:
                assert isinstance(item.content, PanCommand), item.content
                update = session.handle(item.content, time.monotonic(), busy=item.is_busy)
                self._link.append_many(trial.trial_id, trial.epoch, update.events)
                self._is_busy = self._is_busy and item.is_busy
            app.show(update.view)
            self._watch.tell(update.events, session.observation)

    def _play_pog(self, trial: Trial, episode: Episode, progress: str, away_s: float) -> None:
        session, update, stored = self._begin_pog(trial, episode, away_s)
        app = PogApp(self._page, update.view, self._new_screen(), copies=self._home.copies, progress=progress)
        self._watch = self._home.watches.begin(trial, episode, stored)
        try:
            while not session.is_over:
                command = self._wait().content
                if isinstance(command, ClickRay):
                    storey = update.view.storeys.index(command.storey_y)
                    command = Click(command, self._home.pog_scene.hit(storey, command.origin, command.direction))
                assert isinstance(command, PogCommand), command
                update = session.handle(command, time.monotonic())
                self._link.append_many(trial.trial_id, trial.epoch, update.events)
                app.show(update.view)
                self._watch.tell(update.events)
        finally:
            app.close()

    def _begin_pan(
        self, trial: Trial, episode: Episode, away_s: float
    ) -> tuple[PanSession, SessionUpdate[PanView], list[Event]]:
        """A new session, or the stored one at the same step and pose, and all its events, which are stored."""
        config, scene = self._home.config, self._home.scene
        env = pan_env(episode, scene, self._home.renderer, config)
        options = {"key": trial.key, "task": config.task_for(episode, "pan"), "scene_digest": scene.digest}
        stored = self._link.events(trial.trial_id)
        if stored:
            session = pan_session_from_events(stored, env, **options, resume_within_s=config.resume_within_s)
        else:
            session = PanSession(env, **options, resume_within_s=config.resume_within_s)
        update = session.handle(Resume(away_s) if stored else Start(), time.monotonic())
        self._link.append_many(trial.trial_id, trial.epoch, update.events)
        return session, update, [*stored, *update.events]

    def _begin_pog(
        self, trial: Trial, episode: Episode, away_s: float
    ) -> tuple[PogSession, SessionUpdate[PogView], list[Event]]:
        """A new session, or the stored one with the same storey and mark, and all its events, which are stored."""
        config, scene = self._home.config, self._home.scene
        options = {
            "key": trial.key,
            "task": config.task_for(episode, "pog"),
            "storeys": scene.navigation.storey_heights,
            "scene_digest": scene.digest,
            "resume_within_s": config.resume_within_s,
        }
        stored = self._link.events(trial.trial_id)
        session = pog_session_from_events(stored, **options) if stored else PogSession(**options)
        update = session.handle(Resume(away_s) if stored else Start(), time.monotonic())
        self._link.append_many(trial.trial_id, trial.epoch, update.events)
        return session, update, [*stored, *update.events]

    def _result(self, trial: Trial, episode: Episode) -> EpisodeRun | Answer:
        """The result of a finished trial from its stored events; stays on the server."""
        events = self._link.events(trial.trial_id)
        if trial.task == "pan":
            navigation = self._home.scene.navigation
            return pan_outcome(events, episode, navigation=navigation, participant=self.code)
        return pog_outcome(events, episode, storeys=self._home.storeys, participant=self.code)

    def _ask(self, title: str, text: str, button: str) -> None:
        """Shows a notice until its button is pressed."""
        send = self._new_screen()

        async def press() -> None:
            await send(_Signal.NEXT)

        self._page.notice(title, text, button=(button, press))
        self._wait()

    def _wait(self, *, timeout_s: float | None = None) -> _Item:
        """The next thing that the present screen sends; raises queue.Empty after `timeout_s`."""
        while True:
            item = self._queue.get(timeout=timeout_s)
            if item.content is _Signal.GONE:
                raise _GoneError
            if item.content is _Signal.SUPERSEDED:
                raise SupersededError(f"{self.code} opened the study in another tab.")
            if item.screen == self._screen:
                return item
