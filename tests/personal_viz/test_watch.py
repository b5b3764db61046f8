"""A researcher watches a study: nothing that is stored or shown changes, whatever the observer does."""

import asyncio
import dataclasses
import queue
import threading
from collections.abc import Callable, Sequence
from typing import Any, get_type_hints

import numpy as np
import pytest

from human_study.commands import Confirm, GiveUp, Move, PressStop, ShowStorey
from human_study.events import Act, Clicked, Event, event_to_json
from human_study.store import Trial
from human_study.views import PanView, PogView
from personal_viz import seat as seat_module
from personal_viz.seat import Home, Seat
from personal_viz.store_link import TrialPlace
from personal_viz.watch import MAX_WAITING, Watches
from sim.episodes.schema import Episode
from sim.errors import RecordingError
from sim.tasks.observers import Insight
from sim.tasks.pan import PanEnv
from sim.tasks.run_files import Answer, ClickRay, EpisodeRun, Step, Vector3
from sim.types import Action, Observation, Task

from ..human_study.small_world import PoseColours, SquareRoom, episode, study

FORWARD, LEFT = Move(Action.FORWARD, code="KeyW"), Move(Action.LEFT, code="KeyA")
STOP = PressStop()
RAY = ClickRay(
    origin=(0.0, 3.0, 0.0),
    direction=(0.0, -1.0, 0.0),
    camera_position=(0.0, 3.0, 0.0),
    camera_wxyz=(1.0, 0.0, 0.0, 0.0),
    storey_y=0.0,
)
HIT = (-1.5, 0.0, 0.0)


class Clock:
    """`time.monotonic` that goes on by 0.1 s per look."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def monotonic(self) -> float:
        self.now_s += 0.1
        return self.now_s


class MemoryLink:
    """The store of one trial."""

    def __init__(self, task: str, code: str = "p02") -> None:
        self.trial = Trial("t1", code, 1, task, episode().key, 1, 0.0)  # type: ignore[arg-type]
        self.stored: list[Event] = []
        self.outcome: Any = None

    def trials(self, code: str) -> list[TrialPlace]:
        return [TrialPlace(1, self.trial.task, self.trial.key, bool(self.stored), self.outcome is not None)]

    def open_trial(self, code: str, order_no: int) -> Trial:
        self.trial = dataclasses.replace(self.trial, epoch=self.trial.epoch + 1)
        return self.trial

    def events(self, trial_id: str) -> list[Event]:
        return list(self.stored)

    def append_many(self, trial_id: str, epoch: int, events: Sequence[Event]) -> None:
        self.stored += events

    def finish_trial(self, trial_id: str, outcome: Any) -> None:
        self.outcome = outcome


class Screen:
    """Stands for Page, PanApp and PogApp: keeps what is shown and sends what a script presses."""

    def __init__(self) -> None:
        self.send: Callable[[Any], Any] | None = None
        self.views: queue.Queue[PanView | PogView] = queue.Queue()
        self.shown: list[PanView | PogView] = []
        self.notices: queue.Queue[str] = queue.Queue()

    def notice(self, title: str, text: str, *, button: Any = None) -> None:
        self.notices.put(title)
        if button is not None:
            asyncio.run(button[1]())

    def app(self, page: Any, view: PanView | PogView, send: Callable[[Any], Any], **options: Any) -> "Screen":
        self.send = send
        self.show(view)
        return self

    def show(self, view: PanView | PogView) -> None:
        self.shown.append(view)
        self.views.put(view)

    def close(self) -> None:
        """As PogApp's."""

    def press(self, command: Any) -> None:
        """Sends a command and waits for the view after it."""
        assert self.send is not None
        asyncio.run(self.send(command))
        self.views.get(timeout=30)


class Pointed:
    """A PogScene in which every ray meets the same point."""

    def hit(self, storey: int, origin: object, direction: object) -> Vector3:
        return HIT


def make_env(episode: Episode) -> PanEnv:
    return PanEnv(episode.start, SquareRoom(), renderer=PoseColours(), camera=study().robot_camera, max_steps=500)


class Notes:
    """Observers of both tasks that keep what they are told."""

    def __init__(self, *, fails_at: str = "", waits_for: threading.Event | None = None) -> None:
        self.told: list[tuple] = []
        self._fails_at, self._waits_for = fails_at, waits_for

    def of_walk(self, trial: Trial) -> "Walk":
        return Walk(self)

    def of_answer(self, trial: Trial) -> "Pointing":
        return Pointing(self)

    def note(self, name: str, *what: object) -> None:
        if self._waits_for is not None:
            self._waits_for.wait(30)
        if name == self._fails_at:
            raise RecordingError("x.rrd: the disk is full; expected space. Free some.")
        self.told.append((name, *what))


