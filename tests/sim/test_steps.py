"""One forward step on the floor grid: walls stop it, sliding follows them, and Habitat's rule decides on collisions."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.frames import forward_from_yaw
from sim.types import GridSpec
from sim.walk.floor_grid import STOP_MARGIN, FloorGrid
from tests.sim.grids import CELL, at, grid_of, level_floors


@pytest.fixture(scope="module")
def open_room() -> FloorGrid:
    return grid_of(size=2.0)


@pytest.fixture(scope="module")
def slanted() -> FloorGrid:
    """Free only below the diagonal x + z = 2, so the wall is a staircase of cells."""
    return grid_of(lambda x, z: x + z < 2, size=2.0)


def test_a_free_step_ends_at_the_wanted_place_and_pushing_against_a_wall_does_not_move(open_room):
    assert open_room.step(at(1, 1), at(1.2, 1.15)) == ((1.2, 0.0, 1.15), False)
    position = at(1.9, 1)
    for _ in range(3):
        result = open_room.step(position, position + at(0.25, 0))
        position = np.array(result.position)
        assert result.collided
    assert position[0] == pytest.approx(2 - STOP_MARGIN, abs=1e-9)


def test_a_wall_stops_the_step_a_tenth_of_a_millimetre_before_it_and_sliding_continues_along_it(open_room):
    position, collided = open_room.step(at(1.9, 1), at(2.15, 1))
    assert position == pytest.approx((2 - STOP_MARGIN, 0, 1), abs=1e-9)
    assert collided
    assert open_room.is_navigable(np.array(position))
    position, collided = open_room.step(at(1.9, 1), at(2.1, 1.2))
    assert position == pytest.approx((2.0, 0, 1.1), abs=2 * STOP_MARGIN)
    assert collided
    position, collided = open_room.step(at(1.9, 1), at(2.1, 1.2), slide=True)
    assert position == pytest.approx((2.0, 0, 1.2), abs=2 * STOP_MARGIN)
    assert collided


def test_sliding_follows_a_slanted_wall(slanted):
    position, _ = slanted.step(at(0.95, 0.95), at(1.15, 0.95), slide=True)
    assert position[0] - 0.95 > 0.05
    assert position[2] < 0.95
    assert slanted.is_navigable(np.array(position))


def test_a_full_step_that_ends_just_before_a_wall_is_no_collision_and_a_shortened_one_is(open_room):
    assert not open_room.step(at(1.74999 - STOP_MARGIN / 10, 1), at(1.99998, 1)).collided
    assert open_room.step(at(1.7501, 1), at(2.0001, 1)).collided  # moved 0.2498 m: 0.0624 + 1e-5 < 0.0625


def test_a_start_just_off_the_map_is_snapped_and_a_step_from_far_off_or_to_another_island_does_not_move(open_room):
    position, collided = open_room.step(at(-0.1, 1), at(0.15, 1))
    assert position == pytest.approx((0.15, 0, 1))
    assert not collided
    assert open_room.step(at(-0.1, 1), at(-0.05, 1)).position[0] == pytest.approx(0, abs=2 * STOP_MARGIN)
    position, collided = open_room.step(at(1.8, 1, 0.19), at(2.05, 1, 0.19))
    assert position == pytest.approx((2 - STOP_MARGIN, 0, 1), abs=1e-9)
    assert collided
    assert open_room.step(at(50, 50), at(50.25, 50)) == ((50.0, 0.0, 50.0), True)
    split = grid_of(lambda x, z: np.abs(x - 1) > 0.05, size=2.0)
    assert split.step(at(0.9, 1), at(1.15, 1)) == ((0.9, 0.0, 1.0), True)
    assert split.step(at(0.9, 1), at(1.15, 1), slide=True) == ((0.9, 0.0, 1.0), True)


def test_a_step_up_a_stair_takes_the_height_of_the_tread_and_a_step_under_a_gallery_stays_below():
    spec = GridSpec((0.0, 0.0), CELL, (10, 40))
    rc = np.argwhere(np.ones(spec.shape, bool))
    stair = FloorGrid.from_cells(rc, (0.18 * (rc[:, 1] // 10)).astype(np.float64), grid=spec)
    assert stair.step(at(0.4, 0.25), at(0.65, 0.25)).position == pytest.approx((0.65, 0.18, 0.25))
    assert stair.step(at(0.65, 0.25, 0.18), at(0.4, 0.25, 0.18)).position == pytest.approx((0.4, 0.0, 0.25))
    layers = level_floors((10, 40), 0.0, 1.2)
    assert layers.step(at(0.4, 0.25), at(0.65, 0.25)).position[1] == 0.0
    assert layers.step(at(0.4, 0.25, 1.2), at(0.65, 0.25, 1.2)).position[1] == pytest.approx(1.2)


places = st.tuples(st.floats(0.001, 1.999), st.floats(0.001, 1.999)).map(lambda xz: at(*xz))


@given(places, st.floats(-math.pi, math.pi), st.booleans())
@settings(deadline=None, max_examples=150)
def test_every_step_ends_on_the_map_and_without_sliding_on_the_wanted_line(slanted, start, yaw, slide):
    start = slanted.snap(start)
    forward = forward_from_yaw(yaw)
    position, collided = slanted.step(start, start + 0.25 * forward, slide=slide)
    moved = np.array(position) - start
    assert slanted.is_navigable(np.array(position))
    assert np.linalg.norm(moved) < 0.30
    if not slide:
        assert np.linalg.norm(moved) <= 0.25 + 1e-9
        assert np.linalg.norm(moved - (moved @ forward) * forward) < 1e-6
        assert collided or np.linalg.norm(moved) > 0.249
