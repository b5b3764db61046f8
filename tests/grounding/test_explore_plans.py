"""The explorer's plans: weights of cells near obstacles, limits of path costs, and the effect of collisions."""

import dataclasses
import math

import numpy as np
import pytest
from scipy import ndimage

from grounding.agents.floor_memory import FloorMemory
from grounding.agents.plan_kernels import best_heading, spread_costs, weigh
from grounding.agents.seeking import Seeker
from sim.frames import T_start_camera
from sim.tasks.observers import FREE, OCCUPIED, UNKNOWN
from sim.types import FORWARD_STEP, TURN_STEP, Action, Camera, Observation, Pose

from .test_explore import CAMERA, observation

FLOOR = 0.05 / FORWARD_STEP
"""Actions needed to cross a cell that is far from all obstacles."""


def seen(*xz: tuple[float, float], collided: bool = False) -> FloorMemory:
    """Memory of a robot that stood at these places, facing -z without anything near; `collided` is for the last one."""
    memory = FloorMemory()
    for step, (x, z) in enumerate(xz):
        is_last = step == len(xz) - 1
        memory.see(observation(Pose((x, 0.0, z), 0.0), depth=20.0, step=step, collided=collided and is_last))
    return memory


def on_floor(yaw: float, step: int, *, floor_y: float = 0.0, seat: float = 0.0) -> Observation:
    """A view of an endless floor without walls; a seat of 25 cm fills a share of the picture's columns."""
    down = (np.arange(CAMERA.height) + 0.5 - CAMERA.height / 2) / CAMERA.focal
    top_y = np.where(np.arange(CAMERA.width) < seat * CAMERA.width, 0.25, floor_y)
    depth = np.where(down > 0.04, (CAMERA.mount_height - top_y[:, None]) / np.maximum(down, 0.04), 20.0).T
    view = observation(Pose((0.0, 0.0, 0.0), yaw), depth=20.0, step=step)
    return dataclasses.replace(view, depth_m=np.ascontiguousarray(depth, np.float32))


def weight_at(memory: FloorMemory, xz: tuple[float, float]) -> float:
    ground = memory.ground()
    row, col = ground.grid.rc_from_xz(np.array(xz))
    return float(ground.weights[row, col])


def test_weights_fall_with_the_distance_to_obstacles_and_are_inf_too_near_and_nan_inside() -> None:
    rng = np.random.default_rng(0)
    cells = np.where(rng.random((60, 70)) < 0.01, np.uint8(OCCUPIED), np.uint8(FREE))
    cells[0, :] = UNKNOWN
    away = np.asarray(ndimage.distance_transform_edt(cells != OCCUPIED)) * 0.05
    factor = weigh(cells, cells, 0.05, 0.17, (5.0, 0.35, 3.0, 0.215, 6.0))
    assert np.isnan(factor[cells == OCCUPIED]).all()
    assert np.isinf(factor[(cells == UNKNOWN)]).all(), "unknown cells are not assumed to be free"
    is_free = cells == FREE
    assert np.isinf(factor[is_free & (away < 0.16)]).all()
    far = is_free & (away > 0.19)
    more = 6 * np.maximum(0, 1 - away[far] / 0.215)
    np.testing.assert_allclose(factor[far], 1 + 5 * np.exp(-away[far] / 0.35) + more, rtol=0.05)


def test_costs_beyond_a_limit_are_left_out_and_costs_within_it_do_not_change() -> None:
    weights = np.ones((40, 50))
    weights[10:30, 25] = np.inf
    source, zero = np.array([[20, 10]]), np.zeros(1)
    whole = spread_costs(weights, source, zero)
    near = spread_costs(weights, source, zero, 15.0)
    np.testing.assert_array_equal(near[whole <= 15], whole[whole <= 15])
    assert np.isinf(near[whole > 15]).all()
    until = spread_costs(weights, source, zero, math.inf, (20, 20), 3.0)
    assert until[20, 20] == whole[20, 20]
    assert np.isinf(until[whole > whole[20, 20] + 3]).all()


def test_a_collision_raises_weights_most_where_the_wall_must_be_but_not_on_the_path_behind() -> None:
    free, touched = seen((0.0, 0.0)), seen((0.0, 0.0), (0.0, -0.01), collided=True)
    places = [(0.0, -0.22), (0.17, -0.22), (0.0, 0.12), (0.6, -0.22)]
    more = [weight_at(touched, place) - weight_at(free, place) for place in places]
    assert more == sorted(more, reverse=True), "most ahead, where the wall must be; little behind the robot"
    assert more[0] > 1.5 * FLOOR > more[2]
    assert more[3] == pytest.approx(0.0, abs=1e-3)
    assert np.isnan(weight_at(touched, (0.0, -0.06)))
    memory = seen((0.02, 0.6), (0.02, 0.35), (0.02, 0.1), (0.02, 0.0), collided=True)
    assert [weight_at(memory, (0.02, z)) for z in (0.58, 0.47, 0.22, 0.03)] == pytest.approx([FLOOR] * 4)
    assert weight_at(memory, (0.02, -0.22)) > 2 * FLOOR


def test_a_turn_continues_to_the_same_side_until_a_forward() -> None:
    seeker = Seeker(CAMERA)
    yaw, actions = 0.0, []
    for step, looks in enumerate((math.pi, yaw)):
        seeker.see(on_floor(looks, step))
    behind = seeker.frontiers()[0]._replace(place_xz=(0.02, 2.0), target_xz=(0.02, 8.0))
    seeker.choose(behind)
    for step in range(2, 12):
        action = seeker.pursue()
        assert action is not None
        actions.append(action)
        if action is Action.FORWARD:
            break
        assert seeker.is_turning
        yaw += {Action.LEFT: 1, Action.RIGHT: -1}[action] * math.radians(30)
        seeker.see(on_floor(yaw, step))
    assert actions[-1] is Action.FORWARD
    assert len(actions) > 4
    assert len(set(actions[:-1])) == 1, "all turns are to the same side"
    assert not seeker.is_turning


