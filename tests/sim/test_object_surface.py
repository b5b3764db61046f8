"""The object at a place on a mesh, by faces and by id images, and points spread over one object."""

from dataclasses import replace

import numpy as np
import pytest

from sim.mesh import IdImages, TriangleMesh
from sim.walk.object_surface import object_ids_at, object_surface
from tests.sim.meshes import box, floor, mesh_of

PAINTED = np.zeros((25, 60), np.uint16)
PAINTED[6:10, 28:32] = 7
"""Object ids of a wall of 6 x 2.5 m, one texel per decimetre: a picture (id 7) at x = 2.8-3.2, y = 1.5-1.9."""


def painted_wall() -> TriangleMesh:
    """A floor and a wall of two large triangles; the picture on the wall exists only in the id image."""
    wall = (np.array([[0, 2.5, 0], [0, 0, 0], [6, 0, 0], [6, 2.5, 0]]), (200, 200, 200), 0)
    mesh = mesh_of(wall, floor(0, 0, 6, 6))
    return replace(mesh, ids=IdImages((PAINTED,), np.array([0, 0, -1, -1], np.int16), mesh.face_uv))


def test_ids_are_read_from_the_image_of_a_face_or_from_the_face_if_it_has_none():
    mesh = painted_wall()
    places = np.array([[3.0, 1.7, 0], [3.3, 1.7, 0], [3.0, 1.45, 0], [2.85, 1.85, 0], [1, 0, 1], [0, 0, 0]])
    faces = np.array([0, 0, 0, 1, 2, -1])
    faces[:4] = np.where(places[:4, 1] < 2.5 - places[:4, 0] * 2.5 / 6, 0, 1)
    # The first of the wall's two triangles lies below the diagonal from (0, 2.5) to (6, 0).
    assert object_ids_at(mesh, faces, places).tolist() == [7, 0, 0, 7, 0, 0]
    crate = mesh_of(floor(0, 0, 6, 6), *box((2.7, 0.0, 2.7), (3.3, 0.5, 3.3), instance=7))
    assert object_ids_at(crate, np.array([0, 2, -1]), np.zeros((3, 3))).tolist() == [0, 7, 0]


def test_points_of_a_surface_are_spread_by_area_and_always_the_same():
    flat = ((0.0, 0.0, 0.0), (2.0, 1.0, 0.5))  # areas 2 x (2 x 1, 2 x 0.5, 1 x 0.5)
    mesh = mesh_of(*box(*flat, instance=7), *box((5, 0, 5), (6, 1, 6), instance=3))
    points = object_surface(mesh, 7, centre=(1.0, 0.5, 0.25), size=(2.0, 1.0, 0.5), count=700)
    assert np.array_equal(points, object_surface(mesh, 7, centre=(1.0, 0.5, 0.25), size=(2.0, 1.0, 0.5), count=700))
    on = {
        axis: np.isclose(points[:, axis], low) | np.isclose(points[:, axis], high)
        for axis, low, high in ((0, 0.0, 2.0), (1, 0.0, 1.0), (2, 0.0, 0.5))
    }
    assert (on[0] | on[1] | on[2]).all()
    assert [on[axis].mean() for axis in range(3)] == pytest.approx([1 / 7, 2 / 7, 4 / 7], abs=0.02)
    top = points[np.isclose(points[:, 1], 1.0)]
    assert top.mean(axis=0) == pytest.approx([1.0, 1.0, 0.25], abs=0.05)
    assert len(object_surface(mesh, 9, centre=(1, 1, 1), size=(1, 1, 1), count=9)) == 0
