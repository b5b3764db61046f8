"""One trial on one page, from its opening to its stored outcome: commands in, stored events, then the view."""

import queue
import time
import traceback
from collections.abc import Sequence

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
from sim.tasks.run_files import Answer, ClickRay, EpisodeRun
from sim.types import EpisodeKey

from .desk import Desk, GoneError
from .home import Home, pan_env
from .pan_app import PanApp
from .pog_app import PogApp
from .store_link import StoreLink
from .watch import TrialWatch


class TrialPlay:
    """Plays trials of one participant in one home."""

    def __init__(self, desk: Desk, link: StoreLink, home: Home, config: StudyConfig) -> None:
        """Shows nothing yet.

        Args:
            desk: The participant's page and queue.
            link: To the store.
            home: In which the trial takes place.
            config: The study.
        """
        self._desk, self._link, self._home, self._config = desk, link, home, config
        self._watch = TrialWatch()

    def play(self, trial: Trial, *, progress: str, away_s: float) -> None:
        """One opened trial to its stored outcome; a failure of ours ends it as `technical`.

        Args:
            trial: As the store opened it.
            progress: "Trial 3 of 30".
            away_s: How long the participant was away; 0 where that was our fault.

        Raises:
            StoreFullError: The store cannot write now; open the trial again to go on.
            SupersededError, TrialEndedError, GoneError: Somebody else goes on with it, or nobody.
        """
        result: EpisodeRun | Answer | None = None
        try:
            episode = self._episode(trial.key)
            play = self._play_pan if trial.task == "pan" else self._play_pog
            play(trial, episode, progress, away_s)
            result = self._result(trial, episode)
            outcome = result.end if isinstance(result, EpisodeRun) else result
        except (StoreFullError, SupersededError, TrialEndedError, GoneError):
            raise
        except Exception as error:  # the live session's door: the same trial must not fail for ever
            traceback.print_exc()
            self._link.append_many(trial.trial_id, trial.epoch, (Error(message=repr(error)[:500], is_fatal=True),))
            outcome = technical_outcome(trial.key, trial.task, participant=trial.code)
        self._link.finish_trial(trial.trial_id, outcome)
        self._watch.end(result)

    def leave(self) -> None:
        """The participant is gone: a researcher who watches sees that."""
        self._watch.leave()

    def _episode(self, key: EpisodeKey) -> Episode:
        return self._home.episodes[key]

    def _play_pan(self, trial: Trial, episode: Episode, progress: str, away_s: float) -> None:
        session, update, stored = self._begin_pan(trial, episode, away_s)
        page, send = self._desk.page, self._desk.new_screen()
        app = PanApp(page, update.view, send, scene_label=self._home.scene.label, progress=progress)
        self._watch = self._home.watches.begin(trial, episode, stored, session.observation)
        while not session.is_over:
            try:
                item = self._desk.wait(timeout_s=STOP_WITHIN_S if update.view.is_armed else None)
            except queue.Empty:
                update = SessionUpdate((), session.view(time.monotonic()))
            else:
                assert isinstance(item.content, PanCommand), item.content
                update = session.handle(item.content, time.monotonic(), busy=item.is_busy)
                self._store(trial, update.events)
                self._desk.done_with(item)
            app.show(update.view)
            self._watch.tell(update.events, session.observation)

    def _play_pog(self, trial: Trial, episode: Episode, progress: str, away_s: float) -> None:
        session, update, stored = self._begin_pog(trial, episode, away_s)
        page, send = self._desk.page, self._desk.new_screen()
        app = PogApp(page, update.view, send, copies=self._home.copies, progress=progress)
        self._watch = self._home.watches.begin(trial, episode, stored)
        try:
            while not session.is_over:
                command = self._desk.wait().content
                if isinstance(command, ClickRay):
                    storey = update.view.storeys.index(command.storey_y)
                    command = Click(command, self._home.pog_scene.hit(storey, command.origin, command.direction))
                assert isinstance(command, PogCommand), command
                update = session.handle(command, time.monotonic())
                self._store(trial, update.events)
                app.show(update.view)
                self._watch.tell(update.events)
        finally:
            app.close()

    def _store(self, trial: Trial, events: Sequence[Event]) -> None:
        self._link.append_many(trial.trial_id, trial.epoch, events)

    def _begin_pan(
        self, trial: Trial, episode: Episode, away_s: float
    ) -> tuple[PanSession, SessionUpdate[PanView], list[Event]]:
        """A new session, or the stored one at the same step and pose, and all its events, which are stored."""
        config, scene = self._config, self._home.scene
        env = pan_env(episode, scene, self._home.renderer, config)
        options = {"key": trial.key, "task": config.task_for(episode, "pan"), "scene_digest": scene.digest}
        stored = self._link.events(trial.trial_id)
        if stored:
            session = pan_session_from_events(stored, env, **options, resume_within_s=config.resume_within_s)
        else:
            session = PanSession(env, **options, resume_within_s=config.resume_within_s)
        update = session.handle(Resume(away_s) if stored else Start(), time.monotonic())
        self._store(trial, update.events)
        return session, update, [*stored, *update.events]

    def _begin_pog(
        self, trial: Trial, episode: Episode, away_s: float
    ) -> tuple[PogSession, SessionUpdate[PogView], list[Event]]:
        """A new session, or the stored one with the same storey and mark, and all its events, which are stored."""
        config, scene = self._config, self._home.scene
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
        self._store(trial, update.events)
        return session, update, [*stored, *update.events]

    def _result(self, trial: Trial, episode: Episode) -> EpisodeRun | Answer:
        """The result of a finished trial from its stored events; stays on the server."""
        events = self._link.events(trial.trial_id)
        if trial.task == "pan":
            navigation = self._home.scene.navigation
            return pan_outcome(events, episode, navigation=navigation, participant=trial.code)
        return pog_outcome(events, episode, storeys=self._home.storeys, participant=trial.code)
