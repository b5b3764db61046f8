"""Storeys of a growing map: floors are found on the way, frames on stairs wait, points belong to the floor below."""

import numpy as np
import pytest

from grounding.maps.storeys import Storeys, ViewOptions, floors_of_frames, points_at
from grounding.maps.view_quality import bearing_weight, distance_weight, patches_of
from sim.frames import T_world_camera
from sim.tasks.observers import FREE
from sim.types import Camera, Frame, Pose

CAMERA = Camera(width=80, height=60)


def frame(x: float, feet: float, z: float = 0.0, *, depth: float = 2.0) -> Frame:
    """A view along -z of a wall `depth` metres away."""
    T = T_world_camera(Pose((x, feet, z), 0.0), CAMERA)
    return Frame(np.zeros((60, 80, 3), np.uint8), np.full((60, 80), depth, np.float32), T, CAMERA)


def feet_of(frames: list[Frame]) -> list[float]:
    return [round(float(one.T_world_camera[1, 3]) - 0.88, 3) for one in frames]


def test_a_robot_that_climbs_opens_a_storey_only_when_it_moves_on_level_floor() -> None:
    storeys = Storeys(ViewOptions(batch=1))
    stairs = [(0.25 * step, 0.15 * step) for step in range(1, 20)]  # to 2.85 m
    assert feet_of(storeys.take(frame(0.0, 0.0))) == [0.0]
    out = [feet_of(storeys.take(frame(x, feet))) for x, feet in stairs]
    assert out[:9] == [[round(0.15 * step, 3)] for step in range(1, 10)]
    assert out[9:] == [[]] * 10  # from 1.5 m above the floor on, the storey is not known yet
    assert storeys.take(frame(5.0, 2.85)) == []
    assert storeys.take(frame(5.25, 2.85)) == []
    assert len(storeys.take(frame(5.5, 2.85))) == 13
    assert storeys.floors == pytest.approx([0.0, 2.85], abs=0.02)
    assert feet_of(storeys.take(frame(4.0, 1.4))) == [1.4]
    assert storeys.num_frames == 1 + 19 + 3 + 1


def test_turning_on_a_stair_opens_no_storey_and_the_waiting_frames_go_to_the_floor_below() -> None:
    storeys = Storeys(ViewOptions(batch=1))
    storeys.take(frame(0.0, 0.0))
    assert all(storeys.take(frame(3.0, 1.8)) == [] for _ in range(12))
    assert len(storeys.rest()) == 12
    assert storeys.floors == [0.0]
    assert storeys.num_frames == 13


def test_a_robot_that_goes_down_opens_a_storey_below() -> None:
    storeys = Storeys(ViewOptions(batch=100))
    for x in range(4):
        storeys.take(frame(float(x), 0.0))
    for x in range(4):
        storeys.take(frame(float(x), -2.7))
    assert len(storeys.rest()) == 8
    assert storeys.floors == pytest.approx([0.0, -2.7])
    assert storeys.index_of(np.array([-1.0, -2.9, 0.1, -4.3])).tolist() == [1, 1, 0, -1]


def test_points_belong_to_the_floor_below_and_have_the_weights_of_onemap_and_vlfm() -> None:
    storeys = Storeys(ViewOptions(floors=(2.8, 0.0)))
    heights = np.array([-1.6, -1.4, 0.0, 2.4, 2.49, 2.51, 2.8, 9.0])
    assert storeys.index_of(heights).tolist() == [-1, 0, 0, 0, 0, 1, 1, 1]
    points = points_at(frame(1.0, 0.5, 3.0), np.array([[29, 39], [30, 40], [0, 0]]))
    middle = points[:2].mean(axis=0)
    assert middle == pytest.approx([1.0, 0.5 + 0.88, 1.0])
    assert points[2, 0] < 0  # the upper left pixel lies to the left
    assert points[2, 1] > 1.38  # and above the camera
    assert points[2, 2] == pytest.approx(1.0)
    assert distance_weight(np.array([0.5, 1, 2, 3, 4, 5])) == pytest.approx(
        [0.964, 1, 0.862, 0.553, 0.264, 0.093], abs=6e-4
    )
    half = np.arctan(40 / CAMERA.focal)
    columns = 40 + CAMERA.focal * np.tan(np.array([0, 0.25, 0.5, 1]) * half)
    assert bearing_weight(columns, CAMERA) == pytest.approx([1, 0.8902, 0.625, 0.25], abs=1e-4)


