"""PAN and POG sessions as state machines."""

import math
from collections.abc import Sequence

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
from human_study.trial.outcome import end_reason, pan_outcome, pog_outcome
from human_study.trial.session import PanSession, PogSession
from human_study.trial.views import PanView
from sim.errors import StudyError, TaskStateError
from sim.tasks.run_files import ClickRay
from sim.types import Action

from .small_world import SCENE_DIGEST, SquareRoom, env, episode, study

RAY = ClickRay(
    origin=(0.0, 2.0, 0.0),
    direction=(0.0, -1.0, 0.0),
    camera_position=(0.0, 2.0, 0.0),
    camera_wxyz=(1.0, 0.0, 0.0, 0.0),
    storey_y=0.0,
)
LEFT, RIGHT, FORWARD = (Move(action, "Key") for action in (Action.LEFT, Action.RIGHT, Action.FORWARD))


def pan_session(*, max_steps: int = 500, with_pictures: bool = False) -> PanSession:
    task = study(steps=max_steps).task_for(episode(), "pan")
    world = env(max_steps=max_steps, with_pictures=with_pictures)
    return PanSession(world, key=episode().key, task=task, scene_digest=SCENE_DIGEST)


def pog_session(*, storeys: tuple[float, ...] = (0.0, 3.0)) -> PogSession:
    task = study().task_for(episode(), "pog")
    return PogSession(key=episode().key, task=task, storeys=storeys, scene_digest=SCENE_DIGEST)


def drive(session: PanSession, commands: Sequence[PanCommand], *, every_s: float = 0.5) -> list[Event]:
    """Starts the session and gives it one command every `every_s`; returns all events."""
    events = list(session.handle(Start(), 100.0).events)
    for number, command in enumerate(commands, start=1):
        events += session.handle(command, 100.0 + number * every_s).events
    return events


def kinds(events: tuple[Event, ...] | list[Event]) -> list[str]:
    return [event.kind for event in events]


def test_a_press_of_a_key_moves_the_robot_one_step_and_says_so() -> None:
    session = pan_session(with_pictures=True)
    first = session.handle(Start(), 10.0)
    update = session.handle(Move(Action.FORWARD, "KeyW", t_cli_ms=5.5), 11.0)
    assert kinds(first.events) == ["open", "shown"]
    assert kinds(update.events) == ["key", "act", "shown"]
    key, act, shown = update.events
    assert (key.code, key.t_cli_ms, key.t_s) == ("KeyW", 5.5, 1.0)  # type: ignore[union-attr]
    assert act.position == (0.0, 0.0, -0.25)  # type: ignore[union-attr]
    assert shown.frame_hash != first.events[1].frame_hash  # type: ignore[union-attr]
    assert update.view.step == 1
    assert update.view.rgb is not None


def test_a_wall_stops_the_robot_where_it_stands() -> None:
    events = drive(pan_session(), [FORWARD] * 5)
    steps = [event.step for event in events if event.kind == "act"]
    assert [step.collided for step in steps] == [False, False, False, True, True]
    assert steps[-1].position == pytest.approx((0.0, 0.0, -0.899))


def test_a_blocked_step_comes_with_a_sign_and_the_record_says_so() -> None:
    session = pan_session(with_pictures=True)
    events = drive(session, [FORWARD] * 4)
    shown = [event for event in events if isinstance(event, Shown)]
    assert [event.blocked for event in shown] == [False, False, False, False, True]
    assert event_to_json(shown[-1]).endswith('"blocked":true}')
    blocked = session.view(102.1)
    assert isinstance(blocked, PanView)
    assert blocked.is_blocked
    turned = session.handle(LEFT, 103.0)
    assert isinstance(turned.view, PanView)
    assert not turned.view.is_blocked
    assert [event.blocked for event in turned.events if isinstance(event, Shown)] == [False]


def test_the_sign_of_a_blocked_step_waits_for_its_picture_and_ends_with_an_absence() -> None:
    world = env(with_pictures=True)
    task = study().task_for(episode(), "pan")
    names = {"key": episode().key, "task": task, "scene_digest": SCENE_DIGEST, "looks_later": True}
    session = PanSession(world, **names)
    events = list(session.handle(Start(), 0.0).events)
    for number in range(1, 5):
        stepped = session.handle(FORWARD, float(number))
        looked = session.look(number + 0.1)
        events += [*stepped.events, *looked.events]
    before, after = stepped.view, looked.view
    assert isinstance(before, PanView)
    assert isinstance(after, PanView)
    assert (before.is_blocked, after.is_blocked) == (False, True)
    again = PanSession(env(with_pictures=True), **names).after(events)
    back = again.handle(Resume(1.0), 10.0)
    assert isinstance(back.view, PanView)
    assert not back.view.is_blocked
    assert [event.blocked for event in back.events if isinstance(event, Shown)] == [False]


