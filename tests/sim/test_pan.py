"""PanEnv: Habitat's action semantics in worlds with known answers."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.errors import TaskStateError
from sim.render.raycast import Raycaster
from sim.tasks.pan import PanEnv
from sim.types import Action, Camera, Pose

from .raycasters import soup
from .worlds import open_room, room_with

START = Pose((3.0, 0.0, 3.0), 0.0)


def test_forward_moves_a_quarter_metre_along_minus_z_and_along_minus_x_after_three_lefts() -> None:
    env = PanEnv(START, open_room(), renderer=None)
    env.reset()
    observation = env.step(Action.FORWARD)
    assert env.pose.position == pytest.approx((3.0, 0.0, 2.75))
    assert not observation.collided
    assert observation.gps == pytest.approx((0.25, 0.0))
    env = PanEnv(START, open_room(), renderer=None)
    for _ in range(3):
        env.step(Action.LEFT)
    observation = env.step(Action.FORWARD)
    assert env.pose.position == pytest.approx((2.75, 0.0, 3.0))
    assert observation.compass == pytest.approx(math.pi / 2)
    assert observation.gps == pytest.approx((0.0, -0.25))


def test_without_colours_the_depth_stays_the_same() -> None:
    walls, camera = Raycaster(soup(4)), Camera(32, 24)
    whole = PanEnv(START, open_room(), renderer=walls, camera=camera).reset()
    bare = PanEnv(START, open_room(), renderer=walls, camera=camera, colours=False).reset()
    assert bare.rgb is None
    assert bare.depth_m is not None
    assert whole.depth_m is not None
    np.testing.assert_array_equal(bare.depth_m, whole.depth_m)


def test_a_wall_stops_the_robot_with_a_collision_and_without_sliding() -> None:
    env = PanEnv(Pose((3.0, 0.0, 0.1), 0.0), open_room(), renderer=None)
    observation = env.step(Action.FORWARD)
    assert observation.collided
    assert env.pose.position[2] == pytest.approx(0.0, abs=2e-3)
    again = env.step(Action.FORWARD)
    assert again.collided
    assert env.pose.position[2] == pytest.approx(0.0, abs=2e-3)
    env = PanEnv(Pose((3.0, 0.0, 0.01), math.radians(30)), open_room(), renderer=None)
    for _ in range(5):
        env.step(Action.FORWARD)
    assert math.dist(env.pose.position, (3.0, 0.0, 0.01)) < 0.05


def test_looking_up_only_tilts_the_camera() -> None:
    env = PanEnv(START, open_room(), renderer=None)
    up = env.step(Action.LOOK_UP)
    assert env.pose.position == START.position
    assert env.pose.tilt == pytest.approx(math.radians(30))
    assert up.T_start_camera[1, 3] == pytest.approx(0.88)
    assert up.T_start_camera[:3, 2] == pytest.approx([0, 0.5, -math.cos(math.radians(30))])


def test_stop_as_the_500th_action_counts_and_a_501st_is_refused() -> None:
    env = PanEnv(START, open_room(), renderer=None)
    for _ in range(499):
        env.step(Action.LEFT)
    env.step(Action.STOP)
    assert (env.end_reason, env.pose.position) == ("stop", START.position)
    with pytest.raises(TaskStateError, match="after the end"):
        env.step(Action.LEFT)


def test_500_turns_end_the_episode_without_stop() -> None:
    env = PanEnv(START, open_room(), renderer=None)
    for _ in range(500):
        env.step(Action.LEFT)
    assert env.end_reason == "steps"
    with pytest.raises(TaskStateError):
        env.step(Action.STOP)


def test_a_restored_environment_continues_in_the_same_way() -> None:
    first = PanEnv(START, open_room(), renderer=None)
    for action in (Action.LEFT, Action.FORWARD, Action.RIGHT, Action.FORWARD):
        first.step(action)
    second = PanEnv(START, open_room(), renderer=None)
    second.restore(first.steps[:2])
    for action in (Action.RIGHT, Action.FORWARD):
        second.step(action)
    assert second.poses == first.poses


@settings(max_examples=50, deadline=None)
@given(st.lists(st.sampled_from([Action.FORWARD, Action.LEFT, Action.RIGHT]), max_size=60))
def test_the_robot_never_leaves_the_free_floor_or_moves_farther_than_one_step(actions: list[Action]) -> None:
    env = PanEnv(START, _PILLAR_ROOM, renderer=None)
    for action in actions:
        env.step(action)
    positions = np.array([pose.position for pose in env.poses])
    lengths = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    assert lengths.max(initial=0) <= 0.25 + 1e-9
    assert all(_PILLAR_ROOM.is_navigable(position) for position in positions)


_PILLAR_ROOM = room_with(lambda xz: ~((abs(xz[:, 0] - 3) < 0.5) & (abs(xz[:, 1] - 2) < 0.3)))
