"""Lets a researcher watch participants while they take part: stored events go to observers, on threads of their own.

Participants never wait for this: a seat hands over events that are stored and shown already, and an observer that fails
or is too slow is told nothing more of that trial. Nothing comes back from here.
"""

import contextlib
import queue
import sys
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from human_study.store.store import Trial
from human_study.trial.events import Act, Clicked, Event, MapOff, ShownStorey
from human_study.trial.outcome import task_began_s, walked_steps
from sim.episodes.schema import Episode
from sim.tasks.observers import Observer
from sim.tasks.pan import PanEnv
from sim.tasks.run_files import Answer, ClickRay, EpisodeRun, Vector3
from sim.types import Observation

MAX_WAITING = 200
"""Most calls that may wait for an observer; a step's picture and depth take 2 MB."""
CLOSE_S = 5.0
"""Longest wait for the observers' remaining work when the program ends."""


class AnswerObserver(Protocol):
    """Receives a POG trial as it happens; times are seconds since the trial's start."""

    def on_reset(self, episode: Episode) -> None:
        """The trial begins."""
        ...

    def on_storey(self, floor_y: float, t_s: float) -> None:
        """The participant looks at the storey with this floor height, metres."""
        ...

    def on_click(self, ray: ClickRay, hit: Vector3 | None, t_s: float) -> None:
        """The participant clicked; `hit` is the new mark, None = the ray met nothing."""
        ...

    def on_end(self, answer: Answer) -> None:
        """The trial is over, stored and scored."""
        ...


class Observers(Protocol):
    """Makes an observer for each trial."""

    def of_walk(self, trial: Trial) -> Observer:
        """The observer of a PAN trial."""
        ...

    def of_answer(self, trial: Trial) -> AnswerObserver:
        """The observer of a POG trial."""
        ...


class Watches:
    """The watched participants of a worker, each with a thread that reports one trial after the other."""

    def __init__(self, observers: Observers | None = None, *, make_env: Callable[[Episode], PanEnv]) -> None:
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
            thread = self._threads[trial.code]
        watch = TrialWatch(thread)
        thread.put(_Item(watch, open_teller=open_teller))
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

    def tell(self, events: Sequence[Event], observation: Observation | None = None) -> None:
        """Reports events that are stored and shown; `observation` is the robot's observation after them."""
        self._put(lambda teller: teller.tell(events, observation))

    def end(self, result: EpisodeRun | Answer | None) -> None:
        """Reports that the trial is over and stored; None = a failure of ours ended it without a result."""
        if result is not None:
            self._put(lambda teller: teller.end(result))
        self.leave()

    def leave(self) -> None:
        """Reports that nothing more will come: the participant is gone, or the trial is over."""
        self._put(None)

    def _put(self, call: "Callable[[_Teller], None] | None") -> None:
        if self._thread is not None:
            self._thread.put(_Item(self, call))


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

    def tell(self, events: Sequence[Event], observation: Observation | None) -> None:
        for event in events:
            if isinstance(event, MapOff):
                self._began_s = event.t_s or 0.0
            elif isinstance(event, Act):  # one at most: a command is one step
                assert observation is not None
                step = event.step.model_copy(update={"t_s": (event.t_s or 0.0) - self._began_s})
                self._observer.on_step(step, observation, None)

    def end(self, result: EpisodeRun | Answer) -> None:
        assert isinstance(result, EpisodeRun)
        self._observer.on_end(result)


class _AnswerTeller:
    """Reports a POG trial to an `AnswerObserver`."""

    def __init__(self, observer: AnswerObserver, episode: Episode, events: Sequence[Event]) -> None:
        """Reports the start and, in a resumed trial, every storey and mark so far."""
        self._observer = observer
        observer.on_reset(episode)
        self.tell(events, None)

    def tell(self, events: Sequence[Event], observation: Observation | None) -> None:
        for event in events:
            if isinstance(event, ShownStorey):
                self._observer.on_storey(event.storey_y, event.t_s or 0.0)
            elif isinstance(event, Clicked):
                self._observer.on_click(event.ray, event.hit, event.t_s or 0.0)

    def end(self, result: EpisodeRun | Answer) -> None:
        assert isinstance(result, Answer)
        self._observer.on_end(result)


_Teller = _WalkTeller | _AnswerTeller


@dataclass(frozen=True, slots=True)
class _Item:
    """Something to report of a trial."""

    watch: TrialWatch
    call: Callable[[_Teller], None] | None = None
    """Reports it; None = the observer is let go."""
    open_teller: Callable[[], _Teller] | None = None
    """Makes the teller of a trial that begins; from then on only this trial's items count."""


class _WatchThread:
    """Reports one participant's trials in order, from any of the participant's seats."""

    def __init__(self, code: str) -> None:
        self._code = code
        self._items: queue.Queue[_Item | None] = queue.Queue(MAX_WAITING)
        self._lost: TrialWatch | None = None
        self._present: TrialWatch | None = None
        self._teller: _Teller | None = None
        self._thread = threading.Thread(target=self._run, daemon=True, name=f"watch-{code}")
        self._thread.start()

    def put(self, item: _Item) -> None:
        """Queues an item; with too many waiting, this one and its trial's later ones are left out."""
        if item.watch is self._lost:
            return
        try:
            self._items.put_nowait(item)
        except queue.Full:
            self._lost = item.watch
            self._complain(f"is {MAX_WAITING} calls behind")

    def close(self) -> None:
        """Lets the thread do its waiting items and end."""
        with contextlib.suppress(queue.Full):
            self._items.put(None, timeout=CLOSE_S)
            self._thread.join(CLOSE_S)

    def _run(self) -> None:
        while (item := self._items.get()) is not None:
            try:
                self._take(item)
            except Exception as error:  # the door to a plug-in: an observer may fail, a participant's trial must not
                self._teller = None
                self._complain(f"failed ({type(error).__name__}: {error})")
            del item  # it holds a picture
        self._teller = None

    def _take(self, item: _Item) -> None:
        if item.open_teller is not None:
            self._present, self._teller = item.watch, None  # lets go of the previous one: they may share a file
            self._teller = item.open_teller()
        elif item.watch is self._present and self._teller is not None:
            if item.call is not None:
                item.call(self._teller)
            else:
                self._teller = None

    def _complain(self, what: str) -> None:
        print(f"personal-viz: watching {self._code}: the observer {what}; the trial goes on unseen.", file=sys.stderr)