def test_a_held_key_and_a_press_while_busy_are_dropped_and_logged() -> None:
    session = pan_session()
    session.handle(Start(), 0.0)
    held = session.handle(Move(Action.FORWARD, "KeyW", repeat=True), 1.0)
    busy = session.handle(FORWARD, 2.0, busy=True)
    assert [event.reason for event in (held.events[1], busy.events[1])] == ["repeat", "busy"]  # type: ignore[union-attr]
    assert busy.view.step == 0


def test_presses_faster_than_50_ms_are_dropped_and_logged() -> None:
    session = pan_session()
    session.handle(Start(), 0.0)
    session.handle(LEFT, 1.0)
    assert session.handle(LEFT, 1.049).events[1].reason == "rate"  # type: ignore[union-attr]
    assert session.handle(LEFT, 1.051).view.step == 2


def test_people_with_four_actions_cannot_look_up() -> None:
    session = pan_session()
    session.handle(Start(), 0.0)
    update = session.handle(Move(Action.LOOK_UP, "KeyR"), 1.0)
    assert update.events[1].reason == "action"  # type: ignore[union-attr]
    assert update.view.step == 0


@pytest.mark.parametrize(("gap_s", "is_over"), [(0.06, True), (2.0, True), (2.01, False)])
def test_stop_needs_two_presses_within_two_seconds(gap_s: float, is_over: bool) -> None:
    session = pan_session()
    session.handle(Start(), 0.0)
    first = session.handle(PressStop(), 1.0)
    second = session.handle(PressStop(), 1.0 + gap_s)
    assert kinds(first.events) == ["key", "stop_armed"]
    assert first.view.is_armed
    assert second.view.is_over is is_over
    assert second.view.is_armed is not is_over
    assert kinds(second.events) == (["key", "act", "stop"] if is_over else ["key", "stop_armed"])


def test_a_move_between_the_two_presses_disarms_stop() -> None:
    session = pan_session()
    drive(session, [PressStop(), LEFT, PressStop()])
    assert not session.is_over


def test_an_armed_stop_falls_back_by_itself() -> None:
    session = pan_session()
    session.handle(Start(), 0.0)
    session.handle(PressStop(), 1.0)
    assert session.view(3.0).is_armed
    assert not session.view(3.1).is_armed


def test_stop_as_the_500th_action_counts() -> None:
    session = pan_session()
    events = drive(session, [LEFT] * 499 + [PressStop(), PressStop()])
    run = pan_outcome(events, episode(), navigation=SquareRoom(), participant="p02")
    assert len(run.steps) == 500
    assert run.end.reason == "stop"


def test_the_500th_move_ends_the_trial_without_stop() -> None:
    session = pan_session()
    events = drive(session, [LEFT] * 505)
    run = pan_outcome(events, episode(), navigation=SquareRoom(), participant="p02")
    assert len(run.steps) == 500
    assert run.end.reason == "steps"
    assert session.end_reason == "steps"
    assert kinds(events).count("key") == 500


def test_giving_up_is_a_failure_with_the_distance_from_there() -> None:
    events = drive(pan_session(), [LEFT, LEFT, LEFT, FORWARD, GiveUp(), GiveUp()])
    end = pan_outcome(events, episode(), navigation=SquareRoom(), participant="p02").end
    assert end.reason == "giveup"
    assert end.measures is not None
    paper = end.measures.rules["paper"]
    assert paper is not None
    assert not paper.success
    assert paper.dtg == pytest.approx(0.75)


def test_a_known_walk_has_the_measures_computed_by_hand() -> None:
    events = drive(pan_session(), [LEFT] * 3 + [FORWARD] * 5 + [PressStop(), PressStop()])
    run = pan_outcome(events, episode(), navigation=SquareRoom(), participant="p02")
    measures = run.end.measures
    assert measures is not None
    paper, habitat = measures.rules["paper"], measures.rules["habitat"]
    assert paper is not None
    assert habitat is not None
    assert run.start.participant == "p02"
    assert run.steps[-2].position == pytest.approx((-1.25, 0.0, 0.0), abs=1e-9)
    assert (paper.success, habitat.success) == (True, True)
    assert paper.start_distance == pytest.approx(1.0)
    assert paper.spl == pytest.approx(0.8)
    assert habitat.spl == pytest.approx(1.0)
    assert measures.centre_distance == pytest.approx(0.75)
    assert [run.steps[0].t_s, run.steps[-1].t_s] == [0.5, 5.0]


