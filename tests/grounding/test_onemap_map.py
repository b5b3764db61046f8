"""OneMap's map with known answers: confidence, projection, fusion of features and obstacles."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from grounding.agents.onemap.confidence import observation_confidence
from grounding.agents.onemap.feature_grid import UPSTREAM_THRESHOLD, FeatureGrid
from grounding.agents.onemap.projection import CellView, cells_of_pixels, view_of_cells
from sim.frames import T_start_camera, T_world_camera
from sim.render.raycast import Raycaster
from sim.types import Camera, GridSpec, Pose

from .two_rooms import two_room_scene

CAMERA = Camera(64, 48)
HERE = Pose((0.0, 0.0, 0.0), 0.0)
ALL = np.s_[:, :]


@pytest.mark.parametrize(
    ("depth", "expected"), [(0.5, 0.9636), (1.0, 1.0), (2.0, 0.8623), (3.0, 0.5529), (4.0, 0.2636), (5.0, 0.0934)]
)
def test_a_wall_straight_ahead_counts_by_its_distance(depth: float, expected: float) -> None:
    found = observation_confidence(np.full((48, 64), depth, np.float32), CAMERA.lens)
    np.testing.assert_allclose(found, expected, atol=1e-4)


def test_pixels_within_a_few_of_an_edge_of_depth_count_less_and_those_without_return_nothing() -> None:
    depth = np.full((48, 64), 1.0, np.float32)
    depth[:, 32:] = 3.0
    depth[:, 60] = 0.0
    row = observation_confidence(depth, CAMERA.lens)[20]
    assert row[20] == 1.0, "far from the edge"
    assert row[31] < 0.8, "beside the edge"
    assert row[50] == pytest.approx(0.5529, abs=1e-4)
    assert row[60] == 0.0
    assert not observation_confidence(np.zeros((48, 64), np.float32), CAMERA.lens).any()


def direct(
    cells: NDArray[np.int32], confidence: NDArray[np.float32], patches: NDArray[np.float32]
) -> dict[int, NDArray[np.float64]]:
    """The literal form: one vector per pixel by bilinear resizing, then weighted means per cell."""
    (height, width), (rows, cols, _) = cells.shape, patches.shape
    v = np.clip((np.arange(height) + 0.5) * rows / height - 0.5, 0, None)
    u = np.clip((np.arange(width) + 0.5) * cols / width - 0.5, 0, None)
    top, left = v.astype(int), u.astype(int)
    low, right = np.minimum(top + 1, rows - 1), np.minimum(left + 1, cols - 1)
    dv, du = (v - top)[:, None, None], (u - left)[None, :, None]
    wide = patches.astype(np.float64)
    pixels = (1 - dv) * ((1 - du) * wide[top][:, left] + du * wide[top][:, right])
    pixels += dv * ((1 - du) * wide[low][:, left] + du * wide[low][:, right])
    weights = confidence.astype(np.float64)
    return {
        int(cell): (weights[cells == cell][:, None] * pixels[cells == cell]).sum(axis=0) / weights[cells == cell].sum()
        for cell in np.unique(cells[cells >= 0])
    }


@pytest.mark.parametrize("size", [(6, 8), (5, 7), (1, 1)])
def test_cells_are_the_weighted_means_of_one_vector_per_pixel(size: tuple[int, int]) -> None:
    rng = np.random.default_rng(5)
    patches = rng.standard_normal((*size, 12)).astype(np.float32)
    patches /= np.linalg.norm(patches, axis=-1, keepdims=True)
    depth = rng.uniform(0.3, 4.0, (48, 64)).astype(np.float32)
    depth[rng.random(depth.shape) < 0.1] = 0
    confidence = rng.uniform(0, 1, depth.shape).astype(np.float32) * (depth > 0)
    grid = FeatureGrid().grid
    T = T_start_camera(HERE, Pose((0.3, 0.0, -0.2), 0.7), CAMERA)
    cells, blocked = cells_of_pixels(depth, confidence, T, CAMERA, grid)
    view = view_of_cells(cells, blocked, confidence, patches, 360_000)
    expected = direct(cells, confidence, patches)
    assert len(view.cells) == len(expected) > 100
    for cell, feature, mean in zip(view.cells.tolist(), view.features, view.confidence, strict=True):
        np.testing.assert_allclose(feature, expected[cell], atol=1e-6)
        assert mean == pytest.approx(float(confidence[cells == cell].mean()), abs=1e-6)


def located(pose: Pose, depth_m: float, pixel: tuple[int, int]) -> tuple[int, bool]:
    """Cell index and obstacle of the point that one pixel shows at this depth; all others show nothing."""
    depth = np.zeros((48, 64), np.float32)
    depth[pixel] = depth_m
    grid = GridSpec((-30.0, -30.0), 0.1, (600, 600))
    cells, blocked = cells_of_pixels(
        depth, (depth > 0).astype(np.float32), T_start_camera(HERE, pose, CAMERA), CAMERA, grid
    )
    return int(cells[pixel]), bool(blocked[pixel])


@pytest.mark.parametrize(
    ("yaw_deg", "rc"), [(0.0, (289, 300)), (90.0, (299, 289)), (180.0, (310, 299)), (-90.0, (300, 310))]
)
def test_points_ahead_fall_into_the_cell_whose_corner_is_below_them_in_all_four_directions(
    yaw_deg: float, rc: tuple[int, int]
) -> None:
    """1.05 m ahead and a little to the right; truncation would put two of the four one cell nearer to the start."""
    cell, blocked = located(Pose((0.0, 0.0, 0.0), math.radians(yaw_deg)), 1.05, (24, 32))
    assert divmod(cell, 600) == rc
    assert blocked


def test_points_far_below_the_floor_are_obstacles_where_their_ray_meets_it_and_the_floor_is_free() -> None:
    """The lowest row looks down by 23.5 rows over a focal length of 38.82: the floor is 1.454 m away."""
    stair, is_stair = located(HERE, 3.0, (47, 32))
    floor, is_floor = located(HERE, 1.45, (47, 32))
    assert divmod(stair, 600) == divmod(floor, 600) == (285, 300)
    assert (is_stair, is_floor) == (True, False)


def view(feature: tuple[float, ...], confidence: float, *, cell: int = 180_300, is_blocked: bool = False) -> CellView:
    return CellView(
        np.array([cell], np.int32),
        np.array([feature], np.float32),
        np.array([confidence], np.float32),
        np.array([is_blocked]),
    )


def test_confidences_add_and_opposite_features_cancel_by_their_difference() -> None:
    grid = FeatureGrid()
    grid.fuse(view((1.0, 0.0), 0.6))
    grid.fuse(view((-1.0, 0.0), 0.2))
    assert grid.confidence[300, 300] == pytest.approx(0.8)
    feature = grid.feature_at((300, 300))
    assert feature is not None
    np.testing.assert_allclose(feature, (0.5, 0.0), atol=1e-6)  # (.6 - .2) / (.6 + .2)
    assert grid.feature_at((0, 0)) is None
    assert grid.num_touched == 1


def test_an_obstacle_is_cleared_by_the_second_of_two_free_views() -> None:
    grid = FeatureGrid()
    found = []
    for is_blocked in (True, False, False):
        grid.fuse(view((1.0, 0.0), 0.5, is_blocked=is_blocked))
        found.append((float(grid.obstacle[300, 300]), bool(grid.is_occupied(ALL)[300, 300])))
    assert found == [(1.0, True), (0.5, True), (pytest.approx(1 / 3), False)]
    assert grid.is_navigable(ALL)[300, 300]


def test_a_cell_beside_an_obstacle_is_not_navigable_and_an_unseen_one_is() -> None:
    grid = FeatureGrid()
    grid.fuse(view((1.0, 0.0), 0.5, is_blocked=True))
    assert not grid.is_navigable(ALL)[299, 301]
    assert grid.is_navigable(ALL)[298, 300]


@pytest.mark.parametrize(("threshold", "looks"), [(UPSTREAM_THRESHOLD, 6), (1.0, 2)])
def test_a_cell_is_explored_after_six_looks_at_one_metre_or_two_with_turns_of_30_degrees(
    threshold: float, looks: int
) -> None:
    grid = FeatureGrid(threshold=threshold)
    for _ in range(looks - 1):
        grid.fuse(view((1.0, 0.0), 1.0))
    assert not grid.is_explored(ALL)[300, 300]
    grid.fuse(view((1.0, 0.0), 1.0))
    assert grid.is_explored(ALL)[300, 300]
    assert grid.is_checked(ALL)[300, 300]
    grid.set_query(np.array([0.0, 1.0], np.float32))
    assert grid.is_explored(ALL)[300, 300]
    assert not grid.is_checked(ALL)[300, 300]


def test_similarity_is_the_product_with_the_mean_feature_and_follows_a_new_query() -> None:
    grid = FeatureGrid()
    grid.set_query(np.array([1.0, 0.0], np.float32))
    grid.fuse(view((0.6, 0.8), 0.5))
    grid.fuse(view((1.0, 0.0), 0.5))
    assert grid.similarity[300, 300] == pytest.approx(0.8)
    grid.set_query(np.array([0.0, 1.0], np.float32))
    assert grid.similarity[300, 300] == pytest.approx(0.4)
    assert np.count_nonzero(grid.similarity) == 1


def test_the_first_view_makes_the_two_metres_around_the_start_explored() -> None:
    grid = FeatureGrid()
    patches = np.ones((2, 2, 1), np.float32)
    depth = np.full((48, 64), 1.55, np.float32)
    T = T_start_camera(HERE, HERE, CAMERA)
    cells = grid.add(depth, T, CAMERA, patches)
    assert grid.is_explored(ALL).sum() == 400
    assert grid.is_explored(ALL)[290:310, 290:310].all()
    assert set(np.unique(cells[cells >= 0] // 600)) == {284}, "a wall 1.55 m ahead"
    grid.add(depth, T, CAMERA, patches)
    assert grid.confidence[300, 300] == 10.0


def test_a_look_at_one_metre_outweighs_one_at_four() -> None:
    """The same piece of wall from both places: (1 - .2636) / (1 + .2636)."""
    grid = FeatureGrid()
    for z, depth, feature in ((2.95, 4.0, -1.0), (-0.05, 1.0, 1.0)):
        T = T_start_camera(HERE, Pose((0.0, 0.0, z), 0.0), CAMERA)
        grid.add(np.full((48, 64), depth, np.float32), T, CAMERA, np.full((2, 2, 1), feature, np.float32))
    assert grid.confidence[289, 300] == pytest.approx(1.2636, abs=1e-4)
    assert grid.feature_at((289, 300)) == pytest.approx([0.5828], abs=1e-4)


def test_a_spin_of_30_degree_turns_explores_cells_outside_the_start_area() -> None:
    grid, start, renderer = FeatureGrid(), Pose((2.0, 0.0, 2.0), 0.0), Raycaster(two_room_scene().mesh)
    for turn in range(12):
        pose = Pose(start.position, turn * math.pi / 6)
        T = T_start_camera(start, pose, CAMERA)
        grid.add(renderer.depth(T_world_camera(pose, CAMERA), CAMERA), T, CAMERA, np.ones((2, 2, 1), np.float32))
    outside = grid.is_explored(ALL).copy()
    outside[290:310, 290:310] = False
    upstream = grid.confidence * UPSTREAM_THRESHOLD > 1
    upstream[290:310, 290:310] = False
    assert int(outside.sum()) > 500, "of 1,600 cells of the room"
    assert not upstream.any(), "its threshold needs a spin of 72 turns"
