"""VLFM's value map: its known answers, and the same result as over the whole grid."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from grounding.agents.vlfm.agent import chosen_frontier
from grounding.agents.vlfm.value_map import ValueMap, cone_confidence, depth_row, fuse, most_valuable
from sim.frames import T_world_camera
from sim.types import Camera, GridSpec, Pose

GRID = GridSpec((-25.0, -25.0), 0.05, (1000, 1000))
CAMERA = Camera(64, 48)
HALF = math.radians(39.5)


def whole_grid_add(
    values: NDArray, confidence: NDArray, depth: NDArray, pose: Pose, camera: Camera, score: float
) -> tuple[NDArray, NDArray]:
    """The literal form: every cell of the grid is computed in numpy, none is left out."""
    xz = GRID.xz_from_rc(np.moveaxis(np.mgrid[:1000, :1000], 0, -1))
    dx, dz = xz[..., 0] - pose.position[0], xz[..., 1] - pose.position[2]
    forward = -dx * math.sin(pose.yaw) - dz * math.cos(pose.yaw)
    aside = dx * math.cos(pose.yaw) - dz * math.sin(pose.yaw)
    half = math.radians(camera.hfov_deg) / 2
    bearing = np.arctan2(aside, forward)
    column = np.clip((bearing + half) / (2 * half) * (camera.width - 1) + 0.5, 0, camera.width - 1).astype(int)
    far = np.clip(np.where(depth == 0, 5.0, depth), 0.5, 5.0).max(axis=0)
    visible = (forward**2 + aside**2 <= 25) & (np.abs(bearing) <= half) & (forward <= far[column])
    new = np.where(visible, 0.25 + 0.75 * np.cos(bearing / half * math.pi / 2) ** 2, 0.0)
    new[(new < 0.35) & (new < confidence)] = 0
    total = confidence + new
    with np.errstate(invalid="ignore"):
        fused = np.nan_to_num((confidence * values + new * score) / total)
        trust = np.nan_to_num((confidence.astype(float) ** 2 + new**2) / total)
    return fused.astype(np.float32), trust.astype(np.float32)


def views() -> list[tuple[Pose, NDArray[np.float32], float]]:
    """Places, depth and scores of six pictures; the last two look over the grid's edge."""
    rng = np.random.default_rng(4)
    places = [
        (0.0, 0.0, 0.0),
        (0.4, 0.0, 0.5),
        (-1.0, 1.0, 2.2),
        (3.0, -2.0, -2.9),
        (24.0, 24.5, 3.0),
        (-24.9, 0.0, 1.6),
    ]
    return [
        (
            Pose((x, 0.0, z), yaw),
            rng.uniform(0.0, 6.0, (48, 64)).astype(np.float32) * (rng.random((48, 64)) > 0.01),
            float(rng.uniform(-0.4, 0.4)),
        )
        for x, z, yaw in places
    ]


@pytest.mark.parametrize(("share", "expected"), [(0, 1.0), (0.25, 0.8902), (0.5, 0.625), (1, 0.25), (-0.5, 0.625)])
def test_confidence_falls_from_the_middle_of_the_picture_to_a_quarter_at_its_sides(
    share: float, expected: float
) -> None:
    assert cone_confidence(share * HALF, HALF) == pytest.approx(expected, abs=5e-5)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ((0.2, 1.0), (0.4, 0.5), (0.266667, 0.833333)),
        ((0.5, 0.2), (1.0, 0.4), (0.833333, 0.333333)),
        ((0.2, 0.5), (0.9, 0.3), (0.2, 0.5)),
        ((0.0, 0.0), (0.9, 0.3), (0.9, 0.3)),
        ((0.0, 0.0), (0.9, 0.0), (0.0, 0.0)),
        ((-0.2, 1.0), (-0.4, 0.5), (-0.266667, 0.833333)),
    ],
)
def test_scores_are_weighted_by_confidence_and_a_weak_look_never_changes_a_strong_one(
    old: tuple[float, float], new: tuple[float, float], expected: tuple[float, float]
) -> None:
    assert fuse(*old, *new, 0) == pytest.approx(expected, abs=1e-6)


def test_replace_takes_the_new_score_and_equal_weighting_the_mean() -> None:
    assert fuse(0.2, 1.0, 0.4, 0.3, 1) == (0.4, 0.3)
    assert fuse(0.2, 1.0, 0.4, 0.0, 1) == (0.2, 1.0)
    assert fuse(0.2, 1.0, 0.4, 0.3, 2) == pytest.approx((0.3, 1.0))
    assert fuse(0.2, 0.3, 0.4, 0.0, 2) == pytest.approx((0.2, 1.0))


def test_the_window_gives_the_values_of_the_whole_grid() -> None:
    found = ValueMap(GRID)
    values, confidence = np.zeros((1000, 1000), np.float32), np.zeros((1000, 1000), np.float32)
    for pose, depth, score in views():
        found.add(depth, T_world_camera(pose, CAMERA), CAMERA, [score])
        values, confidence = whole_grid_add(values, confidence, depth, pose, CAMERA, score)
    assert int((confidence > 0).sum()) > 20_000
    np.testing.assert_allclose(found.values[..., 0], values, atol=1e-7, rtol=0)
    np.testing.assert_allclose(found.confidence, confidence, atol=1e-7, rtol=0)


