"""The raycaster on small meshes: depths, colours, ids and rays computed by hand, with both backends."""

import math
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.errors import SceneError
from sim.frames import T_world_camera
from sim.mesh import FACE_IDS, VERTEX_COLOURS, IdImages
from sim.render import embree
from sim.render.raycast import SKY_RGB, Raycaster
from sim.types import Camera, Pose

from .meshes import box, floor, mesh_of
from .raycasters import LOOK_DOWN, assert_same, has_embree, seen_from_above, soup


def test_depth_is_planar_and_0_where_nothing_is_hit(make_raycaster):
    wall = mesh_of(*box((-1.0, -5.0, -2.5), (1.0, 5.0, -2.0)))
    frame = make_raycaster(wall).render(
        T_world_camera(Pose((0, 0, 0), 0.0), Camera(90, 60, 90.0)), Camera(90, 60, 90.0)
    )
    # The focal length is 45 px, so the wall 2 m away spans 45 columns; every hit has depth 2.
    assert frame.depth_m.dtype == np.float32
    np.testing.assert_allclose(frame.depth_m[:, 23:67], 2.0, atol=1e-5)
    assert (frame.depth_m[:, :22] == 0).all()
    assert (frame.depth_m[:, 68:] == 0).all()
    assert tuple(frame.rgb[0, 0]) == SKY_RGB
    assert frame.instance_ids[0, 0] == 0


def test_flat_colours_and_instances_are_those_of_the_first_face_hit(make_raycaster):
    mesh = mesh_of(floor(-5, -5, 5, 5, rgb=(10, 20, 30)), *box((-0.1, 0.2, -0.1), (0.1, 0.4, 0.1), instance=7))
    frame = make_raycaster(mesh).render(T_world_camera(LOOK_DOWN, Camera()), Camera())
    assert tuple(frame.rgb[240, 320]) == (200, 30, 30)
    assert frame.instance_ids[240, 320] == 7
    assert frame.depth_m[240, 320] == pytest.approx(0.48, abs=1e-5)
    assert tuple(frame.rgb[0, 0]) == (10, 20, 30)
    assert frame.instance_ids[0, 0] == 0
    assert frame.depth_m[0, 0] == pytest.approx(0.88, abs=1e-5)


def test_cast_gives_range_position_and_face_of_the_first_hit(make_raycaster):
    raycaster = make_raycaster(mesh_of(floor(-5, -5, 5, 5), floor(-1, -1, 1, 1, y=1.0)))
    origins = np.array([[0.0, 3, 0], [2, 3, 0], [0, 3, 0], [0, 3, 0]])
    directions = np.array([[0.0, -10, 0], [0, -1, 0], [0, 1, 0], [0, 0, 0]])
    hits = raycaster.cast(origins, directions)
    np.testing.assert_allclose(hits.range_m, [2, 3, np.inf, np.inf], atol=1e-6)
    np.testing.assert_allclose(hits.positions[:2], [[0, 1, 0], [2, 0, 0]], atol=1e-6)
    assert np.isnan(hits.positions[2:]).all()
    assert hits.face_ids[0] in (2, 3)
    assert hits.face_ids[1] in (0, 1)
    assert list(hits.face_ids[2:]) == [-1, -1]
    hits = make_raycaster(mesh_of(floor(0, 0, 1, 1))).cast(np.empty((0, 3)), np.empty((0, 3)))
    assert hits.range_m.shape == (0,)
    assert hits.positions.shape == (0, 3)


def test_several_threads_get_the_same_frames_as_one(make_raycaster):
    raycaster = make_raycaster(soup(1), threads=2)
    camera = Camera(320, 240)
    views = [T_world_camera(Pose((0, 0, 0), yaw), camera) for yaw in np.linspace(0, 6, 12)]
    alone = [raycaster.render(view, camera) for view in views]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda view: raycaster.render(view, camera), views))
    for one, other in zip(alone, together, strict=True):
        assert_same(one, other)


