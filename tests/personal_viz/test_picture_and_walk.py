"""Homes whose picture and walk disagree in a known way, and one in which they agree."""

from dataclasses import replace

import numpy as np
import pytest

from personal_viz.bench.homes.picture_and_walk import (
    Count,
    PictureAndWalk,
    floating,
    forwards,
    in_walls,
    map_places,
    on_beds,
    picture_and_walk,
)
from sim.homes.open_home import scene_from_plan
from sim.mesh import Scene
from sim.render.raycast import Raycaster
from sim.types import GridSpec
from sim.walk.floor_grid import FloorGrid
from tests.sim.plans import piece, two_rooms

WEST, EAST = np.array([[1.0, 0.0, 1.0]]), np.array([[6.0, 0.0, 2.0]])


def measured(scene: Scene) -> PictureAndWalk:
    return picture_and_walk(scene, starts=WEST, views=EAST, caster=Raycaster(scene.mesh))


def with_map(scene: Scene, free) -> Scene:
    """The scene with a map of the places (x, z) that are free, whatever is drawn."""
    spec = GridSpec((0.0, 0.0), 0.05, (80, 160))
    rc = np.argwhere(np.ones(spec.shape, bool))
    rc = rc[free(*spec.xz_from_rc(rc).T)]
    return replace(scene, navigation=FloorGrid.from_cells(rc, np.zeros(len(rc)), grid=spec))


@pytest.fixture(scope="module")
def rooms() -> Scene:
    return scene_from_plan(two_rooms())


def test_a_map_made_from_the_mesh_agrees_with_it(rooms: Scene) -> None:
    found = measured(rooms)
    assert found.phantom.found < 20 == found.phantom.of / 100  # the map keeps 0.2 m from walls, the body has 0.18 m
    assert found.free_ahead.found < 0.05 * found.free_ahead.of
    assert 0.97 < found.standing.found / found.standing.of < 1.04
    assert (found.close_starts, found.close_views) == (Count(0, 1), Count(0, 1))
    assert found.storey_pairs == Count(0, 0)


def test_floor_that_is_drawn_but_not_walkable_is_found(rooms: Scene) -> None:
    half = with_map(rooms, lambda x, z: (x > 0.3) & (x < 3.7) & (z > 0.3) & (z < 2.0))
    phantom, ahead = forwards(half, Raycaster(half.mesh), num=300)
    assert phantom.found > 5
    assert ahead.found > 0.2 * ahead.of
    found = measured(half)
    assert found.standing.found / found.standing.of > 3


def test_a_place_beside_a_wall_is_too_close(rooms: Scene) -> None:
    beside = picture_and_walk(
        rooms, starts=np.array([[1.0, 0.0, 0.15]]), views=np.array([[0.3, 0.0, 0.3]]), caster=Raycaster(rooms.mesh)
    )
    assert (beside.close_starts, beside.close_views) == (Count(1, 1), Count(0, 1))


@pytest.mark.parametrize(
    ("centre", "is_floating"),
    [((2.0, 0.5, 2.0), False), ((2.0, 0.72, 2.0), True), ((2.0, 1.5, 0.3), False), ((2.0, 1.5, 2.0), True)],
    ids=["on the floor", "above the floor", "at a wall", "in the air"],
)
def test_a_piece_that_touches_nothing_floats(centre: tuple[float, float, float], is_floating: bool) -> None:
    scene = scene_from_plan(two_rooms(piece("box_1", centre, (0.6, 1.0, 0.6))))
    assert floating(scene) == Count(int(is_floating), 1)


def test_a_piece_that_stands_across_a_wall_is_in_it() -> None:
    inside = piece("picture_1", (4.0, 1.5, 1.0), (0.5, 0.4, 0.06), yaw=-np.pi / 2)
    before = piece("picture_2", (3.9, 1.5, 3.2), (0.5, 0.4, 0.04), yaw=-np.pi / 2)
    assert in_walls(scene_from_plan(two_rooms(inside, before))) == Count(1, 2)


def test_a_bed_with_places_of_the_map_on_it_is_counted() -> None:
    scene = scene_from_plan(
        two_rooms(piece("bed_1", (2.0, 0.3, 2.0), (1.5, 0.6, 2.0)), piece("bed_2", (6.0, 0.3, 2.0), (1.5, 0.6, 2.0)))
    )
    places = map_places(scene, WEST)
    assert on_beds(scene.objects, places) == Count(0, 2)
    on_one = np.vstack([places, [2.1, 0.6, 2.2]])
    assert on_beds(scene.objects, on_one) == Count(1, 2)
