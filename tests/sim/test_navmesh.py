"""The map of a `.navmesh`: tiny meshes with answers computed by hand, and laws that hold on any mesh."""

import math
import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.errors import SceneError
from sim.walk.navmesh import NavMesh, load_navmesh
from tests.sim.meshes import floor, mesh_of
from tests.sim.navmesh_files import l_shape, plate, two_storeys, write_navmesh


def at(x: float, z: float, y: float = 0.0) -> np.ndarray:
    return np.array([x, y, z], float)


@pytest.fixture(scope="module")
def corner(tmp_path_factory) -> NavMesh:
    """The L, whose inner corner is (4, 2)."""
    return load_navmesh(write_navmesh(tmp_path_factory.mktemp("navmesh") / "l.navmesh", l_shape()))


@pytest.fixture(scope="module")
def home(tmp_path_factory) -> NavMesh:
    """Two storeys joined by a ramp; island 1 is a closed room at y = 0 under the upper one."""
    return load_navmesh(write_navmesh(tmp_path_factory.mktemp("navmesh") / "home.navmesh", two_storeys()))


def test_a_path_is_straight_where_it_can_be_bends_at_the_inner_corner_and_includes_the_slope_of_a_ramp(corner, home):
    assert corner.distance(at(1, 1), at(5, 5)) == pytest.approx(2 * math.sqrt(10), abs=1e-6)
    path = corner.shortest_path(at(1, 1), at(5, 5)[None])
    np.testing.assert_allclose(path, [[1, 0, 1], [4, 0, 2], [5, 0, 5]], atol=1e-6)
    assert corner.distance(at(1, 1), at(5.5, 1.5)) == pytest.approx(math.hypot(4.5, 0.5), abs=1e-6)
    assert len(corner.shortest_path(at(1, 1), at(5.5, 1.5)[None])) == 2
    assert home.distance(at(5, 6), at(5, 10, y=3)) == pytest.approx(5, abs=1e-6)
    # Pieces between bends are straight in 3-D: 3 m of floor and a ramp of 4 m that rises 3 m are one piece over 7 m.
    assert home.distance(at(5, 3), at(5, 10, y=3)) == pytest.approx(math.hypot(7, 3), abs=1e-6)


def test_a_goal_above_the_floor_keeps_its_height_one_beside_it_is_moved_and_one_at_the_start_has_distance_0(corner):
    assert corner.distance(at(1, 1), at(3, 1, y=1.5)) == pytest.approx(2.5, abs=1e-6)
    assert corner.distance(at(1, 1), at(1, -1.5, y=0.7)) == pytest.approx(1.0, abs=1e-6)
    np.testing.assert_allclose(corner.shortest_path(at(1, 1), at(1, -1.5, y=0.7)[None])[-1], [1, 0, 0])
    assert corner.distance(at(2, 1), at(2, 1)) == 0
    assert corner.distance(at(2, 1, y=0.3), at(2, 1)) == 0  # the projected points count
    assert corner.shortest_path(at(2, 1), at(2, 1)[None]).tolist() == [[2, 0, 1], [2, 0, 1]]


def test_islands_do_not_reach_each_other_and_the_nearest_goal_on_the_mesh_counts(home):
    below, above = at(2, 12), at(2, 12, y=3)
    assert (home.island(below), home.island(above)) == (1, 0)
    assert home.distances(np.stack([at(1, 1), above, below]), below[None]).tolist() == [math.inf, math.inf, 0]
    assert home.shortest_path(above, below[None]) is None
    assert math.isfinite(home.distance(at(1, 1), above))
    goals = np.stack([at(50, 50), at(2, 12), at(1, 1.5), at(5, 5)])
    assert home.distances(np.stack([at(1, 1), at(5, 4)]), goals) == pytest.approx([0.5, 1.0])
    assert home.shortest_path(at(1, 1), goals)[-1].tolist() == [1, 0, 1.5]
    assert home.distances(at(1, 1)[None], goals[:2]).tolist() == [math.inf]
    assert home.distances(at(1, 1)[None], np.empty((0, 3))).tolist() == [math.inf]
    assert home.distances(np.empty((0, 3)), goals).tolist() == []


def test_a_point_between_storeys_snaps_to_the_nearer_one_and_a_height_within_the_climb_counts_as_none(home):
    assert home.snap(at(2, 12, y=1.4)).tolist() == [2, 0, 12]
    assert home.snap(at(2, 12, y=1.6)).tolist() == [2, 3, 12]
    # 0.19 m above the floor is within the climb: the plate directly below wins over the one beside it.
    assert home.snap(at(3.999, 11, y=3.19)).tolist() == pytest.approx([3.999, 3, 11])


