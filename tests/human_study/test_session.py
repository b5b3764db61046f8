"""PAN and POG sessions as state machines."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from human_study.trial.commands import (
    Click,
    Confirm,
    Fail,
    GiveUp,
    LookFrom,
    Move,
    PanCommand,
    PressStop,
    Resume,
    ShowStorey,
    Start,
    Tick,
)
from human_study.trial.events import Cam, Event, Shown, event_to_json
from human_study.trial.outcome import end_reason
from human_study.trial.session import PanSession
from sim.errors import StudyError, TaskStateError
from sim.types import Action

from .small_world import SCENE_DIGEST, env, episode, study
from .trials import (
    FORWARD,
    LEFT,
    NO_TERMS,
    RAY,
    RIGHT,
    answer_of,
    begun,
    drive,
    driven,
    kinds,
    new_session,
    rebuilt_session,
    run_of,
)


def signs(events: list[Event] | tuple[Event, ...]) -> list[bool]:
    """Whether each picture came with the sign of a blocked step."""
    return [event.blocked for event in events if isinstance(event, Shown)]


def camera(height: float) -> LookFrom:
    return LookFrom((0.0, height, 0.0), (1.0, 0.0, 0.0, 0.0))


def cams(events: tuple[Event, ...]) -> list[tuple[float | None, tuple[float, float, float]]]:
    return [(event.t_s, event.position) for event in events if isinstance(event, Cam)]


def test_a_press_of_a_key_moves_the_robot_one_step_and_says_so() -> None:
    session = new_session("pan")
    first = session.handle(Start(), 10.0)
    update = session.handle(Move(Action.FORWARD, "KeyW", t_cli_ms=5.5), 11.0)
    assert kinds(first.events) == ["open", "shown"]
    assert kinds(update.events) == ["key", "act", "shown"]
    key, act, shown = update.events
    assert (key.code, key.t_cli_ms, key.t_s) == ("KeyW", 5.5, 1.0)
    assert act.position == (0.0, 0.0, -0.25)
    assert shown.frame_hash != first.events[1].frame_hash
    assert update.view.step == 1
    assert update.view.rgb is not None


def test_a_wall_stops_the_robot_and_the_blocked_step_comes_with_a_sign() -> None:
    session = new_session("pan")
    events = drive(session, [FORWARD] * 5)
    steps = [event.step for event in events if event.kind == "act"]
    assert [step.collided for step in steps] == [False, False, False, True, True]
    assert steps[-1].position == pytest.approx((0.0, 0.0, -0.899))
    assert signs(events) == [False, False, False, False, True, True]
    assert event_to_json(events[-1]).endswith('"blocked":true}')
    assert session.view(102.6).is_blocked
    turned = session.handle(LEFT, 103.0)
    assert not turned.view.is_blocked
    assert signs(turned.events) == [False]


def test_the_sign_of_a_blocked_step_waits_for_its_picture_and_ends_with_an_absence() -> None:
    session = new_session("pan", looks_later=True)
    events = list(session.handle(Start(), 0.0).events)
    for number in range(1, 5):
        stepped = session.handle(FORWARD, float(number))
        looked = session.look(number + 0.1)
        events += [*stepped.events, *looked.events]
    assert (stepped.view.is_blocked, looked.view.is_blocked) == (False, True)
    back = new_session("pan", looks_later=True).after(events).handle(Resume(1.0), 10.0)
    assert not back.view.is_blocked
    assert signs(back.events) == [False]


@pytest.mark.parametrize(
    ("command", "is_busy", "reason"),
    [
        pytest.param(Move(Action.FORWARD, "KeyW", repeat=True), False, "repeat", id="a held key"),
        pytest.param(FORWARD, True, "busy", id="a press while busy"),
        pytest.param(Move(Action.LOOK_UP, "KeyR"), False, "action", id="looking up with four actions"),
    ],
)
def test_a_press_that_does_not_count_is_dropped_and_logged(command: Move, is_busy: bool, reason: str) -> None:
    update = begun("pan").handle(command, 1.0, busy=is_busy)
    assert update.events[1].reason == reason
    assert update.view.step == 0


def test_presses_faster_than_50_ms_are_dropped_and_logged() -> None:
    session = begun("pan")
    session.handle(LEFT, 1.0)
    assert session.handle(LEFT, 1.049).events[1].reason == "rate"
    assert session.handle(LEFT, 1.051).view.step == 2


@pytest.mark.parametrize(("gap_s", "is_over"), [(0.06, True), (2.0, True), (2.01, False)])
def test_stop_needs_two_presses_within_two_seconds(gap_s: float, is_over: bool) -> None:
    session = begun("pan")
    first = session.handle(PressStop(), 1.0)
    assert kinds(first.events) == ["key", "stop_armed"]
    assert first.view.is_armed
    assert session.view(1.0 + gap_s).is_armed == is_over  # it falls back by itself
    second = session.handle(PressStop(), 1.0 + gap_s)
    assert second.view.is_over is is_over
    assert second.view.is_armed is not is_over
    assert kinds(second.events) == (["key", "act", "stop"] if is_over else ["key", "stop_armed"])


def test_a_move_between_the_two_presses_disarms_stop() -> None:
    session = new_session("pan")
    drive(session, [PressStop(), LEFT, PressStop()])
    assert not session.is_over


def test_stop_as_the_500th_action_counts_and_the_500th_move_ends_the_trial_without_it() -> None:
    stopped = run_of(drive(new_session("pan"), [LEFT] * 499 + [PressStop(), PressStop()]))
    assert (len(stopped.steps), stopped.end.reason) == (500, "stop")
    session = new_session("pan")
    events = drive(session, [LEFT] * 505)
    run = run_of(events)
    assert (len(run.steps), run.end.reason, session.end_reason) == (500, "steps", "steps")
    assert kinds(events).count("key") == 500


def test_giving_up_is_a_failure_with_the_distance_from_there() -> None:
    end = run_of(drive(new_session("pan"), [LEFT, LEFT, LEFT, FORWARD, GiveUp(), GiveUp()])).end
    assert end.reason == "giveup"
    paper = end.measures.rules["paper"]
    assert (paper.success, paper.dtg) == (False, pytest.approx(0.75))


def test_a_known_walk_has_the_measures_computed_by_hand() -> None:
    run = run_of(drive(new_session("pan"), [LEFT] * 3 + [FORWARD] * 5 + [PressStop(), PressStop()]))
    measures = run.end.measures
    paper, habitat = measures.rules["paper"], measures.rules["habitat"]
    assert run.start.participant == "p02"
    assert run.steps[-2].position == pytest.approx((-1.25, 0.0, 0.0), abs=1e-9)
    assert (paper.success, habitat.success) == (True, True)
    assert paper.start_distance == pytest.approx(1.0)
    assert (paper.spl, habitat.spl) == (pytest.approx(0.8), pytest.approx(1.0))
    assert measures.centre_distance == pytest.approx(0.75)
    assert [run.steps[0].t_s, run.steps[-1].t_s] == [0.5, 5.0]


def test_a_rebuilt_session_stands_at_the_same_step_and_pose() -> None:
    names = {"key": episode().key, "task": study().task_for(episode(), "pan"), "scene_digest": SCENE_DIGEST}
    world, again = env(with_pictures=True), env(with_pictures=True)
    events = drive(PanSession(world, **names), [LEFT, FORWARD, FORWARD, RIGHT, FORWARD, FORWARD, FORWARD])
    rebuilt = PanSession(again, **names).after(events)
    update = rebuilt.handle(Resume(away_s=30.0), 7.0)
    assert again.pose == world.pose
    assert again.steps == world.steps
    assert update.view.step == 7
    assert update.events[0].frame_hash == events[-1].frame_hash
    assert rebuilt.handle(FORWARD, 8.0).events[1].t_s == pytest.approx(3.5 + 1.0)
    with pytest.raises(TaskStateError, match="expected the same episode and scene ddd"):
        PanSession(env(), **(names | {"scene_digest": "e" * 64})).after(events)


def test_coming_back_too_late_ends_the_trial_as_abandoned() -> None:
    events = drive(new_session("pan"), [FORWARD])
    update = rebuilt_session("pan", NO_TERMS, events).handle(Resume(away_s=600.5), 0.0)
    assert kinds(update.events) == ["abandoned"]
    assert update.view.is_over
    assert end_reason([*events, *update.events]) == "abandoned"


def test_a_failure_on_our_side_is_another_outcome_than_a_failure_of_the_person() -> None:
    assert end_reason(drive(new_session("pan"), [FORWARD, Fail("renderer died")])) == "technical"


def test_a_trial_starts_once_and_before_anything_else() -> None:
    session = new_session("pan")
    with pytest.raises(TaskStateError, match="before Start or Resume"):
        session.handle(FORWARD, 0.0)
    with pytest.raises(TaskStateError, match="found Resume; expected Start"):
        session.handle(Resume(), 0.0)
    events = drive(session, [FORWARD])
    for started in (session, rebuilt_session("pan", NO_TERMS, events)):
        with pytest.raises(TaskStateError, match="found Start; expected Resume"):
            started.handle(Start(), 200.0)
    with pytest.raises(StudyError, match="is not over"):
        run_of(events)


def test_time_away_is_not_counted_and_never_runs_back() -> None:
    session = new_session("pan")
    events = drive(session, [FORWARD], every_s=2.0)
    events += driven(session, [(Resume(away_s=90.0), 192.0), (LEFT, 193.0)])
    assert [event.t_s for event in events if event.kind == "act"] == [2.0, 3.0]


COMMANDS = st.sampled_from(
    [LEFT, FORWARD, Move(Action.LOOK_UP, "KeyR"), Move(Action.LEFT, "KeyA", repeat=True), PressStop(), GiveUp()]
)


@given(st.lists(st.tuples(COMMANDS, st.floats(0, 3), st.booleans()), max_size=40), st.integers(1, 8))
def test_no_sequence_of_commands_makes_a_step_too_many_or_one_after_the_end(
    presses: list[tuple[PanCommand, float, bool]], max_steps: int
) -> None:
    session = new_session("pan", max_steps=max_steps)
    events = list(session.handle(Start(), 0.0).events)
    now_s = 0.0
    for command, wait_s, busy in presses:
        now_s += wait_s
        was_over, steps_before = session.is_over, session.view(now_s).step
        update = session.handle(command, now_s, busy=busy)
        events += update.events
        assert update.view.step - steps_before in ((0,) if was_over or busy else (0, 1))
        assert not (was_over and update.events)
    assert sum(event.kind == "act" for event in events) == session.view(now_s).step <= max_steps
    assert end_reason(events) == session.end_reason
    assert rebuilt_session("pan", NO_TERMS, events, max_steps=max_steps).end_reason == session.end_reason


def test_the_last_point_before_confirm_is_the_answer() -> None:
    session = new_session("pog")
    clicks = [Click(RAY, hit) for hit in ((2.0, 0.1, 2.0), (-1.5, 0.1, 0.0), None)]
    events = driven(session, [(command, float(at)) for at, command in enumerate([Start(), ShowStorey(1), *clicks])])
    view = session.view(4.0)
    assert (view.mark.point, view.storey) == ((-1.5, 0.1, 0.0), 1)
    events += session.handle(Confirm(), 5.0).events
    answer = answer_of(events)
    assert kinds(events) == ["open", "storey", "click", "click", "click", "confirm"]
    assert answer.candidates == ((-1.5, 0.1, 0.0),)
    assert (answer.t_s, answer.reason, answer.participant) == (5.0, "click", "p01")
    assert answer.measures.success
    assert answer.measures.planar_distance == pytest.approx(0.5)
    assert answer.measures.distance_3d == pytest.approx(math.hypot(0.5, 0.4))


def test_an_answer_without_a_mark_and_a_storey_that_the_home_does_not_have_are_dropped() -> None:
    session = begun("pog")
    session.handle(Click(RAY, None), 1.0)
    update = session.handle(Confirm(), 2.0)
    assert update.events[0].reason == "nothing_marked"
    assert not update.view.is_over
    update = begun("pog").handle(ShowStorey(2), 1.0)
    assert update.events[0].reason == "storey"
    assert update.view.storey == 0


def test_giving_up_in_pog_gives_no_answer_even_with_a_mark() -> None:
    commands = [(Start(), 0.0), (Click(RAY, (-2.0, 0.5, 0.0)), 1.0), (GiveUp(), 2.0), (GiveUp(), 4.0)]
    answer = answer_of(driven(new_session("pog"), commands))
    assert (answer.candidates, answer.ray, answer.reason) == ((), None, "giveup")
    assert not answer.measures.success


def test_camera_poses_are_kept_at_most_twice_a_second_and_none_after_an_answer() -> None:
    session = begun("pog")
    kept = [len(session.handle(camera(5.0), now_s).events) for now_s in (1.0, 1.2, 1.49, 1.5, 1.9, 2.0)]
    assert kept == [1, 0, 0, 1, 0, 1]
    session = begun("pog")
    driven(session, [(Click(RAY, (-2.0, 0.5, 0.0)), 1.0), (camera(5.0), 1.5), (camera(6.0), 1.5), (Confirm(), 1.6)])
    assert session.wait_s(1.6) is None
    assert session.handle(Tick(), 9.0).events == ()


def test_the_pose_in_which_the_camera_comes_to_rest_is_kept_however_soon_it_came() -> None:
    session = begun("pog")
    driven(session, [(camera(5.0), 1.0), (camera(6.0), 1.1), (camera(7.0), 1.2)])
    assert session.wait_s(1.25) == pytest.approx(0.25)
    assert session.wait_s(1.75) == 0  # a late question still gets a finite wait
    assert cams(session.handle(Tick(), 1.75).events) == [(1.75, (0.0, 7.0, 0.0))]
    assert session.wait_s(1.75) is None
    assert session.handle(Tick(), 3.0).events == ()


def test_a_newer_pose_takes_the_place_of_one_that_was_held_back() -> None:
    session = begun("pog")
    driven(session, [(camera(5.0), 1.0), (camera(5.0), 1.1)])
    # no tick came in between: the server was busy
    assert cams(session.handle(camera(6.0), 4.0).events) == [(4.0, (0.0, 6.0, 0.0))]
    assert session.wait_s(4.0) is None


def test_a_rebuilt_pog_session_shows_the_same_storey_and_mark() -> None:
    session = new_session("pog")
    events = driven(session, [(Start(), 0.0), (ShowStorey(1), 1.0), (Click(RAY, (1.0, 3.0, 1.0)), 2.0)])
    rebuilt = rebuilt_session("pog", NO_TERMS, events)
    assert rebuilt.handle(Resume(away_s=1.0), 50.0).view == session.view(2.0)
