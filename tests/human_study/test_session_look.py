"""A look at the map or the home before the task: its limits, its record, and coming back to it."""

import pytest

from human_study.trial.commands import (
    Click,
    CloseMap,
    Confirm,
    GiveUp,
    LookFrom,
    Move,
    PageChanged,
    PressStop,
    Resume,
    ShowNames,
    ShowStorey,
    Start,
    Tick,
)
from human_study.trial.events import Act, MapOff, MapOn, TimedOut
from human_study.trial.outcome import task_began_s
from human_study.trial.terms import Look, TrialTerms, terms_of
from human_study.trial.views import LookView, PanView, PogView
from sim.types import Action, TaskKind

from .small_world import study
from .trials import (
    FORWARD,
    HOME_LOOK,
    LEFT,
    MAP_LOOK,
    RAY,
    answer_of,
    begun,
    driven,
    kinds,
    new_session,
    rebuilt_session,
    resumed,
    run_of,
)

LOOKS: list[tuple[TaskKind, TrialTerms]] = [("pan", MAP_LOOK), ("pog", HOME_LOOK)]


@pytest.mark.parametrize(("kind", "terms"), LOOKS)
def test_a_look_comes_first_and_says_what_is_shown_and_for_how_long(kind: TaskKind, terms: TrialTerms) -> None:
    session = new_session(kind, terms)
    update = session.handle(Start(), 10.0)
    assert kinds(update.events) == ["open", "map_on"]
    assert update.events[0].condition == terms.condition
    on = update.events[1]
    assert isinstance(on, MapOn)
    assert (on.what, on.min_s, on.max_s) == (terms.look.what, 5.0, 60.0)
    assert update.view == LookView(terms.look.what, (0.0, 3.0), 0, 5, 60)


@pytest.mark.parametrize(("kind", "terms"), LOOKS)
def test_the_map_cannot_be_left_before_the_shortest_look(kind: TaskKind, terms: TrialTerms) -> None:
    session = begun(kind, terms)
    early = session.handle(CloseMap(), 4.9)
    assert early.events[0].reason == "too_early"
    assert isinstance(early.view, LookView)
    assert early.view.wait_s == 1
    left = session.handle(CloseMap(), 5.0)
    off = left.events[0]
    assert isinstance(off, MapOff)
    assert (off.reason, off.look_s, off.t_s) == ("left", 5.0, 5.0)
    assert isinstance(left.view, PanView if kind == "pan" else PogView)


@pytest.mark.parametrize(("kind", "terms"), LOOKS)
def test_a_look_ends_by_itself_after_its_longest_time(kind: TaskKind, terms: TrialTerms) -> None:
    session = new_session(kind, terms)
    now_s = 100.0
    events = list(session.handle(Start(), now_s).events)
    ticks = 0
    while session.phase == "look":
        wait_s = session.wait_s(now_s)
        now_s += wait_s
        events += session.handle(Tick(), now_s).events
        ticks += 1
    off = next(event for event in events if isinstance(event, MapOff))
    assert (off.reason, off.look_s, now_s) == ("time", 60.0, 160.0)
    assert ticks == 60  # the seconds that are shown
    assert kinds(events).count("looking") == 11


def test_a_press_that_comes_with_the_end_of_the_look_is_no_step() -> None:
    session = new_session("pan", MAP_LOOK)
    update = driven(session, [(Start(), 0.0), (FORWARD, 3.0), (Tick(), 59.0), (CloseMap(), 60.5), (FORWARD, 61.0)])
    assert kinds(update) == [
        "open", "map_on", "key", "dropped", "looking", "map_off", "shown", "dropped", "key", "act", "shown",
    ]  # fmt: skip
    assert next(event.reason for event in update if isinstance(event, MapOff)) == "time"


def test_walking_pointing_and_giving_up_have_no_effect_during_the_look() -> None:
    session = new_session("pan", MAP_LOOK)
    events = driven(session, [(Start(), 0.0), (LEFT, 1.0), (PressStop(), 2.0), (GiveUp(), 2.5), (GiveUp(), 3.5)])
    assert {event.reason for event in events if event.kind == "dropped"} == {"phase"}
    assert session.phase == "look"
    pointing = new_session("pog", HOME_LOOK)
    events = driven(pointing, [(Start(), 0.0), (Click(RAY, (0.0, 0.0, 0.0)), 1.0)])
    assert kinds(events) == ["open", "map_on", "dropped"]