def test_snap_reaches_two_metres_sideways_and_four_vertically(corner):
    assert corner.snap(at(2, -1.9)).tolist() == [2, 0, 0]
    assert corner.snap(at(2, -2.3)) is None
    assert corner.snap(at(2, 1, y=3.9)).tolist() == [2, 0, 1]
    assert corner.snap(at(2, 1, y=-4.3)) is None
    for wild in (at(math.nan, 1), at(1, math.inf), at(1e30, 1), at(1, 1, y=-1e30)):
        assert corner.snap(wild) is None
        assert corner.distance(wild, at(1, 1)) == math.inf
        assert not corner.is_navigable(wild)


def test_a_point_is_navigable_within_the_given_height_and_a_centimetre_sideways(corner):
    assert corner.is_navigable(at(1, 1, y=0.49))
    assert not corner.is_navigable(at(1, 1, y=0.51))
    assert not corner.is_navigable(at(1, 1, y=0.2), max_dy=0.1)
    assert corner.is_navigable(at(1, -0.009))
    assert not corner.is_navigable(at(1, -0.011))
    assert not corner.is_navigable(at(1, 1, y=10))


def test_a_free_step_follows_the_ramp_and_no_step_reaches_another_island_or_starts_off_the_mesh(home):
    assert home.step(at(1, 1), at(1.25, 1)) == ((1.25, 0.0, 1.0), False)
    found, collided = home.step(at(5, 8, y=1.5), at(5, 8.25, y=1.5))
    assert found == pytest.approx((5, 1.6875, 8.25))
    assert not collided
    assert home.step(at(100, 100, y=100), at(100.25, 100, y=100)) == ((100, 100, 100), True)
    above = at(2, 12, y=3)
    assert home.step(above, at(2, 12)) == ((2, 3, 12), True)


def test_a_wall_stops_a_step_at_the_point_of_contact_and_sliding_continues_along_it(corner):
    stopped, collided = corner.step(at(1, 1.9), at(1.1, 2.1))
    assert stopped == pytest.approx((1.05, 0, 2.0), abs=1e-6)
    assert collided
    slid, collided = corner.step(at(1, 1.9), at(1.1, 2.1), slide=True)
    assert slid == pytest.approx((1.1, 0, 2.0), abs=1e-6)
    assert collided
    place = at(2, 1.9)
    for _ in range(3):
        place = np.array(corner.step(place, place + np.array([0.05, 0, 0.25])).position)
    assert place == pytest.approx([2.02, 0, 2.0], abs=1e-5)


def test_a_step_that_begins_off_the_mesh_starts_on_it_but_collisions_are_judged_from_where_it_began(corner):
    found, collided = corner.step(at(1, 1, y=0.3), at(1.25, 1, y=0.3))
    assert found == (1.25, 0, 1)
    assert not collided  # the robot moved 0.25 m along and 0.3 m down
    found, collided = corner.step(at(1, -1.0), at(1, -1.25))
    assert found == (1, 0, 0)  # the edge, which is farther away than the wanted step
    assert not collided


def test_the_distance_to_the_nearest_wall_is_planar_and_at_most_the_search_radius(corner):
    assert corner.distance_to_obstacle(at(1, 0.4)) == pytest.approx(0.4)
    assert corner.distance_to_obstacle(at(5, 1.0)) == pytest.approx(1.0)
    assert corner.distance_to_obstacle(at(1, 0.4), max_radius=0.25) == 0.25
    assert corner.distance_to_obstacle(at(4.3, 1.6)) == pytest.approx(0.5, abs=1e-6)  # the inner corner
    assert corner.distance_to_obstacle(at(50, 50)) == math.inf


def test_area_includes_slopes_islands_have_radii_and_a_ramp_is_not_a_storey(home):
    # 8 + 4 + 8 m2 downstairs, a ramp of 2 x 5 m, 8 + 16 m2 upstairs, 16 m2 in the closed room
    assert home.area == pytest.approx(70)
    assert home.island_radius(at(2, 12)) == pytest.approx(math.hypot(2, 2))
    assert home.island_radius(at(50, 50)) == 0
    assert home.storey_heights == (0.0, 3.0)


