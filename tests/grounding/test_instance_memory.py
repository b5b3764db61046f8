"""The agent that remembers things: two rugs that change hands, and searches for all things."""

import dataclasses
import math
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from grounding.agents.goal_text import described_thing
from grounding.agents.instance_memory import InstanceMemoryAgent, sought
from grounding.agents.seeking import FULL_TURN
from grounding.perception.by_name import EpisodeTruth, make_perception
from grounding.phrases.rules import RulePhrases
from sim.checks import check_agent, check_home, check_trials
from sim.frames import T_world_agent
from sim.homes.open_home import scene_from_plan
from sim.homes.plan import Furniture, Rect, Storey
from sim.homes.renderers import renderer_of
from sim.mesh import Scene
from sim.sequences.playing import SearchBySearch, play_sequence
from sim.tasks.pan import PanEnv
from sim.types import SEQUENCE7, Action, Camera, Observation, Pose, Prompt, Task

from ..sim import plans
from ..sim.home_story import subtask
from .test_explore import observation
from .told_walks import ToldWalk, told_walk

CAMERA = Camera(320, 240)
"""At half this size most patches that show the brown rug show the table on it too: its parts then look different, and
the agent stops at one of them, 1.09 m from the rug's middle."""
BROWN, GREEN = "small brown and beige patterned woven rug", "green and white striped woven rug"
SWAP: list[dict[str, Any]] = [
    {
        "before": 0,
        "kind": "intro",
        "text": f"Ada owns the {BROWN}. Bo owns the {GREEN}.",
        "adds": [["Ada", "rug_31"], ["Bo", "rug_51"]],
    },
    {
        "before": 1,
        "kind": "swap",
        "text": f"Two things have changed places between Ada and Bo. To Bo went the {BROWN}; to Ada went the {GREEN}.",
        "adds": [["Bo", "rug_31"], ["Ada", "rug_51"]],
        "removes": [["Ada", "rug_31"], ["Bo", "rug_51"]],
    },
]
ASKS = [
    subtask("Ada", "rug", "rug_31", "fresh", 0),
    subtask("Ada", "rug", "rug_51", "changed", 1, old_object_id="rug_31"),
    subtask("Bo", "rug", "rug_31", "changed", 1, old_object_id="rug_51"),
]


@lru_cache(maxsize=4)
def played(root: Path, out: Path, *, keeps_memory: bool = True, ignores: bool = False) -> ToldWalk:
    """The agent with oracle perception in a story of two rugs."""
    phrases = RulePhrases()
    return told_walk(
        root,
        out,
        lambda eyes: InstanceMemoryAgent(eyes, lambda task: described_thing(task, phrases), phrases),
        messages=SWAP,
        asks=ASKS[:2] if ignores else ASKS,
        camera=CAMERA,
        keeps_memory=keeps_memory,
        ignores=ignores,
        seed=int(not keeps_memory),
    )


def succeeded(told: ToldWalk) -> list[bool | None]:
    return [search.succeeds("paper") for search in told.run.end.searches]


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("told")


@pytest.mark.slow
def test_it_walks_to_what_the_messages_say_and_to_the_old_thing_where_it_hears_none(
    small_home_root: Path, out: Path
) -> None:
    told = played(small_home_root, out)
    assert succeeded(told) == [True, True, True]
    assert told.insight.goal is not None
    assert told.insight.note.startswith("to the best of")
    deaf = played(small_home_root, out, ignores=True)
    assert succeeded(deaf) == [True, False]
    assert deaf.steps[1] < 12, "it stands there already, and does not look around"


@pytest.mark.slow
def test_memory_makes_the_way_to_a_known_thing_shorter_and_the_seed_changes_nothing(
    small_home_root: Path, out: Path
) -> None:
    kept, forgotten = played(small_home_root, out), played(small_home_root, out, keeps_memory=False)
    assert kept.actions[: kept.steps[0]] == forgotten.actions[: kept.steps[0]]
    assert kept.steps[2] < forgotten.steps[2]


class TwoMarks:
    """Says STOP at once, and wants two things."""

    def reset(self, task: Task, camera: Camera, *, seed: int, keep_memory: bool = False) -> None:
        self.marked = 0

    def act(self, observation: Observation) -> Action:
        if not self.wants_more:
            return Action.RIGHT
        self.marked += 1
        return Action.STOP

    @property
    def wants_more(self) -> bool:
        return self.marked < 2