def test_the_storey_and_the_camera_of_a_look_are_logged() -> None:
    session = new_session("pan", TrialTerms(condition="glb", look=Look("glb")))
    look = LookFrom((0.0, 9.0, 0.0), (1.0, 0.0, 0.0, 0.0))
    events = driven(session, [(Start(), 0.0), (ShowStorey(1), 1.0), (look, 2.0), (look, 2.1), (look, 2.6)])
    assert kinds(events) == ["open", "map_on", "storey", "cam", "cam"]
    view = session.view(3.0)
    assert isinstance(view, LookView)
    assert (view.storey, view.left_s, view.wait_s) == (1, None, 0)
    walking = session.handle(CloseMap(), 3.0)
    assert isinstance(walking.view, PanView)
    dropped = session.handle(look, 4.0).events
    assert [event.reason for event in dropped if event.kind == "dropped"] == ["phase"]


def test_the_steps_of_a_walk_are_timed_from_the_robots_first_picture() -> None:
    session = new_session("pan", MAP_LOOK)
    stop = [(PressStop(), 45.0), (PressStop(), 46.0)]
    events = driven(session, [(Start(), 0.0), (CloseMap(), 42.0), (LEFT, 43.0), (FORWARD, 44.5), *stop])
    run = run_of(events)
    assert [step.t_s for step in run.steps] == [1.0, 2.5, 4.0]
    assert [event.t_s for event in events if isinstance(event, Act)] == [43.0, 44.5, 46.0]
    assert task_began_s(events) == 42.0


def test_a_pog_answer_is_timed_from_the_texts() -> None:
    session = new_session("pog", HOME_LOOK)
    events = driven(
        session, [(Start(), 0.0), (CloseMap(), 20.0), (Click(RAY, (-2.0, 0.5, 0.0)), 27.0), (Confirm(), 30.5)]
    )
    answer = answer_of(events)
    assert (answer.t_s, answer.reason) == (10.5, "click")


@pytest.mark.parametrize(("kind", "terms"), LOOKS)
def test_a_person_who_comes_back_finds_the_rest_of_the_look(kind: TaskKind, terms: TrialTerms) -> None:
    session = new_session(kind, terms)
    events = driven(session, [(Start(), 0.0), (ShowStorey(1), 1.0), (Tick(), 23.0), (Tick(), 25.5)])
    again, back = resumed(kind, terms, events, away_s=200.0, now_s=1000.0)
    assert kinds(back) == ["map_on"]
    view = again.view(1000.0)
    assert isinstance(view, LookView)
    assert (view.storey, view.wait_s, view.left_s) == (1, 0, 37)  # the last stored event was at 23 s
    off = again.handle(CloseMap(), 1010.0).events[0]
    assert isinstance(off, MapOff)
    assert off.look_s == 33.0


def test_reloading_again_and_again_does_not_make_a_look_longer_than_one_pause_between_two_records() -> None:
    events = list(new_session("pan", MAP_LOOK).handle(Start(), 0.0).events)
    watched_s = 0.0
    for _ in range(100):
        session, back = resumed("pan", MAP_LOOK, events, away_s=1.0)
        events += back
        now_s = 0.0
        while session.phase == "look" and now_s < 9.0:
            wait_s = session.wait_s(now_s)
            now_s += wait_s
            events += session.handle(Tick(), now_s).events
        watched_s += now_s
        if session.phase != "look":
            break
    assert session.phase == "task"
    assert watched_s <= 60.0 * 9 / 5 + 9


@pytest.mark.parametrize(("kind", "terms"), LOOKS)
def test_a_person_who_comes_back_to_the_task_does_not_see_the_map_again(kind: TaskKind, terms: TrialTerms) -> None:
    events = driven(new_session(kind, terms), [(Start(), 0.0), (CloseMap(), 10.0)])
    session, back = resumed(kind, terms, events)
    assert session.phase == "task"
    assert kinds(back) == (["shown"] if kind == "pan" else ["storey"])
    assert session.handle(Tick(), 400.0).events == ()