def test_an_upper_storey_is_distinguished_from_a_roof_by_the_ceiling_above_it(tmp_path):
    path = write_navmesh(tmp_path / "bare.navmesh", [plate(0, 0, 6, 6), plate(0, 0, 6, 6, y=3)])
    between, above = floor(-1, -1, 7, 7, y=2.9), floor(-1, -1, 7, 7, y=5.9)
    assert load_navmesh(path, mesh=mesh_of(between, above)).storey_heights == (0.0, 3.0)
    assert load_navmesh(path, mesh=mesh_of(between)).storey_heights == (0.0,)
    assert load_navmesh(path).storey_heights == (0.0,)  # without a mesh, a bare plate on top counts as a roof
    corridors = [plate(0, 2 * i, 8, 2 * i + 0.8) for i in range(6)] + [
        plate(8, 2 * i, 9, 2 * i + 0.8) for i in range(6)
    ]
    joints = [plate(8, 2 * i + 0.8, 9, 2 * i + 2) for i in range(5)]
    path = write_navmesh(tmp_path / "roof.navmesh", [*corridors, *joints, plate(0, 0, 9, 11, y=2.8)])
    assert load_navmesh(path).storey_heights == (0.0,)


def test_the_top_down_view_has_the_cells_of_one_storey(home):
    lower, upper = home.top_down(0.0), home.top_down(3.0)
    assert lower.grid == upper.grid
    assert lower.grid.cell == 0.05
    # Each storey has the half of the ramp that is nearer to it.
    assert lower.free.sum() * 0.05**2 == pytest.approx(8 + 4 + 8 + 4 + 16, rel=0.01)
    assert upper.free.sum() * 0.05**2 == pytest.approx(4 + 8 + 16, rel=0.01)
    rc = lower.grid.rc_from_xz(np.array([[3.99, 1.0], [3.99, 2.1], [5.0, 13.9]]))
    assert lower.free[tuple(rc.T)].tolist() == [True, False, False]
    assert upper.free[tuple(rc.T)].tolist() == [False, False, True]


def test_places_near_a_point_are_dense_and_reach_the_circle_and_the_walls(corner):
    centre = at(4, 2)
    places = corner.points_within(centre[None], 1.0, max_dy=0.5)
    away = np.hypot(*(places - centre)[:, [0, 2]].T)
    assert away.max() == pytest.approx(1.0, abs=1e-8)
    assert away.max() <= 1.0
    assert away.min() == pytest.approx(0, abs=1e-7)  # the corner itself, where two walls meet
    # three quarters of the disc's cells and of its rim, and 2 m of walls
    assert len(places) == pytest.approx((0.75 * math.pi / 0.05 + 0.75 * 2 * math.pi + 2) / 0.05, rel=0.02)
    assert all(corner.is_navigable(place) for place in places)
    some = np.random.default_rng(0).uniform(-0.99, 0.99, (200, 2)) + centre[[0, 2]]
    some = some[np.hypot(*(some - centre[[0, 2]]).T) < 0.99]
    for x, z in some:
        if corner.is_navigable(at(x, z)):
            assert np.hypot(places[:, 0] - x, places[:, 2] - z).min() <= 0.05


def test_places_stay_on_their_storey_include_a_wall_that_the_circle_just_reaches_and_are_listed_once(home, corner):
    assert set(home.points_within(at(2, 12)[None], 0.5, max_dy=1.0)[:, 1]) == {0.0}
    assert set(home.points_within(at(2, 12)[None], 0.5, max_dy=3.0)[:, 1]) == {0.0, 3.0}
    touching = home.points_within(at(2, -0.5)[None], 0.50001, max_dy=1.0)
    assert len(touching)
    assert np.abs(touching - [2, 0, 0]).max() < 0.01
    assert home.points_within(at(2, -0.51)[None], 0.5, max_dy=1.0).shape == (0, 3)
    assert home.points_within(np.empty((0, 3)), 0.5, max_dy=1.0).shape == (0, 3)
    twice = corner.points_within(np.stack([at(1, 1), at(1, 1)]), 0.5, max_dy=1.0)
    np.testing.assert_array_equal(twice, corner.points_within(at(1, 1)[None], 0.5, max_dy=1.0))


def test_random_points_are_uniform_over_the_surface_and_repeat_with_the_seed(home):
    rng = np.random.default_rng(3)
    points = np.array([home.random_point(rng) for _ in range(1500)])
    assert all(home.is_navigable(point, max_dy=1e-3) for point in points)
    in_closed_room = (points[:, 1] == 0) & (points[:, 2] > 9.9)
    assert in_closed_room.mean() == pytest.approx(16 / 70, abs=0.04)
    again = np.random.default_rng(3)
    np.testing.assert_array_equal(points[:5], [home.random_point(again) for _ in range(5)])
    assert (home.random_point(np.random.default_rng(4)) != points[0]).any()


