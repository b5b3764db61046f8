"""Agents in home sequences: an agent made for episodes does one search after the other, with or without its memory."""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode
from sim.episodes.sequence_files import SequenceSet
from sim.errors import AgentError
from sim.frames import T_world_agent, gps_from_poses, quat_xyzw_from_yaw, wrap_angle
from sim.plugins import call_plugin
from sim.tasks.agent_makers import AgentMaker, MakesShortestPath
from sim.tasks.agents import Agent, next_action
from sim.tasks.pan import PanEnv
from sim.tasks.rules import reaches_target
from sim.tasks.runner import WalkTerms, episode_seed
from sim.tasks.workers import SceneJob, Workers, results, without
from sim.types import SEQUENCE7, Action, Camera, ClutterLevel, EpisodeKey, Observation, Pose, Task

from .runs import SequenceRun
from .scoring import run_from_sequence_env
from .searches import prompts_of, remembered_episode, search_episode, sequence_key, sequence_task, task_so_far
from .writer import SequenceWriter

BATCH = 2
"""Sequences that a worker process runs before it hands them over."""


@runtime_checkable
class FollowsSequences(Protocol):
    """An agent that reads `message` and `query` of observations itself and says FOUND; all others do one search at a
    time, as an episode."""

    follows_sequences: bool


@runtime_checkable
class Carries(Protocol):
    """An agent that keeps its memory where it is told how the next start lies to the first one."""

    def carry(self, T_map_start: NDArray[np.float64]) -> None:
        """Where the next episode starts (4, 4) in the frame of the first start."""
        ...


@runtime_checkable
class WantsMore(Protocol):
    """An agent that goes on after STOP in a search for all objects; for others such a search ends there."""

    @property
    def wants_more(self) -> bool:
        """After STOP, whether it looks for another object."""
        ...


AgentOf = Callable[[int, Pose, tuple[Pose, ...]], Agent | None]
"""(index of a search, pose where it begins or goes on, places marked in it) -> its agent, world frame.

None = no other agent: a search for all objects ends here, unless the agent wants more; before the first mark there
always is one."""


