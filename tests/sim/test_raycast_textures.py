"""How the raycaster shows textures, vertex colours and light on textures, with both backends."""

import math
from dataclasses import replace

import numpy as np
import pytest

from sim.frames import T_world_camera
from sim.mesh import FLAT, VERTEX_COLOURS
from sim.render.texels import surfaces_of_mesh
from sim.types import Camera, Pose

from .meshes import floor, mesh_of
from .raycasters import LOOK_DOWN, assert_same, seen_from_above


def test_the_top_left_texel_lies_at_texture_coordinate_0_0(make_raycaster):
    image = np.zeros((2, 2, 3), np.uint8)
    image[0, 0], image[0, 1], image[1, 0] = (255, 0, 0), (0, 255, 0), (0, 0, 255)
    mesh = mesh_of(floor(-1, -1, 1, 1), textures=(image,), texture=0)
    frame = make_raycaster(mesh).render(T_world_camera(LOOK_DOWN, Camera()), Camera())
    f = Camera().focal / 0.88
    seen = {(x, z): tuple(frame.rgb[round(240 + f * z), round(320 + f * x)]) for x in (-0.5, 0.5) for z in (-0.5, 0.5)}
    assert seen[-0.5, -0.5][0] > 250
    assert seen[0.5, -0.5][1] > 250
    assert seen[-0.5, 0.5][2] > 250
    assert max(seen[0.5, 0.5]) < 5


def test_texels_are_blended_and_repeat_beyond_the_border(make_raycaster):
    image = np.array([[[0, 0, 0], [200, 200, 200]]], np.uint8)
    mesh = mesh_of(floor(-1, -1, 1, 1), textures=(image,), texture=0)
    mesh.face_uv[..., 0] += 3.0  # whole repeats change nothing
    camera = Camera(hfov_deg=120.0)
    frame = make_raycaster(mesh).render(T_world_camera(LOOK_DOWN, camera), camera)
    f = camera.focal / 0.88
    row = frame.rgb[240, :, 0].astype(int)
    assert row[round(320 + f * -0.5)] == pytest.approx(0, abs=2)
    assert row[round(320 + f * 0.5)] == pytest.approx(200, abs=2)
    assert row[320] == pytest.approx(100, abs=2)  # halfway between the two texels
    assert row[round(320 + f * 0.995)] == pytest.approx(101, abs=2)  # also where the texture repeats


def test_nearest_shows_texels_as_they_are(make_raycaster):
    image = np.array([[[10, 20, 30], [200, 210, 220]], [[1, 2, 3], [250, 0, 9]]], np.uint8)
    raycaster = make_raycaster(mesh_of(floor(-1, -1, 1, 1), textures=(image,), texture=0), texture_filter="nearest")
    for x, z, rgb in [
        (-0.9, -0.3, (10, 20, 30)),
        (-0.02, -0.02, (10, 20, 30)),
        (0.02, -0.02, (200, 210, 220)),
        (-0.02, 0.3, (1, 2, 3)),
        (0.5, 0.6, (250, 0, 9)),
    ]:
        assert seen_from_above(raycaster, x, z, Camera(hfov_deg=120.0))[0] == rgb


def test_bilinear_weighs_the_four_texels_by_area(make_raycaster):
    image = np.array([[[0, 100, 10], [80, 100, 10]], [[160, 100, 90], [240, 100, 90]]], np.uint8)
    raycaster = make_raycaster(mesh_of(floor(-1, -1, 1, 1), textures=(image,), texture=0))
    # Texel centres are at +-0.5 m, so red grows by 80 per metre of x and 160 of z, blue by 80 per metre of z.
    for x, z in [(0.0, 0.0), (-0.25, 0.25), (0.4, -0.1), (-0.45, -0.45)]:
        red, green, blue = seen_from_above(raycaster, x, z, Camera(hfov_deg=120.0))[0]
        assert (red, blue) == pytest.approx((120 + 80 * x + 160 * z, 50 + 80 * z), abs=2)
        assert green == 100