def passage(angle: float) -> tuple[np.ndarray, tuple[float, float], tuple[int, int]]:
    """Weights of a passage of 0.2 m for the robot's centre, 3 m long, and its ends (u, v) and (row, col)."""
    rows, cols = np.mgrid[:100, :100]
    u, v = cols + 0.5 - 20, rows + 0.5 - 50
    along, across = u * math.cos(angle) + v * math.sin(angle), v * math.cos(angle) - u * math.sin(angle)
    weights = np.where((np.abs(across) < 2) & (along > -4) & (along < 64), FLOOR, np.inf)
    return weights, (20.0, 50.0), (int(50 + 60 * math.sin(angle)), int(20 + 60 * math.cos(angle)))


@pytest.mark.parametrize("degrees", range(0, 46, 3))
def test_a_narrow_passage_is_walked_in_zigzag_whatever_its_direction(degrees: float) -> None:
    weights, (u, v), (row, col) = passage(math.radians(degrees))
    to_go = spread_costs(weights, np.array([[row, col]]), np.zeros(1))
    yaw, actions, step = -math.pi / 2, 0, FORWARD_STEP / 0.05  # it faces +u
    while to_go[int(v), int(u)] > 1 and actions < 60:
        turns, cost = best_heading(weights, to_go, u, v, yaw, step, math.radians(30), 6, 2.0, np.zeros(12))
        assert math.isfinite(cost)
        yaw += turns * math.radians(30)
        actions += abs(turns) + 1
        for _ in range(20):  # a forward ends at the first wall
            to_u, to_v = u - step / 20 * math.sin(yaw), v - step / 20 * math.cos(yaw)
            if not math.isfinite(weights[int(to_v), int(to_u)]):
                break
            u, v = to_u, to_v
    assert to_go[int(v), int(u)] <= 1
    assert actions <= 20, "12 forwards, and the turns between them"


@pytest.mark.parametrize(("floor_y", "seat"), [(0.0, 0.0), (-0.1, 0.0), (0.0, 0.7), (0.06, 0.6)])
def test_the_floor_is_found_near_the_feet_even_where_a_seat_fills_more_of_the_picture(
    floor_y: float, seat: float
) -> None:
    memory = FloorMemory()
    for step in range(14):
        memory.see(on_floor(step * TURN_STEP, step, floor_y=floor_y, seat=seat))
    assert memory.floor_y == pytest.approx(floor_y, abs=0.021)


def test_exploring_ends_after_many_steps_without_new_floor_and_later_with_a_long_frontier() -> None:
    seeker, found = Seeker(CAMERA), []
    for step in (0, 162, 640, 641):
        seeker.see(on_floor(0.0, step))
        found.append(seeker.is_dull())
    assert found == [False, False, False, True], "160 steps, and 8 for each of 60 cells of the frontier"
    seeker.see(on_floor(math.pi, 642))
    assert not seeker.is_dull(), "the floor behind is new"
    seeker, found = Seeker(CAMERA), []
    for step in (0, 352, 353):
        seeker.see(observation(Pose((0.0, 0.0, 0.0), 0.0), depth=20.0, step=step))
        found.append(seeker.is_dull())
    assert found == [False, False, True], "a short frontier, of 24 cells, is left"


def test_what_was_given_up_is_tried_once_more_until_there_is_new_floor() -> None:
    seeker = Seeker(CAMERA)
    seeker.see(on_floor(0.0, 0))
    for step in range(1, 200):
        seeker.see(on_floor(0.0, step))
        frontiers = seeker.frontiers()
        if not frontiers:
            break
        for frontier in frontiers:
            seeker.choose(frontier)
            seeker._leave(frontier, for_steps=1, has_looked=True)
    assert not seeker.frontiers()
    assert seeker.forgive()
    assert seeker.frontiers()


def test_plans_pass_close_to_things_when_nothing_is_found_and_keep_away_again_afterwards() -> None:
    seeker = Seeker(CAMERA)
    for step in (0, 1, 100):
        seeker.see(on_floor(0.0, step))
    assert not seeker.squeeze(), "they do already"
    seeker.see(on_floor(math.pi, 101))
    assert seeker.squeeze()


@pytest.mark.parametrize(("width", "height"), [(200, 150), (640, 480), (1000, 700)])
def test_a_large_picture_gives_the_same_map_as_a_small_one(width: int, height: int) -> None:
    start, known = Pose((0.0, 0.0, 0.0), 0.0), []
    for camera in (Camera(160, 120), Camera(width, height)):
        down = (np.arange(camera.height) + 0.5 - camera.height / 2) / camera.focal
        depth = np.minimum(3.0, camera.mount_height / np.maximum(down, 0.01)).astype(np.float32)  # a wall at 3 m
        view = dataclasses.replace(
            observation(start, depth=20.0, step=0),
            depth_m=np.repeat(depth[:, None], camera.width, axis=1),
            camera=camera,
            T_start_camera=T_start_camera(start, start, camera),
        )
        memory = FloorMemory()
        memory.see(view)
        places = [(x, z) for x in (-1.02, -0.52, 0.02, 0.52, 1.02) for z in (-1.02, -1.52, -2.02, -2.52, -3.0, -3.52)]
        known.append([int(memory.cell_at(place)) for place in places])
    assert known[0] == known[1]
    assert set(known[0]) == {FREE, OCCUPIED, UNKNOWN}