class SearchBySearch:
    """An agent for episodes in a home sequence: each search is an episode that begins where the robot stands.

    The description is all that was told so far. The agent's STOP becomes FOUND; STOP is never said.
    """

    def __init__(self, agent_of: AgentOf, start: Pose, *, keeps_memory: bool) -> None:
        """Makes no agent yet.

        Args:
            agent_of: Gives the agents.
            start: The sequence's start, world frame; the agents do not get it.
            keeps_memory: Whether agents keep what they know of the home. One that carries its memory does all searches.
        """
        self._agent_of, self._start, self._keeps_memory = agent_of, start, keeps_memory

    def reset(self, task: Task, camera: Camera, *, seed: int, keep_memory: bool = False) -> None:
        """Starts a sequence; the agents are reset when their searches begin."""
        self._whole, self._camera, self._seed = task, camera, seed
        self._news, self._index, self._is_sure, self._is_owed = list[tuple[str, int]](), -1, False, False
        self._agent: Agent | None = None

    def act(self, observation: Observation) -> Action:
        """The agent's action; FOUND for its STOP, and again where the search goes on after it.

        Raises:
            AgentError: The agent raised, or returned something that is not one of the task's actions.
        """
        if observation.query is not None:
            self._begin(observation)
        elif self._is_owed:
            self._is_owed, self._is_sure = False, True
            return Action.FOUND
        elif self._is_sure and not self._goes_on(observation):
            return Action.FOUND
        assert self._agent is not None, "an observation with a query comes first"
        action = next_action(self._agent, self._task, self._as_episode(observation))
        if action is Action.STOP and self._is_sure:  # the next object is here too, but FOUND again would end the search
            self._is_sure, self._is_owed = False, True
            return Action.LEFT
        self._is_sure = action is Action.STOP
        return Action.FOUND if self._is_sure else action

    def _begin(self, observation: Observation) -> None:
        """A search begins."""
        self._index, self._marks = self._index + 1, list[Pose]()
        self._is_sure = self._is_owed = False
        self._news += [(observation.message, self._index)] if observation.message else []
        assert observation.query is not None
        self._task = task_so_far(self._whole, self._news, observation.query, self._index)
        self._here = self._pose(observation)
        kept = {"keep_memory": True} if self._keeps_memory and self._agent is not None else {}
        if kept and isinstance(self._agent, Carries):
            agent = self._agent
            call_plugin("agent", agent.carry, T_world_agent(self._here))
        else:
            agent = self._agent_of(self._index, _in_world(self._start, self._here), ())
        self._start_agent(agent, observation, **kept)

    def _goes_on(self, observation: Observation) -> bool:
        """Whether an agent looks for another object in a search for all of them."""
        here = self._pose(observation)
        self._marks.append(_in_world(self._start, here))
        agent = self._agent_of(self._index, self._marks[-1], tuple(self._marks))
        if agent is None:
            return isinstance(self._agent, WantsMore) and self._agent.wants_more
        self._here = here
        self._start_agent(agent, observation)
        return True

    def _start_agent(self, agent: Agent | None, observation: Observation, **more: bool) -> None:
        assert agent is not None, "each search has an agent"
        self._agent, self._first_step = agent, observation.step
        call_plugin("agent", agent.reset, self._task, self._camera, seed=self._seed + self._index, **more)

    def _pose(self, observation: Observation) -> Pose:
        """The robot's pose in the frame of the sequence's start."""
        x, y, z = observation.T_start_camera[:3, 3].tolist()
        return Pose((x, y - self._camera.mount_height, z), observation.compass)

    def _as_episode(self, observation: Observation) -> Observation:
        """The observation in the frame of the search's start, with its steps counted from there."""
        return dataclasses.replace(
            observation,
            gps=gps_from_poses(self._here, self._pose(observation)),
            compass=wrap_angle(observation.compass - self._here.yaw),
            T_start_camera=np.linalg.inv(T_world_agent(self._here)) @ observation.T_start_camera,
            collided=observation.collided and observation.step > self._first_step,
            step=observation.step - self._first_step,
            message=None,
            query=None,
        )


def _in_world(start: Pose, here: Pose) -> Pose:
    """A pose in the frame of a start as a pose in the world."""
    x, y, z = (T_world_agent(start) @ T_world_agent(here))[:3, 3].tolist()
    return Pose((x, y, z), wrap_angle(start.yaw + here.yaw))


@dataclass(frozen=True, slots=True)
class SequenceJob(SceneJob):
    """Everything that a worker process needs to run an agent on some sequences of one scene."""

    sequences: Path
    """Folder of the set; `dataset_root` is that of the episodes from which the homes are recovered."""
    scenes_dir: Path | None
    agent: AgentMaker
    seed: int
    keeps_memory: bool = False
    ignores_messages: bool = False
    """Whether nothing is told after the intro; an agent with ground truth then has that of the intro."""
    clutter: ClutterLevel = 0
    labels: bool = False
    """Whether pictures name the category of each object in view."""
    terms: WalkTerms = WalkTerms(actions=SEQUENCE7)  # noqa: RUF009 - frozen value


