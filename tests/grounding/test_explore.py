"""Exploration of two rooms with known answers: doors, islands, seeds, files, and the map of the agent."""

import dataclasses
import json
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from grounding.agents.coverage import VisibleFloor
from grounding.agents.exploration import load_exploration, save_exploration
from grounding.agents.explore import TASK, Exploration, explore, frames_of, start_on_storey
from grounding.agents.frontier import FrontierExplorer
from grounding.agents.random_frontier import random_frontier
from grounding.agents.rooms_found import RoomMap
from grounding.agents.seeking import Seeker
from sim.checks import check_agent
from sim.errors import AgentError, RunFileError, SceneError
from sim.frames import T_start_camera, T_world_agent
from sim.tasks.observers import FREE
from sim.types import Action, Camera, Observation, Pose

from .two_rooms import two_room_scene, two_rooms

CAMERA = Camera(96, 72)
START = Pose((1.0, 0.0, 1.0), yaw=0.5)


@lru_cache(maxsize=4)
def explored(*, has_door: bool = True, max_steps: int = 600) -> Exploration:
    scene, plan = two_room_scene(has_door=has_door), two_rooms(has_door=has_door)
    return explore(scene, START, seed=3, max_steps=max_steps, camera=CAMERA, plan=plan)


def test_both_rooms_are_seen_through_a_door_of_90_cm_and_coverage_never_falls() -> None:
    found = explored()
    assert found.stop_reason == "no-frontier"
    assert found.steps[-1].action is Action.STOP
    assert len(found.steps) < 400
    assert found.coverage[-1] > 0.97
    assert (found.doors_passed, found.num_doors, found.rooms_missed) == (1, 1, ())
    assert len(found.coverage) == len(found.poses) == len(found.steps) + 1
    assert all(np.diff(found.coverage) >= 0)
    assert 0 < found.coverage[0] < found.coverage[-1] <= 1


def test_a_room_that_cannot_be_reached_counts_neither_as_floor_nor_as_missed_and_runs_repeat() -> None:
    found = explored(has_door=False)
    assert found.coverage[-1] > 0.97
    assert found.area_m2 < 0.6 * explored().area_m2
    assert (found.doors_passed, found.rooms_missed) == (0, ())
    assert all(pose.position[0] < 4 for pose in found.poses)
    again = explore(
        two_room_scene(has_door=False), START, seed=3, max_steps=600, camera=CAMERA, plan=two_rooms(has_door=False)
    )
    assert again == explored(has_door=False)


def test_if_the_steps_run_out_the_last_one_is_stop_and_the_reason_says_so() -> None:
    found = explored(max_steps=20)
    assert len(found.steps) == 20
    assert found.steps[-1].action is Action.STOP
    assert found.stop_reason == "steps"
    assert found.rooms_missed == ("east",)


def test_an_exploration_is_equal_when_read_back_and_a_damaged_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    save_exploration(path, explored())
    assert load_exploration(path) == explored()
    content = json.loads(path.read_text())
    path.write_text(json.dumps({**content, "coverage": [0.5]}))
    with pytest.raises(RunFileError, match=r"a\.json.*coverage has 1 values; expected"):
        load_exploration(path)
    with pytest.raises(RunFileError, match="cannot be read"):
        load_exploration(tmp_path / "none.json")


def test_frames_are_the_views_along_the_path_with_ids_and_another_home_is_refused() -> None:
    found = explored(has_door=False)
    frames = list(frames_of(two_room_scene(has_door=False), found, camera=CAMERA, every=10))
    assert len(frames) == len(range(0, len(found.steps), 10))
    np.testing.assert_allclose(frames[0].T_world_camera[:3, 3], (1.0, CAMERA.mount_height, 1.0))
    assert frames[0].ids is not None
    with pytest.raises(SceneError, match="expected the same home"):
        next(frames_of(two_room_scene(), found))


def test_starts_depend_on_the_seed_and_are_on_the_main_floor_not_on_a_table_top() -> None:
    scene = two_room_scene()
    starts = [start_on_storey(scene, 0.0, seed) for seed in range(8)]
    assert all(abs(start.position[1]) < 0.3 for start in starts)
    assert starts[0] == start_on_storey(scene, 0.0, 0) != starts[1]