class Walk:
    """An `Observer`."""

    def __init__(self, notes: Notes) -> None:
        self._note = notes.note

    def on_reset(self, episode: Episode, observation: Observation) -> None:
        self._note("reset", str(episode.key), observation)

    def on_step(self, step: Step, observation: Observation, insight: Insight | None) -> None:
        assert insight is None
        self._note("step", step, observation)

    def on_end(self, run: EpisodeRun) -> None:
        self._note("end", run)


class Pointing:
    """An `AnswerObserver`."""

    def __init__(self, notes: Notes) -> None:
        self._note = notes.note

    def on_reset(self, episode: Episode) -> None:
        self._note("reset", str(episode.key))

    def on_storey(self, floor_y: float, t_s: float) -> None:
        self._note("storey", floor_y, round(t_s, 3))

    def on_click(self, ray: ClickRay, hit: Vector3 | None, t_s: float) -> None:
        self._note("click", ray, hit, round(t_s, 3))

    def on_end(self, answer: Answer) -> None:
        self._note("end", answer)


@dataclasses.dataclass
class FakeScene:
    """What seats need of a scene."""

    label = "a room (invented)"
    digest = "d" * 64
    navigation = SquareRoom()


@dataclasses.dataclass
class Played:
    """A trial in the making."""

    screen: Screen
    link: MemoryLink
    watches: Watches
    seat: Seat


@pytest.fixture
def play(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Played]:
    """Seats a participant at a screen without a browser."""

    def begin(link: MemoryLink, observers: Notes | None) -> Played:
        screen, clock = Screen(), Clock()
        monkeypatch.setattr(seat_module, "time", clock)
        monkeypatch.setattr(seat_module, "STOP_WITHIN_S", 600.0)  # seats count it in real time, which here has no sense
        monkeypatch.setattr(seat_module, "Page", lambda client: screen)
        monkeypatch.setattr(seat_module, "PanApp", screen.app)
        monkeypatch.setattr(seat_module, "PogApp", screen.app)
        watches = Watches(observers, make_env=make_env)
        config = study(actions="paper4")
        home: Any = Home(
            scene=FakeScene(),  # type: ignore[arg-type]
            renderer=PoseColours(),
            pog_scene=Pointed(),  # type: ignore[arg-type]
            copies=None,  # type: ignore[arg-type]
            episodes={episode().key: episode()},
            storeys=[(0.0, 0.0)],
            config=config,
            opened_s=0.0,
            watches=watches,
        )
        seat = Seat(None, link.trial.code, link, home)  # type: ignore[arg-type]
        screen.views.get(timeout=30)  # the first view
        return Played(screen, link, watches, seat)

    return begin


def walk(played: Played, *commands: Any) -> None:
    """Presses, then waits until everything is stored."""
    for command in commands:
        played.screen.press(command)
    while played.screen.notices.get(timeout=30) != "Thank you!":
        pass


def looks(view: PanView) -> tuple:
    """All that a PAN participant is shown."""
    assert view.rgb is not None
    return (view.task, view.rgb.tobytes(), view.step, view.is_armed, view.is_over)


def lines(link: MemoryLink) -> list[str]:
    """The stored events as they are on disk."""
    return [event_to_json(event) for event in link.stored]


def test_a_watched_walk_is_stored_and_shown_as_an_unwatched_one(play: Callable[..., Played]) -> None:
    presses = (FORWARD, LEFT, FORWARD, STOP, STOP)
    alone = play(MemoryLink("pan"), None)
    walk(alone, *presses)
    notes = Notes()
    watched = play(MemoryLink("pan"), notes)
    walk(watched, *presses)
    watched.watches.close()
    assert lines(watched.link) == lines(alone.link)
    assert watched.link.outcome == alone.link.outcome
    assert [looks(view) for view in watched.screen.shown] == [looks(view) for view in alone.screen.shown]
    assert [name for name, *_ in notes.told] == ["reset", "step", "step", "step", "step", "end"]
    assert [step for name, step, *_ in notes.told if name == "step"] == [
        event.step for event in watched.link.stored if isinstance(event, Act)
    ]
    run = notes.told[-1][1]
    assert run.end == watched.link.outcome
    assert run.start.participant == "p02"


def test_an_observer_sees_what_the_participant_saw(play: Callable[..., Played]) -> None:
    notes = Notes()
    played = play(MemoryLink("pan"), notes)
    walk(played, FORWARD, LEFT, GiveUp())
    played.watches.close()
    seen = [observation.rgb for name, _, observation in notes.told[:3]]
    for rgb, view in zip(seen, played.screen.shown, strict=False):
        assert isinstance(view, PanView)
        np.testing.assert_array_equal(rgb, view.rgb)  # type: ignore[arg-type]
    assert notes.told[-1][0] == "end"
    assert notes.told[-1][1].end.reason == "giveup"