def open_job(job: SequenceJob) -> Callable[[EpisodeKey], SequenceRun]:
    """Opens the job's scene; the result runs the agent over one of its sequences and scores it.

    Raises:
        SceneError: The scene cannot be opened.
        AgentError: The agent cannot be built; the function raises it too, when the agent fails.
    """
    from sim.homes.open_home import open_scene

    dataset = PersonalDataset(job.dataset_root, evidence=job.evidence)
    scene = open_scene(dataset, job.scene, scenes_dir=job.scenes_dir, clutter=job.clutter, labels=job.labels)
    found = {sequence_key(one): one for one in SequenceSet(job.sequences).sequences(scenes=(job.scene,))}
    agent_of = job.agent.open(dataset, scene)
    knows_goals = isinstance(job.agent, MakesShortestPath)
    renderer = None
    if job.agent.looks:
        from sim.homes.renderers import renderer_of

        renderer = renderer_of(scene)

    def run_sequence(key: EpisodeKey) -> SequenceRun:
        sequence, terms = found[key], job.terms
        env = PanEnv(
            sequence.start,
            scene.navigation,
            renderer=renderer,
            camera=terms.camera,
            max_steps=terms.max_steps,
            prompts=prompts_of(sequence, query_index=terms.query_index, ignores_messages=job.ignores_messages),
        )
        truth_of = remembered_episode if job.ignores_messages else search_episode

        def agent_at(index: int, pose: Pose, marks: tuple[Pose, ...]) -> Agent | None:
            episode = _without(_from_here(truth_of(sequence, index), pose), marks)
            return agent_of(episode) if (knows_goals and episode.targets) or not marks else None

        agent = sequence_agent(agent_at, sequence.start, keeps_memory=job.keeps_memory)
        if job.keeps_memory and not isinstance(agent, SearchBySearch):
            raise AgentError(
                f"{key}: {type(agent).__name__} has follows_sequences, so it decides itself what it keeps; "
                "expected no memory to be asked for. Leave --memory out."
            )
        task = sequence_task(sequence, query_index=terms.query_index, max_steps=terms.max_steps, actions=terms.actions)
        try:
            play_sequence(agent, env, task, seed=episode_seed(job.seed, key))
        except AgentError as error:
            raise AgentError(f"{key}: {error}") from error
        return run_from_sequence_env(sequence, env, scene_digest=scene.digest, navigation=scene.navigation)

    return run_sequence


def sequence_agent(agent_of: AgentOf, start: Pose, *, keeps_memory: bool) -> Agent:
    """The agent itself where it follows sequences, else one search after the other; arguments of `SearchBySearch`."""
    first = agent_of(0, start, ())
    if isinstance(first, FollowsSequences) and first.follows_sequences:
        return first
    return SearchBySearch(agent_of, start, keeps_memory=keeps_memory)


def play_sequence(agent: Agent, env: PanEnv, task: Task, *, seed: int) -> None:
    """Resets `env` and steps it with the agent's actions until the sequence is over.

    Raises:
        AgentError: The agent raised, or returned something that is not one of the task's actions.
    """
    assert env.max_steps == task.max_steps, (env.max_steps, task.max_steps)
    observation = env.reset()
    call_plugin("agent", agent.reset, task, env.camera, seed=seed)
    while not env.is_over:
        try:
            action = next_action(agent, task, observation)
        except AgentError as error:
            raise AgentError(f"step {observation.step + 1}: {error}") from error
        observation = env.step(action)


def run_sequences(
    jobs: Sequence[SequenceJob],
    writer: SequenceWriter,
    *,
    processes: Workers,
    on_sequence: Callable[[], None] = lambda: None,
) -> None:
    """Runs every job, one per scene, and appends finished runs to `writer` in order; sequences that it already holds
    are skipped. `on_sequence` is called when a sequence is on disk.

    Raises:
        PersonalVizError: A sequence could not be run; all sequences before it are on disk.
    """
    for run in results(open_job, without(jobs, writer.done), processes=processes, batch=BATCH):
        writer.add_sequence(run)
        on_sequence()


def _from_here(episode: Episode, pose: Pose) -> Episode:
    """The episode with another start."""
    qx, qy, qz, qw = quat_xyzw_from_yaw(pose.yaw)
    moved = {"start_position": pose.position, "start_rotation": (qx, qy, qz, qw)}
    return dataclasses.replace(episode, record=episode.record.model_copy(update=moved))


def _without(episode: Episode, marks: tuple[Pose, ...]) -> Episode:
    """The episode without the targets that were marked."""
    left = list(episode.targets)
    for mark in marks:
        hit = next((target for target in left if reaches_target(mark.position, target)), None)
        left = [target for target in left if target is not hit]
    return dataclasses.replace(episode, targets=tuple(left))
