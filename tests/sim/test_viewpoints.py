"""View points in small homes with known answers: distance, line of sight, storey, yaw and tilt."""

import math

import numpy as np
import pytest

from sim.frames import T_world_camera
from sim.homes.invented.plans import invent_plan
from sim.homes.open_home import scene_from_plan
from sim.mesh import SceneObject, TriangleMesh
from sim.render.raycast import Raycaster
from sim.types import CAMERA_HEIGHT, Camera, Pose
from sim.walk.floor_grid import floor_grid_from_mesh
from sim.walk.viewpoints import RELAXED_RADIUS, SPACING, SeenFrom, view_points_around
from tests.sim.meshes import box, floor, mesh_of
from tests.sim.test_object_surface import painted_wall

BOX = ((2.7, 0.0, 2.7), (3.3, 0.5, 3.3))
"""A crate in the middle of a floor of 6 x 6 m."""


def item_of(low, high, *, instance: int = 7) -> SceneObject:
    centre, size = (np.array(low) + high) / 2, np.array(high) - low
    return SceneObject(instance, "crate_0", "crate", tuple(centre.tolist()), tuple(size.tolist()))


def around(mesh: TriangleMesh, low, high) -> list[SeenFrom]:
    return view_points_around(item_of(low, high), mesh, navigation=floor_grid_from_mesh(mesh), renderer=Raycaster(mesh))


def planar(point: SeenFrom, xz=(3.0, 3.0)) -> float:
    return math.hypot(point.position[0] - xz[0], point.position[2] - xz[1])


def steepness_deg(point: SeenFrom) -> float:
    """Angle by which the line from the camera to the visible point rises, degrees."""
    x, y, z = np.subtract(point.visible_point, point.position)
    return math.degrees(math.atan2(y - CAMERA_HEIGHT, math.hypot(x, z)))


def floors(points: list[SeenFrom]) -> set[float]:
    return {round(point.position[1], 2) for point in points}


def pixel_of(point: SeenFrom) -> tuple[float, float]:
    """(column, row) of the visible point in the picture from the pose of the view point."""
    camera = Camera()
    T_camera_world = np.linalg.inv(T_world_camera(Pose(point.position, point.yaw, point.tilt), camera))
    x, y, z = T_camera_world[:3, :3] @ point.visible_point + T_camera_world[:3, 3]
    assert z > 0, "in front of the camera"
    return camera.width / 2 + camera.focal * x / z, camera.height / 2 + camera.focal * y / z


