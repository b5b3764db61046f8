"""VLFM's object cloud: thin masks, trust, retraction, and the point to walk to."""

import numpy as np
import pytest
from numpy.typing import NDArray

from grounding.agents.vlfm.density_clusters import density_clusters
from grounding.agents.vlfm.object_cloud import TRUSTED, ObjectCloud, eroded, is_at_side, points_of
from sim.frames import T_world_camera
from sim.tasks.observers import Detection
from sim.types import Camera, Frame, Pose

CAMERA = Camera(320, 240)


def frame_of(depth: float, *, position: tuple[float, float, float] = (0.0, 0.0, 0.0), yaw: float = 0.0) -> Frame:
    """A view of a wall at this depth."""
    T = T_world_camera(Pose(position, yaw), CAMERA)
    return Frame(np.zeros((240, 320, 3), np.uint8), np.full((240, 320), depth, np.float32), T, CAMERA)


def mask_of(left: int, right: int, top: int = 100, bottom: int = 160) -> NDArray[np.bool_]:
    mask = np.zeros((240, 320), bool)
    mask[top:bottom, left:right] = True
    return mask


def detection(left: int, right: int, score: float = 0.9) -> Detection:
    return Detection("cup", (left, 100, right, 160), score)


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def test_a_mask_10_pixels_wide_vanishes_and_one_of_11_leaves_one_column() -> None:
    assert not eroded(mask_of(100, 110)).any()
    left = eroded(mask_of(100, 111))
    assert (int(left.sum()), np.flatnonzero(left.any(axis=0)).tolist()) == (50, [105])
    assert not eroded(np.zeros((240, 320), bool)).any()
    assert int(eroded(mask_of(0, 11)).sum()) == 6 * 50, "nothing is taken off at the picture's side"


def test_a_detection_nearer_than_a_metre_is_ignored() -> None:
    assert points_of(frame_of(0.9), mask_of(150, 200), rng=rng()) is None
    seen = points_of(frame_of(1.1), mask_of(150, 200), rng=rng())
    assert seen is not None
    assert (seen.marks == TRUSTED).all()
    assert seen.points[:, 2] == pytest.approx(-1.1)


@pytest.mark.parametrize(
    ("left", "right", "expected"),
    [(16, 106, True), (17, 106, False), (16, 107, False), (212, 304, True), (212, 303, False), (211, 320, False)],
)
def test_only_masks_in_a_side_third_that_touch_the_outer_twentieth_are_at_the_side(
    left: int, right: int, expected: bool
) -> None:
    assert is_at_side(mask_of(left, right)) == expected


def test_points_at_the_side_or_beyond_475_metres_are_not_trusted() -> None:
    at_side = points_of(frame_of(2.0), mask_of(0, 60), rng=rng())
    far = points_of(frame_of(4.9), mask_of(140, 200), rng=rng())
    near = points_of(frame_of(4.7), mask_of(140, 200), rng=rng())
    assert at_side is not None
    assert far is not None
    assert near is not None
    for seen in (at_side, far):
        assert len(np.unique(seen.marks)) == 1
        assert 0 < seen.marks[0] < 1
    assert (near.marks == TRUSTED).all()


def test_a_far_detection_is_forgotten_when_the_robot_faces_it_within_two_and_a_half_metres() -> None:
    cloud = ObjectCloud()
    cloud.add(frame_of(4.9), [(detection(140, 200), mask_of(140, 200))], rng=rng())
    cloud.retract(frame_of(5.0, position=(0.0, 0.0, -2.2)))  # 2.7 m away
    cloud.retract(frame_of(5.0, position=(0.0, 0.0, -2.5), yaw=np.pi))  # looks away
    assert len(cloud.points) > 100
    cloud.retract(frame_of(5.0, position=(0.0, 0.0, -2.5)))  # 2.4 m away
    assert len(cloud.points) == 0
    assert cloud.goal((0.0, 0.0)) is None


def test_trusted_points_are_never_forgotten() -> None:
    cloud = ObjectCloud()
    cloud.add(frame_of(4.0), [(detection(140, 200), mask_of(140, 200))], rng=rng())
    count = len(cloud.points)
    cloud.retract(frame_of(5.0, position=(0.0, 0.0, -2.0)))
    assert len(cloud.points) == count > 100


