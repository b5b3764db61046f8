"""Where paths part, on paths that are small enough to measure by hand."""

import itertools

import numpy as np
import pytest
from numpy.typing import NDArray

from recordings.divergence import Departure, departure, divergence_of, parting, path_deviation

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


def test_runs_that_do_not_walk_and_goals_out_of_reach_have_no_divergence() -> None:
    straight, turned = line((0, 0, 0), (6, 0, 0)), line((0, 0, 0), (2, 0, 0), (2, 0, -3))
    found = divergence_of([straight, None, turned], CORNER, pair=(0, 2))
    assert [stray is None for stray in found.strays] == [False, True, False]
    assert found.strays[0] is not None
    assert found.strays[0].departure == Departure(11, 5.5)
    assert found.parted == (Departure(7, 3.5), Departure(7, 3.5))
    without = divergence_of([straight, turned], None, pair=None)
    assert without.strays == (None, None)
    assert without.parted is None
