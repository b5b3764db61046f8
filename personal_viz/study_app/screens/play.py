"""Plays one trial on one page, from its opening to its stored outcome: takes commands, stores events, shows views.

The session decides what to show (a look, the task, a question) and when time alone changes something. This module
waits as long as the session says, stores its events, and shows its view on the right screen.
"""

import contextlib
import html
import itertools
import queue
import time
import traceback
from collections.abc import Callable
from typing import Any

from human_study.design.study import StudyConfig, StudyPog
from human_study.store.store import SupersededError, Trial, TrialEndedError
from human_study.store.writer import StoreFullError
from human_study.trial.commands import Command, Rate, Resume, Start, Tick, Unmark
from human_study.trial.events import Error, Event
from human_study.trial.outcome import end_reason, has_begun, pan_outcome, pog_outcome, unscored_outcome
from human_study.trial.searches import SearchTexts, sequence_outcome
from human_study.trial.session import PanSession, PogSession
from human_study.trial.terms import terms_of
from human_study.trial.views import LookView, PanView, PogView, RateView, SessionUpdate
from sim.episodes.schema import Episode
from sim.episodes.sequence_files import HomeSequence
from sim.errors import StudyError
from sim.sequences.runs import SequenceRun
from sim.tasks.run_files import Answer, ClickRay, EpisodeRun

from ..home.frames import successors
from ..home.homes import Home, pan_env
from ..home.surfaces import MapView
from ..store_link import StoreLink
from ..watch import TrialWatch
from .camera import storey_names
from .cards import rate_card
from .look import LookScreen
from .page import GoneError, Page
from .pan import PanScreen
from .pog import Nudge, PogScreen, click_of

View = LookView | PanView | PogView | RateView
Result = EpisodeRun | Answer | SequenceRun


