"""The choice of the next frontier: the explorer takes a near one; random-frontier draws one and holds it a while."""

import dataclasses
import math
from collections import Counter
from collections.abc import Iterator
from itertools import groupby

import numpy as np
import pytest
from numpy.typing import NDArray

from grounding.agents.explore import TASK, explore
from grounding.agents.floor_memory import Ground
from grounding.agents.frontiers import Frontier, costs_from, find_frontiers
from grounding.agents.random_frontier import RandomFrontierAgent, random_frontier
from grounding.agents.seeking import FULL_TURN, Seeker
from sim.render.raycast import Raycaster
from sim.tasks.observers import FREE, OCCUPIED, UNKNOWN, Insight
from sim.tasks.pan import PanEnv
from sim.tasks.run_files import Step
from sim.types import FORWARD_STEP, Action, Camera, GridSpec, Pose

from .two_rooms import two_room_scene

CAMERA = Camera(96, 72)
START = Pose((1.0, 0.0, 1.0), yaw=0.5)
TURNS = (Action.LEFT, Action.RIGHT)
ROBOT_ROW, CELL = 100, 0.05


def corridor(*gaps: tuple[int, int]) -> Ground:
    """A walled corridor along z, 2 m wide and 10 m long, with gaps (first row, rows) in its left wall."""
    cells = np.full((220, 60), UNKNOWN, np.uint8)
    cells[9:211, 9:51] = OCCUPIED
    cells[10:210, 10:50] = FREE
    for row, length in gaps:
        cells[row : row + length, :10] = UNKNOWN
    weights = np.where(cells == FREE, CELL / FORWARD_STEP, np.inf)
    return Ground(cells, cells, weights, GridSpec((0.0, 0.0), CELL, (220, 60)))


def frontiers_of(ground: Ground, spent: NDArray[np.float32] | None = None) -> list[Frontier]:
    """Frontiers for a robot in the middle of the corridor that faces the wall with the gaps."""
    here = (30.5 * CELL, (ROBOT_ROW + 0.5) * CELL)
    costs = costs_from(ground, here)
    nothing, never = np.zeros(ground.cells.shape, bool), np.zeros(ground.cells.shape, np.uint8)
    return find_frontiers(
        ground,
        costs,
        banned=nothing,
        failures=never,
        spent=np.zeros(ground.cells.shape, np.float32) if spent is None else spent,
        robot=(*here, math.pi / 2),
        is_tilted=False,
        can_look=True,
        camera=CAMERA,
    )


def first_rows(frontiers: list[Frontier]) -> list[int]:
    return [int(frontier.cells_rc[:, 0].min()) for frontier in frontiers]


@pytest.mark.parametrize("near_first", [True, False])
def test_the_nearer_of_two_equally_long_frontiers_is_first(near_first: bool) -> None:
    near, far = (60, 190) if near_first else (130, 15)
    found = frontiers_of(corridor((near, 16), (far, 16)))
    assert first_rows(found) == [near, far]
    assert found[0].cost < found[1].cost < math.inf


def test_a_short_frontier_costs_more_up_to_a_limit_and_one_too_narrow_is_left_out() -> None:
    short, long, far_off = (68, 6), (150, 30), (190, 20)
    found = frontiers_of(corridor(short, long))
    assert first_rows(found) == [long[0], short[0]]
    assert found[1].cost < found[0].cost < 2 * found[1].cost, "the short one is nearer, but less lies behind it"
    found = frontiers_of(corridor(short, far_off))
    assert first_rows(found) == [short[0], far_off[0]]
    assert first_rows(frontiers_of(corridor((64, 4), (125, 16)))) == [125]


def test_steps_already_spent_on_a_frontier_add_to_its_cost() -> None:
    near, far = (60, 16), (190, 16)
    before = frontiers_of(corridor(near, far))
    spent = np.zeros((220, 60), np.float32)
    spent[60:76] = 50.0
    after = frontiers_of(corridor(near, far), spent)
    assert (first_rows(before), first_rows(after)) == ([60, 190], [190, 60])
    assert after[1].cost == pytest.approx(before[0].cost + 50.0)
    assert after[0].cost == before[1].cost


def test_a_seeker_remembers_the_steps_it_spent_on_a_goal() -> None:
    """Each abandoned goal becomes more expensive, so the robot does not go to and fro between goals for ever."""
    scene = two_room_scene()
    env = PanEnv(START, scene.navigation, renderer=Raycaster(scene.mesh), camera=CAMERA)
    seeker, view = Seeker(CAMERA), env.reset()
    for _ in range(8):
        seeker.see(view)
        view = env.step(Action.LEFT)
    seeker.see(view)
    before = {item.middle_xz: item for item in seeker.frontiers()}
    assert len(before) > 1
    goal = min(before.values(), key=lambda item: item.cost)
    seeker.choose(goal)
    seeker.see(dataclasses.replace(view, step=view.step + 10))
    seeker.choose(None)
    after = {item.middle_xz: item for item in seeker.frontiers()}
    assert after.keys() == before.keys()
    for place, item in after.items():
        assert item.cost == pytest.approx(before[place].cost + (10.0 if place == goal.middle_xz else 0.0))