def test_random_points_of_a_storey_lie_on_it(home):
    rng = np.random.default_rng(0)
    heights = np.array([home.random_point(rng, storey_y=3.0)[1] for _ in range(300)])
    assert heights.min() > 1.5
    assert (heights < 3).any()  # the upper half of the ramp
    with pytest.raises(SceneError, match=r"storey_y 9\.0; expected a height near one of \[0\.00, 3\.00\]"):
        home.random_point(rng, storey_y=9.0)


def test_many_threads_and_another_process_get_the_answers_of_one_thread(home):
    rng = np.random.default_rng(1)
    starts = np.array([home.random_point(rng) for _ in range(60)])
    goals = np.array([home.random_point(rng) for _ in range(60)])
    expected = home.distances(starts, goals[:1])
    with ThreadPoolExecutor(4) as pool:
        for found in pool.map(lambda _: home.distances(starts, goals[:1]), range(16)):
            np.testing.assert_array_equal(found, expected)
    copy = pickle.loads(pickle.dumps(home))
    assert copy.distance(at(1, 1), at(2, 12, y=3)) == home.distance(at(1, 1), at(2, 12, y=3))
    assert copy.digest == home.digest


# Laws of HABITAT_SEMANTICS.md section 6 on the handmade home; their numbers there are in brackets.

seeds = st.integers(0, 2**32 - 1)
shared = settings(max_examples=100, deadline=None)


def place(home: NavMesh, seed: int) -> np.ndarray:
    return home.random_point(np.random.default_rng(seed))


@shared
@given(seeds)
def test_the_place_to_which_a_random_point_snaps_is_navigable_and_snaps_to_itself(home, seed):  # [3, 5, 13]
    point = place(home, seed)
    assert home.is_navigable(point, max_dy=0.01)
    snapped = home.snap(point + np.random.default_rng(seed).uniform([-10, -2.5, -10], [10, 2.5, 10]))
    if snapped is not None:
        assert home.is_navigable(snapped)
        np.testing.assert_allclose(home.snap(snapped), snapped, atol=1e-5)


@shared
@given(seeds, st.floats(0.1, 5))
def test_the_distance_to_an_obstacle_is_within_the_radius(home, seed, radius):  # [6]
    assert 0 <= home.distance_to_obstacle(place(home, seed), max_radius=radius) <= np.float32(radius)


@shared
@given(seeds, st.floats(0, 2 * math.pi), st.floats(0.01, 100), st.booleans())
def test_a_step_ends_on_the_mesh_of_its_island(home, seed, yaw, length, slide):  # [7]
    start = place(home, seed)
    end = start + length * np.array([math.cos(yaw), 0, math.sin(yaw)])
    found = np.array(home.step(start, end, slide=slide).position)
    assert np.abs(home.snap(found) - found).max() < 0.01
    assert home.island(found) == home.island(start)


@shared
@given(seeds, st.floats(0, 2 * math.pi))
def test_without_sliding_a_step_keeps_its_direction(home, seed, yaw):  # [8]
    start = place(home, seed)
    wanted = np.array([math.cos(yaw), 0, math.sin(yaw)])
    moved = (np.array(home.step(start, start + wanted).position) - start) * [1, 0, 1]
    if np.linalg.norm(moved) > 3e-3:
        assert moved @ wanted / np.linalg.norm(moved) > math.cos(math.radians(1))


@shared
@given(seeds, seeds)
def test_a_path_is_as_long_as_the_distance_and_lies_on_one_island(home, seed, other):  # [9, 10]
    start, goal = place(home, seed), place(home, other)
    path = home.shortest_path(start, goal[None])
    distance = home.distance(start, goal)
    if home.island(start) != home.island(goal):
        assert path is None
        assert distance == math.inf
        return
    assert np.linalg.norm(np.diff(path, axis=0), axis=1).sum() == pytest.approx(distance, abs=1e-5)
    assert distance >= np.linalg.norm(goal - start) - 1e-5
    assert {home.island(point) for point in path} == {home.island(start)}


@shared
@given(seeds, st.lists(seeds, min_size=1, max_size=40))
def test_the_distance_to_many_goals_is_the_distance_to_the_nearest(home, seed, others):  # [11]
    start, goals = place(home, seed), np.array([place(home, other) for other in others])
    assert home.distances(start[None], goals)[0] == min(home.distance(start, goal) for goal in goals)
