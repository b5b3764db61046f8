"""OneMap's goals on small maps with known answers: frontiers, points of interest, the choice, and the consensus."""

import numpy as np
import pytest
from numpy.typing import NDArray

from grounding.agents.onemap.goals import (
    MapGoal,
    chosen,
    explored_region,
    frontiers,
    hot_cells,
    points_of_interest,
)
from grounding.agents.onemap.target import Target, believed, replaced

SHAPE = (80, 80)


def image(*places: tuple[slice | int, slice | int]) -> NDArray[np.bool_]:
    found = np.zeros(SHAPE, bool)
    for place in places:
        found[place] = True
    return found


def test_small_islands_are_filled_large_ones_and_smaller_parts_are_not() -> None:
    explored = image(np.s_[10:60, 10:60], np.s_[70:75, 70:75])
    explored[15:24, 15:26] = False  # 99 cells
    explored[30:40, 30:40] = False  # 100 cells
    region = explored_region(explored, np.ones(SHAPE, bool))
    assert region[15:24, 15:26].all()
    assert not region[30:40, 30:40].any()
    assert not region[70:75, 70:75].any()


def corridor() -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """An explored corridor, 9 cells wide between walls and open at its lower end; and the navigable cells."""
    region, navigable = image(np.s_[10:40, 31:40]), np.ones(SHAPE, bool)
    navigable[9:, 28:31] = navigable[9:, 40:43] = navigable[7:10, 28:43] = False
    return region, navigable


def test_the_open_end_of_a_corridor_is_its_only_frontier_and_its_middle_the_goal() -> None:
    region, navigable = corridor()
    nothing = np.zeros(SHAPE, np.float32)
    found = frontiers(region, navigable, nothing, np.ones(SHAPE, bool))
    assert found == [MapGoal("frontier", (39, 35), 1.0)]
    navigable[41, 31:40] = False
    navigable[40, 31:40] = False
    assert frontiers(region, navigable, nothing, np.ones(SHAPE, bool)) == []


@pytest.mark.parametrize(("steps", "score"), [(24, 1.9), (25, 1.9), (26, 1.0)])
def test_a_frontier_scores_what_was_glimpsed_up_to_two_and_a_half_metres_behind_it(steps: int, score: float) -> None:
    region, navigable = corridor()
    similarity = np.zeros(SHAPE, np.float32)
    similarity[39 + steps, 35] = 0.9
    (found,) = frontiers(region, navigable, similarity, np.ones(SHAPE, bool))
    assert found.score == pytest.approx(score)


def test_a_frontier_does_not_score_what_lies_behind_unseen_cells_and_nothing_if_unseen_itself() -> None:
    region, navigable = corridor()
    similarity, seen = np.zeros(SHAPE, np.float32), np.ones(SHAPE, bool)
    similarity[50, 35] = 0.9
    seen[45] = False
    (found,) = frontiers(region, navigable, similarity, seen)
    assert found.score == 1.0
    seen[39, 35] = False
    (found,) = frontiers(region, navigable, similarity, seen)
    assert found.score == 0.0


def points(
    similarity: NDArray[np.float32],
    *,
    checked: tuple[slice | int, slice | int] | None = None,
    region: NDArray | None = None,
) -> list[MapGoal]:
    return points_of_interest(
        similarity,
        np.ones(SHAPE, bool),
        region=image(np.s_[10:40, 10:40]) if region is None else region,
        is_explored=np.zeros(SHAPE, bool),
        is_checked=image() if checked is None else image(checked),
    )


def hills() -> NDArray[np.float32]:
    """Two hills: similarity 0.8 at (20, 20) beside 0.7, and 0.5 at (30, 35) beside 0.45; a single cell of 0.6."""
    similarity = np.zeros(SHAPE, np.float32)
    similarity[20, 20:22] = 0.8, 0.7
    similarity[30, 35:37] = 0.5, 0.45
    similarity[14, 36] = 0.6
    return similarity


def test_peaks_of_two_cells_or_more_are_points_of_interest_until_they_were_checked() -> None:
    found = points(hills())
    assert [(goal.kind, goal.rc) for goal in found] == [("point", (20, 20)), ("point", (30, 35))]
    assert [goal.score for goal in found] == pytest.approx([1.8, 1.5])
    assert [goal.rc for goal in points(hills(), checked=np.s_[19:22, 19:22])] == [(30, 35)]


def test_points_of_interest_lie_within_one_and_a_half_metres_of_the_explored_area() -> None:
    near, far = image(np.s_[15:25, 34:36]), image(np.s_[15:25, 35:36])
    assert [goal.rc for goal in points(hills(), region=near)] == [(20, 20), (30, 35)]
    assert [goal.rc for goal in points(hills(), region=far)] == [(30, 35)]
    assert len(points(hills(), region=image())) == 2, "no explored area yet"


