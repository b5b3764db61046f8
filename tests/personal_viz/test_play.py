"""One trial from its opening to its stored outcome: which screen comes when, and that storing comes before showing."""

import dataclasses
from pathlib import Path

import pytest

from human_study.design.plan import Phase
from human_study.export.verify import verify_trial
from human_study.store.store import SupersededError
from human_study.store.writer import StoreFullError
from human_study.trial.commands import CloseMap, Confirm, GiveUp, Move, PageChanged, PressStop, ShowStorey
from human_study.trial.events import Clicked, Confidence, Event, Shown, Unmarked
from human_study.trial.views import LookView, Mark, MarkedObject, PanView, PogView
from personal_viz.study_app.screens.page import GoneError, WithdrawnError
from personal_viz.study_app.screens.pog import Nudge
from sim.sequences.searches import sequence_key
from sim.tasks.run_files import Answer, EpisodeEnd, Vector3
from sim.types import Action, Camera, Pose
from tests.sim.home_story import MESSAGES, SUBTASKS, told_in

from ..human_study.finished import room
from ..human_study.small_world import episode
from .fake_play import HIT, LAMP, PASS, RAY, FakeScene, MemoryLink, Played, RenderedHere, TwoStoreyScene, played
from .fake_play import fake_screens as fake_screens

FORWARD, LEFT = Move(Action.FORWARD, code="KeyW"), Move(Action.LEFT, code="KeyA")
STOP = (PressStop(), PressStop())
MAP = {"memory": {"arms": ["topdown"], "min_s": 2, "max_s": 10}}
HOME_FIRST = {"pog": {"conditions": ["map_first"], "look_max_s": 30, "answer_max_s": 60}}
Fakes = tuple[list, list[str]]


def kinds(trial: Played) -> list[str]:
    return [event.kind for event in trial.link.stored]


def test_a_walk_without_a_map_is_one_screen(fake_screens: Fakes) -> None:
    trial = played(fake_screens, MemoryLink("pan"), FORWARD, *STOP)
    assert trial.screens == ["PanScreen"]
    assert [view.step for view in trial.shown if isinstance(view, PanView)][-1] == 2
    assert isinstance(trial.link.outcome, EpisodeEnd)
    assert trial.link.outcome.reason == "stop"
    assert trial.raised is None


@pytest.mark.parametrize("phase", ["practice", "main"])
def test_a_blocked_step_is_shown_as_such_in_practice_too(fake_screens: Fakes, phase: Phase) -> None:
    link = MemoryLink("pan")
    link.trial = dataclasses.replace(link.trial, phase=phase)
    trial = played(fake_screens, link, *[FORWARD] * 4, LEFT, *STOP)
    signs = [(view.step, view.is_blocked) for view in trial.shown if isinstance(view, PanView) and view.rgb is not None]
    assert {step for step, is_blocked in signs if is_blocked} == {4}
    assert [event.step for event in link.stored if isinstance(event, Shown) and event.blocked] == [4]


def test_every_step_is_stored_before_its_picture_is_shown(fake_screens: Fakes) -> None:
    link = MemoryLink("pan")
    trial = played(fake_screens, link, FORWARD, LEFT, GiveUp(), GiveUp())
    assert link.calls == [
        "store open shown",
        "store key act",
        "store shown key act",
        "store shown giveup_armed",
        "store giveup",
        "finish",
    ]
    pictures = [view.step for view in trial.shown if isinstance(view, PanView) and view.rgb is not None]
    assert sorted(set(pictures)) == [0, 1, 2]
    hashes = [event.frame_hash for event in link.stored if isinstance(event, Shown)]
    assert len(set(hashes)) == 3


def test_the_pictures_of_the_next_keys_are_wished_for_and_forgotten_at_the_end(fake_screens: Fakes) -> None:
    wished: list[int] = []

    class Noting(RenderedHere):
        def begin(self, pose: Pose, camera: Camera) -> None:
            wished.append(self.ahead["p02"])
            super().begin(pose, camera)

    frames = Noting()
    played(fake_screens, MemoryLink("pan"), FORWARD, home_options={"renderer": frames})
    assert (wished, frames.ahead) == ([3], {"p02": 0})
    assert [pose.position for pose in frames.begun] == [(0.0, 0.0, -0.25)]


def test_a_look_comes_before_the_walk(fake_screens: Fakes) -> None:
    trial = played(fake_screens, MemoryLink("pan", "topdown"), PASS, PASS, CloseMap(), FORWARD, *STOP, **MAP)
    assert trial.screens == ["LookScreen", "PanScreen"]
    assert isinstance(trial.shown[0], LookView)
    assert kinds(trial)[:4] == ["open", "map_on", "map_off", "shown"]
    assert trial.page.waits[0] == pytest.approx(1.0)


def test_a_look_that_nobody_leaves_ends_by_itself(fake_screens: Fakes) -> None:
    trial = played(fake_screens, MemoryLink("pan", "topdown"), *[PASS] * 10, *STOP, **MAP)
    assert trial.link.outcome.reason == "stop"
    left = [view.left_s for view in trial.shown if isinstance(view, LookView)]
    assert left == [10, 9, 8, 7, 6, 5, 4, 3, 2, 1]