def test_a_view_extends_the_occupancy_of_its_own_storey_and_missing_returns_block_nothing() -> None:
    storeys = Storeys(ViewOptions(floors=(0.0, 3.0)))
    storeys.take(frame(0.0, 3.0, depth=4.0))
    storeys.rest()
    assert (storeys.occupancy(0).cells == FREE).sum() == 0
    assert (storeys.occupancy(1).cells == FREE).sum() > 30
    storeys = Storeys(ViewOptions(floors=(0.0,)))
    storeys.take(frame(0.0, 0.0, depth=0.0))
    storeys.rest()
    assert not storeys.occupancy(0).cells.any()


def test_a_patch_lies_on_the_surface_that_has_its_median_depth() -> None:
    view = frame(0.0, 0.0)
    depth = view.depth_m.copy()
    depth[:, :4] = 1.0  # two fifths of the first patch are nearer
    depth[:, 70:] = 0.0
    depth[:, 60:70] = 6.0
    changed = Frame(view.rgb, depth, view.T_world_camera, view.camera)
    patches = patches_of(changed, (6, 8), max_depth=5.0)
    points, weights = patches.points.reshape(6, 8, 3), patches.weights.reshape(6, 8)
    assert points[:, :6, 2] == pytest.approx(np.full((6, 6), -2.0))
    assert (weights[:, 6:] == 0).all()
    assert np.isnan(points[:, 6:]).all()
    assert weights[0, 1] == pytest.approx(0.862, abs=0.001)
    assert weights[0, 0] == pytest.approx(0.862 * 0.6, abs=0.08)


def over_a_table(*, floor: bool = True, mirrored: bool = False) -> Frame:
    """A view from 1.3 m down onto a table of 0.75 m, with a strip of floor beside it; `mirrored`: a spot 1 m below."""
    T = T_world_camera(Pose((0.0, 1.3 - CAMERA.mount_height, 0.0), 0.0, -0.9), CAMERA)
    rows, cols = np.mgrid[: CAMERA.height, : CAMERA.width]
    fx, fy, cx, cy = CAMERA.lens
    rays_camera = np.stack([(cols + 0.5 - cx) / fx, (rows + 0.5 - cy) / fy, np.ones(rows.shape)], axis=-1)
    rays = rays_camera @ T[:3, :3].T
    down = -np.minimum(rays[..., 1], -0.01)
    depth = (1.3 - 0.75) / down
    depth[cols >= 66] = 1.3 / down[cols >= 66] if floor else 0.0
    if mirrored:
        depth[50:54, 70:74] = 2.3 / down[50:54, 70:74]
    depth[depth > 4.0] = 0.0
    return Frame(np.zeros((60, 80, 3), np.uint8), depth.astype(np.float32), T, CAMERA)


def test_a_table_that_fills_the_view_is_not_the_floor_and_a_mirrored_spot_below_it_neither() -> None:
    view = over_a_table(mirrored=True)
    pixels = points_at(view, np.argwhere(view.depth_m > 0))[:, 1]
    assert (np.abs(pixels - 0.75) < 0.01).sum() > 4 * (np.abs(pixels) < 0.01).sum()
    assert floors_of_frames([view]) == pytest.approx((0.0,), abs=0.01)
    assert floors_of_frames([over_a_table(floor=False)]) == pytest.approx((0.75,), abs=0.01)