def test_nothing_behind_a_wall_is_seen_and_no_return_is_far() -> None:
    depth = np.full((48, 64), 2.0, np.float32)
    found = ValueMap(GRID)
    found.add(depth, T_world_camera(Pose((0.0, 0.0, 0.0), 0.0), CAMERA), CAMERA, [0.3])
    seen = found.confidence > 0
    assert seen[500 - 39, 500]
    assert not seen[500 - 42, 500]
    depth[10, 3], depth[:, 5] = 0.0, 0.1
    assert depth_row(depth)[[2, 3, 5]].tolist() == [2.0, 5.0, 0.5]


def test_two_texts_have_values_of_their_own_and_the_first_counts_if_it_fits_a_frontier() -> None:
    found = ValueMap(GRID, num_texts=2)
    found.add(np.zeros((48, 64), np.float32), T_world_camera(Pose((0.0, 0.0, 0.0), 0.0), CAMERA), CAMERA, [0.1, 0.3])
    (values,) = found.values_at(np.array([[0.0, -3.0]]))
    assert values == pytest.approx([0.1, 0.3])
    both = np.array([[0.1, 0.3], [0.2, 0.2]])
    assert most_valuable(both, threshold=0.2).tolist() == [0.1, 0.2]
    assert most_valuable(both, threshold=0.21).tolist() == [0.3, 0.2]


def test_the_value_of_a_place_is_the_median_of_the_seen_cells_and_minus_infinity_where_none_is() -> None:
    found = ValueMap(GRID)
    for offset, value in ((0, -0.5), (3, -0.2), (9, 0.4)):
        found.values[500, 500 + offset, 0], found.confidence[500, 500 + offset] = value, 0.5
    found.values[500, 511, 0], found.confidence[500, 511] = 0.9, 0.5  # 11 cells away
    assert found.values_at(np.array([[0.01, 0.01], [9.0, 9.0]]))[:, 0] == pytest.approx([-0.2, -np.inf])


def test_a_disc_at_or_beyond_the_edge_of_the_grid_holds_only_cells_of_the_grid() -> None:
    found = ValueMap(GRID)
    found.values[0, 9, 0], found.confidence[0, 9] = 0.7, 1.0
    found.values[9, 9, 0], found.confidence[9, 9] = -0.7, 1.0  # 12.7 cells from the corner
    corner = GRID.xz_from_rc(np.array([[0, 0], [-3, 5], [-40, -40], [999, 999], [1050, 9]]))
    assert found.values_at(corner)[:, 0] == pytest.approx([0.7, 0.7, -np.inf, -np.inf, -np.inf])


def test_an_encoder_with_negative_cosines_gives_the_same_order_as_with_a_constant_added() -> None:
    negative, shifted = ValueMap(GRID), ValueMap(GRID)
    for pose, depth, score in views()[:4]:
        negative.add(depth, T_world_camera(pose, CAMERA), CAMERA, [score - 0.5])
        shifted.add(depth, T_world_camera(pose, CAMERA), CAMERA, [score + 0.5])
    rng = np.random.default_rng(1)
    places = rng.uniform(-4, 4, (60, 2))
    first, second = negative.values_at(places)[:, 0], shifted.values_at(places)[:, 0]
    assert np.isfinite(first).sum() > 20
    assert first[np.isfinite(first)] + 1.0 == pytest.approx(second[np.isfinite(second)], abs=1e-6)
    assert (np.argsort(first, kind="stable") == np.argsort(second, kind="stable")).all()


@pytest.mark.parametrize(("loss", "expected"), [(0.0099, 0), (0.0101, 1)])
def test_the_last_frontier_is_kept_until_its_value_has_fallen_by_a_hundredth(loss: float, expected: int) -> None:
    places = np.array([[0.0, 0.0], [3.0, 0.0]])
    values = np.array([0.3 - loss, 0.9])
    assert chosen_frontier(places, values, last=(0.0, 0.0), last_value=0.3) == expected


def test_a_frontier_within_half_a_metre_of_the_last_takes_its_place_and_one_farther_off_does_not() -> None:
    values = np.array([0.9, 0.3])
    assert chosen_frontier(np.array([[3.0, 0.0], [0.5, 0.0]]), values, last=(0.0, 0.0), last_value=0.3) == 1
    assert chosen_frontier(np.array([[3.0, 0.0], [0.51, 0.0]]), values, last=(0.0, 0.0), last_value=0.3) == 0
    assert chosen_frontier(np.array([[3.0, 0.0], [0.5, 0.0]]), values, last=None, last_value=-math.inf) == 0


def test_frontiers_of_equal_value_do_not_take_turns() -> None:
    places, values = np.array([[0.0, 0.0], [3.0, 0.0]]), np.array([0.2, 0.2])
    first = chosen_frontier(places, values, last=None, last_value=-math.inf)
    assert first == 0
    last = (float(places[first, 0]), float(places[first, 1]))
    assert chosen_frontier(places[::-1], values, last=last, last_value=0.2) == 1