def test_the_texts_come_after_the_home(fake_screens: Fakes) -> None:
    trial = played(fake_screens, MemoryLink("pog", "map_first"), CloseMap(), RAY, Confirm(), **HOME_FIRST)
    assert trial.screens == ["LookScreen", "SceneView", "PogScreen"]
    assert isinstance(trial.link.outcome, Answer)
    assert trial.link.outcome.candidates == (HIT,)


@pytest.mark.parametrize(("pointing", "answer"), [("free", HIT), ("snap", LAMP.centre)])
def test_the_object_that_a_click_met_is_stored_and_is_the_answer_only_where_marks_snap(
    fake_screens: Fakes, pointing: str, answer: Vector3
) -> None:
    choices = {"pog": {"conditions": ["map_open"], "pointing": pointing}}
    trial = played(fake_screens, MemoryLink("pog"), RAY, Confirm(), **choices)
    assert trial.link.outcome.candidates == (answer,)
    assert trial.link.outcome.measures.on_object
    (clicked,) = [event for event in trial.link.events() if isinstance(event, Clicked)]
    assert (clicked.ray, clicked.hit, clicked.object_name) == (RAY, HIT, LAMP.name)
    item = MarkedObject("lamp", LAMP.centre, LAMP.size) if pointing == "snap" else None
    assert [view.mark for view in trial.shown][1] == Mark(answer, HIT, 0, item)
    link = MemoryLink("pog")
    played(fake_screens, link, RAY, **choices)
    again = played(fake_screens, link, Confirm(), away_s=5.0, **choices)
    assert again.shown[0].mark == Mark(answer, HIT, 0, item)


def test_where_objects_do_not_hold_the_target_clicks_tell_of_none_and_marks_stay(fake_screens: Fakes) -> None:
    other = dataclasses.replace(LAMP, name="another lamp_8")
    scene = FakeScene(objects=(other,))
    snap = {"pog": {"conditions": ["map_open"], "pointing": "snap"}}
    link = played(fake_screens, MemoryLink("pog"), RAY, Confirm(), home_options={"scene": scene}, **snap).link
    assert (link.outcome.measures.on_object, link.outcome.candidates) == (None, (HIT,))
    (clicked,) = [event for event in link.events() if isinstance(event, Clicked)]
    assert (clicked.object_name, clicked.snapped) == (None, None)


def test_an_arrow_on_another_storey_sets_one_more_mark_in_a_search_for_all_and_moves_that_one_afterwards(
    fake_screens: Fakes, small_home_root: Path, tmp_path: Path
) -> None:
    story = told_in(small_home_root, tmp_path, messages=MESSAGES[:1], subtasks=[SUBTASKS[1]])
    key = sequence_key(story)
    options = {"scene": TwoStoreyScene(), "episodes": {}, "sequences": {key: story}}
    trial = played(
        fake_screens, MemoryLink("pog", "history_visible", key=key), RAY, ShowStorey(1), Nudge(0.1, 0.0),
        Nudge(0.1, 0.0), home_options=options, sequences={"sha256": "0" * 64}, pog={"conditions": ["map_open"]},
    )  # fmt: skip
    marks = [[mark.storey for mark in view.marks] for view in trial.shown if isinstance(view, PogView)]
    assert marks == [[], [0], [0], [0, 1], [0, 1]]
    assert [event.index for event in trial.link.stored if isinstance(event, Unmarked)] == [1]


def test_the_time_runs_out_without_the_browser_and_a_later_click_does_not_count(fake_screens: Fakes) -> None:
    walked = played(fake_screens, MemoryLink("pan"), FORWARD, *[PASS] * 9, pan_max_s=6)
    pointed = played(fake_screens, MemoryLink("pog", "map_first"), CloseMap(), RAY, *[PASS] * 9, **HOME_FIRST)
    assert [(trial.link.outcome.reason, trial.raised) for trial in (walked, pointed)] == [("timeout", None)] * 2
    assert pointed.link.outcome.candidates == ()
    choices = {"pog": {"conditions": ["map_open"], "answer_max_s": 0.5}}
    trial = played(fake_screens, MemoryLink("pog"), RAY, **choices)
    assert trial.link.outcome.reason == "timeout"
    assert not any(isinstance(event, Clicked) for event in trial.link.stored)


def test_the_question_after_an_answer_is_a_screen_of_its_own_and_the_answer_counts_without_it(
    fake_screens: Fakes,
) -> None:
    trial = played(fake_screens, MemoryLink("pog"), RAY, Confirm(), "2", confidence=True)
    assert trial.screens == ["SceneView", "PogScreen", "How sure are you?"]
    assert [event.value for event in trial.link.stored if isinstance(event, Confidence)] == [2]
    assert trial.link.calls[-1] == "finish"
    trial = played(fake_screens, MemoryLink("pog"), RAY, Confirm(), confidence=True)
    assert isinstance(trial.raised, GoneError)
    assert trial.link.outcome.candidates == (HIT,)


