"""Pictures of a home: rendered once, in the right order, the same ones with and without looking ahead."""

import os
import sys
import threading
from concurrent.futures import Future

import numpy as np
import pytest
from numpy.typing import NDArray

from human_study.trial.commands import Move, Start
from human_study.trial.events import Event, Shown
from human_study.trial.session import PanSession
from personal_viz.study_app.home.frames import RENDER_NICE, Frames, RenderThreads, successors
from sim.errors import SceneError
from sim.frames import T_world_camera
from sim.render.renderer import jpeg_bytes
from sim.tasks.pan import PanEnv
from sim.types import PAPER4, PAPER6, TURN_STEP, Action, Camera, Frame, Pose
from tests.human_study.small_world import CAMERA, SCENE_DIGEST, PoseColours, SquareRoom, episode, study

HERE, THERE = Pose((0.0, 0.0, 0.0), 0.0), Pose((0.5, 0.0, 1.0), 0.3)
WALK = (Action.FORWARD, Action.LEFT, Action.FORWARD, Action.RIGHT, Action.RIGHT, Action.LEFT, Action.FORWARD)
WAIT_S = 30.0


class Colours(PoseColours):
    """A whole `Renderer`: pictures tell poses apart."""

    def render_batch(self, Ts_world_camera: NDArray[np.float64], camera: Camera) -> list[Frame]:
        return [self.render(T, camera) for T in Ts_world_camera]


class Recorder(Colours):
    """Notes the x of each picture; waits before each one until it is let go."""

    def __init__(self, *, is_held: bool = False) -> None:
        self.xs: list[float] = []
        self.go = threading.Event()
        self.began = threading.Event()
        if not is_held:
            self.go.set()

    def render(self, T_world_camera: NDArray[np.float64], camera: Camera) -> Frame:
        self.xs.append(round(float(T_world_camera[0, 3]), 6))
        self.began.set()
        assert self.go.wait(WAIT_S)
        return super().render(T_world_camera, camera)


def looked(frames: Frames, pose: Pose) -> Frame:
    return frames.render(T_world_camera(pose, CAMERA), CAMERA)


def at(x: float) -> Pose:
    return Pose((x, 0.0, 0.0), 0.0)


def test_a_pose_is_rendered_once_and_looks_the_same_each_time() -> None:
    renderer, plain = Recorder(), Colours()
    frames = Frames(renderer, RenderThreads(2))
    first, again, other = looked(frames, HERE), looked(frames, HERE), looked(frames, THERE)
    assert len(renderer.xs) == 2
    assert again.rgb is first.rgb
    for pose, frame in ((HERE, first), (THERE, other)):
        assert np.array_equal(frame.rgb, plain.render(T_world_camera(pose, CAMERA), CAMERA).rgb)
    assert frames.jpeg(first.rgb) == jpeg_bytes(first.rgb)
    assert frames.jpeg(first.rgb) is frames.jpeg(first.rgb)


def test_researchers_who_watch_get_the_depth_too() -> None:
    assert not looked(Frames(Colours(), RenderThreads(1)), HERE).depth_m.any()
    frames = Frames(Colours(), RenderThreads(1), keep_depth=True)
    assert (looked(frames, HERE).depth_m == 1).all()
    assert (looked(frames, HERE).depth_m == 1).all()


def test_pictures_unused_for_longest_are_forgotten() -> None:
    renderer = Recorder()
    frames = Frames(renderer, RenderThreads(1), kept=2)
    for x in (1.0, 2.0, 1.0, 3.0, 1.0, 2.0):
        looked(frames, at(x))
    assert renderer.xs == [1.0, 2.0, 3.0, 2.0]


def test_a_picture_that_somebody_waits_for_goes_before_those_rendered_ahead() -> None:
    renderer, threads = Recorder(is_held=True), RenderThreads(1)
    frames = Frames(renderer, threads)
    frames.begin(at(1.0), CAMERA)
    assert renderer.began.wait(WAIT_S)
    frames.look_ahead("p01", [at(5.0), at(6.0)], CAMERA)
    frames.begin(at(2.0), CAMERA)
    renderer.go.set()
    assert len(looked(frames, at(6.0)).rgb) == CAMERA.height
    assert renderer.xs.index(2.0) == 1
    assert renderer.xs.count(6.0) == 1


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere priorities belong to whole processes")
def test_pictures_leave_the_cores_to_keys_that_wait_to_be_stored() -> None:
    done: Future[int] = Future()
    own = os.getpriority(os.PRIO_PROCESS, threading.get_native_id())
    RenderThreads(1).run(lambda: done.set_result(os.getpriority(os.PRIO_PROCESS, threading.get_native_id())))
    assert done.result(WAIT_S) == max(own, RENDER_NICE)
    assert os.getpriority(os.PRIO_PROCESS, threading.get_native_id()) == own


