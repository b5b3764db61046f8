"""Agents that see in home sequences: what they keep from search to search, and that they see in the right frame."""

import dataclasses
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from grounding.agents.by_name import MakesSeeing
from grounding.agents.goal_text import described_thing
from grounding.agents.instance_memory import InstanceMemoryAgent
from grounding.agents.onemap.agent import OneMapAgent
from grounding.agents.random_frontier import RandomFrontierAgent
from grounding.agents.vlfm.agent import VlfmAgent
from grounding.chat.endpoint import LlmOptions
from grounding.maps.oracle_map import object_texts
from grounding.perception.by_name import EpisodeTruth, make_perception
from grounding.perception.oracle_detector import OracleDetector
from grounding.perception.protocol import Perception
from grounding.phrases.rules import RulePhrases
from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode
from sim.frames import planar_distance
from sim.homes.open_home import open_scene
from sim.homes.renderers import renderer_of
from sim.mesh import Scene
from sim.tasks.agents import Agent
from sim.tasks.observers import FREE, OCCUPIED
from sim.tasks.pan import PanEnv
from sim.tasks.runner import play_episode
from sim.types import PAPER6, Action, Camera, Observation

from ..sim.home_story import SCENE, subtask
from .told_walks import ToldWalk, told_walk

CAMERA = Camera(96, 72)
TELLS: list[dict[str, Any]] = [
    {
        "before": 0,
        "kind": "intro",
        "text": "Ada owns the blue wooden dresser. Bo owns the white enamel stove.",
        "adds": [["Ada", "dresser_49"], ["Bo", "stove_18"]],
    }
]
ASKS = [
    subtask("Ada", "dresser", "dresser_49", "fresh", 0),
    subtask("Bo", "stove", "stove_18", "fresh", 0),
    subtask("Ada", "dresser", "dresser_49", "revisit", 0),
]


@lru_cache(maxsize=1)
def home_at(root: Path) -> tuple[Scene, dict[int, str], tuple[Episode, ...]]:
    dataset = PersonalDataset(root)
    scene = open_scene(dataset, SCENE)
    return scene, object_texts(dataset, scene), tuple(dataset.episodes(splits=("easy",)))


@lru_cache(maxsize=2)
def onemap_in(root: Path, out: Path, *, keeps_memory: bool) -> ToldWalk:
    """OneMap with oracle perception asked for the dresser, the stove, and the dresser again."""
    phrases = RulePhrases()
    return told_walk(
        root,
        out,
        lambda eyes: OneMapAgent(eyes, lambda task: described_thing(task, phrases)),
        messages=TELLS,
        asks=ASKS,
        camera=CAMERA,
        keeps_memory=keeps_memory,
    )


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("told")


def test_with_memory_onemap_sees_where_things_are_from_each_start(small_home_root: Path, out: Path) -> None:
    told = onemap_in(small_home_root, out, keeps_memory=True)
    assert [search.succeeds("paper") for search in told.run.end.searches[1:]] == [True, True]
    (dresser,) = (item for item in home_at(small_home_root)[0].objects if item.instance_id == 49)
    assert told.insight.goal is not None
    places = [told.insight.goal, *(each.position for each in told.insight.detections if each.position)]
    assert len(places) > 1
    for place in places:
        assert planar_distance((told.last_start @ np.array([*place, 1.0])).tolist(), dresser.centre) < 1.2
    assert told.insight.grid is None, "a grid cannot be turned into the frame of the start"


def test_with_memory_a_revisit_needs_fewer_steps(small_home_root: Path, out: Path) -> None:
    kept, forgotten = (onemap_in(small_home_root, out, keeps_memory=on) for on in (True, False))
    assert kept.steps[0] == forgotten.steps[0], "nothing is remembered in the first search"
    assert forgotten.run.end.searches[2].succeeds("paper")
    assert kept.steps[2] < forgotten.steps[2] / 2


def eyes_at(root: Path, start: Any) -> Perception:
    scene, captions, _ = home_at(root)
    return make_perception("oracle", truth=EpisodeTruth(scene, start, captions))


def made(name: str, root: Path) -> Agent:
    """An agent that looks for the stove from the start of the first easy episode."""
    if name == "random-frontier":
        return RandomFrontierAgent()
    eyes = eyes_at(root, home_at(root)[2][0].start)
    if name == "onemap":
        return OneMapAgent(eyes, lambda task: "white enamel stove")
    if name == "instance-memory":
        return InstanceMemoryAgent(eyes, lambda task: "white enamel stove", RulePhrases())
    if name == "vlfm":
        return VlfmAgent(eyes, lambda task: "white enamel stove")
    from grounding.agents.frontier_vlm.agent import JudgedFrontierAgent
    from grounding.agents.frontier_vlm.choices import GeometryJudge

    return JudgedFrontierAgent(eyes, lambda task: "white enamel stove", judge=GeometryJudge)


