"""Baked light: no seams, dark corners, a bright sun side, lamps, and its cache."""

from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from sim.cache import VARIABLE
from sim.homes.building import light as light_module
from sim.homes.building.light import DARKEST
from sim.homes.building.quads import QuadBuilder
from sim.homes.furniture.shapes import box
from sim.homes.plan import Finish
from sim.mesh import TriangleMesh
from sim.render.raycast import Raycaster
from sim.render.renderer import Backend

from .raycasters import has_embree

WHITE = Finish(rgb=(255, 255, 255))
"""A finish without texture, so that vertex colours are the light itself."""
Light = NDArray[np.float64]
Vec = tuple[float, float, float]


def add_box(builder: QuadBuilder, centre: Vec, size: Vec, *, yaw: float = 0.0, instance: int = 0) -> None:
    """Adds a white box, turned by `yaw` about its centre."""
    builder.add_quads(box((0, 0, 0), size).turned("y", yaw).corners + np.array(centre), WHITE, instance=instance)


def flat(x0: float, z0: float, x1: float, z1: float, y: float = 0.0) -> list[list[tuple[float, float, float]]]:
    """A level rectangle that faces up."""
    return [[(x0, y, z0), (x0, y, z1), (x1, y, z1), (x1, y, z0)]]


def wall_x(x: float, z0: float, z1: float, height: float = 2.5) -> NDArray[np.float64]:
    """A wall at x that faces +x."""
    return np.array([[(x, 0, z1), (x, 0, z0), (x, height, z0), (x, height, z1)]], float)


def wall_z(z: float, x0: float, x1: float, height: float = 2.5) -> NDArray[np.float64]:
    """A wall at z that faces +z."""
    return np.array([[(x0, 0, z), (x1, 0, z), (x1, height, z), (x0, height, z)]], float)


def room(builder: QuadBuilder, side: float = 4.0) -> None:
    """Adds a square floor and four walls that face inwards, without a ceiling."""
    builder.add_quads(flat(0, 0, side, side), WHITE)
    builder.add_quads(wall_x(0, 0, side), WHITE)
    builder.add_quads(wall_x(side, 0, side)[:, ::-1], WHITE)
    builder.add_quads(wall_z(0, 0, side), WHITE)
    builder.add_quads(wall_z(side, 0, side)[:, ::-1], WHITE)


def light_at(
    mesh: TriangleMesh, points: list[tuple[float, float, float]], towards: tuple[float, float, float]
) -> Light:
    """Mean light (N,) in [0, 1] where rays from points (N, 3) meet the mesh, blended as the renderer does."""
    assert mesh.vertex_rgb is not None
    origins = np.array(points, float)
    hits = Raycaster(mesh).cast(origins, np.tile(towards, (len(origins), 1)))
    assert (hits.face_ids >= 0).all()
    corners = mesh.vertices[mesh.faces[hits.face_ids]].astype(float)
    a, b, c = np.moveaxis(corners, 1, 0)
    whole = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    share_b = np.linalg.norm(np.cross(hits.positions - a, c - a), axis=1) / whole
    share_c = np.linalg.norm(np.cross(b - a, hits.positions - a), axis=1) / whole
    shares = np.stack([1 - share_b - share_c, share_b, share_c], axis=1)
    rgb = mesh.vertex_rgb[mesh.faces[hits.face_ids]].astype(float).mean(axis=2)
    return (shares * rgb).sum(axis=1) / 255


def floor_light(mesh: TriangleMesh, places: list[tuple[float, float]]) -> Light:
    """Light (N,) of the first surface below each place (x, z) at a height of 0.4 m."""
    return light_at(mesh, [(x, 0.4, z) for x, z in places], (0, -1, 0))


