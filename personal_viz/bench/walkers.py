"""Makes runs to record: walkers without a goal in an invented home, long runs for agents, short ones for people."""

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sim.authoring.generation import invent_dataset
from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode
from sim.homes.open_home import open_scene
from sim.mesh import Scene
from sim.tasks.pan import PanEnv
from sim.tasks.provenance import make_run_info
from sim.tasks.rules import score_run
from sim.tasks.run_files import EpisodeEnd, EpisodeRun, EpisodeStart, Run
from sim.types import Action, WhoKind

SEED = 5
HOME = "BenchHome"
SECONDS_PER_STEP = 0.8
"""Approximate time that a person takes for a step."""
_TURN_SHARE = 0.1
"""Probability that a walker turns although it could go on."""
_MOST_TURNS = 5
"""Largest number of turns in a row: 150 degrees."""


@dataclass(frozen=True, slots=True)
class RecordedHome:
    """An invented home and the episode that all walkers play in it."""

    scene: Scene
    episode: Episode


def recorded_home(*, seed: int = SEED) -> RecordedHome:
    """The invented home of a seed with its first episode; the same seed gives the same home."""
    with tempfile.TemporaryDirectory() as folder:
        invent_dataset(Path(folder), name=HOME, seed=seed)
        dataset = PersonalDataset(folder)
        return RecordedHome(open_scene(dataset, HOME, scenes_dir=None), next(dataset.episodes(splits=("easy",))))


def walked(home: RecordedHome, who: str, *, who_kind: WhoKind, num_steps: int, seed: int) -> Run:
    """A run of exactly `num_steps` actions, STOP last: straight ahead, with turns at walls and now and then.

    Args:
        home: The home to walk in.
        who: Name of the run and of the walker.
        who_kind: Kind of walker; people take SECONDS_PER_STEP for each step and have a code.
        num_steps: Number of actions.
        seed: Seed of the turns.
    """
    rng = np.random.default_rng(seed)
    episode, navigation = home.episode, home.scene.navigation
    env = PanEnv(episode.start, navigation, renderer=None, max_steps=num_steps)
    turns: list[Action] = []
    while len(env.steps) < num_steps - 1:
        collided = bool(env.steps) and env.steps[-1].collided
        if not turns and (collided or rng.random() < _TURN_SHARE):
            side = (Action.LEFT, Action.RIGHT)[int(rng.integers(2))]
            turns = [side] * int(rng.integers(1, _MOST_TURNS + 1))
        env.step(turns.pop() if turns else Action.FORWARD, t_s=_t_s(env, who_kind))
    env.step(Action.STOP, t_s=_t_s(env, who_kind))
    start, measures = (
        episode.start,
        score_run(
            episode,
            env.poses,
            stopped=True,
            navigation=navigation,
            collisions=sum(step.collided for step in env.steps),
            scene_digest=home.scene.digest,
        ),
    )
    run = EpisodeRun(
        start=EpisodeStart(
            split=episode.key.split,
            scene=episode.key.scene,
            episode_id=episode.key.episode_id,
            position=start.position,
            yaw=start.yaw,
            participant="P01" if who_kind == "human" else None,
        ),
        steps=env.steps,
        end=EpisodeEnd(reason="stop", measures=measures),
    )
    info = make_run_info(who, who=who, who_kind=who_kind, scene_kind=home.scene.kind, dataset_digest="bench")
    return Run(info=info, episodes=(run,))


def _t_s(env: PanEnv, who_kind: WhoKind) -> float:
    return SECONDS_PER_STEP * (len(env.steps) + 1) if who_kind == "human" else 0.0
