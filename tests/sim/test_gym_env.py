"""The Gymnasium view of PAN passes Gymnasium's checker, uses Habitat's names, and hides ground truth until the end."""

import gc
import itertools
import json
import math
import warnings
import weakref
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import FilterObservation, RecordEpisodeStatistics

from sim.episodes.dataset import PersonalDataset
from sim.errors import DatasetError, SceneError, TaskStateError
from sim.homes.open_home import open_scene
from sim.mesh import Scene, TriangleMesh
from sim.render.raycast import Raycaster
from sim.tasks.agents import ShortestPathAgent
from sim.tasks.gym_env import PanGymEnv, lab_depth
from sim.tasks.pan import PanEnv
from sim.tasks.runner import play_episode
from sim.types import PAPER4, PAPER6, Camera, EpisodeKey

pytestmark = pytest.mark.slow

SMALL = Camera(64, 48)
STOP, FORWARD, LEFT, LOOK_UP = 0, 1, 2, 4


@pytest.fixture(scope="module")
def dataset(invented_root: Path) -> PersonalDataset:
    return PersonalDataset(invented_root)


def demo_env(dataset: PersonalDataset, **options) -> PanGymEnv:
    return PanGymEnv(dataset, **{"scenes": ("Demo",), "camera": SMALL, **options})


@pytest.mark.parametrize("options", [{}, {"pictures": False}, {"actions": PAPER4, "reward": "distance_to_goal"}])
def test_gymnasiums_checker_finds_no_problem(dataset: PersonalDataset, options: dict) -> None:
    spec = EnvSpec(
        "PersonalPan-v0",
        entry_point=PanGymEnv,
        kwargs={"dataset": dataset, "scenes": ("Demo",), "camera": SMALL, **options},
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gymnasium.make(spec, render_mode="rgb_array").unwrapped)
    assert "PersonalPan-v0" not in gymnasium.registry


def test_gymnasiums_wrapper_for_episode_statistics_works(dataset: PersonalDataset) -> None:
    plain = FilterObservation(demo_env(dataset, max_steps=3), ["rgb", "depth", "gps", "compass"])
    env = RecordEpisodeStatistics(plain)
    env.reset(seed=0)
    for _ in range(2):
        assert "episode" not in env.step(LEFT)[4]
    _, _, terminated, truncated, info = env.step(LEFT)
    assert (terminated, truncated) == (False, True)
    assert (info["episode"]["l"], info["episode"]["r"]) == (3, 0)
    assert "measures" in info


def test_observations_have_habitats_names_shapes_and_types(dataset: PersonalDataset) -> None:
    env = demo_env(dataset)
    observation, info = env.reset(seed=0)
    found = {name: (value.shape, value.dtype) for name, value in observation.items() if isinstance(value, np.ndarray)}
    assert found == {
        "rgb": ((48, 64, 3), np.uint8),
        "depth": ((48, 64, 1), np.float32),
        "gps": ((2,), np.float32),
        "compass": ((1,), np.float32),
    }
    episode = dataset.episode(env.episode_key)
    assert (observation["description"], observation["query"]) == (episode.record.summary, episode.record.query[0])
    assert info == {"episode_key": str(env.episode_key), "collided": False}
    assert env.action_space == spaces.Discrete(6)
    assert demo_env(dataset, actions=PAPER4).action_space == spaces.Discrete(4)


def test_depth_is_clipped_and_mapped_as_in_habitat_lab() -> None:
    depth_m = np.array([[0.0, 0.3, 0.5], [2.75, 5.0, 9.0]], np.float32)
    normalized = lab_depth(depth_m, (0.5, 5.0), normalize=True)
    assert (normalized.shape, normalized.dtype) == ((2, 3, 1), np.float32)
    assert normalized[..., 0].tolist() == [[0.0, 0.0, 0.0], [0.5, 1.0, 1.0]]
    metres = lab_depth(depth_m, (0.5, 5.0), normalize=False)
    assert metres[..., 0].tolist() == [[0.5, 0.5, 0.5], [2.75, 5.0, 5.0]]
    assert lab_depth(np.array([[9.0]], np.float32), (0.0, 10.0), normalize=True)[0, 0, 0] == pytest.approx(0.9)


def test_actions_are_numbered_as_in_habitat(dataset: PersonalDataset) -> None:
    env = demo_env(dataset, pictures=False)
    env.reset(seed=0)
    observation, *_ = env.step(LEFT)
    assert observation["compass"] == pytest.approx([math.radians(30)])
    assert observation["gps"] == pytest.approx([0, 0])
    for _ in range(12):
        observation, *_, info = env.step(FORWARD)
    assert info["collided"] or np.hypot(*observation["gps"]) == pytest.approx(3.0)
    assert env.step(LOOK_UP)[0]["compass"] == pytest.approx([math.radians(30)])