def edges_on(mesh: TriangleMesh, x: float, *, left: bool) -> Iterator[tuple[NDArray, NDArray]]:
    """Ends z (2,) and their light (2,) in [0, 255] of each edge at x that belongs to a face on this side."""
    assert mesh.vertex_rgb is not None
    for face in mesh.faces:
        on = face[np.abs(mesh.vertices[face, 0] - x) < 1e-6]
        if len(on) == 2 and (mesh.vertices[face, 0].mean() < x) == left:
            order = on[np.argsort(mesh.vertices[on, 2])]
            yield mesh.vertices[order, 2], mesh.vertex_rgb[order].mean(axis=1)


def test_quads_of_different_sizes_have_the_same_light_along_a_shared_edge() -> None:
    builder, edge = QuadBuilder(), 2.03
    builder.add_quads(flat(0, 0, edge, 3.11), WHITE)
    for z0, z1 in ((0.0, 0.37), (0.37, 1.9), (1.9, 3.11)):
        builder.add_quads(flat(edge, z0, 3.3, z1), WHITE)
    add_box(builder, (2.0, 0.6, 1.0), (0.8, 1.0, 0.7), yaw=0.4, instance=1)
    builder.add_quads(wall_z(0, 0, 3.3), WHITE)
    mesh = builder.mesh()
    at = np.linspace(0.001, 3.109, 500)
    sides = []
    for left in (True, False):
        light = np.full(len(at), np.nan)
        for z, values in edges_on(mesh, edge, left=left):
            here = (at >= z[0]) & (at <= z[1])
            light[here] = np.interp(at[here], z, values)
        sides.append(light)
    assert not np.isnan(sides).any()
    assert np.ptp(sides[0]) > 25, "the box and the wall darken a part of the edge"
    np.testing.assert_allclose(sides[0], sides[1], atol=1.01)


def test_the_corner_of_a_room_is_darker_than_its_middle() -> None:
    builder = QuadBuilder()
    room(builder)
    mesh = builder.mesh()
    corner, foot, middle = floor_light(mesh, [(0.05, 0.05), (0.05, 2.0), (2.0, 2.0)])
    assert corner < foot - 0.05
    assert foot < middle - 0.15
    low, high = light_at(mesh, [(2.0, 0.03, 2.0), (2.0, 1.5, 2.0)], (-1, 0, 0))
    assert low < high - 0.1


def test_the_floor_under_a_table_is_darker_and_no_surface_is_black() -> None:
    builder = QuadBuilder()
    room(builder, 5.0)
    add_box(builder, (2.5, 0.72, 2.5), (1.4, 0.06, 0.9), instance=1)
    under, beside = floor_light(builder.mesh(), [(2.5, 2.5), (4.0, 4.0)])
    assert under < beside - 0.12
    builder = QuadBuilder()
    room(builder)
    add_box(builder, (2, 0.1, 2), (1.5, 0.16, 1.5), instance=1)
    add_box(builder, (2, 0.18, 2), (1.5, 0.3, 1.5), instance=2)  # overlaps the first
    mesh = builder.mesh()
    assert mesh.vertex_rgb is not None
    assert mesh.vertex_rgb.min() >= int(DARKEST * 255)


def test_the_side_towards_the_sun_is_brighter() -> None:
    builder = QuadBuilder()
    add_box(builder, (0, 1, 0), (1, 1, 1), instance=1)
    mesh = builder.mesh()
    sides = {
        name: float(light_at(mesh, [tuple(3 * np.array(d) + [0, 1, 0])], tuple(-np.array(d)))[0])
        for name, d in {"up": (0, 1, 0), "+x": (1, 0, 0), "-x": (-1, 0, 0), "+z": (0, 0, 1), "-z": (0, 0, -1)}.items()
    }
    assert sides["+x"] > sides["-x"] + 0.1
    assert sides["+z"] > sides["-z"] + 0.05
    assert len({round(value, 2) for value in sides.values()}) >= 4, "neighbouring sides differ"