@pytest.mark.parametrize(("cell", "smooth"), [(1, True), (2, True), (4, False)])
@pytest.mark.parametrize("tilt", [-math.pi / 2, -1.0])
def test_mipmaps_show_the_mean_of_the_texels_that_a_pixel_covers(make_raycaster, cell, smooth, tilt):
    board = np.kron(np.indices((256 // cell, 256 // cell)).sum(axis=0) % 2, np.ones((cell, cell), int)) * 200
    image = np.repeat(board[..., None], 3, axis=2).astype(np.uint8)
    mesh = mesh_of(floor(-1, -1, 1, 1), textures=(image,), texture=0)
    # From 0.88 m up, a pixel is 3.2 cm wide and covers 4.1 x 4.1 texels (4.8 x 5.7 looking forward), which is one texel
    # of the level that is 4 times smaller: it shows cells of 4 texels, and the mean of smaller cells.
    camera = Camera(32, 24, 60.0)
    rgb = (
        make_raycaster(mesh, texture_filter="mipmap")
        .render(T_world_camera(Pose((0.0, 0.0, 0.0 if tilt < -1.5 else 0.5), 0.0, tilt), camera), camera)
        .rgb[10:14, 14:18]
    )
    assert (rgb == 100).all() == smooth


def test_mipmaps_show_the_full_texture_at_close_range(make_raycaster):
    image = np.random.default_rng(0).integers(0, 256, (16, 12, 3), np.uint8)
    mesh = mesh_of(floor(-1, -1, 1, 1), textures=(image,), texture=0)
    view = T_world_camera(LOOK_DOWN, Camera())  # a texel is 50 pixels wide
    assert_same(
        make_raycaster(mesh, texture_filter="mipmap").render(view, Camera()),
        make_raycaster(mesh).render(view, Camera()),
    )


@pytest.mark.parametrize("size", [(1, 1), (1, 5), (7, 2), (3, 3)])
@pytest.mark.parametrize("texture_filter", ["nearest", "bilinear", "mipmap"])
def test_one_coloured_textures_of_any_size_have_one_colour(make_raycaster, size, texture_filter):
    image = np.full((*size, 3), (7, 130, 255), np.uint8)
    mesh = mesh_of(floor(-5, -5, 5, 5), textures=(image,), texture=0)
    mesh.face_uv[:] *= 97.3
    camera = Camera(64, 48)
    frame = make_raycaster(mesh, texture_filter=texture_filter).render(T_world_camera(LOOK_DOWN, camera), camera)
    assert (frame.rgb == (7, 130, 255)).all()


def test_vertex_colours_are_interpolated(make_raycaster):
    mesh = mesh_of(floor(-1, -1, 1, 1))
    corners = np.array([[0, 0, 200], [0, 100, 200], [200, 100, 200], [200, 0, 200]], np.uint8)  # red with x, green z
    mesh = replace(mesh, vertex_rgb=corners, face_texture=np.full(2, VERTEX_COLOURS, np.int16))
    raycaster = make_raycaster(mesh)
    for x, z in [(0.0, 0.0), (-0.5, 0.25), (0.3, -0.4), (0.7, 0.2)]:
        rgb, _ = seen_from_above(raycaster, x, z, Camera(hfov_deg=120.0))
        assert rgb == pytest.approx((100 + 100 * x, 50 + 50 * z, 200), abs=1.5)


def test_textures_are_not_copied(make_raycaster):
    image = np.full((4, 4, 3), 50, np.uint8)
    raycaster = make_raycaster(mesh_of(floor(-1, -1, 1, 1), textures=(image,), texture=0))
    assert seen_from_above(raycaster, 0.1, 0.1)[0] == (50, 50, 50)
    image[:] = 60
    assert seen_from_above(raycaster, 0.1, 0.1)[0] == (60, 60, 60)


CORNERS = np.array([[0, 0, 255], [0, 100, 255], [200, 100, 255], [200, 0, 255]], np.uint8)
"""Light at the corners of `floor`: red grows with x, green with z, blue is full."""


@pytest.mark.parametrize("texture_filter", ["nearest", "bilinear", "mipmap"])
def test_light_is_interpolated_and_multiplies_textures(make_raycaster, texture_filter):
    image = np.full((8, 8, 3), (100, 200, 77), np.uint8)
    mesh = replace(mesh_of(floor(-1, -1, 1, 1), textures=(image,), texture=0), vertex_rgb=CORNERS)
    raycaster = make_raycaster(mesh, texture_filter=texture_filter)
    for x, z in [(0.0, 0.0), (-0.5, 0.25), (0.3, -0.4), (0.7, 0.2)]:
        rgb, _ = seen_from_above(raycaster, x, z, Camera(hfov_deg=120.0))
        light = (100 + 100 * x) / 255, (50 + 50 * z) / 255
        assert rgb == pytest.approx((100 * light[0], 200 * light[1], 77), abs=1.01)


def test_light_changes_neither_flat_faces_nor_vertex_colours_nor_ids(make_raycaster):
    image = np.full((8, 8, 3), (100, 200, 77), np.uint8)
    quads = (floor(-3, -1, -1, 1, rgb=(90, 80, 70), instance=4), floor(-1, -1, 1, 1), floor(1, -1, 3, 1, instance=6))
    kinds = np.repeat([FLAT, 0, VERTEX_COLOURS], 2).astype(np.int16)
    dark = np.full((12, 3), 51, np.uint8)
    raycaster = make_raycaster(replace(mesh_of(*quads, textures=(image,)), face_texture=kinds, vertex_rgb=dark))
    wide = Camera(hfov_deg=150.0)
    assert seen_from_above(raycaster, -2.0, 0.1, wide) == ((90, 80, 70), 4)
    assert seen_from_above(raycaster, 0.0, 0.1, wide) == ((20, 40, 15), 0)
    assert seen_from_above(raycaster, 2.0, 0.1, wide) == ((51, 51, 51), 6)


@pytest.mark.parametrize("texture_filter", ["nearest", "bilinear", "mipmap"])
def test_full_light_leaves_every_texel_as_it_is(make_raycaster, texture_filter):
    image = np.random.default_rng(1).integers(0, 256, (40, 30, 3), np.uint8)
    plain = mesh_of(floor(-1, -1, 1, 1), floor(5, 5, 6, 6), textures=(image,), texture=0)
    light = np.full((8, 3), 255, np.uint8)
    light[4:] = 9  # darkens the other rectangle, so that light is not skipped altogether
    view = T_world_camera(LOOK_DOWN, Camera())
    frames = [
        make_raycaster(replace(plain, vertex_rgb=rgb), texture_filter=texture_filter).render(view, Camera())
        for rgb in (None, light)
    ]
    assert_same(*frames)


def test_light_is_kept_only_where_it_changes_a_texture():
    image = np.full((8, 8, 3), 100, np.uint8)
    textured = mesh_of(floor(-1, -1, 1, 1), textures=(image,), texture=0)
    flat = replace(textured, face_texture=np.full(2, VERTEX_COLOURS, np.int16))
    white = np.full((4, 3), 255, np.uint8)
    meshes = [textured, replace(textured, vertex_rgb=white), replace(flat, vertex_rgb=CORNERS)]
    assert [len(surfaces_of_mesh(mesh, texture_filter="nearest")[0].light) for mesh in meshes] == [0, 0, 0]
    light = surfaces_of_mesh(replace(textured, vertex_rgb=CORNERS), texture_filter="nearest")[0].light
    corners = [255 << 16, 255 << 16 | 100 << 8, 255 << 16 | 100 << 8 | 200, 255 << 16 | 200]
    assert light.tolist() == [[corners[0], corners[1], corners[2]], [corners[0], corners[2], corners[3]]]
