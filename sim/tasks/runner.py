"""The only loop that steps an environment for agents; resumable episode by episode, results independent of `jobs`."""

import dataclasses
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode
from sim.errors import AgentError, RecordingError
from sim.mesh import Scene
from sim.plugins import call_plugin
from sim.types import MAX_STEPS, PAPER6, Action, Camera, ClutterLevel, EpisodeKey, Observation, Pose, Task
from sim.walk.navigation_map import NavigationMap

from .agent_makers import AgentMaker
from .agents import Agent, next_action
from .looks import HomeLook, LooksFirst
from .observers import Explains, Insight, Observer
from .pan import PanEnv
from .rules import score_run
from .run_files import EpisodeEnd, EpisodeRun, EpisodeStart, Step
from .run_writer import RunWriter
from .workers import SceneJob, Workers, results, without

BATCH = 8
"""Episodes that a worker process runs before it hands them over; a kill can lose this many per process."""


@dataclass(frozen=True, slots=True)
class WalkTerms:
    """What an agent may do in each episode, and with which camera; a study's terms are those of its people."""

    actions: tuple[Action, ...] = PAPER6
    max_steps: int = MAX_STEPS
    query_index: int = 0
    """Which of the query's paraphrases the agent reads."""
    camera: Camera = Camera()  # noqa: RUF009 - frozen value

    def task(self, episode: Episode) -> Task:
        """The part of an episode that the agent may see."""
        task = episode.task("pan", query_index=self.query_index, actions=self.actions)
        return dataclasses.replace(task, max_steps=self.max_steps)


@dataclass(frozen=True, slots=True)
class AgentJob(SceneJob):
    """Everything that a worker process needs to run an agent on some episodes of one scene."""

    scenes_dir: Path | None
    agent: AgentMaker
    seed: int
    clutter: ClutterLevel = 0
    """Amount of furniture without a caption in homes without a scan."""
    labels: bool = False
    """Whether pictures name the category of each object in view."""
    make_observer: Callable[[Scene], Observer] | None = None
    """Makes the observer of the scene's episodes; like the whole job, it must be picklable and comparable."""
    terms: WalkTerms = WalkTerms()
    look_at: Callable[[Scene, Pose], HomeLook] | None = None
    """Makes the look at the home before an episode with this start, for an agent that `LooksFirst`; None = none."""


@dataclass(frozen=True, slots=True)
class Played:
    """A finished episode, and the error of an observer that could not show it."""

    run: EpisodeRun
    problem: RecordingError | None = None


@runtime_checkable
class Closes(Protocol):
    """An observer that can end its view of an episode that was broken off; this is optional."""

    def close(self) -> None:
        """Ends the view in its current state."""
        ...


class Watch:
    """Reports one episode to an observer; after its first failure, which is kept, the episode continues unwatched."""

    def __init__(self, observer: Observer | None, episode: Episode) -> None:
        """Takes the observer; None = nobody watches."""
        self._observer = observer
        self._episode = episode
        self.problem: RecordingError | None = None
        """The observer's error."""

    def reset(self, observation: Observation) -> None:
        """The episode begins."""
        self._tell(lambda observer: observer.on_reset(self._episode, observation))

    def step(self, step: Step, observation: Observation, agent: Agent) -> None:
        """The agent took a step.

        Raises:
            AgentError: The agent's insight cannot be read or shown.
        """
        if self._observer is not None:
            insight = _insight_of(agent)
            self._tell(lambda observer: observer.on_step(step, observation, insight))

    def end(self, run: EpisodeRun) -> None:
        """The episode is over and scored."""
        self._tell(lambda observer: observer.on_end(run))

    def break_off(self) -> None:
        """The agent failed; an observer that can be closed shows everything up to here."""
        self._tell(lambda observer: observer.close() if isinstance(observer, Closes) else None)

    def _tell(self, call: Callable[[Observer], None]) -> None:
        if self._observer is None:
            return
        try:
            call(self._observer)
        except RecordingError as error:
            self._observer, self.problem = None, error


def play(
    agent: Agent,
    episode: Episode,
    home: Scene,
    *,
    seed: int = 0,
    camera: Camera = Camera(),  # noqa: B008 - frozen value
    pictures: bool = True,
) -> EpisodeRun:
    """One episode played by an agent in the episode's home (`open_home`), scored under every rule.

    The agent gets the description and the query, never the goal; its observations hold `rgb` and `depth_m` unless
    `pictures` is False. `seed` is that of its random numbers.

    Raises:
        SceneError: The episode takes place in another home.
        AgentError: The agent raised, or returned something that is not one of the task's actions.
    """
    env = PanEnv.in_home(home, episode, camera=camera, pictures=pictures)
    play_episode(agent, env, episode.task("pan", actions=PAPER6), seed=seed)
    return run_from_env(episode, env, scene_digest=home.digest, navigation=home.navigation)


