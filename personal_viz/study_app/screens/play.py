"""Plays one trial on one page, from its opening to its stored outcome: takes commands, stores events, shows views.

The session decides what to show (a look, the task, a question) and when time alone changes something. This module
waits as long as the session says, stores its events, and shows its view on the right screen.
"""

import contextlib
import queue
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from human_study.design.study import StudyConfig
from human_study.store.store import SupersededError, Trial, TrialEndedError
from human_study.store.writer import StoreFullError
from human_study.trial.commands import Command, Resume, Start, Tick
from human_study.trial.events import Error, Event
from human_study.trial.outcome import has_begun, pan_outcome, pog_outcome, technical_outcome
from human_study.trial.session import PanSession, PogSession
from human_study.trial.terms import terms_of
from human_study.trial.views import LookView, PanView, PogView, RateView, SessionUpdate
from sim.episodes.schema import Episode
from sim.errors import StudyError
from sim.tasks.run_files import Answer, ClickRay, EpisodeRun

from ..home.frames import successors
from ..home.homes import Home, pan_env
from ..home.map_view import MapView
from ..home.scene_view import SceneView
from ..store_link import StoreLink
from ..watch import TrialWatch
from .cards import RateApp
from .desk import Desk, GoneError, WithdrawnError
from .look import LookApp
from .pan import PanApp
from .pog import Nudge, PogApp, click_of

Session = PanSession | PogSession
View = LookView | PanView | PogView | RateView


@dataclass(frozen=True, slots=True)
class _Screen:
    """The screen on the page now."""

    kind: type
    """Type of the screen's views."""
    show: Callable[[Any], None]
    close: Callable[[], None]


