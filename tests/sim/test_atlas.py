"""Textures as tiles of a few sheets: every place keeps its colour, no neighbour shows through, sizes stay bounded."""

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from sim.copies.atlas import NUM_SHEETS, SHEET_SIDE, atlased
from sim.mesh import FLAT, TriangleMesh

from .meshes import floor, joined, mesh_of

UNIT = np.array([[0, 0], [0, 1], [1, 1], [1, 0]], np.float32)[[[0, 1, 2], [0, 2, 3]]]


def squares(*textures: NDArray[np.uint8], side: float = 1.0) -> TriangleMesh:
    """One square of floor per texture, each texture laid over its square once."""
    mesh = mesh_of(*(floor(2 * side * k, 0, 2 * side * k + side, side) for k in range(len(textures))))
    return replace(mesh, textures=textures, face_texture=np.repeat(np.arange(len(textures)), 2).astype(np.int16))


def colours(mesh: TriangleMesh, weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Colours (F, P, 3) of the faces, bilinear and repeating, at barycentric weights (P, 3)."""
    shown = np.empty((len(mesh.faces), len(weights), 3))
    for face, texture in enumerate(mesh.face_texture):
        image = mesh.textures[texture].astype(float)
        height, width = image.shape[:2]
        x, y = (weights @ mesh.face_uv[face] * [width, height] - 0.5).T
        x0, y0 = np.floor(x).astype(int), np.floor(y).astype(int)
        s, t = (x - x0)[:, None], (y - y0)[:, None]
        rows, cols = (y0 % height, (y0 + 1) % height), (x0 % width, (x0 + 1) % width)
        upper = image[rows[0], cols[0]] * (1 - s) + image[rows[0], cols[1]] * s
        lower = image[rows[1], cols[0]] * (1 - s) + image[rows[1], cols[1]] * s
        shown[face] = upper * (1 - t) + lower * t
    return shown


CHECKS = np.kron([[0, 255], [255, 0]], np.ones((16, 16)))[..., None].repeat(3, axis=2).astype(np.uint8)
PLACES = np.random.default_rng(0).dirichlet([1, 1, 1], 200)


def plain(rgb: tuple[int, int, int], height: int, width: int) -> NDArray[np.uint8]:
    return np.tile(np.array(rgb, np.uint8), (height, width, 1))


@settings(max_examples=30, deadline=None)
@given(st.lists(st.tuples(st.integers(1, 90), st.integers(1, 90)), min_size=1, max_size=30), st.integers(0, 999))
def test_no_colour_of_a_neighbour_shows_through(sizes: list[tuple[int, int]], seed: int) -> None:
    rgb = np.random.default_rng(seed).integers(0, 256, (len(sizes), 3))
    textures = tuple(plain(tuple(value), *size) for value, size in zip(rgb, sizes, strict=True))
    atlas = atlased(squares(*textures))
    np.testing.assert_allclose(colours(atlas, PLACES), np.repeat(rgb, 2, axis=0)[:, None].repeat(200, axis=1))


def test_28_large_textures_become_four_sheets_that_show_the_same() -> None:
    rng = np.random.default_rng(3)
    coarse = [rng.integers(0, 256, (9, 9, 3)).astype(np.uint8) for _ in range(28)]
    textures = tuple(np.kron(image, np.ones((50, 50, 1), np.uint8)) for image in coarse)
    mesh = squares(*textures)
    atlas = atlased(mesh)
    assert len(atlas.textures) == NUM_SHEETS
    assert max(max(image.shape) for image in atlas.textures) <= SHEET_SIDE
    assert sum(image.shape[0] * image.shape[1] for image in atlas.textures) > 0.7 * NUM_SHEETS * SHEET_SIDE**2
    assert np.median(np.abs(colours(atlas, PLACES) - colours(mesh, PLACES))) < 1
    assert atlas.face_uv.min() >= 0
    assert atlas.face_uv.max() <= 1


def test_a_few_small_textures_keep_every_texel_even_with_coordinates_whole_images_off() -> None:
    rng = np.random.default_rng(4)
    mesh = squares(*(rng.integers(0, 256, (40, 60, 3)).astype(np.uint8) for _ in range(3)))
    inner = np.clip(PLACES, 0.05, None) / np.clip(PLACES, 0.05, None).sum(axis=1, keepdims=True)
    np.testing.assert_allclose(colours(atlased(mesh), inner), colours(mesh, inner), atol=0.02)
    rng = np.random.default_rng(6)
    mesh = squares(rng.integers(0, 256, (40, 60, 3)).astype(np.uint8))
    moved = replace(mesh, face_uv=mesh.face_uv + np.array([[[-3, 5]], [[2, -1]]], np.float32))
    assert [image.shape for image in atlased(moved).textures] == [image.shape for image in atlased(mesh).textures]
    np.testing.assert_allclose(atlased(moved).face_uv, atlased(mesh).face_uv, atol=1e-5)


def test_texels_are_shared_out_by_surface_and_many_repeating_textures_shrink_together() -> None:
    small, large = squares(*[plain((5, 5, 5), 2048, 2048)] * 2), squares(*[plain((9, 9, 9), 2048, 2048)] * 6, side=3.0)
    atlas = atlased(joined(small, large))
    sizes = np.array([atlas.textures[texture].shape[1] for texture in atlas.face_texture])
    pixels = np.ptp(atlas.face_uv[..., 0], axis=1) * sizes
    np.testing.assert_allclose(pixels[4:], 504, atol=1.5)
    np.testing.assert_allclose(pixels[:4], 504 / 3, atol=1.5)
    mesh = squares(*(plain((k, k, k), 1024, 1024) for k in range(20)))
    atlas = atlased(replace(mesh, face_uv=mesh.face_uv * 3))
    assert len(atlas.textures) == 20
    assert sum(image.shape[0] * image.shape[1] for image in atlas.textures) <= NUM_SHEETS * SHEET_SIDE**2
    assert min(image.shape[0] for image in atlas.textures) > 400


def test_texels_that_no_face_shows_do_not_mix_into_their_neighbours() -> None:
    image = plain((0, 0, 0), 2048, 2048)
    image[::3, ::3] = (0, 255, 0)
    image[100:900, 200:1100] = (240, 200, 160)
    mesh = squares(image, plain((9, 9, 9), 2048, 2048), plain((9, 9, 9), 2048, 2048), plain((9, 9, 9), 2048, 2048))
    uv = mesh.face_uv.copy()
    uv[0] = np.array([[200, 100], [200, 900], [1100, 900]]) / 2048
    uv[1] = np.array([[200, 100], [1100, 900], [1100, 100]]) / 2048
    inside = np.clip(PLACES, 0.002, None) / np.clip(PLACES, 0.002, None).sum(axis=1, keepdims=True)
    shown = colours(atlased(replace(mesh, face_uv=uv)), inside)[:2]
    assert np.abs(shown - [240, 200, 160]).max() < 12


def test_a_texture_that_repeats_stays_alone_and_light_stays_on_its_corners() -> None:
    mesh = squares(CHECKS, plain((1, 2, 3), 8, 8))
    repeated = replace(mesh, face_uv=np.where(np.arange(4)[:, None, None] < 2, mesh.face_uv * 7 - 2.25, mesh.face_uv))
    atlas = atlased(repeated)
    assert sorted(image.shape[:2] for image in atlas.textures) == [(16, 16), (32, 32)]
    np.testing.assert_allclose(colours(atlas, PLACES), colours(repeated, PLACES), atol=0.5)
    light = np.random.default_rng(5).integers(0, 256, (8, 3)).astype(np.uint8)
    atlas = atlased(replace(mesh, face_uv=mesh.face_uv * [[[7]], [[7]], [[1]], [[1]]], vertex_rgb=light))
    np.testing.assert_array_equal(atlas.faces, mesh.faces)
    np.testing.assert_array_equal(atlas.vertices, mesh.vertices)
    np.testing.assert_array_equal(atlas.vertex_rgb, light)


def test_faces_without_texture_and_textures_without_faces_cost_nothing() -> None:
    mesh = squares(plain((1, 2, 3), 8, 8), plain((4, 5, 6), 8, 8))
    only = atlased(replace(mesh, face_texture=np.array([FLAT, FLAT, 1, 1], np.int16)))
    assert only.face_texture.tolist() == [FLAT, FLAT, 0, 0]
    assert len(only.textures) == 1
    assert atlased(replace(mesh, face_texture=np.full(4, FLAT, np.int16))).textures == ()