def test_stop_terminates_and_the_step_limit_truncates(dataset: PersonalDataset) -> None:
    env = demo_env(dataset, pictures=False, max_steps=3)
    env.reset(seed=0)
    ends = [env.step(LEFT)[2:4] for _ in range(3)]
    assert ends == [(False, False), (False, False), (False, True)]
    with pytest.raises(TaskStateError, match="after the end"):
        env.step(LEFT)
    env.reset()
    for action in (LEFT, LEFT):
        env.step(action)
    assert env.step(STOP)[2:4] == (True, False)


def test_measures_are_given_only_at_the_end(dataset: PersonalDataset) -> None:
    env = demo_env(dataset, pictures=False)
    env.reset(seed=0)
    assert set(env.step(LEFT)[4]) == {"episode_key", "collided"}
    *_, info = env.step(STOP)
    assert set(info) == {"episode_key", "collided", "measures"}
    assert set(info["measures"]["rules"]) == {"paper", "habitat", "authors", "paper-strict"}
    assert info["measures"]["num_steps"] == 2


def test_an_agent_gets_no_information_about_the_goal(dataset: PersonalDataset) -> None:
    env = demo_env(dataset, pictures=False)
    for episode in dataset.episodes(splits=("easy",), scenes=("Demo",)):
        observation, info = env.reset(options={"episode": episode.key})
        told = json.dumps([{name: str(value) for name, value in observation.items()}, info])
        secrets = [
            *episode.record.object_names,
            *(text for texts in episode.record.captions_per_object for text in texts),
        ]
        assert not [secret for secret in secrets if secret in told.replace(episode.record.summary, "")]


def drive(env: PanGymEnv, dataset: PersonalDataset, key: EpisodeKey) -> tuple[list[float], dict]:
    """Rewards, and measures of the rule `paper`, on the path of the shortest-path agent, which knows the goal."""
    episode, scene = dataset.episode(key), open_scene(dataset, key.scene)
    way = PanEnv(episode.start, scene.navigation, renderer=None)
    play_episode(ShortestPathAgent(episode, scene.navigation), way, episode.task("pan"), seed=0)
    env.reset(options={"episode": key})
    rewards, info = [], {}
    for step in way.steps:
        _, reward, _, _, info = env.step(PAPER6.index(step.action))
        rewards.append(reward)
    return rewards, info["measures"]["rules"]["paper"]


def test_the_reward_is_one_for_a_successful_end_or_adds_up_to_the_start_distance(dataset: PersonalDataset) -> None:
    key = next(dataset.episodes(splits=("easy",), scenes=("Demo",))).key
    rewards, measures = drive(demo_env(dataset, pictures=False), dataset, key)
    assert measures["success"]
    assert rewards[-1] == 1.0
    assert set(rewards[:-1]) == {0.0}
    env = demo_env(dataset, pictures=False)
    env.reset(options={"episode": str(key)})
    assert env.step(STOP)[1] == 0.0
    rewards, measures = drive(demo_env(dataset, pictures=False, reward="distance_to_goal"), dataset, key)
    assert sum(rewards) == pytest.approx(measures["start_distance"] - measures["dtg"])
    assert measures["start_distance"] > 1
    assert rewards[-1] == 0.0


def keys_of(env: PanGymEnv, count: int) -> list[EpisodeKey]:
    found = []
    for _ in range(count):
        env.reset()
        found.append(env.episode_key)
    return found


def test_one_round_has_every_episode_once_scene_by_scene(dataset: PersonalDataset) -> None:
    env = PanGymEnv(dataset, splits=("easy",), pictures=False)
    everything = [episode.key for episode in dataset.episodes(splits=("easy",))]
    env.reset(seed=3)
    seen = [env.episode_key, *keys_of(env, len(everything) - 1)]
    assert sorted(seen) == sorted(everything)
    assert seen != everything
    changes = [a.scene != b.scene for a, b in itertools.pairwise(seen)]
    assert sum(changes) == 1


def test_the_seed_decides_the_order_and_dataset_order_is_kept_without_shuffling(dataset: PersonalDataset) -> None:
    orders = []
    for seed in (1, 1, 2):
        env = demo_env(dataset, pictures=False)
        env.reset(seed=seed)
        orders.append([env.episode_key, *keys_of(env, 5)])
    assert orders[0] == orders[1] != orders[2]
    env = demo_env(dataset, pictures=False, shuffle=False)
    assert keys_of(env, 3) == [episode.key for episode in dataset.episodes(scenes=("Demo",))][:3]


