"""The floor grid as a navigation map: small worlds with answers computed by hand."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.errors import SceneError
from sim.types import GridSpec
from sim.walk.floor_grid import FloorGrid, floor_grid_from_mesh
from tests.sim.grids import CELL, at, cluttered_home, grid_of, height_at
from tests.sim.meshes import box, floor, mesh_of, ramp


@pytest.fixture(scope="module")
def open_floor() -> FloorGrid:
    return grid_of()


@pytest.fixture(scope="module")
def walled() -> FloorGrid:
    """A wall 10 cm thick at z = 1.95..2.05 that leaves free x > 3."""
    return grid_of(lambda x, z: (x > 3) | (np.abs(z - 2) > 0.05))


@pytest.fixture(scope="module")
def two_storeys() -> FloorGrid:
    """Floors of 6 x 2 m at y = 0 and 2.8, one above the other, joined by a stair of 14 risers at x = 6 and a bridge."""
    spec = GridSpec((0.0, 0.0), CELL, (40, 280))
    lower = np.argwhere(np.ones((40, 120), bool))
    stair = np.argwhere(np.ones((20, 140), bool)) + np.array([0, 120])
    heights = np.minimum(2.8, 0.2 * (1 + (stair[:, 1] - 120) // 5))
    bridge = np.argwhere(np.ones((20, 140), bool)) + np.array([20, 120])  # from the top of the stair back to x = 6
    rc = np.concatenate([lower, stair, bridge, lower])
    y = np.concatenate([np.zeros(len(lower)), heights, np.full(len(bridge) + len(lower), 2.8)])
    return FloorGrid.from_cells(rc, y, grid=spec)


def test_on_open_floor_the_distance_is_the_straight_line_between_snapped_points_or_infinite_off_the_map(open_floor):
    starts = np.array([at(0.513, 0.527), at(3.9, 0.11), at(1.0, 1.0)])
    found = open_floor.distances(starts, np.array([at(3.513, 3.527)]))
    np.testing.assert_allclose(found, [4.2426407, 3.4388, 3.5623], atol=2e-3)
    goals = np.array([at(1.01, 1.02), at(1.04, 1.04)])
    np.testing.assert_allclose(open_floor.distances(goals, goals), 0.0, atol=1e-12)
    assert open_floor.distances(np.array([at(1, 1)]), np.array([at(-0.8, 1.0, 0.7)]))[0] == pytest.approx(1, abs=1e-3)
    assert open_floor.distances(np.array([at(1, 1)]), np.empty((0, 3)))[0] == np.inf
    assert open_floor.distances(np.array([at(-2.1, 1)]), np.array([at(1, 1)]))[0] == np.inf
    assert open_floor.distances(np.array([at(1, 1)]), np.array([at(1, 1, 4.3)]))[0] == np.inf


def test_the_path_around_a_wall_stays_on_free_floor_and_is_hardly_longer_than_the_shortest(walled):
    exact = 2 * np.hypot(2.0, 0.95) + 0.1
    found = walled.distances(np.array([at(1, 1)]), np.array([at(1, 3)]))[0]
    assert exact <= found <= 1.002 * exact
    path = walled.shortest_path(at(1, 1), np.array([at(1, 3)]))
    assert path is not None
    np.testing.assert_allclose(path[[0, -1]], [at(1, 1), at(1, 3)])
    assert all(walled.is_navigable(point) for point in path)
    length = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
    assert length == pytest.approx(walled.distances(np.array([at(1, 1)]), np.array([at(1, 3)]))[0])
    goals = np.array([at(1, 3), at(0.5, 1), at(3.5, 3.5)])
    assert walled.distances(np.array([at(1, 1)]), goals)[0] == pytest.approx(0.5)


def test_islands_corners_and_high_steps_are_not_joined():
    split = grid_of(lambda x, z: np.abs(z - 2) > 0.05)
    assert split.distances(np.array([at(1, 1)]), np.array([at(1, 3)]))[0] == np.inf
    assert split.shortest_path(at(1, 1), np.array([at(1, 3)])) is None
    assert split.island(at(1, 1)) != split.island(at(1, 3))
    spec = GridSpec((0.0, 0.0), CELL, (2, 2))
    diagonal = FloorGrid.from_cells(np.array([[0, 0], [1, 1]]), np.zeros(2), grid=spec)
    assert diagonal.distances(np.array([at(0.02, 0.02)]), np.array([at(0.07, 0.07)]))[0] == np.inf
    spec = GridSpec((0.0, 0.0), CELL, (1, 3))
    rc = np.array([[0, 0], [0, 1], [0, 2]])
    steps = FloorGrid.from_cells(rc, np.array([0.0, 0.2, 0.41]), grid=spec)
    assert np.isfinite(steps.distances(np.array([at(0.02, 0.02)]), np.array([at(0.07, 0.02, 0.2)]))[0])
    assert steps.island(at(0.07, 0.02, 0.2)) != steps.island(at(0.12, 0.02, 0.41))


def test_a_goal_above_the_floor_adds_its_height_beyond_a_climb_as_in_habitat(open_floor):
    # 0.8 m above the floor, less the climb of 0.2 m that does not count: 0.6 m over 3 m.
    assert open_floor.distances(at(0.5, 1)[None], at(3.5, 1, 0.8)[None])[0] == pytest.approx(3.0594117, abs=1e-6)
    assert open_floor.distances(at(0.5, 1, 0.8)[None], at(3.5, 1)[None])[0] == pytest.approx(3.0594117, abs=1e-6)
    assert open_floor.distances(at(0.5, 1)[None], at(3.5, 1, 0.2)[None])[0] == pytest.approx(3.0, abs=1e-6)
    assert open_floor.distances(at(2, 1)[None], at(2, 1, 0.8)[None])[0] == 0.0, "both snap to one point"
    path = open_floor.shortest_path(at(0.5, 1), at(3.5, 1, 0.8)[None])
    assert path is not None
    np.testing.assert_allclose(path, [at(0.5, 1), at(3.5, 1)])


def test_snap_keeps_points_on_the_map_and_moves_others_to_the_nearest_border(open_floor):
    np.testing.assert_allclose(open_floor.snap(at(1.23, 2.34, 0.2)), at(1.23, 2.34))
    np.testing.assert_allclose(open_floor.snap(at(-1.0, 2.34, 0.2)), at(0, 2.34), atol=2e-4)
    assert open_floor.snap(at(-2.01, 2.0)) is None
    assert open_floor.snap(at(1, 1, 4.01)) is None


def test_only_the_stair_joins_stacked_storeys_and_points_belong_to_the_floor_below_them(two_storeys):
    # 8.05 m along the lower floor and up the stair (2.6 m), one riser sideways onto the bridge, 8 m back upstairs.
    distance = two_storeys.distances(np.array([at(1, 0.5)]), np.array([at(1, 0.5, 2.8)]))[0]
    assert distance == pytest.approx(np.hypot(8.05, 2.6) + 8.05, rel=0.02)
    assert two_storeys.storey_heights == pytest.approx((0.0, 2.8))
    assert height_at(two_storeys, at(1, 1, 0.5)) == 0.0
    assert height_at(two_storeys, at(1, 1, 2.95)) == pytest.approx(2.8)
    assert two_storeys.is_navigable(at(1, 1, 3.2))
    assert not two_storeys.is_navigable(at(1, 1, 1.4))
    assert not two_storeys.is_navigable(at(1, 1, 0.2), max_dy=0.1)


def test_storey_queries_keep_to_their_storey(two_storeys):
    rng = np.random.default_rng(0)
    assert {two_storeys.random_point(rng, storey_y=2.8)[1] > 1.3 for _ in range(50)} == {True}
    assert two_storeys.top_down(0.0).free.sum() == 120 * 40 + 7 * 5 * 20
    with pytest.raises(
        SceneError, match=r"no free cell at storey_y 9\.0; expected a height near one of \[0\.00, 2\.80\]"
    ):
        two_storeys.random_point(rng, storey_y=9.0)


def test_random_points_fill_the_free_area_evenly(walled):
    rng = np.random.default_rng(1)
    points = np.array([walled.random_point(rng) for _ in range(2000)])
    assert all(walled.is_navigable(point) for point in points)
    assert np.mean(points[:, 2] < 2) == pytest.approx(0.5, abs=0.04)


def test_random_points_stay_off_tops_and_roofs_however_large(open_floor):
    large_top = mesh_of(floor(0, 0, 6, 6), *box((2, 0.7, 2), (4, 0.75, 4)))
    roofed = mesh_of(floor(0, 0, 6, 6), *box((0, 2.6, 0), (6, 2.8, 6)))
    for mesh in (large_top, roofed):
        found = floor_grid_from_mesh(mesh)
        assert len(np.unique(found.islands)) == 2
        rng = np.random.default_rng(2)
        assert {found.random_point(rng)[1] for _ in range(200)} == {0.0}
        assert {found.random_point(rng, storey_y=0.0)[1] for _ in range(200)} == {0.0}
    with pytest.raises(SceneError, match=r"no free cell at storey_y 2\.8; expected a height near one of \[0\.00\]"):
        found.random_point(rng, storey_y=2.8)
    rng = np.random.default_rng(0)  # a map without such islands draws as it always did
    drawn = [open_floor.random_point(rng) for _ in range(3)]
    np.testing.assert_allclose(drawn, [[0.1635, 0, 3.402], [3.8008, 0, 2.5407], [3.8303, 0, 2.5865]], atol=5e-5)


def test_points_within_a_circle_reach_its_rim_never_leave_it_and_are_not_repeated(open_floor):
    centre = at(2, 2)
    points = open_floor.points_within(centre[None], 1.0, max_dy=0.5)
    away = np.hypot(*(points - centre)[:, [0, 2]].T)
    assert away.max() <= 1.0
    assert len(points) == pytest.approx(np.pi / CELL**2, rel=0.1)
    angles = np.linspace(0, 2 * np.pi, 360)
    rim = 2 + np.stack([np.cos(angles), np.sin(angles)], axis=1)
    gaps = np.hypot(*(rim[:, None] - points[None][..., [0, 2]]).transpose(2, 0, 1)).min(axis=1)
    assert gaps.max() < 0.036  # half a cell's diagonal
    assert open_floor.points_within(at(2, 2, 0.6)[None], 1.0, max_dy=0.5).shape == (0, 3)
    points = open_floor.points_within(np.array([at(1, 1), at(1.2, 1), at(1, 1)]), 0.5, max_dy=0.5)
    cells = np.floor(points[:, [0, 2]] / CELL).astype(int)
    assert len(np.unique(cells, axis=0)) == len(points)


@pytest.mark.parametrize(
    ("rc", "y", "text"),
    [
        ([], [], "no free cell"),
        ([[0, 0]], [0.0, 1.0], "1 cells but 2 heights"),
        ([[0, 9]], [0.0], r"cell \[0, 9\] outside the grid"),
        ([[0, 0]], [np.nan], "height .*nan.* at cell"),
        ([[0, 0], [0, 0]], [0.0, 0.1], r"cell \[0, 0\] given twice"),
    ],
)
def test_invalid_cells_are_refused_with_the_reason(rc, y, text):
    with pytest.raises(SceneError, match=text):
        FloorGrid.from_cells(np.array(rc, np.int64), np.array(y), grid=GridSpec((0.0, 0.0), CELL, (4, 4)))


def test_a_grid_survives_pickling_and_its_digest_tells_grids_apart(open_floor, walled):
    copy = pickle.loads(pickle.dumps(walled))
    assert copy.digest == walled.digest != open_floor.digest
    assert copy.storey_heights == walled.storey_heights == (0.0,)


places = st.tuples(st.floats(0.01, 3.99), st.floats(0.01, 3.99)).map(lambda xz: at(*xz))


@given(places, places)
@settings(deadline=None, max_examples=60)
def test_distances_are_never_below_the_straight_line_and_nearly_symmetric(walled, a, b):
    a, b = walled.snap(a), walled.snap(b)
    there = walled.distances(a[None], b[None])[0]
    back = walled.distances(b[None], a[None])[0]
    assert there >= np.linalg.norm(b - a) - 1e-9
    assert back == pytest.approx(there, rel=0.02, abs=0.02)


@given(places, st.lists(places, min_size=1, max_size=4))
@settings(deadline=None, max_examples=40)
def test_the_distance_to_several_goals_is_the_distance_to_the_nearest(walled, start, goals):
    each = [walled.distances(start[None], goal[None])[0] for goal in goals]
    together = walled.distances(start[None], np.array(goals))[0]
    assert together == pytest.approx(min(each), rel=0.01, abs=0.01)


def test_every_place_that_the_grid_returns_is_navigable_at_its_own_height():
    grid = floor_grid_from_mesh(cluttered_home())
    rng = np.random.default_rng(4)
    centres = np.array([grid.random_point(rng) for _ in range(3)])
    places = [*grid.points_within(centres, 1.0, max_dy=0.5), *centres]
    places += [grid.snap(centre + rng.uniform(-1, 1, 3)) for centre in centres]
    places += [np.array(grid.step(place, place + rng.uniform(-0.3, 0.3, 3) * (1, 0, 1)).position) for place in places]
    assert all(grid.is_navigable(place, max_dy=1e-6) for place in places)


def test_the_order_of_the_faces_does_not_matter():
    mesh = cluttered_home()
    shuffled = replace(mesh, faces=np.random.default_rng(5).permutation(mesh.faces))
    assert floor_grid_from_mesh(mesh).digest == floor_grid_from_mesh(shuffled).digest


def test_a_floor_shrinks_by_the_robots_radius_and_ledge_but_keeps_its_heights_and_slopes():
    # 80 cells, less 1 (ledge) and 4 (0.18 m rounded up) at each side: 70 x 70 cells.
    found = floor_grid_from_mesh(mesh_of(floor(0, 0, 4, 4)))
    assert found.area == pytest.approx(12.25)
    assert found.storey_heights == (0.0,)
    found = floor_grid_from_mesh(mesh_of(floor(0, 0, 4, 4, y=0.13), floor(0, 0, 4, 4, y=-0.2)))
    assert height_at(found, at(2, 2)) == pytest.approx(0.13)
    found = floor_grid_from_mesh(mesh_of(ramp(0, 0, 10, 6, y0=0, y1=5)))
    assert found.surface_area / found.area == pytest.approx(np.sqrt(1.25), rel=0.005)


def test_steps_of_15_cm_and_ramps_of_30_degrees_can_be_walked_but_higher_and_steeper_ones_cannot():
    for rise, joined in ((0.15, True), (0.45, False)):
        home = mesh_of(floor(0, 0, 3, 3), *box((3, 0, 0), (6, rise, 3)))
        found = floor_grid_from_mesh(home)
        distance = found.distances(np.array([at(1, 1)]), np.array([at(5, 1, rise)]))[0]
        assert np.isfinite(distance) == joined
    for slope_deg, joined in ((30, True), (50, False)):
        top = 3 * np.tan(np.radians(slope_deg))
        home = mesh_of(floor(0, 0, 3, 3), ramp(3, 0, 6, 3, y0=0, y1=top), floor(6, 0, 9, 3, y=top))
        found = floor_grid_from_mesh(home)
        distance = found.distances(np.array([at(1, 1.5)]), np.array([at(8, 1.5, top)]))[0]
        assert np.isfinite(distance) == joined


def test_table_tops_and_roofs_are_islands_but_not_storeys():
    found = floor_grid_from_mesh(mesh_of(floor(0, 0, 6, 6), *box((2, 0.7, 2), (4, 0.75, 4))))
    assert not found.is_navigable(at(3, 3))
    assert height_at(found, at(3, 3, 0.9)) == pytest.approx(0.75)
    assert found.island(at(3, 3, 0.75)) != found.island(at(1, 1))
    assert found.storey_heights == (0.0,)
    home = mesh_of(floor(0, 0, 6, 6), *box((0, 2.6, 0), (6, 2.8, 6)))
    found = floor_grid_from_mesh(home)
    assert found.is_navigable(at(3, 3, 2.8))
    assert found.storey_heights == (0.0,)


def test_a_mesh_in_millimetres_with_non_finite_numbers_or_without_faces_or_floor_is_refused_with_advice():
    with pytest.raises(SceneError, match="found no floor of 1 m2 or more on 12 faces"):
        floor_grid_from_mesh(mesh_of(*box((0, 0, 0), (0.5, 0.5, 0.5))))
    with pytest.raises(SceneError, match="found a mesh of 8000 x 9000 m"):
        floor_grid_from_mesh(mesh_of(floor(0, 0, 8000, 9000)))
    with pytest.raises(SceneError, match="5000 m high"):
        floor_grid_from_mesh(mesh_of(floor(0, 0, 4, 4), floor(0, 0, 4, 4, y=5000)))
    home = mesh_of(floor(0, 0, 4, 4), floor(9, 9, 10, 10))
    home.vertices[5, 1] = np.nan
    with pytest.raises(SceneError, match="not finite"):
        floor_grid_from_mesh(home)
    with pytest.raises(SceneError, match="no face at all"):
        floor_grid_from_mesh(home.select(np.zeros(4, bool)))
