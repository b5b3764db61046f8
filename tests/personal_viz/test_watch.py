"""A researcher watches a study: nothing that is stored or shown changes, whatever the observer does."""

import threading
from collections.abc import Callable
from functools import partial
from typing import Any, get_type_hints

import numpy as np
import pytest

from human_study.store.store import Trial
from human_study.trial.commands import CloseMap, Confirm, GiveUp, Move, PressStop, ShowStorey
from human_study.trial.events import Act, Clicked
from human_study.trial.outcome import walked_steps
from human_study.trial.views import LookView, PanView, PogView, RateView
from personal_viz.study_app.watch import MAX_WAITING, Watches
from sim.episodes.schema import Episode
from sim.errors import RecordingError
from sim.tasks.run_files import Answer, EpisodeRun
from sim.types import Action, Observation, Task

from ..human_study.small_world import episode
from .fake_play import HIT, RAY, MemoryLink, make_env, played
from .fake_play import fake_screens as fake_screens

FORWARD, LEFT = Move(Action.FORWARD, code="KeyW"), Move(Action.LEFT, code="KeyA")
STOP = PressStop()
Fakes = tuple[list, list[str]]


class Notes:
    """An observer of walks and answers that keeps each call: its name without `on_`, and the arguments."""

    def __init__(self, *, fails_at: str = "", waits_for: threading.Event | None = None) -> None:
        self.told: list[tuple] = []
        self._fails_at, self._waits_for = fails_at, waits_for

    def of_walk(self, trial: Trial) -> Any:
        return self

    def of_answer(self, trial: Trial) -> Any:
        return self

    def __getattr__(self, name: str) -> Callable[..., None]:
        return partial(self._note, name.removeprefix("on_"))

    def _note(self, name: str, *what: object) -> None:
        if self._waits_for is not None:
            self._waits_for.wait(30)
        if name == self._fails_at:
            raise RecordingError("x.rrd: the disk is full; expected space. Free some.")
        self.told.append((name, *what))


def looks(view: object) -> tuple:
    """All that a PAN participant is shown."""
    assert isinstance(view, PanView)
    return (view.task, None if view.rgb is None else view.rgb.tobytes(), view.step, view.is_armed, view.is_over)


def test_a_watched_walk_is_stored_and_shown_as_an_unwatched_one(fake_screens: Fakes) -> None:
    presses = (FORWARD, LEFT, FORWARD, STOP, STOP)
    alone = played(fake_screens, MemoryLink("pan"), *presses)
    notes = Notes()
    watched = played(fake_screens, MemoryLink("pan"), *presses, observers=notes)
    watched.watches.close()
    assert watched.link.lines() == alone.link.lines()
    assert watched.link.outcome == alone.link.outcome
    assert [looks(view) for view in watched.shown] == [looks(view) for view in alone.shown]
    assert [name for name, *_ in notes.told] == ["reset", "step", "step", "step", "step", "end"]
    steps = [step for name, step, *_ in notes.told if name == "step"]
    assert {insight for name, *_, insight in notes.told if name == "step"} == {None}
    assert steps == [event.step for event in watched.link.stored if isinstance(event, Act)]
    run = notes.told[-1][1]
    assert run.end == watched.link.outcome
    assert run.start.participant == "p02"


def test_an_observer_sees_what_the_participant_saw(fake_screens: Fakes) -> None:
    notes = Notes()
    trial = played(fake_screens, MemoryLink("pan"), FORWARD, LEFT, GiveUp(), GiveUp(), observers=notes)
    trial.watches.close()
    seen = [observation.rgb for _, _, observation, *_ in notes.told[:3]]
    shown = {view.step: view.rgb for view in trial.shown if isinstance(view, PanView) and view.rgb is not None}
    for rgb, step in zip(seen, range(3), strict=True):
        np.testing.assert_array_equal(rgb, shown[step])
    assert notes.told[-1][0] == "end"
    assert notes.told[-1][1].end.reason == "giveup"