def test_a_page_that_is_closed_before_the_answer_leaves_the_trial_open(fake_screens: Fakes) -> None:
    link = MemoryLink("pog", "map_first")
    first = played(fake_screens, link, CloseMap(), ShowStorey(0), RAY, **HOME_FIRST)
    assert isinstance(first.raised, GoneError)
    assert link.outcome is None
    again = played(fake_screens, link, Confirm(), away_s=5.0, **HOME_FIRST)
    assert again.screens == ["SceneView", "PogScreen"]
    view = again.shown[0]
    assert isinstance(view, PogView)
    assert view.mark.point == HIT
    assert link.outcome.candidates == (HIT,)


def test_a_person_who_comes_back_too_late_finds_the_trial_over(fake_screens: Fakes) -> None:
    link = MemoryLink("pan")
    played(fake_screens, link, FORWARD)
    again = played(fake_screens, link, away_s=700.0)
    assert again.screens == []
    assert link.outcome.reason == "abandoned"


def test_taking_over_from_an_open_tab_is_logged_and_the_old_tab_cannot_write(fake_screens: Fakes) -> None:
    link = MemoryLink("pan")
    played(fake_screens, link, FORWARD)
    again = played(fake_screens, link, SupersededError("a newer tab"), took_over=True)
    assert isinstance(again.raised, SupersededError)
    assert kinds(again)[-2:] == ["superseded", "shown"]
    assert link.outcome is None


def test_leaving_for_good_stores_nothing_more(fake_screens: Fakes) -> None:
    trial = played(fake_screens, MemoryLink("pan"), FORWARD, WithdrawnError())
    assert isinstance(trial.raised, WithdrawnError)
    assert trial.link.outcome is None
    assert kinds(trial)[-1] == "shown"


def test_a_broken_renderer_ends_the_trial_as_technical(fake_screens: Fakes, capsys: pytest.CaptureFixture[str]) -> None:
    class Broken(RenderedHere):
        def render(self, *arguments: object) -> None:
            if self.ahead:
                raise RuntimeError("the renderer died")
            return super().render(*arguments)

    trial = played(fake_screens, MemoryLink("pan"), FORWARD, home_options={"renderer": Broken()})
    assert trial.link.outcome.reason == "technical"
    assert kinds(trial)[-1] == "error"
    assert "the renderer died" in capsys.readouterr().err


def test_a_failure_before_the_trial_begins_is_technical_with_one_event(
    fake_screens: Fakes, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(*_: object) -> None:
        raise RuntimeError("the home cannot be walked in")

    monkeypatch.setattr("personal_viz.study_app.screens.play.pan_env", broken)
    trial = played(fake_screens, MemoryLink("pan"), FORWARD)
    assert kinds(trial) == ["error"]
    assert trial.link.outcome == EpisodeEnd(reason="technical")
    found = verify_trial(trial.link.stored, trial.link.outcome, episode().key, home=room(), participant="p02")
    assert found.status == "verified"
    assert "the home cannot be walked in" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["pan_outcome", "pog_outcome"])
def test_a_trial_that_cannot_be_scored_says_so_in_its_record(
    fake_screens: Fakes, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    def broken(*_: object, **__: object) -> None:
        raise RuntimeError("no way to the target")

    monkeypatch.setattr(f"personal_viz.study_app.screens.play.{name}", broken)
    link = MemoryLink("pan" if name == "pan_outcome" else "pog")
    trial = played(fake_screens, link, *([FORWARD, *STOP] if name == "pan_outcome" else [RAY, Confirm()]))
    assert link.outcome.reason == "technical"
    assert link.calls[-2:] == ["store error", "finish"]
    found = verify_trial(link.stored, link.outcome, episode().key, home=room(), participant="p02")
    assert (found.status, found.detail) == ("verified", "")
    assert trial.raised is None
    assert "no way to the target" in capsys.readouterr().err


@pytest.mark.parametrize("before", [[], [RAY]], ids=["at once", "after a click"])
def test_a_lost_webgl_context_is_a_technical_failure_that_is_verified(fake_screens: Fakes, before: list) -> None:
    link = MemoryLink("pog")
    trial = played(fake_screens, link, *before, PageChanged("context_lost"))
    assert kinds(trial) == ["open", *["click" for _ in before], "context_lost", "error"]
    found = verify_trial(link.stored, link.outcome, episode().key, home=room(), participant="p02")
    assert (link.outcome.reason, found.status, found.detail) == ("technical", "verified", "")


def test_a_full_disk_shows_nothing_that_is_not_stored(fake_screens: Fakes) -> None:
    class Full(MemoryLink):
        def append_many(self, trial_id: str, epoch: int, events: list[Event]) -> None:
            if any(event.kind == "act" for event in events):
                raise StoreFullError("study.db: the disk is full; expected space. Free some.")
            super().append_many(trial_id, epoch, events)

    trial = played(fake_screens, Full("pan"), FORWARD)
    assert isinstance(trial.raised, StoreFullError)
    assert [view.step for view in trial.shown if isinstance(view, PanView)] == [0]
    assert kinds(trial) == ["open", "shown"]
