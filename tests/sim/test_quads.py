"""Quads become textured triangles: their places, images, texture coordinates and size."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from sim.copies.glb_writer import glb_from_mesh
from sim.homes.building.house import mesh_from_plan
from sim.homes.building.patches import FLOOR_STEP
from sim.homes.building.quads import QuadBuilder
from sim.homes.building.textures import texture_of
from sim.homes.furniture.shapes import box
from sim.homes.invented.plans import invent_plan
from sim.homes.plan import Finish
from sim.mesh import VERTEX_COLOURS, TriangleMesh

from .meshes import area

WOOD = Finish(material="wood", rgb=(156, 110, 66))
CLOTH = Finish(material="fabric", pattern="plaid", rgb=(150, 60, 52), rgb2=(226, 200, 160))
RED = Finish(rgb=(200, 40, 30))
PAINTING = Finish(material="picture", rgb=(60, 100, 170))
FLOOR = [[(0, 0, 0), (0, 0, 1.1), (2.3, 0, 1.1), (2.3, 0, 0)]]
UPRIGHT = np.array([[(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]], float)
"""Looks towards +z."""


def moved(points: ArrayLike, x: float, y: float, z: float) -> NDArray[np.float64]:
    """Points (..., 3) moved by (x, y, z)."""
    return np.asarray(points, float) + np.array([x, y, z])


def turned(quads: NDArray[np.float64], yaw: float) -> NDArray[np.float64]:
    """Quads turned about +y by `yaw`."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    return quads @ np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]]).T


def built(quads: ArrayLike, finish: Finish, **more: Any) -> TriangleMesh:
    """The mesh of one call of `add_quads`."""
    builder = QuadBuilder()
    builder.add_quads(quads, finish, **more)
    return builder.mesh()


def uv_at(mesh: TriangleMesh, point: tuple[float, float, float]) -> NDArray[np.float64]:
    """Texture coordinates (2,) of the face corners at a point; all must agree."""
    at = np.abs(mesh.vertices[mesh.faces] - np.array(point)).max(axis=2) < 1e-5
    found = mesh.face_uv[at]
    assert len(found)
    assert np.ptp(found, axis=0).max() < 1e-5
    return found[0].astype(float)


def test_a_quad_of_a_plain_smooth_finish_has_its_colour_times_the_light() -> None:
    mesh = built(UPRIGHT, RED, instance=3)
    assert (mesh.face_texture == VERTEX_COLOURS).all()
    assert mesh.textures == ()
    assert set(mesh.face_instance.tolist()) == {3}
    assert mesh.vertex_rgb is not None
    share = mesh.vertex_rgb / np.array([200, 40, 30])
    assert np.ptp(share, axis=1).max() < 0.04
    assert 0.7 < share.min() <= share.max() <= 1.0
    assert np.abs(mesh.face_rgb.astype(int) - mesh.vertex_rgb[mesh.faces].mean(axis=1)).max() < 3


def test_a_textured_quad_has_light_as_its_vertex_colours() -> None:
    mesh = built(UPRIGHT, CLOTH, instance=1)
    texture = texture_of(CLOTH)
    assert texture is not None
    assert (mesh.face_texture == 0).all()
    np.testing.assert_array_equal(mesh.textures[0], texture.image)
    assert mesh.vertex_rgb is not None
    assert np.ptp(mesh.vertex_rgb.astype(int), axis=1).max() <= 1, "white light"
    assert mesh.vertex_rgb.min() > 0.8 * 255
    np.testing.assert_allclose(
        mesh.face_rgb / mesh.vertex_rgb[mesh.faces].mean(axis=1) * 255,
        texture.rgb * np.ones((len(mesh.faces), 1)),
        atol=2,
    )


def test_faces_keep_the_area_the_plane_and_the_side_of_their_quads() -> None:
    for instance in (0, 5):
        mesh = built(FLOOR, RED, instance=instance)
        assert area(mesh).sum() == pytest.approx(2.3 * 1.1, rel=1e-5)
        a, b, c = np.moveaxis(mesh.vertices[mesh.faces], 1, 0)
        normals = np.cross(b - a, c - a)
        assert (normals[:, 1] > 0).all()
        assert np.abs(mesh.vertices[:, 1]).max() == 0
        assert mesh.vertices.min(axis=0).tolist() == [0, 0, 0]
        np.testing.assert_allclose(mesh.vertices.max(axis=0), [2.3, 0, 1.1], atol=1e-6)


def test_floors_are_cut_at_lines_that_all_quads_share() -> None:
    mesh = built(FLOOR, RED)
    lines = np.unique(mesh.vertices[:, 0])
    np.testing.assert_allclose(lines, [*np.arange(19) * FLOOR_STEP, 2.3], atol=1e-6)


def test_quads_of_one_finish_share_one_image() -> None:
    builder = QuadBuilder()
    for x in range(4):
        builder.add_quads(moved(UPRIGHT, x, 0, 0), (CLOTH, WOOD, CLOTH, RED)[x], instance=x + 1)
    mesh = builder.mesh()
    by_instance = {int(i): int(t) for i, t in zip(mesh.face_instance, mesh.face_texture, strict=True)}
    assert len(mesh.textures) == 2
    assert by_instance[1] == by_instance[3] != by_instance[2]
    assert by_instance[4] == VERTEX_COLOURS


