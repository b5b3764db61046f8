"""Lets a researcher watch participants while they take part: stored events go to observers, on threads of their own.

Participants never wait for this: a seat hands over events that are stored and shown already, and an observer that fails
or is too slow is told nothing more of that trial. Nothing comes back from here.
"""

import contextlib
import itertools
import queue
import sys
import threading
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from human_study.store.store import Trial
from human_study.trial.events import Act, Clicked, Event, MapOff, ShownStorey
from human_study.trial.outcome import task_began_s, walked_steps
from sim.episodes.schema import Episode
from sim.tasks.observers import Observer
from sim.tasks.pan import PanEnv
from sim.tasks.run_files import Answer, EpisodeRun
from sim.types import Observation

if TYPE_CHECKING:  # Rerun takes a second to import
    from recordings.observer import AnswerObserver

    from .watch_rerun import RerunObservers

MAX_WAITING = 200
"""Most calls that may wait for an observer; a step's picture and depth take 2 MB."""
CLOSE_S = 5.0
"""Longest wait for the observers' remaining work when the program ends."""


class Watches:
    """The watched participants of a worker, each with a thread that reports one trial after the other."""

    def __init__(self, observers: "RerunObservers | None" = None, *, make_env: Callable[[Episode], PanEnv]) -> None:
        """Starts no thread before a trial begins.

        Args:
            observers: Makes the observers; None = nobody watches, and nothing is done.
            make_env: Makes a copy of the participant's environment at its start. It shows the observer of a resumed
                trial the steps that the participant saw before.
        """
        self._observers, self._make_env = observers, make_env
        self._threads: dict[str, _WatchThread] = {}
        self._lock = threading.Lock()

    def begin(
        self, trial: Trial, episode: Episode, events: Sequence[Event], observation: Observation | None = None
    ) -> "TrialWatch":
        """A participant begins a trial, or comes back to it.

        Args:
            trial: The trial; watches of the participant's earlier trials end.
            episode: The episode, with its targets, because observers are for the researcher.
            events: All events stored so far.
            observation: The robot's present observation, for PAN.
        """
        observers = self._observers
        if observers is None:
            return TrialWatch(None)

        def open_teller() -> _Teller:
            if trial.task == "pan":
                assert observation is not None
                walk = observers.of_walk(trial)
                return _WalkTeller(walk, episode, events, observation, env=self._make_env(episode))
            return _AnswerTeller(observers.of_answer(trial), episode, events)

        with self._lock:
            if trial.code not in self._threads:
                self._threads[trial.code] = _WatchThread(trial.code)
            watch = TrialWatch(self._threads[trial.code])
        watch.put(lambda _: open_teller())
        return watch

    def close(self) -> None:
        """Waits until observers have been told everything, at most CLOSE_S."""
        for thread in self._threads.values():
            thread.close()


class TrialWatch:
    """The watch of one trial, which a seat calls: no call waits, and none raises."""

    def __init__(self, thread: "_WatchThread | None" = None) -> None:
        """For `Watches.begin` only; without a thread nobody watches."""
        self._thread = thread
        self.number = 0 if thread is None else next(thread.numbers)
        """The participant's later trials have higher numbers."""

    def tell(self, events: Sequence[Event], observation: Observation | None = None) -> None:
        """Reports events that are stored and shown; `observation` is the robot's observation after them."""
        self.put(lambda teller: teller.tell(events, observation))

    def end(self, result: EpisodeRun | Answer | None) -> None:
        """Reports that the trial is over and stored; None = a failure of ours ended it without a result."""
        if result is not None:
            self.put(lambda teller: teller.end(result))
        self.leave()

    def leave(self) -> None:
        """Reports that nothing more will come: the participant is gone, or the trial is over."""
        self.put(lambda _: None)

    def put(self, call: "_Call") -> None:
        """Lets the thread make a call with the trial's teller; the call returns the teller of the next one."""
        if self._thread is not None:
            self._thread.put(self, call)