@pytest.mark.parametrize("value", [0.0, 0.3])
def test_equal_similarities_have_no_point_of_interest(value: float) -> None:
    assert points(np.full(SHAPE, value, np.float32)) == []


@pytest.mark.parametrize(("gain", "expected"), [(0.0099, (20, 23)), (0.0101, (70, 70))])
def test_the_last_goal_is_kept_unless_it_scores_a_hundredth_less_than_it_did(
    gain: float, expected: tuple[int, int]
) -> None:
    last = MapGoal("frontier", (20, 20), 1.5)
    goals = [MapGoal("point", (70, 70), 1.9), MapGoal("frontier", (20, 23), 1.5 - gain)]
    assert chosen(goals, last).rc == expected
    assert chosen(goals, None).rc == (70, 70)
    assert chosen(goals, MapGoal("frontier", (20, 29), 1.0)).rc == (70, 70), "0.6 m away is another goal"


def test_equal_similarities_leave_frontiers_alone_of_which_the_first_is_kept() -> None:
    """A corridor that is open at both ends: exploration from frontier to frontier."""
    similarity, navigable = np.full(SHAPE, 0.3, np.float32), np.ones(SHAPE, bool)
    navigable[:, 28:31] = navigable[:, 40:43] = False
    top, low = frontiers(image(np.s_[10:40, 31:40]), navigable, similarity, np.ones(SHAPE, bool))
    assert (top.rc, low.rc) == ((10, 35), (39, 35))
    assert top.score == low.score == pytest.approx(1.3)
    assert chosen([top, low], None) == top
    assert chosen([low, top], top) == top


def test_the_hot_cells_are_the_best_hundredth_and_those_within_three_cells() -> None:
    similarity = np.zeros(SHAPE, np.float32)
    similarity[40, :50] = np.linspace(0.0, 1.0, 50)
    seen = image(np.s_[40, :50])
    hot = hot_cells(similarity, seen)  # of 50 cells the 99th percentile lies between the best two
    assert np.argwhere(hot).min(axis=0).tolist() == [37, 46]
    assert np.argwhere(hot).max(axis=0).tolist() == [43, 52]
    assert hot.sum() == 49


def test_equal_best_cells_are_all_hot_and_none_is_if_all_are_equal() -> None:
    similarity, seen = np.zeros(SHAPE, np.float32), np.ones(SHAPE, bool)
    assert not hot_cells(similarity, seen).any()
    similarity[40:60, 40:60] = 1.0  # six hundredths of the map
    hot = hot_cells(similarity, seen)
    assert hot[37:63, 37:63].all()
    assert hot.sum() == 26 * 26


def detection(*cells: tuple[int, int]) -> tuple[NDArray[np.bool_], NDArray[np.float32], NDArray[np.int32]]:
    """Mask, depth and cells of a picture of one row whose pixels lie in these cells, each 1 m farther than the last."""
    index = np.array([[row * SHAPE[1] + col for row, col in cells]], np.int32)
    return np.ones(index.shape, bool), np.arange(1, len(cells) + 1, dtype=np.float32)[None], index


def test_a_detection_on_cold_cells_is_not_believed_and_one_hot_cell_is_enough() -> None:
    similarity = hills()
    hot = image(np.s_[20, 21])
    assert believed(*detection((50, 50), (51, 50)), is_hot=hot, similarity=similarity) is None
    found = believed(*detection((50, 50), (20, 21), (20, 20)), is_hot=hot, similarity=similarity)
    assert found is not None
    assert (found.rc, found.score, found.depth) == ((20, 21), pytest.approx(1.8), 2.0)


def test_a_target_lies_in_the_middle_of_the_hot_cells_that_a_detection_shows() -> None:
    found = believed(*detection((20, 24), (20, 22), (20, 20)), is_hot=image(np.s_[20, 20:25]), similarity=hills())
    assert found is not None
    assert (found.rc, found.depth) == ((20, 22), 1.0)


def test_a_target_is_dropped_when_its_cell_is_hot_no_more_and_replaced_only_for_a_tenth_more() -> None:
    target, hot = Target((20, 20), 1.5, 2.0), image(np.s_[20, 20])
    better, best = Target((30, 30), 1.6, 1.0), Target((31, 31), 1.66, 3.0)
    assert replaced(target, [], hot) == target
    assert replaced(target, [better], hot) == target
    assert replaced(target, [better, best], hot) == replaced(target, [best, better], hot) == best
    assert replaced(target, [], image(np.s_[60, 60])) is None