class TrialPlay:
    """Plays one trial of one participant in one home."""

    def __init__(
        self, page: Page, link: StoreLink, home: Home, config: StudyConfig, trial: Trial, *, name: str
    ) -> None:
        """Shows nothing yet.

        Args:
            page: The participant's page.
            link: The link to the store.
            home: The home of the trial.
            config: The study.
            trial: The trial, as the store opened it.
            name: The trial's name, such as "Search 3 of 30".
        """
        self._page, self._link, self._home, self._config, self._trial = page, link, home, config, trial
        kind = page.words(f"home.{home.scene.kind}")  # never its name, by which people could find the answers
        self._caption = f"{html.escape(name)} &middot; {html.escape(kind)}"
        self._view = config.view_in(trial.task, trial.condition)
        self._watch = TrialWatch()
        self._kind: type | None = None
        """Type of the views that the present screen shows."""
        self._show: Callable[[Any], None] = _nothing_changes
        """Draws the changes of a view on the present screen."""
        self._owed: tuple[Event, ...] = ()
        """Events that are stored together with the next ones: a commit of their own would only delay the next key."""

    def play(self, *, away_s: float, took_over: bool = False) -> Result | None:
        """Plays the trial to its stored outcome and returns it; None when a failure of ours ended the trial, or the
        participant left a sequence for too long.

        Args:
            away_s: Seconds for which the participant was away; 0 where that was our fault.
            took_over: Whether another tab of the participant still showed the trial.

        Raises:
            StoreFullError: The store cannot write now; open the trial again to go on.
            SupersededError, TrialEndedError, GoneError, WithdrawnError: This page no longer plays the trial.
        """
        session: PanSession | PogSession | None = None
        try:
            stored = self._link.events(self._trial.trial_id)
            session = self._session(stored)
            self._lead(session, stored, Resume(away_s, took_over) if stored else Start())
        except GoneError:
            if session is not None and session.is_over:
                self._finish()  # only how sure the participant is was not answered: the answer counts
            raise
        except (StoreFullError, SupersededError, TrialEndedError):
            raise
        except Exception as error:  # the live session's door: the same trial must not fail for ever
            self._note_failure(error)
        return self._finish()

    def leave(self) -> None:
        """Ends the trial on this page when the participant is gone: tells observers, and renders nothing ahead."""
        self._watch.leave()
        self._home.renderer.look_ahead(self._trial.code, (), self._config.robot_camera)

    def _session(self, stored: list[Event]) -> PanSession | PogSession:
        """A new session, or the stored one in its old phase, at the same step, pose, storey and mark."""
        config, scene, trial, found = self._config, self._home.scene, self._trial, self._found
        is_sequence = isinstance(found, HomeSequence)
        task = config.sequence_task_for(found, trial.task) if is_sequence else config.task_for(found, trial.task)
        names = {
            "key": trial.key,
            "task": task,
            "searches": SearchTexts.of(found, query_index=config.query_index) if is_sequence else None,
            "storeys": scene.navigation.storey_heights,
            "scene_digest": scene.digest,
            "terms": terms_of(config, trial.condition, task=trial.task, home_view=self._home.view),
        }
        if self._view in ("topdown", "map_2d"):
            _ = self._home.copies.maps  # before the clock starts: the first time takes some seconds
        if trial.task == "pog":
            targets = itertools.chain(*found.targets) if is_sequence else found.targets
            session = PogSession(**names, objects=self._home.objects_for(targets))
        else:
            env = pan_env(found, scene, self._home.renderer, config)
            session = PanSession(env, **names, looks_later=True)
        return session.after(stored) if stored else session

    @property
    def _found(self) -> Episode | HomeSequence:
        """The trial's episode, or its sequence in a study of them."""
        trials = self._home.episodes if self._config.sequences is None else self._home.sequences
        return trials[self._trial.key]

    def _lead(self, session: PanSession | PogSession, stored: list[Event], first: Start | Resume) -> None:
        """Shows the session's views until the trial has ended."""
        update = session.handle(first, time.monotonic())
        self._store(update.events)
        if isinstance(self._found, Episode):  # observers show episodes only
            events = [*stored, *update.events]
            self._watch = self._home.watches.begin(self._trial, self._found, events, _sensed(session))
        try:
            while not session.is_done:
                if not self._redraw(update.view):
                    self._kind, self._show = type(update.view), self._new_screen(update.view)
                self._look_ahead(session)
                update = self._next_update(session)
            self._redraw(update.view)
        finally:
            with contextlib.suppress(StudyError):  # somebody else goes on with the trial, or the store cannot write
                self._store(())

    def _next_update(self, session: PanSession | PogSession) -> SessionUpdate:
        """Does and stores the next change, by the browser or by time alone; returns it with the view to show."""
        try:
            item = self._page.wait(timeout_s=session.wait_s(time.monotonic()))
        except queue.Empty:
            update = session.handle(Tick(), time.monotonic())
            self._store(update.events)
            self._watch.tell(update.events, _sensed(session))
            return update
        command, before = self._command(item.content, session), session.view(time.monotonic())
        update = session.handle(command, time.monotonic(), busy=item.is_busy)
        if isinstance(session, PogSession) and isinstance(item.content, Nudge) and not item.content.is_new:
            update = self._without_the_moved(before, update, session)
        if not isinstance(session, PanSession) or not session.needs_look:
            self._store(update.events)
            self._page.done_with(item)
            self._watch.tell(update.events, _sensed(session))
            return update
        self._home.renderer.begin(session.pose, self._config.robot_camera)  # while the step is written to disk
        self._store(update.events)
        self._redraw(update.view)  # the counter is shown before the picture, because the step is on disk
        looked = session.look(time.monotonic())
        self._page.done_with(item)  # not before: a press before this picture is dropped as busy
        self._redraw(looked.view)
        self._owed = looked.events  # they say that the picture was sent; the step itself was stored before
        self._watch.tell((*update.events, *looked.events), _sensed(session))
        return looked

    def _without_the_moved(self, before: View, update: SessionUpdate, session: PogSession) -> SessionUpdate:
        """A mark that was moved in a search for all, where each click sets one more, is taken from its old place.

        Only the newest mark moves, and only on its own storey; elsewhere the same key sets one more.
        """
        if not isinstance(before, PogView) or not isinstance(update.view, PogView) or not before.is_for_all:
            return update
        if not 0 < len(before.marks) < len(update.view.marks) or before.marks[-1].storey != before.storey:
            return update
        taken = session.handle(Unmark(len(before.marks) - 1), time.monotonic())
        return SessionUpdate((*update.events, *taken.events), taken.view)

    def _store(self, events: tuple[Event, ...]) -> None:
        owed, self._owed = self._owed, ()
        if owed or events:
            self._link.append_many(self._trial.trial_id, self._trial.epoch, (*owed, *events))

    def _look_ahead(self, session: PanSession | PogSession) -> None:
        """Begins to render pictures that the next key could show, while nobody waits for another picture."""
        if isinstance(session, PanSession) and session.phase == "task":
            config, navigation = self._config, self._home.scene.navigation
            poses = successors(session.pose, navigation, config.action_set, last=session.last_action)
            self._home.renderer.look_ahead(self._trial.code, poses, config.robot_camera)

    def _redraw(self, view: View) -> bool:
        """Draws the view if the present screen is of its kind; returns whether it is."""
        if type(view) is not self._kind:
            return False
        self._show(view)
        return True

    def _new_screen(self, view: View) -> Callable[[Any], None]:
        """Puts a screen for the view on the page, whose old one ends; returns the function that draws changes."""
        page, send, home = self._page, self._page.new_screen(), self._home
        storeys = storey_names(page.words, self._config.storey_names, home.storey_labels)
        has_history = terms_of(self._config, self._trial.condition, task=self._trial.task).has_history
        match view:
            case LookView():
                shown = self._config.pog if self._trial.task == "pog" else StudyPog()
                options = {"caption": self._caption, "storeys": storeys, "shown": shown}
                return LookScreen(page, view, send, home=home, **options).show
            case PanView():
                config = self._config
                scale, encode = config.display_scale, home.renderer.jpeg
                options = {"caption": self._caption, "display_scale": scale, "encode": encode}
                return PanScreen(page, view, send, has_history=has_history, **options).show
            case PogView():
                is_map, shown = self._view == "map_2d", self._config.pog
                surface = MapView(page.client, home.copies.maps) if is_map else home.shown_in(page.client, shown)
                things = [item.category for item in home.scene.objects if not item.is_building]
                options = {"caption": self._caption, "storeys": storeys, "shown": shown, "things": things}
                return PogScreen(page, view, send, surface=surface, has_history=has_history, **options).show
            case RateView():
                page.card(rate_card(view, page.words), send)
                return _nothing_changes

    def _command(self, content: Any, session: PanSession | PogSession) -> Command:
        """The participant's input as a command of the session; rays and moves of the mark become clicks."""
        if isinstance(content, str):  # a choice of the rating card
            return Rate(int(content))
        if isinstance(content, ClickRay | Nudge):
            view = session.view(time.monotonic())
            if not isinstance(view, PogView):
                return Tick()  # the time was up between the click and now
            is_map, snaps = self._view == "map_2d", self._config.pog.pointing == "snap"
            return click_of(content, view, self._home, is_map=is_map, snaps=snaps)
        assert isinstance(content, Command), content
        return content

    def _finish(self) -> Result | None:
        """Stores the outcome that the stored events give, and returns it; it stays on the server."""
        trial, reason = self._trial, None
        result: Result | None = None
        try:
            events = self._link.events(trial.trial_id)
            if has_begun(events):
                result, reason = self._result(events), end_reason(events)
        except (StoreFullError, SupersededError, TrialEndedError):
            raise
        except Exception as error:  # the live session's door: the same trial must not fail for ever
            self._note_failure(error)
        outcome = result.end if isinstance(result, EpisodeRun | SequenceRun) else result
        if outcome is None or outcome.reason == "technical":
            why = "abandoned" if reason == "abandoned" else "technical"
            result, outcome = None, unscored_outcome(trial.key, trial.task, reason=why, participant=trial.code)
        self._link.finish_trial(trial.trial_id, outcome)
        self._watch.end(result if isinstance(result, EpisodeRun | Answer) else None)
        return result

    def _result(self, events: list[Event]) -> Result | None:
        """The outcome; None of a sequence that we or a long absence ended."""
        trial, home, found = self._trial, self._home, self._found
        navigation, storeys = home.scene.navigation, home.storeys
        if isinstance(found, HomeSequence):
            return sequence_outcome(events, found, navigation=navigation, storeys=storeys, participant=trial.code)
        if trial.task == "pan":
            return pan_outcome(events, found, navigation=navigation, participant=trial.code)
        return pog_outcome(events, found, storeys=storeys, participant=trial.code)

    def _note_failure(self, error: Exception) -> None:
        """Prints a failure of ours that ended the trial, and stores an event that says so."""
        traceback.print_exc()
        failed = Error(message=repr(error)[:500], is_fatal=True)
        self._link.append_many(self._trial.trial_id, self._trial.epoch, (failed,))


def _nothing_changes(view: View) -> None:
    """Does nothing, because a card never changes."""


def _sensed(session: PanSession | PogSession) -> Any:
    """What the robot senses now, for researchers who watch; None in POG."""
    return session.observation if isinstance(session, PanSession) else None