def test_a_rebuilt_session_stands_at_the_same_step_and_pose() -> None:
    walk: list[PanCommand] = [LEFT, FORWARD, FORWARD, RIGHT, FORWARD, FORWARD, FORWARD]
    world = env(with_pictures=True)
    task = study().task_for(episode(), "pan")
    session = PanSession(world, key=episode().key, task=task, scene_digest=SCENE_DIGEST)
    events = drive(session, walk)
    again = env(with_pictures=True)
    rebuilt = PanSession(again, key=episode().key, task=task, scene_digest=SCENE_DIGEST).after(events)
    update = rebuilt.handle(Resume(away_s=30.0), 7.0)
    assert again.pose == world.pose
    assert again.steps == world.steps
    assert update.view.step == 7
    assert update.events[0].frame_hash == events[-1].frame_hash  # type: ignore[union-attr]
    assert rebuilt.handle(FORWARD, 8.0).events[1].t_s == pytest.approx(3.5 + 1.0)


def test_coming_back_too_late_ends_the_trial_as_abandoned() -> None:
    events = drive(pan_session(), [FORWARD])
    task = study().task_for(episode(), "pan")
    rebuilt = PanSession(env(), key=episode().key, task=task, scene_digest=SCENE_DIGEST).after(events)
    update = rebuilt.handle(Resume(away_s=600.5), 0.0)
    assert kinds(update.events) == ["abandoned"]
    assert update.view.is_over
    assert end_reason([*events, *update.events]) == "abandoned"


def test_a_trial_is_not_resumed_on_another_scene() -> None:
    events = drive(pan_session(), [FORWARD])
    task = study().task_for(episode(), "pan")
    with pytest.raises(TaskStateError, match="expected the same episode and scene ddd"):
        PanSession(env(), key=episode().key, task=task, scene_digest="e" * 64).after(events)


def test_a_failure_on_our_side_is_another_outcome_than_a_failure_of_the_person() -> None:
    events = drive(pan_session(), [FORWARD, Fail("renderer died")])
    assert end_reason(events) == "technical"


def test_a_command_before_the_start_is_refused() -> None:
    with pytest.raises(TaskStateError, match="before Start or Resume"):
        pan_session().handle(FORWARD, 0.0)


def test_a_trial_starts_once() -> None:
    session = pan_session()
    with pytest.raises(TaskStateError, match="found Resume; expected Start"):
        session.handle(Resume(), 0.0)
    events = drive(session, [FORWARD])
    task = study().task_for(episode(), "pan")
    rebuilt = PanSession(env(), key=episode().key, task=task, scene_digest=SCENE_DIGEST).after(events)
    for started in (session, rebuilt):
        with pytest.raises(TaskStateError, match="found Start; expected Resume"):
            started.handle(Start(), 200.0)


def test_time_away_is_not_counted_and_never_runs_back() -> None:
    session = pan_session()
    events = drive(session, [FORWARD], every_s=2.0)
    events += session.handle(Resume(away_s=90.0), 192.0).events
    events += session.handle(LEFT, 193.0).events
    assert [event.t_s for event in events if event.kind == "act"] == [2.0, 3.0]


def test_a_running_trial_has_no_outcome() -> None:
    events = drive(pan_session(), [FORWARD])
    with pytest.raises(StudyError, match="is not over"):
        pan_outcome(events, episode(), navigation=SquareRoom(), participant="p02")


COMMANDS = st.sampled_from(
    [LEFT, FORWARD, Move(Action.LOOK_UP, "KeyR"), Move(Action.LEFT, "KeyA", repeat=True), PressStop(), GiveUp()]
)


@given(
    st.lists(st.tuples(COMMANDS, st.floats(0, 3), st.booleans()), max_size=40),
    st.integers(1, 8),
)
def test_no_sequence_of_commands_makes_a_step_too_many_or_one_after_the_end(
    presses: list[tuple[PanCommand, float, bool]], max_steps: int
) -> None:
    session = pan_session(max_steps=max_steps)
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
    task = study(steps=max_steps).task_for(episode(), "pan")
    rebuilt = PanSession(env(max_steps=max_steps), key=episode().key, task=task, scene_digest=SCENE_DIGEST).after(
        events
    )
    assert rebuilt.end_reason == session.end_reason


def test_the_last_point_before_confirm_is_the_answer() -> None:
    session = pog_session()
    events = list(session.handle(Start(), 0.0).events)
    for command, now_s in [
        (ShowStorey(1), 1.0),
        (Click(RAY, (2.0, 0.1, 2.0)), 2.0),
        (Click(RAY, (-1.5, 0.1, 0.0)), 3.0),
        (Click(RAY, None), 4.0),
    ]:
        update = session.handle(command, now_s)
        events += update.events
    assert update.view.marker == (-1.5, 0.1, 0.0)
    assert update.view.storey == 1
    events += session.handle(Confirm(), 5.0).events
    answer = pog_outcome(events, episode(), storeys=[(0.0, 0.0)], participant="p01")
    assert kinds(events) == ["open", "storey", "click", "click", "click", "confirm"]
    assert answer.candidates == ((-1.5, 0.1, 0.0),)
    assert (answer.t_s, answer.reason, answer.participant) == (5.0, "click", "p01")
    assert answer.measures is not None
    assert answer.measures.success
    assert answer.measures.planar_distance == pytest.approx(0.5)
    assert answer.measures.distance_3d == pytest.approx(math.hypot(0.5, 0.4))