def test_wood_is_laid_in_planks_on_floors_but_not_on_furniture_or_walls() -> None:
    planks, grain = texture_of(WOOD, is_floor=True), texture_of(WOOD)
    assert planks is not None
    assert grain is not None
    np.testing.assert_array_equal(built(FLOOR, WOOD).textures[0], planks.image)
    np.testing.assert_array_equal(built(FLOOR, WOOD, instance=1).textures[0], grain.image)
    np.testing.assert_array_equal(built(UPRIGHT, WOOD).textures[0], grain.image)


def test_neighbours_in_a_plane_continue_each_others_texture() -> None:
    left, right = built(FLOOR, WOOD), built(moved(FLOOR, 2.3, 0, 0), WOOD)
    np.testing.assert_allclose(uv_at(left, (2.3, 0, 1.1)), uv_at(right, (2.3, 0, 1.1)), atol=1e-5)
    texture = texture_of(WOOD, is_floor=True)
    assert texture is not None
    across = uv_at(left, (2.3, 0, 0)) - uv_at(left, (0, 0, 0))
    np.testing.assert_allclose(across, [2.3 / texture.metres[0], 0], atol=1e-5)


@pytest.mark.parametrize("yaw", [0, np.pi / 2, np.pi, -np.pi / 2])
def test_textures_stand_upright_and_are_not_mirrored_on_walls(yaw: float) -> None:
    mesh = built(turned(UPRIGHT, yaw), CLOTH, instance=1)
    texture = texture_of(CLOTH)
    assert texture is not None
    low_left, low_right, high_left = (
        uv_at(mesh, tuple(turned(np.array([[point]], float), yaw)[0, 0])) for point in ((0, 0, 0), (1, 0, 0), (0, 1, 0))
    )
    np.testing.assert_allclose(low_right - low_left, [1 / texture.metres[0], 0], atol=1e-5)
    np.testing.assert_allclose(high_left - low_left, [0, -1 / texture.metres[1]], atol=1e-5)


def test_given_texture_coordinates_are_metres_and_a_picture_covers_each_quad_once_and_upright() -> None:
    uv = [[(0.5, 0.5), (0.5, 1.5), (0.0, 1.5), (0.0, 0.5)]]
    mesh = built(UPRIGHT, CLOTH, uv=uv, instance=1)
    np.testing.assert_allclose(uv_at(mesh, (1, 1, 0)), np.array([0.0, 1.5]) / 0.48, atol=1e-5)
    tall = moved(UPRIGHT * np.array([0.6, 0.9, 1]), 3.3, 1.2, 0)
    for uv in (None, [[(0, 0.9), (0.6, 0.9), (0.6, 0), (0, 0)]]):
        mesh = built(np.concatenate([tall, moved(tall, 1, 0, 0)]), PAINTING, uv=uv and uv * 2, instance=1)
        for x in (3.3, 4.3):
            np.testing.assert_allclose(uv_at(mesh, (x, 2.1, 0)), [0, 0], atol=1e-5)
            np.testing.assert_allclose(uv_at(mesh, (x + 0.6, 1.2, 0)), [1, 1], atol=1e-5)


def test_a_quad_with_two_equal_corners_is_a_triangle_and_no_area_is_doubled_or_lost() -> None:
    triangle = np.array([[(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 1, 0)]], float)
    for instance in (0, 1):
        mesh = built(triangle, RED, instance=instance)
        assert area(mesh).sum() == pytest.approx(0.5, rel=1e-5)
        assert (area(mesh) > 0).all()
    builder = QuadBuilder()
    builder.add_quads(np.zeros((0, 4, 3)), RED)
    builder.add_quads(box((0, 1, 0), (1, 2, 0.5)).turned("y", 0.7).corners, RED, instance=2)
    mesh = builder.mesh()
    assert area(mesh).sum() == pytest.approx(2 * (2 + 0.5 + 1), rel=1e-4)


def test_rounded_solids_have_no_edges_in_their_light() -> None:
    angle = np.linspace(0, 2 * np.pi, 13)
    ring = np.stack([np.cos(angle), 0 * angle, np.sin(angle)], axis=1)
    sides = np.stack([ring[1:], ring[:-1], moved(ring[:-1], 0, 1, 0), moved(ring[1:], 0, 1, 0)], axis=1)
    normals = np.stack([ring[1:], ring[:-1], ring[:-1], ring[1:]], axis=1)
    mesh = built(sides, RED, normals=normals, instance=1)
    assert mesh.vertex_rgb is not None
    place = np.round(mesh.vertices, 4)
    order = np.lexsort(place.T)
    same = (np.diff(place[order], axis=0) == 0).all(axis=1)
    assert same.any()
    assert (mesh.vertex_rgb[order][1:][same] == mesh.vertex_rgb[order][:-1][same]).all()
    assert np.ptp(mesh.vertex_rgb[:, 0].astype(int)) > 20, "the side towards the sun is brighter"


@pytest.mark.slow
def test_an_invented_home_is_small_enough_for_a_browser_and_always_the_same() -> None:
    plan = invent_plan("X", seed=1)
    mesh, _ = mesh_from_plan(plan)
    assert mesh_from_plan(plan)[0].digest() == mesh.digest()
    assert len(mesh.faces) <= 300_000
    assert len(glb_from_mesh(mesh)) <= 15_000_000
    assert sum(image.shape[0] * image.shape[1] for image in mesh.textures) <= 4_000_000 * len(plan.storeys)