def first_hit(mesh: TriangleMesh, origin: np.ndarray, target: np.ndarray) -> tuple[int, float]:
    """(face, share of the segment before it) where a segment first hits a mesh, by the Moeller-Trumbore formula."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]].astype(np.float64) for k in range(3))
    way, one, two = target - origin, b - a, c - a
    p = np.cross(way, two)
    scale = (one * p).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = ((origin - a) * p).sum(axis=1) / scale
        q = np.cross(origin - a, one)
        v = (q @ way) / scale
        at = (q * two).sum(axis=1) / scale
    met = (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1 + 1e-9) & (at > 1e-6)
    face = int(np.where(met, at, np.inf).argmin())
    return face, float(at[face])


def test_a_free_crate_is_seen_from_all_sides_within_a_metre_best_points_first():
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
    for point in points:
        x, _, z = point.position
        towards = np.array([3 - x, 3 - z]) / planar(point)
        assert towards @ [-math.sin(point.yaw), -math.cos(point.yaw)] > math.cos(math.radians(20))
        assert 0 < point.visible_share <= 1
    shares = [point.visible_share for point in points]
    assert shares == sorted(shares, reverse=True)


def test_the_same_scene_gives_the_same_points():
    home = mesh_of(floor(0, 0, 6, 6), *box(*BOX, instance=7))
    assert around(home, *BOX) == around(home, *BOX)


def test_a_wall_hides_an_object_but_a_thin_object_is_seen_from_both_sides():
    wall = box((0.0, 0.0, 2.5), (6.0, 2.5, 2.6), instance=0)
    points = around(mesh_of(floor(0, 0, 6, 6), *box(*BOX, instance=7), *wall), *BOX)
    assert points
    assert all(point.position[2] > 2.6 for point in points)
    screen = (np.array([[2.5, 0, 3], [3.5, 0, 3], [3.5, 1.5, 3], [2.5, 1.5, 3]]), (9, 9, 9), 7)
    points = around(mesh_of(floor(0, 0, 6, 6), screen), (2.5, 0, 2.99), (3.5, 1.5, 3.01))
    assert {point.position[2] > 3 for point in points} == {True, False}
    assert max(point.visible_share for point in points) == 1.0


def test_if_a_wall_hides_half_an_object_the_camera_turns_to_the_visible_half():
    sofa = ((2.0, 0.0, 1.0), (4.0, 0.8, 1.5))
    screen = box((2.9, 0.0, 1.52), (3.0, 2.5, 6.0))
    points = around(mesh_of(floor(0, 0, 6, 6), *box(*sofa, instance=7), *screen), *sofa)
    left = [point for point in points if point.position[0] < 2.8 and point.position[2] > 1.7]
    assert left
    assert all(point.visible_point[0] < 3.0 for point in left)


def test_the_radius_is_relaxed_only_if_no_place_within_a_metre_sees_the_object():
    bed = box((2.1, 0.0, 2.1), (3.9, 0.5, 3.9), instance=3)  # leaves no floor within 0.9 m of its centre
    cup = ((2.95, 0.5, 2.95), (3.05, 0.6, 3.05))
    home = mesh_of(floor(0, 0, 6, 6), *bed, *box(*cup, instance=7))
    points = around(home, *cup)
    assert len(points) >= 5
    assert min(map(planar, points)) > 1.0
    assert max(map(planar, points)) <= 1.5
    assert floors(points) == {0.0}, "no view point is on the bed"
    points = around(mesh_of(floor(0, 0, 6, 6), *box(*BOX, instance=7), *box((2.0, 0, 0), (2.1, 2.5, 6))), *BOX)
    assert points
    assert max(map(planar, points)) <= 1.0


def test_a_picture_at_170_cm_is_seen_from_the_floor_below_it():
    wall = box((0.0, 0.0, 0.0), (6.0, 2.5, 0.1))
    picture = ((2.8, 1.5, 0.1), (3.2, 1.9, 0.12))
    points = around(mesh_of(floor(0, 0, 6, 6), *wall, *box(*picture, instance=7)), *picture)
    assert len(points) >= 5
    assert floors(points) == {0.0}
    for point in points:
        assert point.visible_point[1] == pytest.approx(1.7, abs=0.2)
        assert steepness_deg(point) < 61.8


def test_an_object_that_needs_a_tilted_camera_from_nearby_has_view_points_with_that_tilt():
    coin = ((2.95, 0.0, 2.95), (3.05, 0.02, 3.05))
    points = around(mesh_of(floor(0, 0, 6, 6), *box(*coin, instance=7)), *coin)
    assert {point.tilt for point in points} == {-math.radians(30)}
    assert all(-61.8 < steepness_deg(point) < -31.7 for point in points), "half the field of view is 31.7 degrees"


def test_a_cup_on_a_large_table_is_seen_from_the_floor_and_not_from_the_table():
    table = box((2.0, 0.7, 2.0), (4.2, 0.75, 4.2))
    cup = ((2.25, 0.75, 3.0), (2.35, 0.85, 3.1))
    home = mesh_of(floor(0, 0, 6, 6), *table, *box(*cup, instance=7))
    assert floor_grid_from_mesh(home).is_navigable(np.array([3.2, 0.75, 3.2])), "the table top is a walkable island"
    points = around(home, *cup)
    assert points
    assert floors(points) == {0.0}


def test_objects_in_a_closed_box_missing_from_the_mesh_or_far_from_any_floor_have_no_view_points():
    closet = box((2.4, 0.0, 2.4), (3.6, 2.0, 3.6))
    assert around(mesh_of(floor(0, 0, 6, 6), *closet, *box(*BOX, instance=7)), *BOX) == []
    assert around(mesh_of(floor(0, 0, 6, 6), *box(*BOX, instance=3)), *BOX) == []
    far = ((20.0, 0.0, 20.0), (20.5, 0.5, 20.5))
    assert around(mesh_of(floor(0, 0, 6, 6), *box(*far, instance=7)), *far) == []


def test_objects_lamps_and_pictures_beside_a_stair_are_seen_only_from_their_own_storey():
    upper = box((0, 2.8, 0), (6, 3.0, 6))
    low, high = (2.7, 3.0, 2.7), (3.3, 3.5, 3.3)
    home = mesh_of(floor(0, 0, 6, 6), *upper, *box((0, 5.6, 0), (6, 5.8, 6)), *box(low, high, instance=7))
    assert floors(around(home, low, high)) == {3.0}
    upper, roof = box((0, 2.6, 0), (6, 2.7, 6)), box((0, 5.4, 0), (6, 5.5, 6))
    lamp = ((3.0, 2.5, 3.0), (3.4, 2.6, 3.4))
    home = mesh_of(floor(0, 0, 6, 6), *upper, *roof, *box(*lamp, instance=7))
    points = around(home, *lamp)
    assert floors(points) == {0.0}
    assert all(point.tilt > 0 for point in points)
    steps = [quad for k in range(14) for quad in box((3 + 0.28 * k, 0.0, 0.0), (3.28 + 0.28 * k, 0.2 * (k + 1), 1.2))]
    upper = [*box((6.92, 2.6, 0), (10, 2.8, 6)), *box((0, 2.6, 1.4), (6.92, 2.8, 6)), *box((0, 5.6, 0), (10, 5.7, 6))]
    low = ((5.0, 1.5, 1.2), (5.3, 1.8, 1.22))  # on the open side of the stair, above the lower floor
    home = mesh_of(floor(0, 0, 10, 6), *steps, *upper, *box(*low, instance=7))
    points = around(home, *low)
    assert points
    assert max(point.position[1] for point in points) < 1.5


def test_a_rug_in_a_sunken_room_above_a_cellar_is_seen_from_that_room():
    cellar = [floor(0, 0, 9, 6, y=-2.9), *box((0, -0.6, 0), (9, -0.5, 6))]
    room = [*box((-8, -0.5, 0), (4, 0.0, 6)), *box((4, -0.5, 0), (4.4, -0.2, 6)), floor(4.4, 0, 9, 6, y=-0.4)]
    rug = ((6.0, -0.4, 2.5), (7.0, -0.38, 3.5))
    home = mesh_of(*cellar, *room, *box((-8, 2.5, 0), (9, 2.6, 6)), *box(*rug, instance=7))
    assert floor_grid_from_mesh(home).storey_heights == pytest.approx((-2.9, 0.0), abs=0.01)
    points = around(home, *rug)
    assert points
    assert floors(points) <= {-0.4, -0.38}


def test_an_object_that_exists_only_in_an_id_image_is_seen_where_it_is_painted():
    picture = ((2.8, 1.5, -0.01), (3.2, 1.9, 0.01))
    points = around(painted_wall(), *picture)
    assert len(points) >= 5
    for point in points:
        x, y, z = point.visible_point
        assert 2.8 <= x <= 3.2
        assert 1.5 <= y <= 1.9
        assert z == pytest.approx(0, abs=1e-5)


@pytest.mark.parametrize("seed", range(8))
def test_every_view_point_is_on_the_storey_near_the_object_faces_it_and_sees_it(seed):
    rng = np.random.default_rng(seed)
    clutter = []
    for low_x, low_z, side, top in rng.uniform((0, 0, 0.2, 0.3), (5.5, 5.5, 1.2, 2.0), (8, 4)):
        clutter += box((low_x, 0.0, low_z), (low_x + side, top, low_z + side), instance=2)
    shell = [*box((0, 2.5, 0), (6, 2.7, 6)), *box((0, 5.2, 0), (6, 5.4, 6)), *box((2.9, 0, 0), (3.0, 2.5, 4.9))]
    found = 0
    for _ in range(3):
        low = rng.uniform((0.3, 0.0, 0.3), (5.0, 1.6, 5.0))
        high = low + rng.uniform(0.05, (1.2, 0.6, 1.2))
        mesh = mesh_of(floor(0, 0, 6, 6), *shell, *clutter, *box(tuple(low), tuple(high), instance=7))
        item, navigation = item_of(low, high), floor_grid_from_mesh(mesh)
        points = view_points_around(item, mesh, navigation=navigation, renderer=Raycaster(mesh))
        found += len(points)
        for point in points:
            eye = np.add(point.position, (0, CAMERA_HEIGHT, 0))
            assert navigation.is_navigable(np.array(point.position), max_dy=1e-3)
            assert planar(point, (item.centre[0], item.centre[2])) <= RELAXED_RADIUS
            assert abs(point.position[1]) < 1.5
            column, row = pixel_of(point)
            assert column == pytest.approx(320, abs=1e-3)
            assert 0 <= row <= 480
            face, share = first_hit(mesh, eye, np.array(point.visible_point))
            assert mesh.face_instance[face] == 7
            assert share == pytest.approx(1.0, abs=1e-4)
    assert found >= 5


def test_nearly_every_piece_of_an_invented_home_has_view_points_and_is_in_their_pictures():
    scene = scene_from_plan(invent_plan("Demo", seed=3))
    renderer = Raycaster(scene.mesh)
    with_points = 0
    for item in scene.objects[::6]:
        points = view_points_around(item, scene.mesh, navigation=scene.navigation, renderer=renderer)
        with_points += bool(points)
        for point in points[:3]:
            camera = Camera(160, 120)
            frame = renderer.render(T_world_camera(Pose(point.position, point.yaw, point.tilt), camera), camera)
            assert item.instance_id in frame.instance_ids, item.name
    assert with_points >= 0.9 * len(scene.objects[::6])


def test_an_object_known_by_its_box_is_seen_from_all_sides_and_not_through_walls() -> None:
    mesh = mesh_of(floor(0, 0, 6, 6), *box(*BOX, instance=7))
    by_id, by_box = around(mesh, *BOX), boxed(mesh, *BOX)
    assert len(by_id) > 8
    assert abs(len(by_box) - len(by_id)) <= 6  # the box holds a rim of floor too
    assert max(planar(point) for point in by_box) <= 1.0
    wall = box((2.0, 0.0, 2.4), (4.0, 2.0, 2.5))
    hidden = boxed(mesh_of(floor(0, 0, 6, 6), *box(*BOX, instance=7), *wall), *BOX)
    assert hidden
    assert all(point.position[2] > 2.5 for point in hidden)
    assert boxed(mesh, (0.5, 1.0, 0.5), (0.9, 1.4, 0.9)) == []


def boxed(mesh: TriangleMesh, low, high) -> list[SeenFrom]:
    item = item_of(low, high, instance=0)
    return view_points_around(item, mesh, navigation=floor_grid_from_mesh(mesh), renderer=Raycaster(mesh))