class TrialPlay:
    """Plays trials of one participant in one home."""

    def __init__(self, desk: Desk, link: StoreLink, home: Home, config: StudyConfig) -> None:
        """Shows nothing yet.

        Args:
            desk: The participant's page and queue.
            link: The link to the store.
            home: The home of the trials.
            config: The study.
        """
        self._desk, self._link, self._home, self._config = desk, link, home, config
        self._watch = TrialWatch()
        self._owed: tuple[Event, ...] = ()
        """Events that are stored together with the next ones: a commit of their own would only delay the next key."""

    def play(
        self, trial: Trial, *, progress: str, away_s: float, took_over: bool = False
    ) -> EpisodeRun | Answer | None:
        """Plays an opened trial to its stored outcome and returns it; None when a failure of ours ended the trial.

        Args:
            trial: The trial, as the store opened it.
            progress: The trial's name, such as "Search 3 of 30".
            away_s: Seconds for which the participant was away; 0 where that was our fault.
            took_over: Whether another tab of the participant still showed the trial.

        Raises:
            StoreFullError: The store cannot write now; open the trial again to go on.
            SupersededError, TrialEndedError, GoneError, WithdrawnError: This page no longer plays the trial.
        """
        session: Session | None = None
        try:
            episode = self._home.episodes[trial.key]
            stored = self._link.events(trial.trial_id)
            session = self._session(trial, episode, stored)
            self._lead(session, trial, stored, Resume(away_s, took_over) if stored else Start(), progress)
        except GoneError:
            if session is None or not session.is_over:
                raise
            self._finish(trial)  # only the question how sure the participant is was not answered: the answer counts
            raise
        except (StoreFullError, SupersededError, TrialEndedError, WithdrawnError):
            raise
        except Exception as error:  # the live session's door: the same trial must not fail for ever
            traceback.print_exc()
            self._note_failure(trial, error)
        return self._finish(trial)

    def leave(self) -> None:
        """Ends the trial on this page when the participant is gone: tells observers, and renders nothing ahead."""
        self._watch.leave()
        self._home.renderer.look_ahead(self._desk.code, (), self._config.robot_camera)

    def _lead(self, session: Session, trial: Trial, stored: list[Event], first: Start | Resume, progress: str) -> None:
        """Shows the session's views until the trial has ended."""
        update = session.handle(first, time.monotonic())
        self._store(trial, update.events)
        sensed = session.observation if isinstance(session, PanSession) else None
        episode = self._home.episodes[trial.key]
        self._watch = self._home.watches.begin(trial, episode, [*stored, *update.events], sensed)
        screen: _Screen | None = None
        try:
            while not session.is_done:
                screen = self._shown(screen, update.view, trial, progress)
                self._look_ahead(session)
                update = self._next_update(session, screen, trial)
            if screen is not None and isinstance(update.view, screen.kind):
                screen.show(update.view)
        finally:
            if screen is not None:
                screen.close()
            with contextlib.suppress(StudyError):  # somebody else goes on with the trial, or the store cannot write
                self._store(trial, ())

    def _next_update(self, session: Session, screen: _Screen, trial: Trial) -> SessionUpdate:
        """Does and stores the next change, by the browser or by time alone; returns it with the view to show."""
        try:
            item = self._desk.wait(timeout_s=session.wait_s(time.monotonic()))
        except queue.Empty:
            update = session.handle(Tick(), time.monotonic())
            self._store(trial, update.events)
            self._watch.tell(update.events, session.observation if isinstance(session, PanSession) else None)
            return update
        command = self._command(item.content, trial, session)
        update = session.handle(command, time.monotonic(), busy=item.is_busy)
        if not isinstance(session, PanSession):
            self._store(trial, update.events)
            self._desk.done_with(item)
            self._watch.tell(update.events)
            return update
        if session.needs_look:  # the picture is rendered while the step is written to disk
            self._home.renderer.begin(session.pose, self._config.robot_camera)
        self._store(trial, update.events)
        if not session.needs_look:
            self._desk.done_with(item)
            self._watch.tell(update.events, session.observation)
            return update
        if isinstance(update.view, screen.kind):
            screen.show(update.view)  # the counter is shown before the picture, because the step is on disk
        looked = session.look(time.monotonic())
        self._desk.done_with(item)  # not before: a press before this picture is dropped as busy
        if isinstance(looked.view, screen.kind):
            screen.show(looked.view)
        self._owed = looked.events  # they say that the picture was sent; the step itself was stored before
        self._watch.tell((*update.events, *looked.events), session.observation)
        return looked

    def _store(self, trial: Trial, events: tuple[Event, ...]) -> None:
        owed, self._owed = self._owed, ()
        if owed or events:
            self._link.append_many(trial.trial_id, trial.epoch, (*owed, *events))

    def _session(self, trial: Trial, episode: Episode, stored: list[Event]) -> Session:
        """A new session, or the stored one in its old phase, at the same step, pose, storey and mark."""
        config, scene = self._config, self._home.scene
        names = {
            "key": trial.key,
            "task": config.task_for(episode, trial.task),
            "storeys": scene.navigation.storey_heights,
            "scene_digest": scene.digest,
            "terms": terms_of(config, trial.condition),
        }
        if trial.condition in ("topdown", "map_2d"):
            _ = self._home.copies.maps  # before the clock starts: the first time takes some seconds
        if trial.task == "pog":
            session = PogSession(**names)
        else:
            env = pan_env(episode, scene, self._home.renderer, config)
            session = PanSession(env, **names, looks_later=True)
        return session.after(stored) if stored else session

    def _look_ahead(self, session: Session) -> None:
        """Begins to render pictures that the next key could show, while nobody waits for another picture."""
        if not isinstance(session, PanSession) or session.phase != "task":
            return
        config, frames = self._config, self._home.renderer
        poses = successors(session.pose, self._home.scene.navigation, config.action_set, last=session.last_action)
        frames.look_ahead(self._desk.code, poses, config.robot_camera)

    def _shown(self, screen: _Screen | None, view: View, trial: Trial, progress: str) -> _Screen:
        """Shows the view on the present screen, or on a new one of the right kind; returns the screen."""
        if screen is not None and isinstance(view, screen.kind):
            screen.show(view)
            return screen
        if screen is not None:
            screen.close()
        return self._new_screen(view, trial, progress)

    def _new_screen(self, view: View, trial: Trial, progress: str) -> _Screen:
        page, send, copies = self._desk.page, self._desk.new_screen(), self._home.copies
        label = self._home.scene.unnamed_label
        match view:
            case LookView():
                app = LookApp(page, view, send, copies=copies, progress=progress)
            case PanView():
                walk = PanApp(
                    page,
                    view,
                    send,
                    scene_label=label,
                    progress=progress,
                    display_scale=self._config.display_scale,
                    encode=self._home.renderer.jpeg,
                    own_keys=lambda: self._desk.own_keys,
                )
                return _Screen(PanView, walk.show, _nothing_to_close)
            case PogView():
                is_map = trial.condition == "map_2d"
                surface = MapView(page.client, copies.maps) if is_map else SceneView(page.client, copies)
                app = PogApp(page, view, send, surface=surface, scene_label=label, progress=progress)
            case RateView():
                app = RateApp(page, view, send)
        return _Screen(type(view), app.show, app.close)

    def _command(self, content: Any, trial: Trial, session: Session) -> Command:
        """The participant's input as a command of the session; rays and moves of the mark become clicks."""
        if isinstance(content, ClickRay | Nudge):
            view = session.view(time.monotonic())
            if not isinstance(view, PogView):
                return Tick()  # the time was up between the click and now
            return click_of(content, view, self._home, is_map=trial.condition == "map_2d")
        assert isinstance(content, Command), content
        return content

    def _finish(self, trial: Trial) -> EpisodeRun | Answer | None:
        """Stores the outcome that the stored events give, and returns it; it stays on the server."""
        result: EpisodeRun | Answer | None = None
        try:
            events = self._link.events(trial.trial_id)
            if has_begun(events):
                result = self._result(events, trial, self._home.episodes[trial.key])
        except (StoreFullError, SupersededError, TrialEndedError):
            raise
        except Exception as error:  # the live session's door: the same trial must not fail for ever
            traceback.print_exc()
            self._note_failure(trial, error)
        outcome = result.end if isinstance(result, EpisodeRun) else result
        if outcome is None or outcome.reason == "technical":
            result, outcome = None, technical_outcome(trial.key, trial.task, participant=trial.code)
        self._link.finish_trial(trial.trial_id, outcome)
        self._watch.end(result)
        return result

    def _note_failure(self, trial: Trial, error: Exception) -> None:
        """Stores an event that says that a failure of ours ended the trial."""
        self._link.append_many(trial.trial_id, trial.epoch, (Error(message=repr(error)[:500], is_fatal=True),))

    def _result(self, events: list[Event], trial: Trial, episode: Episode) -> EpisodeRun | Answer:
        if trial.task == "pan":
            navigation = self._home.scene.navigation
            return pan_outcome(events, episode, navigation=navigation, participant=trial.code)
        return pog_outcome(events, episode, storeys=self._home.storeys, participant=trial.code)


def _nothing_to_close() -> None:
    """Does nothing, because `Page.clear` ends the PAN screen."""