def play_episode(
    agent: Agent, env: PanEnv, task: Task, *, seed: int, watch: Watch | None = None, look: HomeLook | None = None
) -> None:
    """Resets `env` and steps it with the agent's actions until the episode is over.

    Args:
        agent: The agent.
        env: Its environment.
        task: What it may know; the steps of both are limited alike.
        seed: Seed of the agent's random numbers.
        watch: Gets each step, and never changes observations or actions.
        look: A look at the home, which the agent takes before it knows the task.

    Raises:
        AgentError: The agent raised, returned something that is not one of the task's actions, or cannot look first.
    """
    assert env.max_steps == task.max_steps, (env.max_steps, task.max_steps)
    observation = env.reset()
    if watch is not None:
        watch.reset(observation)
    if look is None:
        call_plugin("agent", agent.reset, task, env.camera, seed=seed)
    else:
        _look(agent, look)
        call_plugin("agent", agent.reset, task, env.camera, seed=seed, keep_memory=True)
    while not env.is_over:
        try:
            action = next_action(agent, task, observation)
        except AgentError as error:
            raise AgentError(f"step {observation.step + 1}: {error}") from error
        observation = env.step(action)
        if watch is not None:
            watch.step(env.steps[-1], observation, agent)


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


def open_job(job: AgentJob) -> Callable[[EpisodeKey], Played]:
    """Opens the job's scene; the result runs the agent over one of the scene's episodes and scores it.

    Pictures are rendered for agents that look at them, and for observers; neither changes where an agent goes.

    Raises:
        SceneError: The scene cannot be opened.
        AgentError: The agent cannot be built; the function raises it too, when the agent fails.
    """
    from sim.homes.open_home import open_scene

    dataset = PersonalDataset(job.dataset_root, evidence=job.evidence)
    scene = open_scene(dataset, job.scene, scenes_dir=job.scenes_dir, clutter=job.clutter, labels=job.labels)
    episodes = {episode.key: episode for episode in dataset.episodes(scenes=(job.scene,))}
    agent_of = job.agent.open(dataset, scene)
    observer = job.make_observer(scene) if job.make_observer else None
    renderer = None
    if job.agent.looks or observer is not None:
        from sim.homes.renderers import renderer_of

        renderer = renderer_of(scene)

    def run_episode(key: EpisodeKey) -> Played:
        episode = episodes[key]
        watch = Watch(observer, episode)
        terms, look = job.terms, job.look_at(scene, episode.start) if job.look_at is not None else None
        task = terms.task(episode)
        env = PanEnv(episode.start, scene.navigation, renderer=renderer, camera=terms.camera, max_steps=terms.max_steps)
        try:
            play_episode(agent_of(episode), env, task, seed=episode_seed(job.seed, key), watch=watch, look=look)
        except AgentError as error:
            watch.break_off()
            raise AgentError(f"{key}: {error}") from error
        run = run_from_env(episode, env, scene_digest=scene.digest, navigation=scene.navigation)
        watch.end(run)
        return Played(run, watch.problem)

    return run_episode


def run_agent(
    jobs: Sequence[AgentJob], writer: RunWriter, *, processes: Workers, on_episode: Callable[[], None] = lambda: None
) -> None:
    """Runs every job, one per scene, and appends finished runs to `writer` in order; episodes that it already holds are
    skipped.

    Runs and their order do not depend on `processes`, the workers. `on_episode` is called when an
    episode is on disk.

    Raises:
        PersonalVizError: An episode could not be run; all episodes before it are on disk. Or its observer failed; then
            the episode is on disk as well.
    """
    for played in results(open_job, without(jobs, writer.done), processes=processes, batch=BATCH):
        writer.add_episode(played.run)
        on_episode()
        if played.problem is not None:
            raise played.problem


def episode_seed(seed: int, key: EpisodeKey) -> int:
    """A seed for one episode that does not depend on which others are run."""
    return zlib.crc32(f"{seed}/{key}".encode())


def _look(agent: Agent, look: HomeLook) -> None:
    if not isinstance(agent, LooksFirst) or look.kind not in agent.looks:
        raise AgentError(
            f"{type(agent).__name__}: cannot take a look of kind {look.kind!r} at the home; expected a method look() "
            "and that kind in its `looks`. Run it without."
        )
    call_plugin("agent", agent.look, look)


def _insight_of(agent: Agent) -> Insight | None:
    """The reasoning that the agent shows, if it shows any.

    Raises:
        AgentError: `insight` raised, or returned something else.
    """
    if not isinstance(agent, Explains):
        return None
    insight = call_plugin("agent", agent.insight)
    if insight is not None and not isinstance(insight, Insight):
        raise AgentError(
            f"{type(agent).__name__}.insight() returned {type(insight).__name__}; expected an Insight or None "
            "(sim.tasks.observers). Correct the agent."
        )
    return insight