def test_a_resumed_walk_is_told_from_its_start(fake_screens: Fakes) -> None:
    link, first, second = MemoryLink("pan"), Notes(), Notes()
    played(fake_screens, link, FORWARD, LEFT, FORWARD, observers=first).watches.close()
    assert [name for name, *_ in first.told] == ["reset", "step", "step", "step"]
    played(fake_screens, link, FORWARD, GiveUp(), GiveUp(), observers=second).watches.close()
    assert [name for name, *_ in second.told] == ["reset", "step", "step", "step", "step", "end"]
    for (_, _, old, *_), (_, _, new, *_) in zip(first.told, second.told, strict=False):
        np.testing.assert_array_equal(old.rgb, new.rgb)
        assert old.step == new.step
        assert old.gps == new.gps


def test_a_watched_walk_after_a_look_at_the_map_is_timed_from_its_first_picture(fake_screens: Fakes) -> None:
    link, first, second = MemoryLink("pan", "topdown"), Notes(), Notes()
    memory = {"arms": ["topdown"], "max_s": 60}
    played(fake_screens, link, ShowStorey(0), CloseMap(), FORWARD, observers=first, memory=memory).watches.close()
    again = played(fake_screens, link, LEFT, STOP, STOP, observers=second, memory=memory)
    again.watches.close()
    steps = list(walked_steps(link.stored))
    assert [step.t_s for step in steps] == [1.0, 2.0, 4.0]
    assert [step for name, step, *_ in first.told if name == "step"] == steps[:1]
    assert [step for name, step, *_ in second.told if name == "step"] == steps


def test_a_watched_answer_is_stored_as_an_unwatched_one(fake_screens: Fakes) -> None:
    presses = (RAY, ShowStorey(0), RAY, Confirm())
    alone = played(fake_screens, MemoryLink("pog", code="p01"), *presses)
    notes = Notes()
    watched = played(fake_screens, MemoryLink("pog", code="p01"), *presses, observers=notes)
    watched.watches.close()
    assert watched.link.lines() == alone.link.lines()
    assert watched.link.outcome == alone.link.outcome
    clicks = [event for event in watched.link.stored if isinstance(event, Clicked)]
    assert [name for name, *_ in notes.told] == ["reset", "click", "storey", "click", "end"]
    told = [what for what in notes.told if what[0] == "click"]
    assert told == [("click", RAY, HIT, pytest.approx(event.t_s)) for event in clicks]
    assert notes.told[-1][1] == watched.link.outcome


@pytest.mark.parametrize("fails_at", ["reset", "step", "end"])
def test_a_failing_observer_is_named_once_and_the_trial_goes_on(
    fake_screens: Fakes, capsys: pytest.CaptureFixture, fails_at: str
) -> None:
    notes = Notes(fails_at=fails_at)
    trial = played(fake_screens, MemoryLink("pan"), FORWARD, LEFT, FORWARD, STOP, STOP, observers=notes)
    trial.watches.close()
    assert trial.link.outcome.reason == "stop"
    told = capsys.readouterr().err.splitlines()
    assert told == [
        "personal-viz: watching p02: the observer failed (RecordingError: x.rrd: the disk is full; expected space. "
        "Free some.); the trial goes on unseen."
    ]


def test_a_participant_does_not_wait_for_an_observer_that_hangs(
    fake_screens: Fakes, capsys: pytest.CaptureFixture
) -> None:
    goes_on = threading.Event()
    notes = Notes(waits_for=goes_on)
    trial = played(fake_screens, MemoryLink("pan"), FORWARD, LEFT, STOP, STOP, observers=notes)
    assert trial.link.outcome.reason == "stop"  # would never be if a press waited
    assert notes.told == []
    goes_on.set()
    trial.watches.close()
    assert [name for name, *_ in notes.told] == ["reset", "step", "step", "step", "end"]
    assert capsys.readouterr().err == ""


def test_an_observer_that_is_far_behind_is_dropped_with_a_message(capsys: pytest.CaptureFixture) -> None:
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


def test_late_reports_of_an_older_tab_are_not_told(capsys: pytest.CaptureFixture) -> None:
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
    for view in (LookView, PanView, PogView, RateView):
        for kind in get_type_hints(view).values():
            assert kind not in (Observation, Episode, EpisodeRun, Answer, Watches)
    seen = {"task", "rgb", "step", "is_armed", "is_blocked", "is_over", "is_giving_up", "left_s"}
    of_its_search = {"notes", "query", "search", "num_searches", "is_for_all", "num_marks", "is_just_marked"}
    assert set(get_type_hints(PanView)) == seen | of_its_search
    assert get_type_hints(PanView)["task"] is Task