@pytest.mark.parametrize("size", [(640, 480), (333, 251), (5, 3), (1, 1)])
def test_frames_do_not_depend_on_the_number_of_threads(make_raycaster, size):
    camera = Camera(*size)
    view = T_world_camera(Pose((0.1, 0, 0.2), 0.3), camera)
    mesh = soup(2)
    alone = make_raycaster(mesh, threads=1).render(view, camera)
    assert alone.rgb.shape == (size[1], size[0], 3)
    assert_same(alone, make_raycaster(mesh, threads=3).render(view, camera))


@pytest.mark.parametrize("count", [0, 1, 3, 9])
def test_a_batch_gives_the_single_frames_in_order(make_raycaster, count):
    camera = Camera(100, 75)
    views = np.array([T_world_camera(Pose((0, 0, 0), 0.7 * k), camera) for k in range(count)]).reshape(-1, 4, 4)
    raycaster = make_raycaster(soup(3), threads=2)
    frames = raycaster.render_batch(views, camera)
    assert len(frames) == count
    for view, frame in zip(views, frames, strict=True):
        assert_same(raycaster.render(view, camera), frame)


@pytest.mark.parametrize("size", [(97, 61), (640, 480)])
def test_depth_alone_equals_the_depth_of_the_frame(make_raycaster, size):
    camera = Camera(*size)
    view = T_world_camera(Pose((0, 0, 0), 1.0), camera)
    raycaster = make_raycaster(soup(4), threads=2)
    np.testing.assert_array_equal(raycaster.depth(view, camera), raycaster.render(view, camera).depth_m)


def test_a_lens_with_an_off_centre_principal_point_shows_that_part_of_a_wider_view(make_raycaster):
    raycaster, whole = make_raycaster(soup(4)), Camera(96, 72)
    part = Camera.of_lens(40, 30, fx=whole.focal, fy=whole.focal, cx=48 - 10, cy=36 - 20)
    view = T_world_camera(Pose((0, 0, 0), 1.0), whole)
    seen, cut = raycaster.render(view, whole), raycaster.render(view, part)
    np.testing.assert_array_equal(cut.instance_ids, seen.instance_ids[20:50, 10:50])
    np.testing.assert_allclose(cut.depth_m, seen.depth_m[20:50, 10:50], rtol=1e-5)
    assert cut.camera == part
    np.testing.assert_array_equal(cut.T_world_camera, view)


def test_a_small_picture_has_the_values_of_the_large_one_at_its_pixels(make_raycaster):
    # Every third pixel centre of a picture three times as wide and high is a pixel centre of the small one.
    raycaster = make_raycaster(soup(5))
    small, large = Camera(7, 5), Camera(21, 15)
    view = T_world_camera(Pose((0, 0, 0), 2.0), small)
    few, many = raycaster.render(view, small), raycaster.render(view, large)
    np.testing.assert_array_equal(few.instance_ids, many.instance_ids[1::3, 1::3])
    np.testing.assert_allclose(few.depth_m, many.depth_m[1::3, 1::3], rtol=1e-5)


def test_id_images_give_ids_within_faces_and_other_faces_keep_theirs(make_raycaster):
    mesh = mesh_of(floor(-1, -1, 1, 1, instance=5), floor(1, -1, 3, 1, instance=6))
    images = (np.array([[1, 300], [65535, 0]], np.uint16),)
    uv = np.concatenate([mesh.face_uv[:2], np.zeros((2, 3, 2), np.float32)])
    mesh = replace(mesh, ids=IdImages(images, np.array([0, 0, FACE_IDS, FACE_IDS], np.int16), uv))
    raycaster = make_raycaster(mesh)
    wide = Camera(hfov_deg=150.0)
    places = {(-0.5, -0.5): 1, (0.5, -0.5): 300, (-0.5, 0.5): 65535, (0.5, 0.5): 0, (0.02, -0.02): 300, (2.0, 0.0): 6}
    for (x, z), instance in places.items():
        assert seen_from_above(raycaster, x, z, wide)[1] == instance


