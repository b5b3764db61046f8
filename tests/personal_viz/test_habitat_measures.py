"""habitat-lab's measures on trajectories with known answers, its odd cases, and their agreement with rule `habitat`."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from personal_viz.bench.habitat.measures import distances_to_goal, habitat_measures
from sim.errors import RunFileError
from sim.tasks.pan import PanEnv
from sim.tasks.rules import score_run
from sim.types import Action, Pose
from tests.sim.worlds import episode, goal, open_room, room_with, view_point

FORWARD, LEFT, STOP = Action.FORWARD, Action.LEFT, Action.STOP


class Straight:
    """A map on which every distance is the straight line, and which counts how often it is asked."""

    asked = 0

    def distances(self, starts, goals):
        self.asked += len(starts)
        return np.linalg.norm(np.asarray(starts)[:, None] - np.asarray(goals)[None], axis=2).min(axis=1)


def line(*heights_x_z: tuple[float, float, float]) -> np.ndarray:
    return np.array(heights_x_z, float)


def test_a_walk_with_a_detour_has_the_spl_computed_by_hand() -> None:
    # L = 4, P = 3 + 1 + 1 + 1 = 6 (the third metre goes up), 0.05 m left.
    positions = line((0, 0, 0), (3, 0, 0), (3, 1, 0), (3, 0, 0), (3.95, 0, 0), (3.95, 0, 0))
    found = habitat_measures(
        positions,
        [FORWARD, FORWARD, FORWARD, FORWARD, STOP],
        [False, True, True, False, False],
        distances=[4, 1, 1.4, 1, 0.05, 0.05],
        success_distance=0.1,
    )
    assert found.success == 1.0
    assert found.spl == pytest.approx(4 / 5.95)
    assert found.soft_spl == pytest.approx((1 - 0.05 / 4) * 4 / 5.95)
    assert (found.distance_to_goal, found.num_steps, found.collisions) == (0.05, 5, 2)


def one_step(distances, action, *, success_distance=0.1, moved=1.0):
    return habitat_measures(
        line((0, 0, 0), (moved, 0, 0)), [action], [False], distances=distances, success_distance=success_distance
    )


@pytest.mark.parametrize(
    ("distances", "action", "expected"),
    [
        pytest.param([2, 0.1], STOP, {"success": 0.0}, id="a distance equal to the success distance is no success"),
        pytest.param([2, np.nextafter(0.1, 0)], STOP, {"success": 1.0}, id="a smaller distance is a success"),
        pytest.param([2, 0.0], FORWARD, {"success": 0.0, "spl": 0.0, "soft_spl": 1.0}, id="without stop soft SPL only"),
        pytest.param([2, 5], FORWARD, {"soft_spl": 0.0}, id="walking away gives 0 and not less"),
        pytest.param(
            [2, math.inf],
            STOP,
            {"distance_to_goal": math.inf, "spl": 0.0, "soft_spl": 0.0},
            id="unreachable only at the end gives zeros",
        ),
    ],
)
def test_a_single_step_has_the_measures_of_habitat_lab(
    distances: list[float], action: Action, expected: dict[str, float]
) -> None:
    found = one_step(distances, action)
    assert {name: getattr(found, name) for name in expected} == expected


def test_unreachable_from_the_start_gives_inf_and_nan_as_in_habitat_lab() -> None:
    found = one_step([math.inf, math.inf], STOP)
    assert (found.distance_to_goal, found.success) == (math.inf, 0.0)
    assert math.isnan(found.spl)
    assert math.isnan(found.soft_spl)
    reached = one_step([math.inf, 0.0], STOP)
    assert reached.success == 1.0
    assert math.isnan(reached.spl)


def test_a_start_on_the_goal_fails_as_it_does_in_habitat_lab() -> None:
    with pytest.raises(ZeroDivisionError, match="habitat-lab divides by it"):
        one_step([0, 0], STOP)


def test_stop_as_the_500th_action_counts() -> None:
    positions = np.zeros((501, 3))
    turns = [LEFT] * 499
    options = {"distances": np.full(501, 0.05), "success_distance": 0.1}
    assert habitat_measures(positions, [*turns, STOP], [False] * 500, **options).success == 1.0
    assert habitat_measures(positions, [*turns, LEFT], [False] * 500, **options).success == 0.0


def test_distances_are_measured_anew_only_after_a_move() -> None:
    navigation = Straight()
    # 0.9e-4 is within atol of the place measured last; two such moves in a row are not.
    positions = line((0, 0, 0), (0, 0, 0), (0.9e-4, 0, 0), (1.8e-4, 0, 0), (1, 0, 0))
    found = distances_to_goal(positions, [[2, 0, 0], [9, 0, 0]], navigation=navigation)
    np.testing.assert_allclose(found, [2, 2, 2, 2 - 1.8e-4, 1], atol=1e-12)
    assert navigation.asked == 3


def test_lengths_that_do_not_fit_are_one_clear_line() -> None:
    with pytest.raises(
        RunFileError, match=r"of 1 actions: found 3 positions \(expected 2\), 0 collided \(expected 1\)"
    ):
        habitat_measures(np.zeros((3, 3)), [STOP], [], distances=[1, 1], success_distance=0.1)
    with pytest.raises(RunFileError, match="found stop as action 1; expected it as the last one only"):
        habitat_measures(np.zeros((3, 3)), [STOP, LEFT], [False] * 2, distances=[1] * 3, success_distance=0.1)
    with pytest.raises(RunFileError, match=r"goals: found shape \(0,\)"):
        distances_to_goal(np.zeros((3, 3)), [], navigation=Straight())
    with pytest.raises(RunFileError, match=r"positions: found shape \(3,\)"):
        distances_to_goal(np.zeros(3), np.zeros((1, 3)), navigation=Straight())


WORLDS = (open_room(), room_with(lambda xz: ~((abs(xz[:, 0] - 3) < 0.4) & (xz[:, 1] > 1))))


@settings(max_examples=40, deadline=None)
@given(
    st.lists(st.sampled_from([FORWARD, FORWARD, LEFT, Action.RIGHT]), max_size=40),
    st.sampled_from(WORLDS),
    st.booleans(),
)
def test_rule_habitat_of_the_tables_gives_the_same_where_both_are_defined(actions, world, stops) -> None:
    target = goal((4.6, 0.5, 4.6), (view_point((4.0, 0.0, 4.0)), view_point((2.0, 0.0, 4.5))))
    env = PanEnv(Pose((2.0, 0.0, 3.0), math.pi), world, renderer=None, max_steps=41)
    for action in [*actions, *([STOP] if stops else [LEFT])]:
        env.step(action)
    positions = np.array([pose.position for pose in env.poses])
    collided = [step.collided for step in env.steps]
    points = np.array([point.agent_state.position for point in target.view_points])
    exact = habitat_measures(
        positions,
        [step.action for step in env.steps],
        collided,
        distances=distances_to_goal(positions, points, navigation=world),
        success_distance=0.1,
    )
    run = score_run(
        episode(target), env.poses, stopped=stops, navigation=world, collisions=sum(collided), scene_digest=""
    )
    rule = run.rules["habitat"]
    assert (rule.success, run.num_steps, run.collisions) == (exact.success == 1, exact.num_steps, exact.collisions)
    tiny = sum(0 < math.dist(a, b) < 2e-4 for a, b in pairwise(positions))  # such moves habitat-lab does not see
    assert (rule.spl, rule.soft_spl, rule.dtg) == pytest.approx(
        (exact.spl, exact.soft_spl, exact.distance_to_goal), abs=1e-9 + 2e-4 * tiny
    )
