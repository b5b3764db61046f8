"""OneMap walks an invented home with a perception that knows the captions of what it sees."""

import dataclasses
from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from grounding.agents.onemap.agent import OneMapAgent
from grounding.agents.seeking import FULL_TURN
from grounding.encoders.hashed import HashedWords
from grounding.maps.oracle_map import object_texts
from grounding.perception.oracle_perception import OraclePerception
from grounding.perception.protocol import Perception
from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode
from sim.errors import AgentError
from sim.frames import T_world_agent, planar_distance
from sim.homes.open_home import open_scene, scene_from_plan
from sim.homes.plan import Rect
from sim.homes.renderers import renderer_of
from sim.mesh import Scene
from sim.tasks.agents import next_action
from sim.tasks.looks import HomeLook
from sim.tasks.observers import Detection
from sim.tasks.pan import PanEnv
from sim.tasks.run_files import EpisodeRun
from sim.tasks.runner import run_from_env
from sim.types import PAPER6, Action, Camera, Frame, Observation, Pose, Task

from ..sim import plans

CAMERA = Camera(96, 72)


class Sight:
    """Detector, segmenter and scorer of the objects in view by caption."""

    def __init__(self, home: Scene, captions: dict[int, str]) -> None:
        self._renderer, self._captions = renderer_of(home), captions
        self._query, self.start = "", Pose((0.0, 0.0, 0.0), 0.0)

    def frame_of(self, observation: Observation) -> Frame:
        T = observation.T_start_camera
        frame = self._renderer.render(T_world_agent(self.start) @ T, observation.camera)
        return dataclasses.replace(frame, T_world_camera=T)

    def set_query(self, text: str) -> None:
        self._query = text

    def detect(self, frame: Frame) -> list[Detection]:
        found = []
        for instance in np.unique(frame.instance_ids).tolist():
            if self._captions.get(instance) == self._query:
                rows, cols = np.nonzero(frame.instance_ids == instance)
                box = (float(cols.min()), float(rows.min()), float(cols.max()) + 1, float(rows.max()) + 1)
                found.append(Detection(self._captions[instance], box, 1.0))
        return found

    def mask(self, frame: Frame, detection: Detection) -> NDArray[np.bool_]:
        own = [instance for instance, caption in self._captions.items() if caption == detection.label]
        return np.isin(frame.instance_ids, own)

    def score(self, frame: Frame, texts: Sequence[str]) -> NDArray[np.float32]:
        return np.zeros(len(texts), np.float32)


@lru_cache(maxsize=1)
def home_at(root: Path) -> tuple[Scene, dict[int, str], tuple[Episode, ...]]:
    dataset = PersonalDataset(root)
    scene = open_scene(dataset, "Small")
    return scene, object_texts(dataset, scene), tuple(dataset.episodes(splits=("easy",)))


def caption_of(episode: Episode) -> str:
    return episode.record.captions_per_object[0][0]


def episode_at(root: Path, thing: str = "table lamp") -> Episode:
    """The search for a thing. The lamp is small enough for 0.6 m from what is seen of it to be 1 m from its middle."""
    (found,) = (each for each in home_at(root)[2] if caption_of(each).startswith(thing))
    return found


class Walker(NamedTuple):
    agent: OneMapAgent
    sight: Sight


def walker_in(root: Path, *, text: str | None = None) -> Walker:
    """An agent that looks for a text, or for the caption of each episode's target."""
    scene, captions, episodes = home_at(root)
    texts = {episode.task("pan").queries: caption_of(episode) for episode in episodes}
    return walker_with(scene, captions, lambda task: text or texts[task.queries])


def walker_with(scene: Scene, captions: dict[int, str], text_of: Callable[[Task], str]) -> Walker:
    sight, encoder = Sight(scene, captions), OraclePerception(HashedWords(), captions)
    return Walker(
        OneMapAgent(lambda: Perception("by id", sight.frame_of, sight, encoder, sight, sight), text_of), sight
    )


def played(
    root: Path,
    walker: Walker,
    *,
    thing: str = "table lamp",
    max_steps: int = 500,
    camera: Camera = CAMERA,
    keep_memory: bool = False,
    first: Pose | None = None,
) -> EpisodeRun:
    """One run of the search for a thing, from the start of its episode; the agent carries the map of a first start."""
    (agent, sight), scene, episode = walker, home_at(root)[0], episode_at(root, thing)
    sight.start = first or episode.start
    if first is not None:
        agent.carry(np.linalg.inv(T_world_agent(first)) @ T_world_agent(episode.start))
    env = PanEnv(episode.start, scene.navigation, renderer=renderer_of(scene), camera=camera, max_steps=max_steps)
    task, observation = episode.task("pan", actions=PAPER6), env.reset()
    agent.reset(task, camera, seed=1, keep_memory=keep_memory)
    while not env.is_over:
        observation = env.step(next_action(agent, task, observation))
    return run_from_env(episode, env, scene_digest=scene.digest, navigation=scene.navigation)


