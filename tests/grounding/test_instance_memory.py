"""The agent that remembers things: two rugs that change hands, and searches for all things."""

import dataclasses
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from grounding.agents.goal_text import described_thing
from grounding.agents.instance_memory import InstanceMemoryAgent, sought
from grounding.maps.oracle_map import object_texts
from grounding.perception.by_name import EpisodeTruth, make_perception
from grounding.phrases.rules import RulePhrases
from sim.episodes.dataset import PersonalDataset
from sim.homes.open_home import open_scene
from sim.homes.renderers import renderer_of
from sim.sequences.playing import SearchBySearch, play_sequence
from sim.sequences.runs import SequenceRun
from sim.sequences.scoring import run_from_sequence_env
from sim.sequences.searches import prompts_of, sequence_task
from sim.tasks.agents import Agent
from sim.tasks.observers import Insight
from sim.tasks.pan import PanEnv
from sim.types import SEQUENCE7, Action, Camera, Observation, Pose, Task

from ..sim.home_story import SCENE, subtask, told_in
from .test_explore import observation

CAMERA = Camera(160, 120)
STEPS = 250
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


class Played(NamedTuple):
    run: SequenceRun
    steps: list[int]
    """Of each search."""
    insight: Insight
    """At the end."""
    actions: list[Action]


@lru_cache(maxsize=4)
def played(root: Path, out: Path, *, keeps_memory: bool = True, ignores: bool = False) -> Played:
    """The agent with oracle perception in a story of two rugs."""
    dataset = PersonalDataset(root)
    scene = open_scene(dataset, SCENE)
    captions, phrases, agents = object_texts(dataset, scene), RulePhrases(), list[InstanceMemoryAgent]()
    sequence = told_in(root, out, messages=SWAP, subtasks=ASKS[:2] if ignores else ASKS)

    def agent_of(index: int, pose: Any, marks: Any) -> Agent | None:
        if marks:
            return None
        eyes = make_perception("oracle", truth=EpisodeTruth(scene, pose, captions))
        agents.append(InstanceMemoryAgent(eyes, lambda task: described_thing(task, phrases), phrases))
        return agents[-1]

    env = PanEnv(
        sequence.start,
        scene.navigation,
        renderer=renderer_of(scene),
        camera=CAMERA,
        max_steps=STEPS,
        prompts=prompts_of(sequence, ignores_messages=ignores),
    )
    agent = SearchBySearch(agent_of, sequence.start, keeps_memory=keeps_memory)
    play_sequence(agent, env, sequence_task(sequence, max_steps=STEPS), seed=int(not keeps_memory))
    run = run_from_sequence_env(sequence, env, scene_digest=scene.digest, navigation=scene.navigation)
    shown = (agents[0] if keeps_memory else agents[-1]).insight()
    return Played(run, np.diff([0, *env.search_ends]).tolist(), shown, [step.action for step in env.steps])


def succeeded(told: Played) -> list[bool | None]:
    return [search.succeeds("paper") for search in told.run.end.searches]


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("told")


@pytest.mark.slow
def test_it_walks_to_what_the_messages_say_and_to_the_old_thing_where_it_hears_none(
    small_home_root: Path, out: Path
) -> None:
    told = played(small_home_root, out)
    assert succeeded(told)[:2] == [True, True]
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
    said += [agent.act(observation(start, depth=2.0, step=step)) for step in (1, 2)]
    assert said == [Action.FOUND, Action.LEFT, Action.FOUND]


def test_what_is_sought_follows_the_table_of_owners() -> None:
    text = f"Ada owns the {BROWN}. Bo owns the {GREEN}. Bo owns the red sofa in the hall."
    assert sought(Task("pan", text, ("Find Bo's rug",)), GREEN, RulePhrases()) == (
        *((GREEN,), (BROWN, "red sofa")),
        ("rug",),
        False,
    )
    assert sought(Task("pan", text, ("Find all of Bo's sofas",)), "red sofa", RulePhrases()) == (
        *(("red sofa",), (BROWN, GREEN)),
        ("sofa",),
        True,
    )
