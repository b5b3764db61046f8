"""Fewer triangles that look the same: shapes, borders, seams and colours stay, and the limit is never exceeded."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from sim.copies.decimate import decimated
from sim.frames import T_world_camera
from sim.mesh import FLAT, VERTEX_COLOURS, TriangleMesh
from sim.render.raycast import Raycaster
from sim.types import Camera, Pose

from .meshes import area, joined, triangles

WHITE = np.full((4, 4, 3), 255, np.uint8)


def sheet(count: int, *, height=lambda x, z: 0 * x, texture=lambda x, z: 0 * x) -> TriangleMesh:
    """A surface of 2 count^2 triangles over [0, 1]^2, whose texture coordinates are (x, z); vertices are not shared."""
    x, z = np.meshgrid(np.linspace(0, 1, count + 1), np.linspace(0, 1, count + 1), indexing="ij")
    points = np.stack([x, height(x, z), z], axis=-1).reshape(-1, 3).astype(np.float32)
    first = (np.arange(count)[:, None] * (count + 1) + np.arange(count)).reshape(-1, 1)
    corners = points[(first + np.array([0, 1, count + 2, 0, count + 2, count + 1])).reshape(-1, 3)]
    middle = corners.mean(axis=1)
    textures = np.asarray(texture(middle[:, 0], middle[:, 2])).astype(np.int16)
    return triangles(corners, face_texture=textures, face_uv=corners[..., [0, 2]], textures=(WHITE, WHITE))


def from_above(mesh: TriangleMesh, *, num: int = 4000) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Heights (num,) in metres and faces (num,) at random places of [0, 1]^2."""
    xz = np.random.default_rng(0).random((num, 2))
    origins = np.stack([xz[:, 0], np.full(num, 5.0), xz[:, 1]], axis=1)
    hits = Raycaster(mesh).cast(origins, np.tile([0.0, -1.0, 0.0], (num, 1)))
    return hits.positions[:, 1], hits.face_ids


def test_a_flat_sheet_keeps_its_outline_and_coordinates_and_a_sphere_its_shape() -> None:
    few = decimated(sheet(30), max_faces=10_000)
    assert len(few.faces) < 60
    assert area(few).sum() == pytest.approx(1.0, abs=1e-6)
    np.testing.assert_allclose(few.face_uv, few.vertices[few.faces][..., [0, 2]])
    assert {(0, 0), (0, 1), (1, 0), (1, 1)} <= {(float(x), float(z)) for x, _, z in few.vertices}
    ball = sheet(100)
    u, v = ball.vertices[:, 0] * np.pi, ball.vertices[:, 2] * 2 * np.pi
    ball = replace(ball, vertices=np.stack([np.sin(u) * np.cos(v), np.cos(u), np.sin(u) * np.sin(v)], 1).astype("f4"))
    few = decimated(ball, max_faces=2000)
    radius = np.linalg.norm(few.vertices[few.faces].mean(axis=1), axis=1)
    assert len(few.faces) <= 2000
    assert radius.min() > 0.98


def test_a_wavy_sheet_stays_within_the_tolerance_but_the_limit_of_faces_has_priority() -> None:
    waves = sheet(60, height=lambda x, z: 0.05 * np.sin(6 * x) * np.cos(5 * z))
    wanted, _ = from_above(waves)
    fine, coarse = decimated(waves, max_faces=10_000, tolerance=0.001), decimated(waves, max_faces=100)
    assert len(fine.faces) < 1500
    assert np.abs(from_above(fine)[0] - wanted).max() < 0.004
    assert 90 <= len(coarse.faces) <= 100
    assert np.quantile(np.abs(from_above(coarse)[0] - wanted), 0.99) < 0.02


def test_seams_between_textures_and_between_colours_stay_where_they_are() -> None:
    seamed = sheet(40, texture=lambda x, z: np.where(z > 0.5, FLAT, x > 0.3))
    rgb = np.where(seamed.vertices[seamed.faces][:, :, 0].mean(axis=1) > 0.7, 200, 50)[:, None]
    seamed = replace(seamed, face_rgb=np.repeat(rgb, 3, axis=1).astype(np.uint8))
    few = decimated(seamed, max_faces=10_000)
    assert len(few.faces) < 200
    _, before = from_above(seamed)
    _, after = from_above(few)
    np.testing.assert_array_equal(few.face_texture[after], seamed.face_texture[before])
    flat = few.face_texture[after] == FLAT
    np.testing.assert_array_equal(few.face_rgb[after][flat], seamed.face_rgb[before][flat])


def test_texture_coordinates_that_jump_are_a_seam_too() -> None:
    cut = sheet(40)
    jumps = cut.face_uv + np.where(cut.face_uv.mean(axis=1) > 0.5, 7.0, 0.0)[:, None]
    few = decimated(replace(cut, face_uv=jumps.astype(np.float32)), max_faces=10_000)
    assert len(few.faces) < 300
    shift = few.face_uv - few.vertices[few.faces][..., [0, 2]]
    np.testing.assert_allclose(shift, np.round(shift / 7) * 7, atol=1e-5)
    assert np.ptp(shift, axis=1).max() < 1e-5


