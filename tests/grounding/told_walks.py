"""Walks of an agent with oracle perception through a told home sequence."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from grounding.agents.looking_agent import LookingAgent
from grounding.maps.oracle_map import object_texts
from grounding.perception.by_name import EpisodeTruth, make_perception
from grounding.perception.protocol import Perception
from sim.episodes.dataset import PersonalDataset
from sim.frames import T_world_agent
from sim.homes.open_home import open_scene
from sim.homes.renderers import renderer_of
from sim.sequences.playing import SearchBySearch, play_sequence
from sim.sequences.runs import SequenceRun
from sim.sequences.scoring import run_from_sequence_env
from sim.sequences.searches import prompts_of, sequence_task
from sim.tasks.agents import Agent
from sim.tasks.observers import Insight
from sim.tasks.pan import PanEnv
from sim.types import Action, Camera

from ..sim.home_story import SCENE, told_in

STEPS = 250
"""Of each search."""


class ToldWalk(NamedTuple):
    """A sequence that an agent has walked."""

    run: SequenceRun
    steps: list[int]
    """Of each search."""
    last_start: NDArray[np.float64]
    """(4, 4) pose of the robot, world frame, where the last search began."""
    insight: Insight
    """At the end."""
    actions: list[Action]


def told_walk(
    root: Path,
    out: Path,
    make_agent: Callable[[Perception], LookingAgent],
    *,
    messages: list[dict[str, Any]],
    asks: list[dict[str, Any]],
    camera: Camera,
    keeps_memory: bool,
    ignores: bool = False,
    seed: int = 0,
) -> ToldWalk:
    """The walk of an agent for episodes through the messages and searches, told in the home of a dataset."""
    dataset = PersonalDataset(root)
    scene = open_scene(dataset, SCENE)
    captions, agents = object_texts(dataset, scene), list[LookingAgent]()
    sequence = told_in(root, out, messages=messages, subtasks=asks)

    def agent_of(index: int, pose: Any, marks: Any) -> Agent | None:
        if marks:
            return None
        agents.append(make_agent(make_perception("oracle", truth=EpisodeTruth(scene, pose, captions))))
        return agents[-1]

    env = PanEnv(
        sequence.start,
        scene.navigation,
        renderer=renderer_of(scene),
        camera=camera,
        max_steps=STEPS,
        prompts=prompts_of(sequence, ignores_messages=ignores),
    )
    agent = SearchBySearch(agent_of, sequence.start, keeps_memory=keeps_memory)
    play_sequence(agent, env, sequence_task(sequence, max_steps=STEPS), seed=seed)
    run = run_from_sequence_env(sequence, env, scene_digest=scene.digest, navigation=scene.navigation)
    ends, shown = env.search_ends, agents[-1].insight()
    start = T_world_agent(env.poses[ends[-2]])
    return ToldWalk(run, np.diff([0, *ends]).tolist(), start, shown, [step.action for step in env.steps])