def test_ranges_are_exact_far_from_the_origin(make_raycaster):
    raycaster = make_raycaster(mesh_of(floor(-900, -900, 900, 900, y=0.1)))
    origin = np.array([[812.3456789, 1.7654321, -700.1234567]])
    hits = raycaster.cast(origin, np.array([[0.3, -1.0, 0.2]]))
    y = float(np.float32(0.1))
    assert hits.range_m[0] == pytest.approx((1.7654321 - y) * math.sqrt(1.13), abs=1e-9)
    assert hits.positions[0, 1] == pytest.approx(y, abs=1e-9)


@pytest.mark.filterwarnings("error")
def test_rays_with_non_finite_numbers_hit_nothing(make_raycaster):
    raycaster = make_raycaster(mesh_of(floor(-5, -5, 5, 5)))
    down = (0, -1, 0)
    origins = np.array([(0, 1, 0), (0, np.nan, 0), (np.inf, 1, 0), (0, 1, 0), (0, 1, 0), (1e300, 1, 0), (0, 1, 0)])
    directions = np.array([(0, np.nan, 0), down, down, (0, -np.inf, 0), (0, -1e300, 0), down, down])
    hits = raycaster.cast(origins, directions)
    assert list(hits.face_ids[:6]) == [-1] * 6
    assert np.isinf(hits.range_m[:6]).all()
    assert np.isnan(hits.positions[:6]).all()
    assert hits.range_m[6] == 1.0


def test_many_rays_hit_the_same_faces_together_and_alone(make_raycaster):
    rng = np.random.default_rng(6)
    origins, directions = rng.uniform(-4, 4, (9001, 3)), rng.normal(size=(9001, 3))
    raycaster = make_raycaster(soup(7), threads=2)
    together = raycaster.cast(origins, directions)
    assert 0.2 < np.isfinite(together.range_m).mean() < 1
    assert together.face_ids.dtype == np.int64
    for first in range(0, 9001, 911):
        alone = raycaster.cast(origins[first : first + 1], directions[first : first + 1])
        assert alone.face_ids[0] == together.face_ids[first]
        assert alone.range_m[0] == together.range_m[first]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system cannot fork")
def test_a_forked_child_renders_the_same_and_ends():
    raycaster, camera = Raycaster(soup(8), threads=2), Camera(320, 240)
    view = T_world_camera(Pose((0, 0, 0), 1.0), camera)
    expected = raycaster.render(view, camera)
    child = os.fork()
    if child == 0:
        frame = raycaster.render(view, camera)
        os._exit(0 if np.array_equal(frame.rgb, expected.rgb) else 1)
    _, status = os.waitpid(child, 0)
    assert os.waitstatus_to_exitcode(status) == 0


@pytest.mark.skipif(not has_embree(), reason="Embree's packets cannot be used here")
@settings(deadline=None, max_examples=15)
@given(
    seed=st.integers(0, 2**32 - 1),
    yaw=st.floats(-3, 3),
    tilt=st.floats(-1.5, 1.5),
    texture_filter=st.sampled_from(["bilinear", "mipmap"]),
    is_lit=st.booleans(),
)
def test_both_backends_see_the_same(seed, yaw, tilt, texture_filter, is_lit):
    mesh, camera = soup(seed, faces=60, is_lit=is_lit), Camera(61, 47)
    view = T_world_camera(Pose((0, -0.88, 0), yaw, tilt), camera)
    casters = (Raycaster(mesh, backend=name, texture_filter=texture_filter) for name in ("embree", "open3d"))
    one, other = (raycaster.render(view, camera) for raycaster in casters)
    same = one.instance_ids == other.instance_ids
    assert same.mean() >= 0.995  # a ray through an edge may hit either face
    np.testing.assert_allclose(one.depth_m[same], other.depth_m[same], rtol=1e-4)
    apart = np.abs(one.rgb[same].astype(int) - other.rgb[same]).max(axis=-1)
    assert np.mean(apart <= 2) >= 0.995  # at the border of two mipmap levels the last bit decides