def test_vertex_colours_stay_where_they_change() -> None:
    blended = sheet(40, texture=lambda x, z: 0 * x + VERTEX_COLOURS)
    inside = np.hypot(blended.vertices[:, 0] - 0.5, blended.vertices[:, 2] - 0.5) < 0.3
    blended = replace(blended, vertex_rgb=np.where(inside[:, None], [220, 30, 30], [20, 20, 200]).astype(np.uint8))
    few = decimated(blended, max_faces=1200)
    assert few.vertex_rgb is not None
    _, before = from_above(blended)
    _, after = from_above(few)
    assert blended.vertex_rgb is not None
    reds = [mesh.vertex_rgb[mesh.faces[face], 0].mean(axis=1) for mesh, face in ((blended, before), (few, after))]
    assert np.abs(reds[0] - reds[1]).mean() < 12


def lit_sheet(light) -> TriangleMesh:
    """A white sheet with this light on its texture: x (K,) -> brightness (K,) in [0, 1]."""
    even = sheet(40)
    grey = np.rint(255 * light(even.vertices[:, 0]))
    return replace(even, vertex_rgb=np.repeat(grey[:, None], 3, axis=1).astype(np.uint8))


def seen_light(mesh: TriangleMesh) -> NDArray[np.float64]:
    """One channel of the picture that a camera above the middle takes of [0.1, 0.9]^2."""
    camera = Camera(160, 160, 90.0, 0.0)
    frame = Raycaster(mesh).render(T_world_camera(Pose((0.5, 0.4, 0.5), 0.0, -np.pi / 2), camera), camera)
    return frame.rgb[..., 0].astype(float)


def test_even_light_costs_no_triangles_soft_shadows_stay_and_textures_stay_as_bright() -> None:
    even = lit_sheet(lambda x: 0.2 + 0.8 * x)
    few = decimated(even, max_faces=10_000)
    assert len(few.faces) < 200
    assert np.abs(seen_light(few) - seen_light(even)).max() <= 2
    even = lit_sheet(lambda x: 1 - 0.6 * np.exp(-((x - 0.5) ** 2) / 0.005))
    few = decimated(even, max_faces=10_000)
    apart = np.abs(seen_light(few) - seen_light(even))
    assert len(few.faces) < 0.7 * len(even.faces)
    assert apart.mean() < 2
    assert apart.max() < 12
    mixed = sheet(20, texture=lambda x, z: np.where(x > 0.5, VERTEX_COLOURS, 0))
    few = decimated(replace(mixed, vertex_rgb=np.full((len(mixed.vertices), 3), 255, np.uint8)), max_faces=10_000)
    assert few.vertex_rgb is not None
    assert set(few.face_texture) == {0, VERTEX_COLOURS}
    assert few.vertex_rgb.min() == 255


def test_a_sheet_folded_onto_itself_keeps_its_outline_and_equal_faces_are_kept_once() -> None:
    up = sheet(1)
    over = replace(up, faces=up.faces[:, ::-1], vertices=up.vertices[:, [2, 1, 0]])  # the other diagonal
    heights, _ = from_above(decimated(joined(up, over), max_faces=1000))
    assert np.isfinite(heights).all()
    one = sheet(3)
    turned = replace(one, faces=one.faces[:, ::-1], face_uv=one.face_uv[:, ::-1])
    twice = replace(joined(one, turned), vertices=one.vertices, faces=np.concatenate([one.faces, turned.faces]))
    assert decimated(replace(twice, textures=one.textures), max_faces=1000).digest() == (
        decimated(one, max_faces=1000).digest()
    )


def test_loose_triangles_are_dropped_smallest_first() -> None:
    rng = np.random.default_rng(1)
    sizes = rng.permutation(np.linspace(0.1, 1, 400))
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 0, 1]]) * sizes[:, None, None] + rng.uniform(0, 90, (400, 1, 3))
    left = decimated(triangles(corners, face_instance=np.arange(400, dtype=np.int32)), max_faces=100)
    assert set(left.face_instance) == set(np.argsort(-sizes)[:100])


meshes = st.builds(
    lambda seed, num, places: (np.random.default_rng(seed).integers(0, places, (num, 3, 3)), seed),
    st.integers(0, 2**16),
    st.integers(0, 60),
    st.integers(1, 5),
)


@settings(deadline=None)
@given(meshes, st.integers(0, 40))
def test_any_mesh_becomes_a_valid_one_within_the_limit_and_the_same_twice(made: tuple, limit: int) -> None:
    corners, seed = made
    num = len(corners)
    rng = np.random.default_rng(seed)
    mesh = triangles(
        corners,
        face_rgb=rng.integers(0, 2, (num, 3)).astype(np.uint8),
        face_instance=np.arange(num, dtype=np.int32),
        face_texture=rng.integers(-2, 2, num).astype(np.int16),
        face_uv=rng.integers(0, 3, (num, 3, 2)).astype(np.float32),
        textures=(WHITE, WHITE),
        vertex_rgb=rng.integers(0, 2, (3 * num, 3)).astype(np.uint8),
    )
    few = decimated(mesh, max_faces=limit)
    assert len(few.faces) <= limit
    assert few.digest() == decimated(mesh, max_faces=limit).digest()
    assert {tuple(point) for point in few.vertices} <= {tuple(point) for point in mesh.vertices}
    a, b, c = few.faces.T
    assert not ((a == b) | (b == c) | (c == a)).any()