def test_a_search_for_all_goes_on_while_the_agent_wants_more() -> None:
    start, marks = Pose((0.0, 0.0, 0.0), 0.0), TwoMarks()
    agent = SearchBySearch(lambda index, pose, marked: None if marked else marks, start, keeps_memory=True)
    first = observation(start, depth=2.0, step=0)
    agent.reset(Task("pan", "Ada owns two rugs.", ("",), actions=SEQUENCE7), CAMERA, seed=0)
    said = [agent.act(dataclasses.replace(first, query="Find all of Ada's rugs"))]
    said += [agent.act(observation(start, depth=2.0, step=step)) for step in (1, 2, 3)]
    assert said == [Action.FOUND, Action.LEFT, Action.FOUND, Action.FOUND], "both objects are here, and that is all"


def test_what_is_sought_follows_the_table_of_owners() -> None:
    text = f"Ada owns the {BROWN}. Bo owns the {GREEN}. Bo owns the red sofa in the hall."
    assert sought(Task("pan", text, ("Find Bo's rug",)), GREEN, RulePhrases()) == (
        *((GREEN,), (BROWN, "red sofa")),
        ("rug",),
        1,
    )
    assert sought(Task("pan", text, ("Find all of Bo's sofas",)), "red sofa", RulePhrases()) == (
        *(("red sofa",), (BROWN, GREEN)),
        ("sofa",),
        1,
    )
    beside = "Bo owns the oak chair next to the oak bench. Bo owns the oak bench."
    assert sought(Task("pan", beside, ("Find Bo's bench",)), "oak bench", RulePhrases()).own == ("oak bench",)
    lamps = "Bo owns a lamp in the kitchen. Bo owns a lamp in the bedroom."
    assert sought(Task("pan", lamps, ("Find all of Bo's lamps",)), "lamp", RulePhrases())[::3] == (("lamp",), 2)


def hall(*pieces: Furniture) -> Scene:
    """A room of 7 x 5 m with these pieces; ids count them from 1."""
    rect = Rect(0, 0, 7, 5)
    walls = plans.walls_around(rect, height=4.0)
    storeys = (Storey(label="ground floor", floor_y=0.0, ceiling=4.0),)
    rooms = (plans.room("hall", rect),)
    return scene_from_plan(plans.two_rooms(*pieces, storeys=storeys, rooms=rooms, walls=walls))


def chest(number: int, z: float, *, x: float = 3.5, y: float = 0.15) -> Furniture:
    """A chest so low that its top is seen from all sides."""
    return plans.piece(f"chest_{number}", (x, y, z), (0.8, 0.3, 0.8))


WEST, EAST = Pose((0.6, 0.0, 2.5), -math.pi / 2), Pose((6.4, 0.0, 2.5), math.pi / 2)
"""Starts before the walls of the hall, from which all of its middle is seen."""
CHESTS = Task("pan", "Ada owns the red chest. Bo owns the blue chest.", ("Find Ada's chest",), actions=SEQUENCE7)


def agent_in(home: Scene, *captions: str, start: Pose = WEST) -> InstanceMemoryAgent:
    """An agent that sees the pieces of a home, with these captions, without errors."""
    ids = [item.instance_id for item in home.objects]
    eyes = make_perception("oracle", truth=EpisodeTruth(home, start, dict(zip(ids, captions, strict=False))))
    phrases = RulePhrases()
    return InstanceMemoryAgent(eyes, lambda task: described_thing(task, phrases), phrases)


def looked(agent: InstanceMemoryAgent, home: Scene, pose: Pose, *, carried: bool = False, up: float = 0.0) -> Action:
    """The action after two looks from a pose; a carried agent is told that it stands there, `up` metres higher."""
    if carried:
        T = np.linalg.inv(T_world_agent(WEST)) @ T_world_agent(pose)
        T[1, 3] += up
        agent.carry(T)
    agent.reset(CHESTS, CAMERA, seed=0, keep_memory=carried)
    seen = PanEnv(pose, home.navigation, renderer=renderer_of(home), camera=CAMERA).reset()
    agent.act(seen)
    return agent.act(dataclasses.replace(seen, step=1))


def fitting(agent: InstanceMemoryAgent) -> list[list[float]]:
    """x and z of the things that fit, in the frame of the search's start."""
    places = agent.insight().candidates
    assert places is not None
    return sorted(places[:, [0, 2]].tolist())