def walked(agent: Any, root: Path, *, steps: int, carry: Callable[[Agent], None] | None = None) -> list[Action]:
    """The agent's actions in the first easy episode; with `carry` it is called before, and memory is kept."""
    scene, _, (episode, *_) = home_at(root)
    env = PanEnv(episode.start, scene.navigation, renderer=renderer_of(scene), camera=CAMERA, max_steps=steps)
    task = dataclasses.replace(episode.task("pan", actions=PAPER6), max_steps=steps)
    if carry is None:
        play_episode(agent, env, task, seed=2)
    else:
        carry(agent)
        agent.reset(task, CAMERA, seed=2, keep_memory=True)
        observation: Observation = env.reset()
        while not env.is_over:
            observation = env.step(agent.act(observation))
    return [step.action for step in env.steps]


def at_height(y: float) -> Callable[[Any], None]:
    """Carries an agent to the first start, or above it."""
    T = np.eye(4)
    T[1, 3] = y
    return lambda agent: agent.carry(T)


def cells(agent: Any) -> NDArray[np.uint8]:
    """(rows, cols) the map that it shows."""
    occupancy = agent.insight().occupancy
    assert occupancy is not None
    return occupancy


@pytest.mark.parametrize("name", ["random-frontier", "onemap", "instance-memory", "vlfm", "judged-frontier"])
def test_a_carried_map_keeps_floor_or_obstacles_alone(small_home_root: Path, name: str) -> None:
    agent = made(name, small_home_root)
    walked(agent, small_home_root, steps=40)
    before = cells(agent)
    walked(agent, small_home_root, steps=1, carry=at_height(0.0))
    after = cells(agent)
    assert np.count_nonzero((after == OCCUPIED) & (before == OCCUPIED)) > 0.9 * np.count_nonzero(before == OCCUPIED)
    share_free = np.count_nonzero((after == FREE) & (before == FREE)) / np.count_nonzero(before == FREE)
    if name in ("random-frontier", "onemap", "instance-memory"):
        assert share_free > 0.95
    else:
        assert share_free < 0.6
    walked(agent, small_home_root, steps=1, carry=lambda agent: None)
    assert np.count_nonzero(cells(agent)) < 0.7 * np.count_nonzero(before), "nobody said where the episode starts"


def test_the_agent_with_a_chat_model_carries_its_obstacles_too(small_home_root: Path) -> None:
    scene, _, (episode, *_) = home_at(small_home_root)
    llm = LlmOptions.model_validate({"base_url": "http://127.0.0.1:9/v1", "model": "nobody"})
    agent = MakesSeeing("frontier-vlm", "oracle", llm=llm).open(PersonalDataset(small_home_root), scene)(episode)
    walked(agent, small_home_root, steps=12)  # it looks around and asks nothing yet
    before = cells(agent) == OCCUPIED
    walked(agent, small_home_root, steps=1, carry=at_height(0.0))
    assert np.count_nonzero((cells(agent) == OCCUPIED) & before) > 0.9 * np.count_nonzero(before)


def test_vlfm_forgets_values_and_explored_area_with_its_query(small_home_root: Path) -> None:
    agent = made("vlfm", small_home_root)
    assert isinstance(agent, VlfmAgent)
    walked(agent, small_home_root, steps=40)
    seen = np.isfinite(np.asarray(agent.insight().similarity))
    walked(agent, small_home_root, steps=1, carry=at_height(0.0))
    again = np.isfinite(np.asarray(agent.insight().similarity))
    assert 0 < again.sum() < 0.6 * seen.sum()


def test_on_another_storey_the_map_begins_anew_at_its_height_and_is_kept_from_there(small_home_root: Path) -> None:
    agent = RandomFrontierAgent()
    first = walked(agent, small_home_root, steps=60)
    assert walked(agent, small_home_root, steps=60, carry=at_height(4.0)) == first
    assert walked(agent, small_home_root, steps=60, carry=at_height(4.0)) != first
    assert walked(agent, small_home_root, steps=60, carry=at_height(0.0)) == first


def test_a_kept_agent_looks_for_the_caption_of_the_search_that_begins(
    small_home_root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    queries: list[str] = []
    set_query = OracleDetector.set_query

    def noted(self: OracleDetector, text: str) -> None:
        queries.append(text)
        set_query(self, text)

    monkeypatch.setattr(OracleDetector, "set_query", noted)
    dataset = PersonalDataset(small_home_root)
    agent_of = MakesSeeing("onemap", "oracle", goal_text="caption").open(dataset, home_at(small_home_root)[0])
    episodes = home_at(small_home_root)[2][:2]
    agent, _ = (agent_of(episode) for episode in episodes)
    for episode in episodes:
        agent.reset(episode.task("pan"), CAMERA, seed=0)
    assert queries == [episode.record.captions_per_object[0][0] for episode in episodes]
    assert queries[0] != queries[1]