def test_a_wall_that_stands_on_a_floor_leaves_no_black_line() -> None:
    """Light is computed on a lattice of the floor, and some of its points lie inside the wall."""
    for shift in (0.0, 0.05, 0.1):
        builder = QuadBuilder()
        builder.add_quads(flat(0, 0, 6, 4), WHITE)
        add_box(builder, (3 + shift, 1.25, 2), (0.12, 2.5, 4))
        mesh = builder.mesh()
        foot = floor_light(mesh, [(3 + shift + side * 0.07, z) for side in (-1, 1) for z in (0.8, 1.3, 1.9, 2.6)])
        middle = floor_light(mesh, [(1.3, 2.0)])[0]
        assert foot.max() < middle - 0.1
        assert foot.min() > middle - 0.45
        assert np.ptp(foot[:4]) < 0.03
        assert np.ptp(foot[4:]) < 0.03


def test_light_changes_smoothly_over_a_floor() -> None:
    builder = QuadBuilder()
    room(builder)
    add_box(builder, (2, 0.4, 1.2), (0.9, 0.8, 0.5), yaw=0.3, instance=1)
    light = floor_light(builder.mesh(), [(x, 2.2) for x in np.linspace(0.1, 3.9, 381).tolist()])
    assert np.abs(np.diff(light)).max() < 0.02, "between places 1 cm apart"


def test_a_lamp_brightens_near_surfaces_but_not_those_behind_a_wall() -> None:
    def lit(*lamps: tuple[float, float, float]) -> TriangleMesh:
        builder = QuadBuilder()
        room(builder)
        builder.add_quads(wall_x(2, 0, 4), WHITE)
        builder.add_quads(wall_x(1.9, 0, 4)[:, ::-1], WHITE)
        return builder.mesh(lamps=lamps)

    places = [(2.8, 0.4), (3.0, 3.6), (1.2, 0.6)]
    gain = floor_light(lit((3.0, 1.4, 0.5)), places) - floor_light(lit(), places)
    assert gain[0] > 0.03
    assert gain[0] > gain[1] + 0.02
    assert gain[2] == pytest.approx(0, abs=1e-9), "the wall shades its other side"
    warm = lit((3.0, 1.4, 0.5)).vertex_rgb
    assert warm is not None
    assert (warm[:, 0].astype(int) - warm[:, 2]).max() > 5


def test_both_backends_for_rays_give_the_same_light(monkeypatch, tmp_path) -> None:
    if not has_embree():
        pytest.skip("Embree's packets cannot be used here")

    def lit() -> NDArray[np.uint8]:
        builder = QuadBuilder()
        room(builder)
        add_box(builder, (2, 0.4, 1.2), (0.9, 0.8, 0.5), yaw=0.3, instance=1)
        vertex_rgb = builder.mesh(lamps=[(3.0, 1.4, 0.5)]).vertex_rgb
        assert vertex_rgb is not None
        return vertex_rgb

    fast = lit()
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    monkeypatch.setattr(light_module, "chosen_backend", lambda: Backend("open3d", 1, "test"))
    slow = lit()
    difference = np.abs(fast.astype(int) - slow)
    assert difference.mean() < 0.2
    assert (difference > 4).mean() < 0.01


def test_light_is_computed_once_and_again_for_other_geometry_or_lamps(monkeypatch, tmp_path) -> None:
    monkeypatch.setenv(VARIABLE, str(tmp_path))

    def lit(shift: float, *lamps: tuple[float, float, float]) -> str:
        builder = QuadBuilder()
        room(builder)
        add_box(builder, (2, 0.4, 1.2 + shift), (0.9, 0.8, 0.5), instance=1)
        return builder.mesh(lamps=lamps).digest()

    first = lit(0.0)
    assert lit(0.0) == first
    assert len(list(tmp_path.rglob("*.light"))) == 1
    assert lit(0.3) != first
    assert lit(0.0, (1.0, 1.5, 1.0)) != first
    assert len(list(tmp_path.rglob("*.light"))) == 3