def actions_of(run: EpisodeRun) -> list[Action]:
    return [step.action for step in run.steps]


def test_it_looks_around_then_walks_to_the_described_thing_and_stops_once_it_is_within_reach(
    small_home_root: Path,
) -> None:
    walker = walker_in(small_home_root)
    run = played(small_home_root, walker)
    assert run.end.reason == "stop"
    assert run.end.measures is not None
    assert run.end.measures.centre_distance < 1.0
    assert actions_of(run)[:FULL_TURN] == [Action.LEFT] * FULL_TURN
    assert actions_of(run).count(Action.FORWARD) > 5
    insight = walker.agent.insight()
    assert insight.goal is not None
    assert insight.grid is not None
    assert insight.similarity is not None
    row, col = insight.grid.rc_from_xz(np.array(insight.goal)[[0, 2]])
    assert insight.similarity[row, col] > 0.2
    before = len(run.steps) - 6
    assert played(small_home_root, walker, max_steps=before).steps == run.steps[:before], "the same after a reset"
    assert [detection.score for detection in walker.agent.insight().detections] == [1.0]


def test_another_thing_seen_in_an_earlier_episode_is_walked_to_at_once(small_home_root: Path) -> None:
    walker, rug = walker_in(small_home_root), "green and white striped woven rug"
    first = played(small_home_root, walker)
    start, other = (episode_at(small_home_root, thing).start for thing in ("table lamp", rug))
    assert planar_distance(start.position, other.position) == pytest.approx(0.86, abs=0.01)
    second = played(small_home_root, walker, thing=rug, keep_memory=True, first=start)
    assert second.end.measures is not None
    paper = second.end.measures.rules["paper"]
    assert paper is not None
    assert paper.spl > 0.8
    assert len(second.steps) < FULL_TURN, "it does not look around first"
    again = played(small_home_root, walker, keep_memory=True)
    assert again.steps == first.steps, "nobody said where the episode starts in the map"


def test_a_thing_seen_in_a_look_at_the_home_is_walked_to_at_once(small_home_root: Path) -> None:
    walker = walker_in(small_home_root)
    first = played(small_home_root, walker)
    scene, episode = home_at(small_home_root)[0], episode_at(small_home_root)
    env = PanEnv(episode.start, scene.navigation, renderer=renderer_of(scene), camera=CAMERA)
    views = [env.reset(), *(env.step(action) for action in actions_of(first)[:-1])]
    for _ in range(2):
        walker.agent.look(HomeLook("glb", views=lambda: iter(views)))
        run = played(small_home_root, walker, keep_memory=True)
        assert run.end.measures is not None
        assert run.end.measures.centre_distance < 1.0
        assert len(run.steps) < len(first.steps) - 6, "it does not look around first"
    assert played(small_home_root, walker, keep_memory=True).steps == first.steps, "a look is for one episode"


def test_in_a_closed_room_where_nothing_resembles_the_text_it_turns_and_does_not_walk() -> None:
    rect = Rect(0.0, 0.0, 2.2, 2.2)
    plan = plans.two_rooms(name="Closet", rooms=(plans.room("closet", rect),), walls=plans.walls_around(rect))
    scene, start = scene_from_plan(plan), Pose((1.1, 0.0, 1.1), 0.0)
    agent, sight = walker_with(scene, {}, lambda task: "small cup")
    sight.start = start
    env = PanEnv(start, scene.navigation, renderer=renderer_of(scene), camera=CAMERA, max_steps=18)
    observation = env.reset()
    agent.reset(Task("pan", "Ada owns a small cup.", ("Find Ada's cup",)), CAMERA, seed=0)
    while not env.is_over:
        observation = env.step(agent.act(observation))
    shown = agent.insight()
    assert shown.frontiers is not None
    assert shown.candidates is not None
    assert len(shown.frontiers) == len(shown.candidates) == 0
    assert [step.action for step in env.steps] == [Action.LEFT] * 18
    assert shown.note == "no goal is left: turning"


@pytest.mark.slow
def test_for_a_text_that_nothing_matches_it_explores_until_its_steps_end(small_home_root: Path) -> None:
    run = played(small_home_root, walker_in(small_home_root, text="zebra xylophone"), camera=Camera(64, 48))
    assert run.end.reason == "steps"
    assert len(run.steps) == 500
    assert len({(round(x), round(z)) for x, _, z in (step.pose.position for step in run.steps)}) > 15


def test_without_pictures_it_says_what_it_needs(small_home_root: Path) -> None:
    agent, camera = walker_in(small_home_root, text="lamp").agent, CAMERA
    agent.reset(episode_at(small_home_root).task("pan"), camera, seed=0)
    blind = Observation(None, None, (0.0, 0.0), 0.0, np.eye(4), camera, collided=False, step=0)
    with pytest.raises(AgentError, match="has no picture; expected colours and depth"):
        agent.act(blind)