@pytest.mark.skipif(not has_embree(), reason="Embree's packets cannot be used here")
@pytest.mark.parametrize("texture_filter", ["nearest", "bilinear", "mipmap"])
def test_packets_of_any_width_see_the_same(monkeypatch, texture_filter):
    mesh, camera = soup(9, is_lit=True), Camera(203, 151)
    view = T_world_camera(Pose((0, 0, 0), 0.5), camera)
    frames = {}
    for width in embree.WIDTHS:
        monkeypatch.setattr(embree, "self_test", lambda width=width: embree.Backend("embree", width, "A test's."))
        raycaster = Raycaster(mesh, backend="embree", texture_filter=texture_filter)
        assert raycaster.backend.packet_width == width
        frames[width] = raycaster.render(view, camera)
        rays = np.zeros((5, 3)), np.eye(5, 3) + 0.3
        expected = Raycaster(mesh, backend="open3d").cast(*rays).face_ids
        np.testing.assert_array_equal(raycaster.cast(*rays).face_ids, expected)
    for width in (8, 4):
        same = frames[width].instance_ids == frames[16].instance_ids
        assert np.mean(frames[width].rgb[same] == frames[16].rgb[same]) >= 0.9995
        assert same.mean() >= 0.9995
        np.testing.assert_allclose(frames[width].depth_m[same], frames[16].depth_m[same], rtol=1e-5)


def test_meshes_without_faces_and_poses_that_are_not_finite_are_refused(make_raycaster):
    empty = mesh_of(floor(0, 0, 1, 1)).select(np.zeros(2, bool))
    with pytest.raises(SceneError, match="without faces"):
        make_raycaster(empty)
    raycaster = make_raycaster(mesh_of(floor(0, 0, 1, 1)))
    with pytest.raises(SceneError, match="pose"):
        raycaster.render(np.full((4, 4), np.nan), Camera())
    with pytest.raises(SceneError, match="pose"):
        raycaster.depth(np.eye(3), Camera())
    with pytest.raises(SceneError, match="pose"):
        raycaster.render_batch(np.full((2, 4, 4), np.inf), Camera())


DAMAGED = {
    "vertices has the value nan": {"vertices": np.full((4, 3), np.nan, np.float32)},
    "faces has the index 4": {"faces": np.array([[0, 1, 2], [0, 2, 4]], np.int32)},
    "faces has the index -1": {"faces": np.array([[0, 1, 2], [0, 2, -1]], np.int32)},
    "face_texture has the index 1": {"face_texture": np.array([0, 1], np.int16)},
    "face_uv has the value inf": {"face_uv": np.full((2, 3, 2), np.inf, np.float32)},
    "face_rgb has 1 rows": {"face_rgb": np.zeros((1, 3), np.uint8)},
    "a texture has shape": {"textures": (np.zeros((4, 4, 4), np.uint8),)},
    "a texture has shape (2, 2, 3) of float32": {"textures": (np.zeros((2, 2, 3), np.float32),)},
    "a texture has shape (0, 2, 3)": {"textures": (np.zeros((0, 2, 3), np.uint8),)},
    "vertex_rgb has fewer": {"face_texture": np.array([VERTEX_COLOURS, 0], np.int16)},
    "vertex_rgb has fewer colours than vertices": {"vertex_rgb": np.zeros((3, 3), np.uint8)},
    "ids.face_image has the index 0": {
        "ids": IdImages((), np.array([0, FACE_IDS], np.int16), np.zeros((2, 3, 2), np.float32))
    },
    "an id image has shape": {
        "ids": IdImages(
            (np.zeros((2, 2), np.int32),),  # pyright: ignore[reportArgumentType]
            np.array([0, FACE_IDS], np.int16),
            np.zeros((2, 3, 2), np.float32),
        )
    },
}


@pytest.mark.parametrize("message", DAMAGED)
def test_a_damaged_mesh_is_refused_in_one_line(message):
    mesh = mesh_of(floor(0, 0, 1, 1), textures=(np.zeros((2, 2, 3), np.uint8),), texture=0)
    with pytest.raises(SceneError) as caught:
        Raycaster(replace(mesh, **DAMAGED[message]))
    assert message in str(caught.value)
    assert "expected" in str(caught.value)
    assert "\n" not in str(caught.value)
