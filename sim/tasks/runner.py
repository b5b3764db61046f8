"""The only loop that steps an environment for agents; resumable episode by episode, results independent of `jobs`."""

import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode
from sim.errors import AgentError
from sim.types import PAPER6, Action, Camera, ClutterLevel, EpisodeKey, Task
from sim.world.navigation_map import NavigationMap

from .agents import Agent, RandomAgent, ShortestPathAgent, load_agent
from .pan import PanEnv
from .rules import score_run
from .run_files import EpisodeEnd, EpisodeRun, EpisodeStart
from .run_writer import RunWriter
from .workers import SceneJob, results, without

BATCH = 8
"""Episodes that a worker process runs before it hands them over: what a kill can lose, per process."""


@dataclass(frozen=True, slots=True)
class AgentJob(SceneJob):
    """All that a worker process needs to run an agent on some episodes of one scene."""

    scenes_dir: Path | None
    agent: str
    """`random`, `shortest-path` or `package.module:factory`."""
    seed: int
    clutter: ClutterLevel = 0
    """How much furniture without a caption stands in homes without a scan."""


def play_episode(agent: Agent, env: PanEnv, task: Task, *, seed: int) -> None:
    """Steps `env` with the agent's actions until the episode is over.

    Raises:
        AgentError: The agent raised, or returned something that is not one of the task's actions.
    """
    observation = env.reset()
    _call_agent(agent.reset, task, env.camera, seed=seed)
    while not env.is_over:
        action = _call_agent(agent.act, observation)
        if not isinstance(action, Action) or action not in task.actions:
            allowed = [item.value for item in task.actions]
            raise AgentError(
                f"step {observation.step + 1}: the agent returned {action!r}; expected an Action of {allowed}. "
                "Correct its act()."
            )
        observation = env.step(action)


def run_from_env(episode: Episode, env: PanEnv, *, scene_digest: str, navigation: NavigationMap) -> EpisodeRun:
    """The finished run of `env`, scored under every rule."""
    reason = env.end_reason
    assert reason is not None, "the episode is not over"
    measures = score_run(
        episode,
        env.poses,
        stopped=reason == "stop",
        navigation=navigation,
        collisions=sum(step.collided for step in env.steps),
        scene_digest=scene_digest,
    )
    start = episode.start
    return EpisodeRun(
        start=EpisodeStart(
            split=episode.key.split,
            scene=episode.key.scene,
            episode_id=episode.key.episode_id,
            position=start.position,
            yaw=start.yaw,
        ),
        steps=env.steps,
        end=EpisodeEnd(reason=reason, measures=measures),
    )


def open_job(job: AgentJob) -> Callable[[EpisodeKey], EpisodeRun]:
    """Opens the job's scene; the result runs the agent over one of the scene's episodes and scores it.

    Raises:
        SceneError: The scene cannot be opened.
        AgentError: The agent cannot be built; the function raises it too, when the agent fails.
    """
    from sim.scenes.sources import open_scene

    dataset = PersonalDataset(job.dataset_root)
    scene = open_scene(dataset, job.scene, scenes_dir=job.scenes_dir, clutter=job.clutter)
    episodes = {episode.key: episode for episode in dataset.episodes(scenes=(job.scene,))}
    plugin, renderer = None, None
    if ":" in job.agent:
        from sim.scenes.labels import renderer_of

        plugin, renderer = load_agent(job.agent), renderer_of(scene)

    def run_episode(key: EpisodeKey) -> EpisodeRun:
        episode = episodes[key]
        agent = plugin or _own_agent(job.agent, episode, scene.navigation)
        env = PanEnv(episode.start, scene.navigation, renderer=renderer, camera=Camera())
        try:
            play_episode(agent, env, episode.task("pan", actions=PAPER6), seed=episode_seed(job.seed, key))
        except AgentError as error:
            raise AgentError(f"{key}: {error}") from error
        return run_from_env(episode, env, scene_digest=scene.digest, navigation=scene.navigation)

    return run_episode


def run_agent(
    jobs: Sequence[AgentJob], writer: RunWriter, *, processes: int, on_episode: Callable[[], None] = lambda: None
) -> None:
    """Runs every job and appends each run to `writer` as it is finished, in order; what the writer holds is skipped.

    Args:
        jobs: One per scene.
        writer: Where finished runs go.
        processes: Worker processes; 1 runs here. Runs and their order do not depend on it.
        on_episode: Called after each episode is on disk.

    Raises:
        PersonalVizError: An episode could not be run; all before it are on disk.
    """
    for run in results(open_job, without(jobs, writer.done), processes=processes, batch=BATCH):
        writer.add_episode(run)
        on_episode()


def episode_seed(seed: int, key: EpisodeKey) -> int:
    """A seed for one episode that does not depend on which others are run."""
    return zlib.crc32(f"{seed}/{key}".encode())


def _own_agent(name: str, episode: Episode, navigation: NavigationMap) -> Agent:
    if name == "random":
        return RandomAgent()
    return ShortestPathAgent(episode, navigation)


def _call_agent(method: Callable[..., Any], *args: Any, **kwargs: Any) -> Any:
    try:
        return method(*args, **kwargs)
    except Exception as error:  # the plug-in door
        reason = " ".join(str(error).split())
        raise AgentError(
            f"{method.__qualname__}() raised {type(error).__name__}: {reason}. Correct the agent."
        ) from error