@pytest.mark.parametrize(("kind", "terms"), LOOKS)
def test_coming_back_too_late_to_a_look_abandons_the_trial(kind: TaskKind, terms: TrialTerms) -> None:
    events = driven(new_session(kind, terms), [(Start(), 0.0)])
    session, back = resumed(kind, terms, events, away_s=600.5)
    assert kinds(back) == ["abandoned"]
    assert (session.end_reason, session.phase) == ("abandoned", "done")


def test_a_look_that_was_over_when_the_person_left_is_not_shown_again() -> None:
    events = driven(new_session("pan", MAP_LOOK), [(Start(), 0.0), (Tick(), 59.5)])
    session, back = resumed("pan", MAP_LOOK, [*events, events[-1].model_copy(update={"t_s": 60.0})])
    assert kinds(back) == ["map_off", "shown"]
    assert session.phase == "task"


@pytest.mark.parametrize(
    ("kind", "terms", "is_fatal"),
    [
        ("pog", HOME_LOOK, True),
        ("pan", TrialTerms(condition="glb", look=Look("glb")), True),
        ("pan", MAP_LOOK, False),
        ("pog", TrialTerms(condition="map_2d"), True),
        ("pan", TrialTerms(condition="none"), False),
    ],
)
def test_a_lost_webgl_context_ends_only_what_it_draws(kind: TaskKind, terms: TrialTerms, is_fatal: bool) -> None:
    session = begun(kind, terms)
    update = session.handle(PageChanged("context_lost", t_cli_ms=7.0), 1.0)
    assert kinds(update.events) == (["context_lost", "error"] if is_fatal else ["context_lost"])
    assert session.end_reason == ("technical" if is_fatal else None)


def test_walking_after_a_look_at_the_3d_home_needs_no_webgl() -> None:
    session = new_session("pan", TrialTerms(condition="glb", look=Look("glb")))
    driven(session, [(Start(), 0.0), (CloseMap(), 1.0), (PageChanged("context_lost"), 2.0)])
    assert not session.is_over


@pytest.mark.parametrize("kind", ["pan", "pog"])
def test_the_time_limit_counts_from_the_task_and_ends_the_trial_by_itself(kind: TaskKind) -> None:
    look = Look("topdown" if kind == "pan" else "home", min_s=0.0, max_s=30.0)
    terms = TrialTerms(condition="topdown" if kind == "pan" else "map_first", look=look, task_max_s=100.0)
    session = new_session(kind, terms)
    events = driven(session, [(Start(), 0.0), (CloseMap(), 30.0)])
    now_s, shown = 30.0, []
    while not session.is_over:
        view = session.view(now_s)
        assert isinstance(view, PanView | PogView)
        shown.append(view.left_s)
        wait_s = session.wait_s(now_s)
        now_s += wait_s
        events += session.handle(Tick(), now_s).events
    assert isinstance(events[-1], TimedOut)
    assert (session.end_reason, now_s, events[-1].limit_s) == ("timeout", 130.0, 100.0)
    assert shown == [120, 60, 50, 40, 30, 20, 10]


def test_a_step_that_comes_after_the_time_limit_is_not_taken() -> None:
    session = new_session("pan", TrialTerms(condition="none", task_max_s=10.0))
    events = driven(session, [(Start(), 0.0), (LEFT, 9.9), (FORWARD, 10.0), (FORWARD, 11.0)])
    assert kinds(events) == ["open", "shown", "key", "act", "shown", "timeout"]
    run = run_of(events)
    assert (len(run.steps), run.end.reason) == (1, "timeout")
    assert not run.end.measures.rules["paper"].success


def test_a_mark_that_was_not_confirmed_in_time_is_no_answer() -> None:
    session = new_session("pog", TrialTerms(condition="map_open", task_max_s=10.0))
    events = driven(session, [(Start(), 0.0), (Click(RAY, (-2.0, 0.5, 0.0)), 5.0), (Tick(), 10.5)])
    answer = answer_of(events)
    assert (answer.reason, answer.candidates, answer.t_s) == ("timeout", (), 10.5)


def test_time_away_does_not_use_up_the_time_limit() -> None:
    terms = TrialTerms(condition="none", task_max_s=100.0)
    events = driven(new_session("pan", terms), [(Start(), 0.0), (LEFT, 90.0)])
    session, _ = resumed("pan", terms, events, away_s=300.0, now_s=5000.0)
    assert session.handle(LEFT, 5009.0).view.step == 2
    assert session.handle(Tick(), 5010.0).events[0].kind == "timeout"


