"""View points around a box in a small room: distance, line of sight, storey and yaw."""

import math

import numpy as np
import pytest

from sim.scenes.scene import TriangleMesh
from sim.world.floor_grid import floor_grid_from_mesh
from sim.world.raycast import Raycaster
from sim.world.viewpoints import SPACING, SeenFrom, view_points_around
from tests.sim.meshes import box, floor, mesh_of

BOX = ((2.7, 0.0, 2.7), (3.3, 0.5, 3.3))
"""A crate in the middle of a floor of 6 x 6 m."""


def around(mesh: TriangleMesh, low, high, *, instance: int = 7) -> list[SeenFrom]:
    centre, size = (np.array(low) + high) / 2, np.array(high) - low
    return view_points_around(
        tuple(centre.tolist()),
        tuple(size.tolist()),
        navigation=floor_grid_from_mesh(mesh),
        renderer=Raycaster(mesh),
        instance_id=instance,
        face_instance=mesh.face_instance,
    )


def planar(point: SeenFrom, xz=(3.0, 3.0)) -> float:
    return math.hypot(point.position[0] - xz[0], point.position[2] - xz[1])


def test_a_crate_in_the_open_is_seen_from_all_sides_within_a_metre():
    points = around(mesh_of(floor(0, 0, 6, 6), *box(*BOX, instance=7)), *BOX)
    assert len(points) >= 12
    assert max(map(planar, points)) <= 1.0
    angles = np.sort([math.atan2(point.position[0] - 3, point.position[2] - 3) for point in points])
    assert np.diff(angles).max() < 1.0
    gaps = [
        math.hypot(a.position[0] - b.position[0], a.position[2] - b.position[2])
        for i, a in enumerate(points)
        for b in points[:i]
    ]
    assert min(gaps) >= SPACING


def test_points_face_the_object_and_the_best_come_first():
    points = around(mesh_of(floor(0, 0, 6, 6), *box(*BOX, instance=7)), *BOX)
    for point in points:
        x, _, z = point.position
        towards = np.array([3 - x, 3 - z]) / planar(point)
        assert towards @ [-math.sin(point.yaw), -math.cos(point.yaw)] == pytest.approx(1.0)
        assert 0 < point.visible_share <= 1
    shares = [point.visible_share for point in points]
    assert shares == sorted(shares, reverse=True)


def test_a_wall_hides_the_object_from_behind_it():
    wall = box((0.0, 0.0, 2.5), (6.0, 2.5, 2.6), instance=0)
    points = around(mesh_of(floor(0, 0, 6, 6), *box(*BOX, instance=7), *wall), *BOX)
    assert points
    assert all(point.position[2] > 2.6 for point in points)


def test_the_radius_is_relaxed_when_fewer_than_five_places_within_a_metre_see_the_object():
    bed = box((2.1, 0.0, 2.1), (3.9, 0.5, 3.9), instance=3)  # leaves no floor within 0.9 m of its middle
    cup = ((2.95, 0.5, 2.95), (3.05, 0.6, 3.05))
    home = mesh_of(floor(0, 0, 6, 6), *bed, *box(*cup, instance=7))
    points = around(home, *cup)
    assert len(points) >= 5
    assert 1.0 < max(map(planar, points)) <= 1.5
    assert {point.position[1] for point in points} == {0.0}, "nobody stands on the bed"


def test_an_object_is_seen_from_its_own_storey_only():
    upper = box((0, 2.8, 0), (6, 3.0, 6))
    low, high = (2.7, 3.0, 2.7), (3.3, 3.5, 3.3)
    home = mesh_of(floor(0, 0, 6, 6), *upper, *box((0, 5.6, 0), (6, 5.8, 6)), *box(low, high, instance=7))
    points = around(home, low, high)
    assert points
    assert all(point.position[1] == pytest.approx(3.0) for point in points)


def test_an_object_that_nobody_can_see_has_no_view_points():
    closet = box((2.4, 0.0, 2.4), (3.6, 2.0, 3.6))
    assert around(mesh_of(floor(0, 0, 6, 6), *closet, *box(*BOX, instance=7)), *BOX) == []
