"""Storeys are cut at level planes: where the planes are, how faces are clipped, and which values they keep."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.copies.cut import CUT_BELOW, cut_storey, storey_cut, storey_mesh
from sim.errors import SceneError
from sim.mesh import VERTEX_COLOURS, IdImages, Scene, TriangleMesh
from sim.types import CUT_HEIGHT, SceneKind
from sim.walk.floor_grid import floor_grid_from_mesh

from .meshes import Quad, area, box, floor, mesh_of, ramp, triangles


def scene_of(*quads: Quad, kind: SceneKind = "scan") -> Scene:
    mesh = mesh_of(*quads)
    return Scene("Room", kind, mesh, (), floor_grid_from_mesh(mesh), mesh.digest())


def ceiling(x0: float, z0: float, x1: float, z1: float, *, y: float) -> Quad:
    corners, rgb, instance = floor(x0, z0, x1, z1, y=y)
    return corners[::-1], rgb, instance


def triangle(corners: list[list[float]]) -> TriangleMesh:
    """One triangle whose texture coordinates are (x + 2 y, z - y)."""
    x, y, z = np.array(corners, np.float32).T
    uv = np.stack([x + 2 * y, z - y], axis=1)[None]
    image, rgb = np.zeros((4, 4, 3), np.uint8), np.array([[9, 9, 9]], np.uint8)
    sevens, zeros = np.array([7], np.int32), np.array([0], np.int16)
    return triangles(
        np.array([corners]), face_rgb=rgb, face_instance=sevens, face_texture=zeros, face_uv=uv, textures=(image,)
    )


def test_a_face_through_the_plane_ends_there() -> None:
    cut = cut_storey(triangle([[0, 0, 0], [2, 0, 0], [0, 2, 0]]), bottom_y=-1.0, top_y=1.0)
    assert len(cut.faces) == 2
    assert area(cut).sum() == pytest.approx(1.5)
    assert sorted(cut.vertices.tolist()) == [[0, 0, 0], [0, 1, 0], [1, 1, 0], [2, 0, 0]]
    tip = cut_storey(triangle([[0, 0, 0], [2, 3, 0], [0, 3, 0]]), bottom_y=-1.0, top_y=1.5)
    assert len(tip.faces) == 1
    assert area(tip).sum() == pytest.approx(3 / 4)


coordinate = st.floats(-2, 2, allow_nan=False, width=32)


@given(st.lists(st.lists(coordinate, min_size=3, max_size=3), min_size=3, max_size=3), coordinate)
def test_both_sides_of_a_plane_make_the_whole_and_keep_its_texture_coordinates(corners: list, height: float) -> None:
    whole = triangle(corners)
    low = cut_storey(whole, bottom_y=-9.0, top_y=height)
    high = cut_storey(whole, bottom_y=height, top_y=9.0)
    flat_there = (whole.vertices[:, 1] == height).all()
    assert area(low).sum() + area(high).sum() == pytest.approx((1 + flat_there) * area(whole).sum(), abs=1e-4)
    for part in (low, high):
        points = part.vertices[part.faces].astype(float)
        wanted = np.stack([points[..., 0] + 2 * points[..., 1], points[..., 2] - points[..., 1]], axis=-1)
        np.testing.assert_allclose(part.face_uv, wanted, atol=1e-4)
        turn = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
        a, b, c = whole.vertices.astype(float)
        assert (turn @ np.cross(b - a, c - a) >= -1e-4).all(), "no face is turned over"
    assert (low.vertices[:, 1] <= np.float32(height)).all()
    assert (high.vertices[:, 1] >= np.float32(height)).all()


def test_vertex_colours_and_face_ids_are_cut_too() -> None:
    whole = triangle([[0, 0, 0], [2, 0, 0], [0, 2, 0]])
    ids = IdImages((np.ones((2, 2), np.uint16),), np.array([0], np.int16), whole.face_uv * 3)
    rgb = np.array([[0, 0, 0], [0, 0, 0], [200, 100, 50]], np.uint8)
    coloured = replace(whole, face_texture=np.array([VERTEX_COLOURS], np.int16), vertex_rgb=rgb, ids=ids)
    cut = cut_storey(coloured, bottom_y=-1.0, top_y=0.5)
    assert cut.vertex_rgb is not None
    assert cut.ids is not None
    np.testing.assert_array_equal(cut.vertex_rgb[cut.vertices[:, 1] == 0.5], [[50, 25, 12]] * 2)
    np.testing.assert_array_equal(cut.vertex_rgb[cut.vertices[:, 1] == 0], [[0, 0, 0]] * 2)
    np.testing.assert_allclose(cut.ids.face_uv, cut.face_uv * 3, atol=1e-6)
    lit = cut_storey(replace(coloured, face_texture=whole.face_texture), bottom_y=-1.0, top_y=0.5)
    assert lit.face_texture.tolist() == [0, 0]
    np.testing.assert_array_equal(lit.vertex_rgb, cut.vertex_rgb)
    np.testing.assert_array_equal(cut.face_instance, [7, 7])


def test_neighbours_stay_joined_along_the_cut() -> None:
    mesh = mesh_of(*box((0, 0, 0), (1, 2, 1)))
    keys, joined = np.unique(mesh.vertices, axis=0, return_inverse=True)
    welded = replace(mesh, vertices=keys, faces=joined.reshape(-1)[mesh.faces].astype(np.int32))
    cut = cut_storey(welded, bottom_y=-1.0, top_y=1.3)
    edges = np.sort(cut.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    pairs, count = np.unique(edges, axis=0, return_counts=True)
    open_edges = pairs[count == 1]
    assert len(open_edges) == 8, "the rim: four sides of two edges each"
    assert (cut.vertices[open_edges, 1] == np.float32(1.3)).all()


ROOM = box((0, 0, 0), (6, 3, 4))[2:]
"""Four walls, 3 m high."""


@pytest.mark.parametrize(
    ("ceiling_y", "top"), [(1.7, 1.6), (2.0, 1.85), (2.2, 2.05), (2.5, 2.2), (4.0, 2.2), (None, 1.9)]
)
def test_the_cut_is_below_the_ceiling_above_eyes_and_near_door_heads(ceiling_y: float | None, top: float) -> None:
    lid = [] if ceiling_y is None else [ceiling(0, 0, 6, 4, y=ceiling_y)]
    scene = scene_of(floor(0, 0, 6, 4), *ROOM, *lid)
    assert storey_cut(scene, 0.0) == pytest.approx((-CUT_BELOW, top), abs=0.02)


def test_planned_homes_are_cut_at_one_height_unless_the_ceiling_is_low() -> None:
    quads = (floor(0, 0, 6, 4), *ROOM)
    assert storey_cut(scene_of(*quads, ceiling(0, 0, 6, 4, y=2.6), kind="invented"), 0.0).top_y == CUT_HEIGHT
    assert storey_cut(scene_of(*quads, ceiling(0, 0, 6, 4, y=1.9), kind="schematic"), 0.0).top_y == pytest.approx(1.75)


def test_one_low_room_lowers_the_cut_but_lamps_do_not() -> None:
    lamps = [quad for x in (1, 2, 3, 4) for quad in box((x, 1.6, 2.0), (x + 0.4, 1.8, 2.4))]
    high = [floor(0, 0, 6, 4), *ROOM, ceiling(2, 0, 6, 4, y=2.5)]
    assert storey_cut(scene_of(*high, ceiling(0, 0, 2, 4, y=2.5), *lamps), 0.0).top_y == pytest.approx(2.2, abs=0.02)
    low = storey_cut(scene_of(*high, ceiling(0, 0, 2, 4, y=1.95), *lamps), 0.0).top_y
    assert low == pytest.approx(1.8, abs=0.02)


def test_split_levels_platforms_and_slopes_stay_visible() -> None:
    quads = [
        floor(0, 0, 6, 4),
        ceiling(0, 0, 6, 4, y=2.6),
        ramp(6, 0, 9, 4, y0=0.0, y1=-1.2),
        ceiling(6, 0, 13, 4, y=1.1),
        floor(9, 0, 13, 4, y=-1.2),
        *box((1, 0, 1), (3, 0.7, 3)),
    ]
    scene = scene_of(*quads)
    heights = storey_cut(scene, 0.0)
    assert heights.bottom_y == pytest.approx(-1.2 - CUT_BELOW, abs=0.1)
    assert 0.999 <= heights.top_y < 1.1, "above the platform, below the ceiling of the lower part"
    seen = storey_mesh(scene, 0.0)
    flat = seen.vertices[seen.faces][..., 1]
    assert {0.0, -1.2, 0.7} <= {round(float(y), 3) for y in flat[np.ptp(flat, axis=1) == 0][:, 0]}
    assert flat.max() < 1.1


def test_a_height_without_faces_is_refused_with_the_heights_that_exist() -> None:
    scene = scene_of(floor(0, 0, 6, 4), *ROOM)
    with pytest.raises(SceneError, match=r"^Room: found no face on a storey at 9.0 m; .* near one of \[0.00\]"):
        storey_mesh(scene, 9.0)