def test_trusted_points_are_goals_before_nearer_ones_that_are_not() -> None:
    cloud = ObjectCloud()
    cloud.points = np.array([[0.0, 0.5, -1.0], [0.0, 0.5, -3.0], [0.0, 0.5, -4.0]])
    cloud.marks, cloud.middles = np.array([0.5, TRUSTED, TRUSTED]), cloud.points
    assert cloud.goal((0.0, 0.0)) == (0.0, 0.5, -3.0)
    assert cloud.nearest((0.0, 0.0), most=2)[:, 2].tolist() == [-3.0, -4.0]
    cloud.points, cloud.marks, cloud.middles = cloud.points[:1], cloud.marks[:1], cloud.middles[:1]
    assert cloud.goal((0.0, 0.0)) == (0.0, 0.5, -1.0)


def test_the_goal_is_the_middle_of_what_one_view_showed_of_the_nearest_thing() -> None:
    cloud = ObjectCloud()
    wide, left = mask_of(120, 300), mask_of(0, 60)  # without 5 pixels a side, columns 125 to 294 at 2 m
    cloud.add(frame_of(2.0), [(detection(120, 300), wide), (detection(0, 60), left)], rng=rng())
    goal = cloud.goal((1.0, -1.0))
    assert goal is not None
    assert goal[0] == pytest.approx((210 - 160) / CAMERA.lens[0] * 2.0, abs=0.02)
    assert goal[2] == pytest.approx(-2.0)


@pytest.mark.parametrize(
    ("z", "moved", "is_kept"), [(-1.0, 0.09, True), (-1.0, 0.11, False), (-3.0, 0.45, True), (-3.0, 0.55, False)]
)
def test_a_goal_stays_while_the_nearest_point_moves_little(z: float, moved: float, is_kept: bool) -> None:
    cloud = ObjectCloud()
    cloud.marks = np.array([TRUSTED])
    cloud.points = cloud.middles = np.array([[0.0, 0.0, z]])
    first = cloud.goal((0.0, 0.0))
    cloud.points = cloud.middles = np.array([[moved, 0.0, z]])
    assert (cloud.goal((0.0, 0.0)) == first) == is_kept


def test_the_order_of_detections_changes_nothing() -> None:
    found = [(detection(left, left + 60, score), mask_of(left, left + 60)) for left, score in ((0, 0.7), (130, 0.9))]
    found.append((detection(255, 320), mask_of(255, 320)))
    clouds = []
    for order in ([0, 1, 2], [2, 0, 1]):
        cloud = ObjectCloud()
        placed = cloud.add(frame_of(2.0), [found[index] for index in order], rng=np.random.default_rng(7))
        clouds.append((cloud.points.tobytes(), cloud.marks.tobytes(), placed))
    assert clouds[0] == clouds[1]
    assert all(each.position is not None for each in clouds[0][2])


def test_the_draw_of_points_depends_on_the_generator_alone() -> None:
    big = mask_of(60, 260, 20, 220)
    first, again, other = (points_of(frame_of(2.0), big, rng=np.random.default_rng(seed)) for seed in (3, 3, 4))
    assert first is not None
    assert again is not None
    assert other is not None
    assert len(first.points) == 5000
    assert first.points.tobytes() == again.points.tobytes() != other.points.tobytes()


def literal_clusters(points: NDArray[np.float64], reach: float, least: int) -> NDArray[np.int64]:
    """DBSCAN as defined, with all distances."""
    near = np.linalg.norm(points[:, None] - points[None], axis=2) <= reach
    core = near.sum(axis=1) >= least
    labels = np.full(len(points), -1)
    for first in np.flatnonzero(core):
        if labels[first] >= 0:
            continue
        cluster = int(labels.max()) + 1
        stack = [first]
        while stack:
            at = stack.pop()
            if labels[at] < 0:
                labels[at] = cluster
                stack.extend(np.flatnonzero(near[at] & (labels < 0)) if core[at] else [])
    return labels


@pytest.mark.parametrize("seed", range(5))
def test_clusters_are_those_of_dbscan(seed: int) -> None:
    draw = np.random.default_rng(seed)
    blobs = [draw.normal(middle, 0.12, (120, 3)) for middle in draw.uniform(-1, 1, (5, 3))]
    points = np.concatenate([*blobs, draw.uniform(-2, 2, (200, 3))])
    draw.shuffle(points)
    found = density_clusters(points, reach=0.2, least=25)
    assert found.max() >= 1
    assert (found == literal_clusters(points, 0.2, 25)).all()


def test_a_cluster_needs_enough_points_and_two_apart_stay_apart() -> None:
    points = np.zeros((100, 3))
    assert (density_clusters(points, reach=0.2, least=100) == 0).all()
    assert (density_clusters(points[:99], reach=0.2, least=100) == -1).all()
    both = np.concatenate([points, points + np.array([0.21, 0, 0]), points[:50]])
    assert np.bincount(density_clusters(both, reach=0.2, least=100)).tolist() == [150, 100]
    assert len(density_clusters(points[:0], reach=0.2, least=100)) == 0