@pytest.mark.parametrize(
    ("second_s", "kind"), [(1.2, "dropped"), (1.5, "giveup"), (6.0, "giveup"), (6.1, "giveup_armed")]
)
def test_giving_up_asks_once_again(second_s: float, kind: str) -> None:
    session = begun("pan", TrialTerms(condition="none"))
    first = session.handle(GiveUp(), 1.0)
    assert kinds(first.events) == ["giveup_armed"]
    assert first.view.is_giving_up
    assert session.handle(GiveUp(), second_s).events[0].kind == kind
    assert session.is_over == (kind == "giveup")


def test_an_unanswered_question_about_giving_up_goes_away_by_itself() -> None:
    session = begun("pog", TrialTerms(condition="map_open"))
    session.handle(GiveUp(), 1.0)
    wait_s = session.wait_s(1.0)
    assert wait_s == pytest.approx(5.0, abs=0.1)
    view = session.handle(Tick(), 1.0 + wait_s).view
    assert isinstance(view, PogView)
    assert not view.is_giving_up
    assert session.wait_s(1.0 + wait_s) is None


def test_an_absence_takes_back_the_first_press_of_stop_and_of_giving_up() -> None:
    session = new_session("pan", TrialTerms(condition="none"))
    driven(session, [(Start(), 0.0), (PressStop(), 1.0), (GiveUp(), 1.0)])
    session.handle(Resume(away_s=100.0), 101.0)
    events = driven(session, [(PressStop(), 101.1), (GiveUp(), 102.0)])
    assert kinds(events) == ["key", "stop_armed", "giveup_armed"]


def test_each_condition_of_a_study_has_its_own_terms() -> None:
    config = study(
        memory={"arms": ["none", "topdown", "glb"], "min_s": 10, "max_s": 45},
        pog={
            "conditions": ["map_first", "map_open", "map_2d"],
            "look_min_s": 20,
            "look_max_s": 90,
            "answer_max_s": 300,
        },
        pan_max_s=1200,
        confidence=True,
        resume_within_s=60,
    )
    looks = {condition: terms_of(config, condition).look for condition in ("none", "topdown", "glb")}
    assert looks == {"none": None, "topdown": Look("topdown", 10, 45), "glb": Look("glb", 10, 45)}
    assert terms_of(config, "map_first").look == Look("home", 20, 90)
    assert terms_of(config, "map_open").look is terms_of(config, "map_2d").look is None
    assert [terms_of(config, name).task_max_s for name in ("glb", "map_2d")] == [1200, 300]
    assert terms_of(config, "none").resume_within_s == 60
    assert terms_of(config, "none").asks_confidence


def test_a_session_that_is_rebuilt_in_mid_look_has_taken_no_step() -> None:
    events = driven(new_session("pan", MAP_LOOK), [(Start(), 0.0), (Move(Action.LEFT, "KeyA"), 1.0)])
    session = rebuilt_session("pan", MAP_LOOK, events)
    session.handle(Resume(), 0.0)
    update = session.handle(CloseMap(), 30.0)
    assert isinstance(update.view, PanView)
    assert update.view.step == 0


@pytest.mark.parametrize("kind", ["pan", "pog"])
def test_names_that_were_asked_for_are_stored_and_still_there_after_a_reload(kind: TaskKind) -> None:
    terms = TrialTerms(look=Look("glb" if kind == "pan" else "home"))
    session = new_session(kind, terms)
    events = driven(session, [(Start(), 0.0), (ShowNames(True), 1.0), (ShowNames(False), 2.0), (ShowNames(True), 3.0)])
    assert [event.kind for event in events][-3:] == ["names_on", "names_off", "names_on"]
    assert session.view(3.0).has_names
    for stored, has_names in ((events, True), (events[:-1], False)):
        again, _ = resumed(kind, terms, stored)
        assert again.view(0.0).has_names == has_names


def test_nobody_asks_for_names_while_walking() -> None:
    events = driven(new_session("pan"), [(Start(), 0.0), (ShowNames(True), 1.0)])
    assert [event.kind for event in events][-1] == "dropped"
