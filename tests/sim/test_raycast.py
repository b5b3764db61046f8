"""The raycaster on one or two rectangles: depths, colours, ids and rays that are known by hand."""

import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from sim.errors import SceneError
from sim.frames import T_world_camera
from sim.types import Camera, Pose
from sim.world.raycast import SKY_RGB, Raycaster
from tests.sim.meshes import box, floor, mesh_of

LOOK_DOWN = Pose((0.0, 0.0, 0.0), 0.0, -math.pi / 2)
"""Image right = +x, image down = +z; the camera is 0.88 m up."""


def test_depth_is_planar_and_0_where_nothing_is_hit():
    wall = mesh_of(*box((-1.0, -5.0, -2.5), (1.0, 5.0, -2.0)))
    frame = Raycaster(wall).render(T_world_camera(Pose((0, 0, 0), 0.0), Camera(90, 60, 90.0)), Camera(90, 60, 90.0))
    # Focal length 45 px, so the wall 2 m away spans 45 columns; every hit has depth 2, also at the picture's edge.
    assert frame.depth_m.dtype == np.float32
    np.testing.assert_allclose(frame.depth_m[:, 23:67], 2.0, atol=1e-5)
    assert (frame.depth_m[:, :22] == 0).all()
    assert (frame.depth_m[:, 68:] == 0).all()
    assert tuple(frame.rgb[0, 0]) == SKY_RGB
    assert frame.instance_ids[0, 0] == 0


def test_flat_colours_and_instances_are_those_of_the_first_face_hit():
    mesh = mesh_of(floor(-5, -5, 5, 5, rgb=(10, 20, 30)), *box((-0.1, 0.2, -0.1), (0.1, 0.4, 0.1), instance=7))
    frame = Raycaster(mesh).render(T_world_camera(LOOK_DOWN, Camera()), Camera())
    assert tuple(frame.rgb[240, 320]) == (200, 30, 30)
    assert frame.instance_ids[240, 320] == 7
    assert frame.depth_m[240, 320] == pytest.approx(0.48, abs=1e-5)
    assert tuple(frame.rgb[0, 0]) == (10, 20, 30)
    assert frame.instance_ids[0, 0] == 0
    assert frame.depth_m[0, 0] == pytest.approx(0.88, abs=1e-5)


def test_the_top_left_texel_lies_at_texture_coordinate_0_0():
    image = np.zeros((2, 2, 3), np.uint8)
    image[0, 0], image[0, 1], image[1, 0] = (255, 0, 0), (0, 255, 0), (0, 0, 255)
    mesh = mesh_of(floor(-1, -1, 1, 1), textures=(image,), texture=0)
    frame = Raycaster(mesh).render(T_world_camera(LOOK_DOWN, Camera()), Camera())
    f = Camera().focal / 0.88
    seen = {(x, z): tuple(frame.rgb[round(240 + f * z), round(320 + f * x)]) for x in (-0.5, 0.5) for z in (-0.5, 0.5)}
    assert seen[-0.5, -0.5][0] > 250
    assert seen[0.5, -0.5][1] > 250
    assert seen[-0.5, 0.5][2] > 250
    assert max(seen[0.5, 0.5]) < 5


def test_texels_are_blended_and_repeat_beyond_the_border():
    image = np.array([[[0, 0, 0], [200, 200, 200]]], np.uint8)
    mesh = mesh_of(floor(-1, -1, 1, 1), textures=(image,), texture=0)
    mesh.face_uv[..., 0] += 3.0  # whole repeats change nothing
    camera = Camera(hfov_deg=120.0)
    frame = Raycaster(mesh).render(T_world_camera(LOOK_DOWN, camera), camera)
    f = camera.focal / 0.88
    row = frame.rgb[240, :, 0].astype(int)
    assert row[round(320 + f * -0.5)] == pytest.approx(0, abs=2)
    assert row[round(320 + f * 0.5)] == pytest.approx(200, abs=2)
    assert row[320] == pytest.approx(100, abs=2)  # half way between the two texels
    assert row[round(320 + f * 0.995)] == pytest.approx(101, abs=2)  # ... and round the repeat


def test_cast_gives_range_position_and_face_of_the_first_hit():
    raycaster = Raycaster(mesh_of(floor(-5, -5, 5, 5), floor(-1, -1, 1, 1, y=1.0)))
    origins = np.array([[0.0, 3, 0], [2, 3, 0], [0, 3, 0], [0, 3, 0]])
    directions = np.array([[0.0, -10, 0], [0, -1, 0], [0, 1, 0], [0, 0, 0]])
    hits = raycaster.cast(origins, directions)
    np.testing.assert_allclose(hits.range_m, [2, 3, np.inf, np.inf], atol=1e-6)
    np.testing.assert_allclose(hits.positions[:2], [[0, 1, 0], [2, 0, 0]], atol=1e-6)
    assert np.isnan(hits.positions[2:]).all()
    assert hits.face_ids[0] in (2, 3)
    assert hits.face_ids[1] in (0, 1)
    assert list(hits.face_ids[2:]) == [-1, -1]


def test_no_rays_give_no_hits():
    hits = Raycaster(mesh_of(floor(0, 0, 1, 1))).cast(np.empty((0, 3)), np.empty((0, 3)))
    assert hits.range_m.shape == (0,)
    assert hits.positions.shape == (0, 3)


def test_several_threads_get_the_frames_that_one_thread_gets():
    raycaster = Raycaster(mesh_of(floor(-5, -5, 5, 5), *box((1, 0, 1), (2, 2, 2)), *box((-3, 0, -4), (-2, 1, -2))))
    camera = Camera(160, 120)
    views = [T_world_camera(Pose((0, 0, 0), yaw), camera) for yaw in np.linspace(0, 6, 24)]
    alone = [raycaster.render(view, camera) for view in views]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda view: raycaster.render(view, camera), views))
    for one, other in zip(alone, together, strict=True):
        np.testing.assert_array_equal(one.rgb, other.rgb)
        np.testing.assert_array_equal(one.depth_m, other.depth_m)


def test_a_mesh_without_faces_is_refused():
    empty = mesh_of(floor(0, 0, 1, 1)).select(np.zeros(2, bool))
    with pytest.raises(SceneError, match="without faces"):
        Raycaster(empty)