def test_a_new_wish_replaces_the_old_one_and_nobody_is_left_out() -> None:
    renderer, threads = Recorder(is_held=True), RenderThreads(1)
    frames = Frames(renderer, threads)
    frames.begin(at(0.0), CAMERA)
    assert renderer.began.wait(WAIT_S)
    frames.look_ahead("p01", [at(1.0), at(1.1)], CAMERA)
    frames.look_ahead("p02", [at(2.0), at(2.1)], CAMERA)
    frames.look_ahead("p01", [at(3.0)], CAMERA)
    done = threading.Event()
    threads.look_ahead("last", [lambda: None, done.set])
    renderer.go.set()
    assert done.wait(WAIT_S)
    assert 3.0 in renderer.xs
    assert 2.0 in renderer.xs
    assert not {1.0, 1.1} & set(renderer.xs)


def test_a_picture_that_is_rendered_ahead_is_not_rendered_again() -> None:
    renderer, threads = Recorder(is_held=True), RenderThreads(1)
    frames = Frames(renderer, threads)
    frames.look_ahead("p01", [at(4.0)], CAMERA)
    assert renderer.began.wait(WAIT_S)
    renderer.go.set()
    looked(frames, at(4.0))
    assert renderer.xs == [4.0]


def test_a_failure_is_told_to_the_caller_and_the_next_try_renders_again() -> None:
    class Broken(Colours):
        is_broken = True

        def render(self, T_world_camera: NDArray[np.float64], camera: Camera) -> Frame:
            if self.is_broken:
                raise SceneError("no picture today")
            return super().render(T_world_camera, camera)

    renderer = Broken()
    frames = Frames(renderer, RenderThreads(1))
    with pytest.raises(SceneError, match="no picture today"):
        looked(frames, HERE)
    renderer.is_broken = False
    assert looked(frames, HERE).rgb.shape == (CAMERA.height, CAMERA.width, 3)


def test_successors_are_the_poses_after_each_action_with_the_last_action_first() -> None:
    room = SquareRoom()
    forward, left, right = successors(HERE, room, PAPER4)
    assert forward.position == pytest.approx((0.0, 0.0, -0.25))
    assert (left.yaw, right.yaw) == pytest.approx((TURN_STEP, -TURN_STEP))
    assert successors(HERE, room, PAPER4, last=Action.RIGHT)[0] == right
    assert [pose.tilt for pose in successors(HERE, room, PAPER6)][3:] == pytest.approx([TURN_STEP, -TURN_STEP])
    env = PanEnv(THERE, room, renderer=None)
    env.step(Action.FORWARD)
    assert successors(THERE, room, PAPER4)[0] == env.pose


def recorded(frames: Frames | Colours, *, looks_ahead: bool) -> list[Event]:
    """The events of a walk, as a seat stores them."""
    config, room = study(), SquareRoom()
    env = PanEnv(episode().start, room, renderer=frames, camera=CAMERA, max_steps=config.steps)
    task = config.task_for(episode(), "pan")
    session = PanSession(env, key=episode().key, task=task, scene_digest=SCENE_DIGEST, looks_later=looks_ahead)
    events = list(session.handle(Start(), 0.0).events)
    for number, action in enumerate(WALK, start=1):
        events += session.handle(Move(action, "Key"), float(number)).events
        if session.needs_look:
            events += session.look(float(number)).events
        if isinstance(frames, Frames) and looks_ahead:
            frames.look_ahead("p01", successors(session.pose, room, PAPER4, last=session.last_action), CAMERA)
    return events


def test_the_record_is_the_same_with_and_without_looking_ahead() -> None:
    threads = RenderThreads(2)
    ahead = recorded(Frames(Colours(), threads), looks_ahead=True)
    assert ahead == recorded(Colours(), looks_ahead=False)
    assert [event.step for event in ahead if isinstance(event, Shown)] == list(range(len(WALK) + 1))


def test_work_that_fails_ends_neither_the_thread_nor_looking_ahead() -> None:
    threads, done = RenderThreads(1), threading.Event()

    def fails() -> None:
        raise SceneError("no picture")

    threads.run(fails)
    threads.look_ahead("p01", [fails, done.set])
    assert done.wait(WAIT_S)