def test_reset_can_choose_an_episode_by_key_or_text(dataset: PersonalDataset) -> None:
    env = demo_env(dataset, pictures=False)
    wanted = [episode.key for episode in dataset.episodes(scenes=("Demo",))][4]
    for name in (wanted, str(wanted)):
        env.reset(options={"episode": name})
        assert env.episode_key == wanted
    with pytest.raises(TaskStateError, match=r"options\['episode'\] is 'easy/Demo/none'; expected one of"):
        env.reset(options={"episode": "easy/Demo/none"})


def test_mistakes_are_refused_in_one_clear_line(dataset: PersonalDataset, tmp_path: Path) -> None:
    env = demo_env(dataset, pictures=False, actions=PAPER4)
    with pytest.raises(TaskStateError, match="no episode"):
        env.step(FORWARD)
    env.reset()
    with pytest.raises(TaskStateError, match="found action 4; expected one of: 0 stop, 1 forward, 2 left, 3 right"):
        env.step(4)
    with pytest.raises(DatasetError, match="no scene 'Nowhere'"):
        PanGymEnv(dataset, scenes=("Nowhere",))
    with pytest.raises(DatasetError, match="found no episode in splits"):
        PanGymEnv(dataset, splits=())


def test_a_closed_environment_can_be_closed_again_or_reset(dataset: PersonalDataset) -> None:
    env = demo_env(dataset, pictures=False)
    env.reset()
    env.close()
    env.close()
    assert env.reset()[1]["collided"] is False


@pytest.mark.slow
def test_a_scene_is_freed_before_the_next_one_is_opened(dataset: PersonalDataset, monkeypatch) -> None:
    casters: list[weakref.ref[Raycaster]] = []
    alive: list[int] = []

    class Watched(Raycaster):
        def __init__(self, mesh: TriangleMesh, **options: Any) -> None:
            super().__init__(mesh, **options)
            casters.append(weakref.ref(self))

    def opened(*args, **kwargs) -> Scene:
        gc.collect()
        alive.append(sum(caster() is not None for caster in casters))
        return open_scene(*args, **kwargs)

    monkeypatch.setattr("sim.render.raycast.Raycaster", Watched)
    monkeypatch.setattr("sim.homes.open_home.open_scene", opened)
    env = PanGymEnv(dataset, camera=SMALL, shuffle=False, reward="distance_to_goal")
    for scene in ("Demo", "Small", "Demo"):
        env.reset(options={"episode": next(dataset.episodes(scenes=(scene,))).key})
    assert (len(casters), alive) == (3, [0, 0, 0])
    env.close()
    gc.collect()
    assert casters[-1]() is None


def test_without_pictures_nothing_is_rendered_until_render_is_called(dataset: PersonalDataset, monkeypatch) -> None:
    made: list[TriangleMesh] = []

    class Counted(Raycaster):
        def __init__(self, mesh: TriangleMesh, **options: Any) -> None:
            made.append(mesh)
            super().__init__(mesh, **options)

    monkeypatch.setattr("sim.render.raycast.Raycaster", Counted)
    env = demo_env(dataset, pictures=False, render_mode="rgb_array")
    env.reset(seed=0)
    env.step(LEFT)
    assert made == []
    assert env.render().shape == (48, 64, 3)
    env.render()
    assert len(made) == 1


def test_no_episode_runs_after_a_scene_could_not_be_opened(dataset: PersonalDataset, monkeypatch) -> None:
    def fail(*args, **kwargs) -> Scene:
        raise SceneError("gone")

    env = PanGymEnv(dataset, scenes=("Demo", "Small"), pictures=False, shuffle=False)
    env.reset(options={"episode": next(dataset.episodes(scenes=("Demo",))).key})
    monkeypatch.setattr("sim.homes.open_home.open_scene", fail)
    with pytest.raises(SceneError, match="gone"):
        env.reset(options={"episode": next(dataset.episodes(scenes=("Small",))).key})
    with pytest.raises(TaskStateError, match="no episode"):
        env.step(FORWARD)


def test_several_environments_run_in_one_vector_environment(dataset: PersonalDataset) -> None:
    vector = gymnasium.vector.SyncVectorEnv([lambda: demo_env(dataset, max_steps=2) for _ in range(2)])
    observations, _ = vector.reset(seed=5)
    assert observations["rgb"].shape == (2, 48, 64, 3)
    vector.step(np.array([LEFT, LEFT]))
    _, rewards, _, truncated, infos = vector.step(np.array([LEFT, LEFT]))
    assert truncated.tolist() == [True, True]
    assert rewards.tolist() == [0.0, 0.0]
    assert infos["measures"]["num_steps"].tolist() == [2, 2]
    vector.close()
