"""Ways compared with a path and with each other, on ways that are small enough to measure by hand."""

import itertools
import math
from dataclasses import astuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from sim.types import Action, Pose
from sim.walk.ways import (
    Departure,
    apart,
    apart_from_path,
    departure,
    parting,
    parting_decision,
    path_deviation,
    warped_distance,
)

CORNER = np.array([[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [4.0, 0.0, 3.0]])
"""A path of 4 m along x, then 3 m along z."""


def line(*corners: tuple[float, float, float], step: float = 0.5) -> NDArray[np.float64]:
    """Positions of the feet (N, 3) every `step` metres along straight pieces."""
    points = [np.array([corners[0]], float)]
    for start, end in itertools.pairwise(corners):
        count = round(np.linalg.norm(np.subtract(end, start)) / step)
        points.append(np.array(start) + np.subtract(end, start) * (np.arange(1, count + 1) / count)[:, None])
    return np.concatenate(points)


def test_the_deviation_is_the_planar_distance_to_the_path_on_the_same_storey() -> None:
    feet = np.array([[0, 0, 0], [2, 0, 0.7], [5.5, 0.2, 1], [4, 0, 4], [-3, 0, -4], [4.3, 0, -0.4]], float)
    assert path_deviation(feet, CORNER) == pytest.approx([0, 0.7, 1.5, 1, 5, 0.5])
    assert path_deviation(np.array([[3.0, 0.0, 4.0]]), np.zeros((1, 3))) == pytest.approx([5.0])
    assert path_deviation(np.array([[3.0, 0.0, 4.0]]), np.zeros((2, 3))) == pytest.approx([5.0])
    stairs = np.array([[0.0, 0.0, 0.0], [6.0, 3.0, 0.0]])  # reaches 1.5 m at x = 3
    (under,) = path_deviation(np.array([[5.0, 0.0, 0.0]]), stairs)
    assert 2.0 <= under < 2.25
    assert path_deviation(np.array([[5.0, 6.0, 0.0]]), stairs) == np.inf


def test_a_run_leaves_the_path_at_the_first_pose_more_than_a_metre_off() -> None:
    feet = line((0, 0, 0), (2, 0, 0), (2, 0, 3))
    deviation = path_deviation(feet, CORNER)
    assert deviation[6] == pytest.approx(1.0)
    left = departure(feet, deviation)
    assert left is not None
    assert (left.row, left.path_m) == (7, pytest.approx(3.5))
    feet = line((0, 0, 0.9), (3.5, 0, 0.9), (3.5, 0, 3.4))
    assert departure(feet, path_deviation(feet, CORNER)) is None


def test_paths_part_at_a_turn_at_the_start_or_on_a_stair_but_not_by_pauses_or_speed() -> None:
    straight, turned = line((0, 0, 0), (6, 0, 0)), line((0, 0, 0), (2, 0, 0), (2, 0, -3))
    parted = parting(straight, turned)
    # a walker at (2, -1) and one at (3, 0) are both 1 m from (2, 0)
    assert parted == (Departure(7, 3.5), Departure(7, 3.5))
    assert parting(line((0, 0, 0), (2, 0, 0)), line((0, 0, 5), (2, 0, 5))) == (Departure(0, 0.0), Departure(0, 0.0))
    slow, fast = line((0, 0, 0), (6, 0, 0), step=0.25), line((0, 0, 0.8), (6, 0, 0.8))
    waiting = np.concatenate([np.repeat(slow[:4], 9, axis=0), slow[4:]])
    assert parting(waiting, fast) is None
    assert parting(fast, waiting) is None
    assert parting(line((0, 0, 0), (2, 0, 0)), line((0, 0, 0), (6, 0, 0))) is None
    level, up = line((0, 0, 0), (8, 0, 0)), line((0, 0, 0), (2, 0, 0), (8, 3, 0))
    parted = parting(level, up)
    assert parted is not None
    assert 1.5 <= up[parted[1].row, 1] < 1.9


def test_a_detour_parts_where_it_begins_and_turning_back_where_the_other_run_cannot_be_waiting() -> None:
    straight = line((0, 0, 0), (8, 0, 0))
    detour = line((0, 0, 0), (3, 0, 0), (3, 0, 3), (3, 0, 0), (8, 0, 0))
    parted = parting(straight, detour)
    assert parted is not None
    assert parted[1] == Departure(9, 4.5)
    straight, back = line((0, 0, 0), (8, 0, 0)), line((0, 0, 0), (4, 0, 0), (0, 0, 0))
    parted = parting(straight, back)
    assert parted is not None
    # to match x = 4 the other run waits at x >= 3, which is 1 m from x = 2; x = 1.5 is too far
    assert parted[1] == Departure(13, 6.5)


def along_x(*places: float, y: float = 0.0, z: float = 0.0) -> NDArray[np.float64]:
    """Feet at these places of a line along x."""
    return np.array([(x, y, z) for x in places], float)


@pytest.mark.parametrize(
    ("first", "second", "metres"),
    [
        (along_x(0, 1, 2, 3), along_x(0, 1, 2, 3), 0.0),
        (along_x(0, 1, 2, 3), along_x(0, 1, 2, 3, z=1), 4.0),  # each place with the one beside it
        (along_x(0, 1, 2, 3, 4), along_x(0, 2, 4), 2.0),  # 1 and 3 are a metre from the nearest place
        (along_x(0, 0, 0, 1), along_x(0, 1), 0.0),  # a pause costs nothing where the other one can wait at it
        (along_x(0, 1, 2), along_x(2, 1, 0), 4.0),  # 2 at the start, 0 in the middle, 2 at the end
        (along_x(0), along_x(1, 2, 3), 6.0),  # the only place is matched with all
        (along_x(0, 4), along_x(0, 4, y=3.0), 6.0),  # a storey above
    ],
)
def test_dtw_is_the_smallest_sum_over_matched_places(
    first: NDArray[np.float64], second: NDArray[np.float64], metres: float
) -> None:
    assert warped_distance(first, second) == pytest.approx(metres)
    assert warped_distance(second, first) == pytest.approx(metres)


def figures(way: NDArray[np.float64], other: NDArray[np.float64]) -> tuple[float, float, float]:
    """DTW per place, nDTW and distance of the ends, of a way from another."""
    return astuple(apart(way, other))


def test_a_way_beside_a_path_is_apart_by_its_offset_and_ndtw_falls_with_it() -> None:
    assert figures(along_x(0, 1, 2, 3, z=0.5), along_x(0, 1, 2, 3)) == pytest.approx((0.5, math.exp(-0.5), 0.5))
    # 0 0 0 1 2 walks as 0 1 2: its turns and pauses are no places
    assert figures(along_x(0, 0, 0, 1, 1, 2), along_x(0, 1, 2)) == (0.0, 1.0, 0.0)
    # two places more, 1 m and 2 m beyond the end: 3 m over the longer way's 5 places and the reference's 3
    assert figures(along_x(0, 1, 2, 3, 4), along_x(0, 1, 2)) == pytest.approx((3 / 5, math.exp(-1), 2.0))
    assert figures(along_x(0, 0), along_x(0, 0, 0)) == (0.0, 1.0, 0.0)


def test_a_shortest_path_given_by_its_corners_has_a_place_each_step() -> None:
    walked = line((0, 0, 0), (4, 0, 0), (4, 0, 3), step=0.25)
    assert astuple(apart_from_path(walked, CORNER)) == pytest.approx((0.0, 1.0, 0.0), abs=1e-9)
    stays = apart_from_path(along_x(0.0), np.array([[0.0, 0, 0], [1, 0, 0]]))  # 0, .25, .5, .75 and 1 m away
    assert astuple(stays) == pytest.approx((0.5, math.exp(-0.5), 1.0))
    at_goal = apart_from_path(along_x(0.0), np.zeros((2, 3)))  # the start lies in the success region
    assert astuple(at_goal) == (0.0, 1.0, 0.0)


@settings(max_examples=60, deadline=None)
@given(
    first=st.lists(st.tuples(*[st.integers(-5, 5)] * 3), min_size=1, max_size=8),
    second=st.lists(st.tuples(*[st.integers(-5, 5)] * 3), min_size=1, max_size=8),
)
def test_dtw_has_the_bounds_of_its_definition(
    first: list[tuple[int, int, int]], second: list[tuple[int, int, int]]
) -> None:
    a, b = np.array(first, float), np.array(second, float)
    total = warped_distance(a, b)
    nearest = np.linalg.norm(a[:, None] - b, axis=2)
    assert total >= max(nearest.min(axis=1).sum(), nearest.min(axis=0).sum()) - 1e-9
    assert total <= nearest[0, :-1].sum() + nearest[:, -1].sum() + 1e-9  # wait at the start, then follow
    assert total >= math.dist(a[-1], b[-1]) - 1e-9
    assert total == pytest.approx(warped_distance(b, a))
    assert warped_distance(a, a) == 0
    assert total == pytest.approx(warped_distance(a[::-1], b[::-1]))


F, L, R, STOP = Action.FORWARD, Action.LEFT, Action.RIGHT, Action.STOP


def decisions(*actions: Action, yaw: float = 0.0) -> list[tuple[Action | None, Pose]]:
    """A run on an empty floor: each step is 25 cm, each turn 30 degrees."""
    x = z = 0.0
    found: list[tuple[Action | None, Pose]] = [(None, Pose((0.0, 0.0, 0.0), yaw))]
    for action in actions:
        if action is F:
            x, z = x - 0.25 * math.sin(yaw), z - 0.25 * math.cos(yaw)
        yaw += {L: math.pi / 6, R: -math.pi / 6}.get(action, 0.0)
        found.append((action, Pose((x, 0.0, z), yaw)))
    return found


@pytest.mark.parametrize(
    ("first", "second", "number"),
    [
        ((F, F, STOP), (F, F, STOP), None),
        ((F, F, STOP), (F, L, STOP), 2),
        ((L, F, STOP), (R, F, STOP), 1),
        ((F, F, STOP), (F, F, F, STOP), 3),  # one stops, the other goes on
        ((F, F), (F, F, L, STOP), 3),  # one gave up after two actions
        ((), (F,), 1),
        ((), (), None),
    ],
)
def test_runs_part_at_the_first_decision_that_differs_or_that_only_one_takes(
    first: tuple[Action, ...], second: tuple[Action, ...], number: int | None
) -> None:
    assert parting_decision(decisions(*first), decisions(*second)) == number
    assert parting_decision(decisions(*second), decisions(*first)) == number


def test_runs_at_other_poses_have_parted_even_if_their_actions_are_the_same() -> None:
    assert parting_decision(decisions(F, F), decisions(F, F, yaw=0.5)) == 0
    slid = decisions(F, F)
    slid[2] = (F, Pose((0.1, 0.0, -0.5), 0.0))
    assert parting_decision(decisions(F, F), slid) == 2
    whole_turn = [(action, Pose(pose.position, pose.yaw + 2 * math.pi)) for action, pose in decisions(F, L, F)]
    assert parting_decision(decisions(F, L, F), whole_turn) is None
