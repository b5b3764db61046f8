"""The only loop that steps an environment for agents; processes per scene, resumable, results independent of `jobs`."""

import multiprocessing
import zlib
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode
from sim.errors import AgentError
from sim.types import PAPER6, Action, Camera, EpisodeKey, Observation, SceneKind, Task
from sim.world.navigation_map import NavigationMap

from .agents import Agent, RandomAgent, ShortestPathAgent, load_agent
from .pan import PanEnv
from .rules import score_run, success_region
from .run_files import EpisodeEnd, EpisodeRun, EpisodeStart, RunWriter


class Observer(Protocol):
    """Sees a run as it happens; must not change it."""

    def on_reset(self, task: Task, observation: Observation) -> None:
        """The episode begins."""
        ...

    def on_step(self, action: Action, observation: Observation) -> None:
        """One action was taken."""
        ...

    def on_end(self, run: EpisodeRun) -> None:
        """The episode is over and scored."""
        ...


@dataclass(frozen=True, slots=True)
class AgentJob:
    """All that a worker process needs to run an agent on some episodes of one scene."""

    dataset_root: Path
    scenes_dir: Path | None
    agent: str
    """`random`, `shortest-path` or `package.module:factory`."""
    seed: int
    scene: str
    keys: tuple[EpisodeKey, ...]


def play_episode(agent: Agent, env: PanEnv, task: Task, *, seed: int, observers: Sequence[Observer] = ()) -> None:
    """Steps `env` with the agent's actions until the episode is over.

    Raises:
        AgentError: The agent raised, or returned something that is not one of the task's actions.
    """
    observation = env.reset()
    _call_agent(agent.reset, task, env.camera, seed=seed)
    for observer in observers:
        observer.on_reset(task, observation)
    while not env.is_over:
        action = _call_agent(agent.act, observation)
        if not isinstance(action, Action) or action not in task.actions:
            allowed = [item.value for item in task.actions]
            raise AgentError(
                f"step {observation.step + 1}: the agent returned {action!r}; expected an Action of {allowed}. "
                "Correct its act()."
            )
        observation = env.step(action)
        for observer in observers:
            observer.on_step(action, observation)


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


def run_scene(job: AgentJob) -> list[EpisodeRun]:
    """Runs the agent over the job's episodes, in order."""
    from sim.scenes.sources import open_scene

    dataset = PersonalDataset(job.dataset_root)
    scene = open_scene(dataset, job.scene, scenes_dir=job.scenes_dir)
    renderer = None
    if ":" in job.agent:
        from sim.scenes.labels import readable
        from sim.world.raycast import Raycaster

        renderer = readable(Raycaster(scene.mesh), scene)
    by_key = {episode.key: episode for episode in dataset.episodes(scenes=(job.scene,))}
    agent = load_agent(job.agent) if ":" in job.agent else RandomAgent()
    runs = []
    for key in job.keys:
        episode = by_key[key]
        if job.agent == "shortest-path":
            region = success_region(episode, scene.navigation, margin=0.1)
            agent = ShortestPathAgent(episode.start, region, scene.navigation)
        env = PanEnv(episode.start, scene.navigation, renderer=renderer, camera=Camera())
        play_episode(agent, env, episode.task("pan", actions=PAPER6), seed=episode_seed(job.seed, key))
        runs.append(run_from_env(episode, env, scene_digest=scene.digest, navigation=scene.navigation))
    return runs


def run_agent(
    jobs: Sequence[AgentJob], writer: RunWriter, *, processes: int, on_scene: Callable[[int], None] = lambda _: None
) -> None:
    """Runs every job and appends its runs to `writer` in order; episodes that the writer holds are skipped.

    Args:
        jobs: One per scene.
        writer: Where finished runs go.
        processes: Worker processes; 1 runs here.
        on_scene: Called with the number of episodes of each finished scene.
    """
    open_jobs = [job for job in (_without_done(job, writer) for job in jobs) if job.keys]
    for runs in _results(open_jobs, processes):
        for run in runs:
            writer.add_episode(run)
        on_scene(len(runs))


def scene_kind(dataset: PersonalDataset, scenes_dir: Path | None) -> SceneKind:
    """Which of the three sources `open_scene` takes for this dataset's scenes."""
    if scenes_dir is not None:
        return "scan"
    return "invented" if any((dataset.root / "scenes").glob("*.plan.json")) else "schematic"


def episode_seed(seed: int, key: EpisodeKey) -> int:
    """A seed for one episode that does not depend on which others are run."""
    return zlib.crc32(f"{seed}/{key}".encode())


def _results(jobs: Sequence[AgentJob], processes: int) -> Iterator[list[EpisodeRun]]:
    if processes <= 1:
        yield from map(run_scene, jobs)
        return
    # spawn: forked children of a process that has loaded numba or Open3D can deadlock in their thread pools
    with ProcessPoolExecutor(processes, mp_context=multiprocessing.get_context("spawn")) as pool:
        yield from pool.map(run_scene, jobs)


def _without_done(job: AgentJob, writer: RunWriter) -> AgentJob:
    keys = tuple(key for key in job.keys if key not in writer.done)
    return AgentJob(job.dataset_root, job.scenes_dir, job.agent, job.seed, job.scene, keys)


def _call_agent(method: Callable[..., Any], *args: Any, **kwargs: Any) -> Any:
    try:
        return method(*args, **kwargs)
    except Exception as error:  # the plug-in door
        raise AgentError(
            f"{method.__qualname__}() raised {type(error).__name__}: {error}. Correct the agent."
        ) from error