class _WalkTeller:
    """Reports a PAN trial to an `Observer`."""

    def __init__(
        self, observer: Observer, episode: Episode, events: Sequence[Event], observation: Observation, *, env: PanEnv
    ) -> None:
        """Reports the start and, in a resumed trial, every step so far as the participant saw it."""
        self._observer, self._began_s = observer, task_began_s(events)
        steps = walked_steps(events)
        self._observer.on_reset(episode, env.reset() if steps else observation)
        for number, step in enumerate(steps, start=1):
            seen = env.restore(steps[:number]) if number < len(steps) else observation
            self._observer.on_step(step, seen, None)

    def tell(self, events: Sequence[Event], observation: Observation | None) -> "_WalkTeller":
        for event in events:
            if isinstance(event, MapOff):
                self._began_s = event.t_s or 0.0
            elif isinstance(event, Act):  # one at most: a command is one step
                assert observation is not None
                step = event.step.model_copy(update={"t_s": (event.t_s or 0.0) - self._began_s})
                self._observer.on_step(step, observation, None)
        return self

    def end(self, result: EpisodeRun | Answer) -> None:
        assert isinstance(result, EpisodeRun)
        self._observer.on_end(result)


class _AnswerTeller:
    """Reports a POG trial to an `AnswerObserver`."""

    def __init__(self, observer: "AnswerObserver", episode: Episode, events: Sequence[Event]) -> None:
        """Reports the start and, in a resumed trial, every storey and mark so far."""
        self._observer = observer
        observer.on_reset(episode)
        self.tell(events, None)

    def tell(self, events: Sequence[Event], observation: Observation | None) -> "_AnswerTeller":
        for event in events:
            if isinstance(event, ShownStorey):
                self._observer.on_storey(event.storey_y, event.t_s or 0.0)
            elif isinstance(event, Clicked):
                self._observer.on_click(event.ray, event.hit, event.t_s or 0.0)
        return self

    def end(self, result: EpisodeRun | Answer) -> None:
        assert isinstance(result, Answer)
        self._observer.on_end(result)


_Teller = _WalkTeller | _AnswerTeller
_Call = Callable[[Any], _Teller | None]


class _WatchThread:
    """Reports one participant's trials in order, from any of the participant's seats."""

    def __init__(self, code: str) -> None:
        self.numbers = itertools.count(1)
        self._code = code
        self._items: queue.Queue[tuple[TrialWatch, _Call] | None] = queue.Queue(MAX_WAITING)
        self._lost: TrialWatch | None = None
        self._thread = threading.Thread(target=self._run, daemon=True, name=f"watch-{code}")
        self._thread.start()

    def put(self, watch: TrialWatch, call: _Call) -> None:
        """Queues a call; with too many waiting, this one and its trial's later ones are left out."""
        if watch is self._lost:
            return
        try:
            self._items.put_nowait((watch, call))
        except queue.Full:
            self._lost = watch
            self._complain(f"is {MAX_WAITING} calls behind")

    def close(self) -> None:
        """Lets the thread make its waiting calls and end."""
        with contextlib.suppress(queue.Full):
            self._items.put(None, timeout=CLOSE_S)
            self._thread.join(CLOSE_S)

    def _run(self) -> None:
        present, teller = 0, None
        while (item := self._items.get()) is not None:
            watch, call = item
            if watch.number > present:  # a trial begins
                present, teller = watch.number, None  # lets go of the previous one: they may share a file
            elif watch.number < present or teller is None:
                continue
            try:
                teller = call(teller)
            except Exception as error:  # the door to a plug-in: an observer may fail, a participant's trial must not
                teller = None
                self._complain(f"failed ({type(error).__name__}: {error})")
            del item, call  # they hold a picture

    def _complain(self, what: str) -> None:
        print(f"personal-viz: watching {self._code}: the observer {what}; the trial goes on unseen.", file=sys.stderr)