def test_the_visible_floor_is_the_reachable_floor_and_the_room_map_names_unseen_rooms() -> None:
    scene = two_room_scene()
    floor = VisibleFloor(scene.navigation, np.array(START.position))
    assert (floor.visible & ~floor.free).sum() == 0
    assert floor.visible.sum() == floor.reachable.sum()
    rooms = RoomMap(two_rooms(), floor)
    nothing = np.zeros(floor.grid.shape, bool)
    through = np.array([(1.0, 0, 1.0), (3.5, 0, 2.0), (4.5, 0, 2.0)])
    assert rooms.missed(nothing, through[:1]) == ("east",)
    assert rooms.missed(floor.visible, through[:1]) == ()
    assert (rooms.doors_passed(through[:2]), rooms.doors_passed(through), rooms.num_doors) == (0, 1, 1)


def observation(pose: Pose, *, depth: float | None, step: int, collided: bool = False) -> Observation:
    """A view in the start frame with every pixel `depth` metres away; None = without depth."""
    start = Pose((0.0, 0.0, 0.0), 0.0)
    image = None if depth is None else np.full((CAMERA.height, CAMERA.width), depth, np.float32)
    offset = np.linalg.inv(T_world_agent(start)) @ np.array([*pose.position, 1.0])
    return Observation(
        rgb=None,
        depth_m=image,
        gps=(float(-offset[2]), float(offset[0])),
        compass=pose.yaw,
        T_start_camera=T_start_camera(start, pose, CAMERA),
        camera=CAMERA,
        collided=collided,
        step=step,
    )


def test_without_depth_the_agent_says_that_it_needs_a_renderer() -> None:
    agent = FrontierExplorer()
    agent.reset(TASK, CAMERA, seed=0)
    with pytest.raises(AgentError, match="no depth"):
        agent.act(observation(START, depth=None, step=0))


def test_abandoned_frontiers_come_back_and_collisions_block_cells_only_for_a_while() -> None:
    here = Pose((0.0, 0.0, 0.0), 0.0)
    seeker = Seeker(CAMERA)
    seeker.see(observation(here, depth=20.0, step=0))
    seeker.see(observation(here, depth=20.0, step=1, collided=True))
    before = seeker.frontiers()
    assert len(before) >= 1
    ahead = (0.0, -0.06)
    assert np.isnan(weight_at(seeker, ahead))
    for frontier in before:
        seeker.choose(frontier)
        seeker._leave(frontier, for_steps=10)
    assert sum(len(frontier.cells_rc) for frontier in seeker.frontiers()) < sum(len(f.cells_rc) for f in before)
    seeker.see(observation(here, depth=20.0, step=400))
    assert sum(len(f.cells_rc) for f in seeker.frontiers()) >= sum(len(f.cells_rc) for f in before)
    assert np.isfinite(weight_at(seeker, ahead)), "a permanent mark would close doors"


def weight_at(seeker: Seeker, xz: tuple[float, float]) -> float:
    ground = seeker.memory.ground()
    row, col = ground.grid.rc_from_xz(np.array(xz))
    return float(ground.weights[row, col])


def test_a_collision_never_blocks_a_place_where_the_robot_has_been() -> None:
    here, back = Pose((0.0, 0.0, 0.0), 0.0), Pose((0.0, 0.0, 0.08), 0.0)
    seeker = Seeker(CAMERA)
    seeker.see(observation(here, depth=20.0, step=0))
    seeker.see(observation(back, depth=20.0, step=1, collided=True))
    assert np.isfinite(weight_at(seeker, (0.0, 0.0)))


def test_the_explorer_shows_its_map_its_frontiers_and_its_reason() -> None:
    insights = []
    explore(
        two_room_scene(),
        START,
        seed=3,
        max_steps=30,
        camera=CAMERA,
        on_step=lambda step, insight: insights.append(insight),
    )
    last = insights[-2]
    assert insights[0] is None
    assert (last.occupancy == FREE).any()
    assert last.frontiers.shape[1] == 2
    assert last.note


@pytest.mark.slow
@pytest.mark.parametrize("name", ["random_frontier:random_frontier", "frontier:FrontierExplorer"])
def test_our_agents_keep_the_contract_of_agents(name: str) -> None:
    assert check_agent(f"grounding.agents.{name}") == []


def test_random_frontier_stops_as_its_last_step_and_never_before() -> None:
    agent = random_frontier()
    task = dataclasses.replace(TASK, max_steps=12)
    actions = []
    agent.reset(task, CAMERA, seed=1)
    for step in range(12):
        actions.append(agent.act(observation(Pose((0.0, 0.0, 0.0), 0.0), depth=0.3, step=step)))
    assert actions[-1] is Action.STOP
    assert Action.STOP not in actions[:-1]