def test_nothing_can_be_confirmed_before_a_point_is_marked() -> None:
    session = pog_session()
    session.handle(Start(), 0.0)
    session.handle(Click(RAY, None), 1.0)
    update = session.handle(Confirm(), 2.0)
    assert update.events[0].reason == "nothing_marked"  # type: ignore[union-attr]
    assert not update.view.is_over


def test_giving_up_in_pog_gives_no_answer_even_with_a_mark() -> None:
    session = pog_session()
    events = list(session.handle(Start(), 0.0).events)
    events += session.handle(Click(RAY, (-2.0, 0.5, 0.0)), 1.0).events
    events += session.handle(GiveUp(), 2.0).events
    events += session.handle(GiveUp(), 4.0).events
    answer = pog_outcome(events, episode(), storeys=[(0.0, 0.0)], participant="p01")
    assert (answer.candidates, answer.ray, answer.reason) == ((), None, "giveup")
    assert answer.measures is not None
    assert not answer.measures.success


def test_camera_poses_are_kept_at_most_twice_a_second() -> None:
    session = pog_session()
    session.handle(Start(), 0.0)
    look = LookFrom((0.0, 5.0, 0.0), (1.0, 0.0, 0.0, 0.0))
    kept = [len(session.handle(look, now_s).events) for now_s in (1.0, 1.2, 1.49, 1.5, 1.9, 2.0)]
    assert kept == [1, 0, 0, 1, 0, 1]


def test_the_pose_in_which_the_camera_comes_to_rest_is_kept_however_soon_it_came() -> None:
    session = pog_session()
    session.handle(Start(), 0.0)
    poses = [LookFrom((0.0, height, 0.0), (1.0, 0.0, 0.0, 0.0)) for height in (5.0, 6.0, 7.0)]
    for pose, now_s in zip(poses, (1.0, 1.1, 1.2), strict=True):
        session.handle(pose, now_s)
    assert session.wait_s(1.25) == pytest.approx(0.25)
    assert session.wait_s(1.75) == 0  # who asks late is not told to wait for ever
    events = session.handle(Tick(), 1.75).events
    assert [(event.t_s, event.position) for event in events if isinstance(event, Cam)] == [(1.75, (0.0, 7.0, 0.0))]
    assert session.wait_s(1.75) is None
    assert session.handle(Tick(), 3.0).events == ()


def test_a_newer_pose_takes_the_place_of_one_that_was_held_back() -> None:
    session = pog_session()
    session.handle(Start(), 0.0)
    old, new = (LookFrom((0.0, height, 0.0), (1.0, 0.0, 0.0, 0.0)) for height in (5.0, 6.0))
    for now_s in (1.0, 1.1):
        session.handle(old, now_s)
    events = session.handle(new, 4.0).events  # no tick came in between: the server was busy
    assert [(event.t_s, event.position) for event in events if isinstance(event, Cam)] == [(4.0, (0.0, 6.0, 0.0))]
    assert session.wait_s(4.0) is None


def test_no_camera_pose_follows_an_answer() -> None:
    session = pog_session()
    for command, now_s in [(Start(), 0.0), (Click(RAY, (-2.0, 0.5, 0.0)), 1.0)]:
        session.handle(command, now_s)
    for height in (5.0, 6.0):
        session.handle(LookFrom((0.0, height, 0.0), (1.0, 0.0, 0.0, 0.0)), 1.5)
    session.handle(Confirm(), 1.6)
    assert session.wait_s(1.6) is None
    assert session.handle(Tick(), 9.0).events == ()


def test_a_storey_that_the_home_does_not_have_is_not_shown() -> None:
    session = pog_session()
    session.handle(Start(), 0.0)
    update = session.handle(ShowStorey(2), 1.0)
    assert update.events[0].reason == "storey"  # type: ignore[union-attr]
    assert update.view.storey == 0


def test_a_rebuilt_pog_session_shows_the_same_storey_and_mark() -> None:
    session = pog_session()
    events = list(session.handle(Start(), 0.0).events)
    events += session.handle(ShowStorey(1), 1.0).events
    events += session.handle(Click(RAY, (1.0, 3.0, 1.0)), 2.0).events
    task = study().task_for(episode(), "pog")
    rebuilt = PogSession(key=episode().key, task=task, storeys=(0.0, 3.0), scene_digest=SCENE_DIGEST).after(events)
    assert rebuilt.handle(Resume(away_s=1.0), 50.0).view == session.view(2.0)