def test_a_robot_that_leaves_the_part_of_the_map_that_was_planned_on_plans_anew() -> None:
    scene = two_room_scene()
    seeker = Seeker(CAMERA)
    view = PanEnv(START, scene.navigation, renderer=Raycaster(scene.mesh), camera=CAMERA).reset()
    seeker.see(view)
    seeker.choose(seeker.frontiers()[0])
    before = seeker.cost_left
    rows = seeker.memory.ground().grid.shape[0]
    behind = rows * seeker.memory.grid.cell + 1.0
    seeker.see(dataclasses.replace(view, step=view.step + 1, gps=(view.gps[0] - behind, view.gps[1])))
    assert seeker.memory.ground().grid.shape[0] > rows
    assert before < seeker.cost_left


def test_the_explorer_looks_around_at_the_start_and_before_it_stops_with_frontiers_left() -> None:
    notes: list[str] = []

    def told(step: Step | None, insight: Insight | None) -> None:
        if insight is not None:
            notes.append(insight.note)

    found = explore(two_room_scene(), START, seed=3, max_steps=600, camera=CAMERA, on_step=told)
    around = [number for number, note in enumerate(notes) if "looking around" in note]
    last = len(found.steps) - 1
    assert around == [*range(FULL_TURN), *range(last - FULL_TURN, last)]
    assert found.stop_reason == "no-frontier"
    assert len({step.action for step in found.steps[:FULL_TURN]} & set(TURNS)) == 1, "one direction"


def test_the_explorer_looks_around_once_more_before_it_gives_up_frontiers_out_of_reach(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    nowhere = Frontier(np.zeros((9, 2), np.int64), (0.0, 0.0), math.inf, (0.0, 0.0), (0.0, 0.0))
    monkeypatch.setattr(Seeker, "frontiers", lambda self, **_: [nowhere])
    monkeypatch.setattr(Seeker, "forgive", lambda self: False)
    found = explore(two_room_scene(), START, seed=3, max_steps=600, camera=CAMERA)
    actions = [step.action for step in found.steps]
    assert (len(set(actions[:-1])), len(actions), actions[-1]) == (1, 2 * FULL_TURN + 1, Action.STOP)
    assert actions[0] in TURNS
    assert found.stop_reason == "no-frontier"


def walked(agent: RandomFrontierAgent, *, has_door: bool, seed: int, max_steps: int) -> Iterator[tuple[Action, Pose]]:
    """Each action of an agent in two rooms with the pose at which it was chosen, until STOP or the last step."""
    scene = two_room_scene(has_door=has_door)
    env = PanEnv(START, scene.navigation, renderer=Raycaster(scene.mesh), camera=CAMERA, max_steps=max_steps + 50)
    agent.reset(dataclasses.replace(TASK, max_steps=max_steps), CAMERA, seed=seed)
    observation = env.reset()
    while not env.is_over:
        action = agent.act(observation)
        yield action, env.pose
        observation = env.step(action)


def test_random_frontier_holds_its_goal_for_several_steps() -> None:
    agent = random_frontier()
    goals = [agent.insight().goal for _ in walked(agent, has_door=True, seed=5, max_steps=120)]
    held = [sum(1 for _ in group) for _, group in groupby(goal for goal in goals if goal is not None)]
    assert len(held) > 5
    assert max(held) >= 5
    assert sum(held) > 2 * len(held), "a goal is held for more than two steps on average"


def test_random_frontier_draws_each_frontier_about_equally_often() -> None:
    """With 120 seeds each of two is drawn 60 times with a deviation of 5.5; 38 and 82 are 4 deviations away."""
    scene = two_room_scene()
    env = PanEnv(Pose((2.0, 0.0, 2.0), yaw=0.0), scene.navigation, renderer=Raycaster(scene.mesh), camera=CAMERA)
    agent, view, drawn = random_frontier(), env.reset(), Counter()
    for seed in range(120):
        agent.reset(TASK, CAMERA, seed=seed)
        agent.act(view)
        drawn[agent.insight().goal] += 1
    assert len(drawn) == 2
    assert all(38 <= count <= 82 for count in drawn.values()), drawn


@pytest.mark.slow
def test_random_frontier_turns_on_the_spot_in_an_explored_closed_room_and_stops_at_step_500() -> None:
    agent = random_frontier()
    actions, poses, is_done = [], [], []
    for action, pose in walked(agent, has_door=False, seed=1, max_steps=500):
        actions.append(action)
        poses.append(pose.position)
        frontiers = agent.insight().frontiers
        is_done.append(frontiers is not None and len(frontiers) == 0)
    assert len(actions) == 500
    assert actions[-1] is Action.STOP
    first = is_done.index(True)
    assert 20 < first < 200
    assert actions[first] in TURNS
    assert set(actions[first:-1]) == {actions[first]}, "always in the same direction"
    assert set(poses[first:]) == {poses[first]}