def test_a_resumed_walk_is_told_from_its_start(play: Callable[..., Played]) -> None:
    link, first, second = MemoryLink("pan"), Notes(), Notes()
    before = play(link, first)
    for command in (FORWARD, LEFT, FORWARD):
        before.screen.press(command)
    before.seat.leave()
    before.watches.close()
    assert [name for name, *_ in first.told] == ["reset", "step", "step", "step"]
    again = play(link, second)
    walk(again, FORWARD, GiveUp())
    again.watches.close()
    assert [name for name, *_ in second.told] == ["reset", "step", "step", "step", "step", "end"]
    for (_, _, old), (_, _, new) in zip(first.told, second.told, strict=False):
        np.testing.assert_array_equal(old.rgb, new.rgb)
        assert old.step == new.step
        assert old.gps == new.gps


def test_a_watched_answer_is_stored_as_an_unwatched_one(play: Callable[..., Played]) -> None:
    presses = (RAY, ShowStorey(0), RAY, Confirm())
    alone = play(MemoryLink("pog", "p01"), None)
    walk(alone, *presses)
    notes = Notes()
    watched = play(MemoryLink("pog", "p01"), notes)
    walk(watched, *presses)
    watched.watches.close()
    assert lines(watched.link) == lines(alone.link)
    assert watched.link.outcome == alone.link.outcome
    clicks = [event for event in watched.link.stored if isinstance(event, Clicked)]
    times = [round(event.t_s or 0.0, 3) for event in clicks]
    assert [name for name, *_ in notes.told] == ["reset", "click", "storey", "click", "end"]
    assert [what for what in notes.told if what[0] == "click"] == [("click", RAY, HIT, t_s) for t_s in times]
    assert notes.told[-1][1] == watched.link.outcome


@pytest.mark.parametrize("fails_at", ["reset", "step", "end"])
def test_a_failing_observer_is_named_once_and_the_trial_goes_on(
    play: Callable[..., Played], capsys: pytest.CaptureFixture, fails_at: str
) -> None:
    played = play(MemoryLink("pan"), Notes(fails_at=fails_at))
    walk(played, FORWARD, LEFT, FORWARD, STOP, STOP)
    played.watches.close()
    assert played.link.outcome.reason == "stop"
    told = capsys.readouterr().err.splitlines()
    assert told == [
        "personal-viz: watching p02: the observer failed (RecordingError: x.rrd: the disk is full; expected space. "
        "Free some.); the trial goes on unseen."
    ]


def test_a_participant_does_not_wait_for_an_observer_that_hangs(
    play: Callable[..., Played], capsys: pytest.CaptureFixture
) -> None:
    goes_on = threading.Event()
    notes = Notes(waits_for=goes_on)
    played = play(MemoryLink("pan"), notes)
    walk(played, FORWARD, LEFT, STOP, STOP)  # would never end if a press waited
    assert played.link.outcome.reason == "stop"
    assert notes.told == []
    goes_on.set()
    played.watches.close()
    assert [name for name, *_ in notes.told] == ["reset", "step", "step", "step", "end"]
    assert capsys.readouterr().err == ""


def test_an_observer_that_is_far_behind_is_left_and_that_is_said(capsys: pytest.CaptureFixture) -> None:
    goes_on = threading.Event()
    notes = Notes(waits_for=goes_on)
    watches = Watches(notes, make_env=make_env)
    link = MemoryLink("pan")
    observation = make_env(episode()).reset()
    watch = watches.begin(link.trial, episode(), (), observation)
    act = Act(t_s=1.0, action=Action.LEFT, position=(0.0, 0.0, 0.0), yaw=0.5)
    for _ in range(2 * MAX_WAITING):
        watch.tell((act,), observation)
    goes_on.set()
    watches.close()
    assert MAX_WAITING <= len(notes.told) <= MAX_WAITING + 1
    assert capsys.readouterr().err.splitlines() == [
        f"personal-viz: watching p02: the observer is {MAX_WAITING} calls behind; the trial goes on unseen."
    ]


def test_what_an_older_tab_says_late_is_not_told(capsys: pytest.CaptureFixture) -> None:
    notes = Notes()
    watches = Watches(notes, make_env=make_env)
    trial, observation = MemoryLink("pan").trial, make_env(episode()).reset()
    act = Act(t_s=1.0, action=Action.LEFT, position=(0.0, 0.0, 0.0), yaw=0.5)
    old = watches.begin(trial, episode(), (), observation)
    new = watches.begin(trial, episode(), (act,), observation)
    old.tell((act,), observation)
    old.leave()
    new.tell((act,), observation)
    watches.close()
    assert [name for name, *_ in notes.told] == ["reset", "reset", "step", "step"]


def test_participants_views_have_no_field_for_what_observers_get() -> None:
    for view in (PanView, PogView):
        for kind in get_type_hints(view).values():
            assert kind not in (Observation, Episode, EpisodeRun, Answer, Watches)
    assert set(get_type_hints(PanView)) == {"task", "rgb", "step", "is_armed", "is_over"}
    assert get_type_hints(PanView)["task"] is Task