def test_a_chest_seen_from_two_sides_is_one_and_two_alike_stay_two() -> None:
    for home, captions, places in (
        (hall(chest(1, 2.5)), ("red chest",), [[0.0, -2.9]]),
        (hall(chest(1, 1.75), chest(2, 3.25)), ("red chest", "red chest"), [[-0.75, -2.9], [0.75, -2.9]]),
    ):
        agent = agent_in(home, *captions)
        looked(agent, home, WEST)
        looked(agent, home, EAST, carried=True)
        assert fitting(agent) == [pytest.approx(place, abs=0.06) for place in places]


def test_what_is_remembered_of_one_storey_is_forgotten_on_another_and_without_keep_memory() -> None:
    home, away = hall(chest(1, 2.5)), dataclasses.replace(WEST, yaw=0.0)
    agent = agent_in(home, "red chest")
    looked(agent, home, WEST)
    assert looked(agent, home, away, carried=True) is Action.RIGHT
    assert len(fitting(agent)) == 1
    looked(agent, home, away, carried=True, up=3.0)
    assert fitting(agent) == []
    assert agent.insight().note == "looking around at the start"
    looked(agent, home, WEST)
    assert len(fitting(agent)) == 1
    agent.reset(CHESTS, CAMERA, seed=0)
    seen = PanEnv(WEST, home.navigation, renderer=renderer_of(home), camera=CAMERA).reset()
    agent.act(dataclasses.replace(seen, depth_m=np.zeros((CAMERA.height, CAMERA.width), np.float32)))
    assert fitting(agent) == []


@pytest.mark.parametrize(("y", "count"), [(0.15, 1), (2.8, 0)])
def test_a_thing_that_only_another_storey_can_have_is_never_gone_to(y: float, count: int) -> None:
    home = hall(chest(1, 2.5, x=5.0, y=y))
    agent = agent_in(home, "red chest")
    looked(agent, home, WEST)
    assert len(agent._memory.things()) == 1, "it is seen"
    assert len(fitting(agent)) == count


def all_of_adas_chests(home: Scene, agent: InstanceMemoryAgent, *, max_steps: int) -> PanEnv:
    """A search for the red and the green chest, to its end."""
    told, query = (
        "Ada owns the red chest. Bo owns the blue chest. Ada owns the green chest.",
        "Find all of Ada's chests",
    )
    task = Task("pan", told, (query,), max_steps=max_steps, actions=SEQUENCE7)
    env = PanEnv(
        WEST,
        home.navigation,
        renderer=renderer_of(home),
        camera=CAMERA,
        max_steps=max_steps,
        prompts=(Prompt(query, is_for_all=True),),
    )
    player = SearchBySearch(lambda index, pose, marks: None if marks else agent, WEST, keeps_memory=True)
    play_sequence(player, env, task, seed=0)
    return env


def test_a_search_for_all_marks_each_right_one_once_and_ends() -> None:
    home = hall(chest(1, 1.0), chest(2, 2.5), chest(3, 4.0))
    env = all_of_adas_chests(home, agent_in(home, "red chest", "blue chest", "green chest"), max_steps=120)
    found = [step.pose.position[2] for step in env.steps if step.action is Action.FOUND]
    assert env.search_reasons == ("stop",)
    assert len(found) == 3, "each right one once, and once more to end the search"
    assert sorted(found[:2]) == pytest.approx([1.0, 4.0], abs=0.5)


def test_a_search_for_all_goes_on_without_a_mark_where_the_rest_is_not_found() -> None:
    home = hall(chest(1, 1.0))
    agent = agent_in(home, "red chest")
    env = all_of_adas_chests(home, agent, max_steps=100)
    assert env.search_reasons == ("steps",)
    assert [step.action for step in env.steps].count(Action.FOUND) == 1
    assert agent.insight().note == "nothing is left to go to"
    assert agent.wants_more


@pytest.mark.slow
def test_it_keeps_the_contract_of_agents_in_home_sequences_too() -> None:
    home = check_home()
    six, _ = check_trials(home)
    captions = [item.category for item in home.objects]
    assert (
        check_agent(
            lambda: agent_in(home, *captions, start=six.start),
            steps=FULL_TURN + 6,
            camera=Camera(96, 72),
            sequences=True,
        )
        == []
    )
