"""PAN as a Gymnasium environment with Habitat's observation names; it drives `PanEnv`, which moves the robot.

Ground truth stays inside: observations hold sensors and the task's text; `info` gives measures only after the end.

    from gymnasium.wrappers import FilterObservation
    from sim.episodes.dataset import PersonalDataset
    from sim.tasks.gym_env import PanGymEnv

    env = PanGymEnv(PersonalDataset("data/split"), scenes_dir=Path("hm3d/val"))
    observation, info = env.reset(seed=1)  # rgb, depth, gps, compass, description, query
    observation, reward, terminated, truncated, info = env.step(1)  # 0 stop, 1 forward, 2 left, 3 right, 4 up, 5 down
    observation, info = env.reset(options={"episode": "easy/TEEsavR23oF/4"})
    images_only = FilterObservation(env, ["rgb", "depth", "gps", "compass"])  # for libraries without text spaces

`gymnasium.make` is not needed and nothing is registered; for vector environments pass `lambda: PanGymEnv(...)`.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Literal

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode
from sim.errors import DatasetError, TaskStateError, did_you_mean
from sim.frames import T_world_camera
from sim.mesh import Scene
from sim.render.renderer import Renderer
from sim.types import (
    MAX_STEPS,
    PAPER6,
    SPLITS,
    Action,
    Camera,
    ClutterLevel,
    EpisodeKey,
    Observation,
    Pose,
    Prompt,
    Split,
)
from sim.walk.navigation_map import NavigationMap

from .pan import PanEnv
from .rules import reaches_target, success_region
from .runner import run_from_env

RewardName = Literal["success", "distance_to_goal"]
DEPTH_RANGE = (0.5, 5.0)
"""Range to which habitat-lab's ObjectNav clips depth, metres (HABITAT_SEMANTICS.md, section 3)."""
_FAR = float(np.finfo(np.float32).max)
"""Habitat's bounds of `gps`."""


class PanGymEnv(gymnasium.Env[dict[str, Any], np.int64]):
    """PAN episodes of a dataset, one after the other; each scene is opened when its turn comes."""

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 4}  # noqa: RUF012 - Gymnasium's own type

    def __init__(
        self,
        dataset: PersonalDataset,
        *,
        scenes_dir: Path | None = None,
        splits: tuple[Split, ...] = SPLITS,
        scenes: tuple[str, ...] | None = None,
        clutter: ClutterLevel = 0,
        labels: bool = False,
        shuffle: bool = True,
        actions: tuple[Action, ...] = PAPER6,
        camera: Camera = Camera(),  # noqa: B008 - frozen value
        pictures: bool = True,
        depth_range: tuple[float, float] = DEPTH_RANGE,
        normalize_depth: bool = True,
        max_steps: int = MAX_STEPS,
        reward: RewardName = "success",
        render_mode: Literal["rgb_array"] | None = None,
    ) -> None:
        """Reads the episodes; opens no scene.

        Args:
            dataset: Source of the episodes.
            scenes_dir: Folder of scans; None = invented or schematic homes (`open_scene`).
            splits: Splits whose episodes are used.
            scenes: Scenes whose episodes are used; None = all.
            clutter: Amount of furniture without a caption that is added to homes without a scan.
            labels: Whether pictures name the category of each object in view.
            shuffle: Scenes and their episodes in random order, drawn again for every round; False = dataset order.
            actions: The action of each number, in order; `PAPER4` leaves out the looks.
            camera: Intrinsics and mounting height.
            pictures: Whether observations hold `rgb` and `depth`; without them a step takes microseconds.
            depth_range: Range to which depth is clipped, metres; a pixel without return becomes the nearest.
            normalize_depth: Whether clipped depth is mapped to 0-1 (habitat-lab's default).
            max_steps: An episode is truncated after this many actions; STOP as the last one terminates it.
            reward: `success`: 1 for an end that succeeds under rule `paper`, else 0. `distance_to_goal`: habitat-lab's
                DistanceToGoalReward, metres by which the step brought the robot nearer to where `paper` accepts STOP;
                0 while no such place can be reached. Both are ground truth: a training signal, never an observation.
            render_mode: "rgb_array" lets `render` return the robot's view.

        Raises:
            DatasetError: No episode is left, a scene is unknown, or a file is damaged.
        """
        self.render_mode = render_mode
        self._dataset, self._scenes_dir = dataset, scenes_dir
        self._clutter: ClutterLevel = clutter
        self._episodes = self._read(splits, scenes)
        self._labels, self._shuffle = labels, shuffle
        self._actions, self._camera, self._pictures = actions, camera, pictures
        self._depth_range, self._normalize_depth, self._reward = depth_range, normalize_depth, reward
        self._max_steps = max_steps
        self._order: Iterator[EpisodeKey] = iter(())
        self._scene: Scene | None = None
        self._renderer: Renderer | None = None
        self._episode: Episode | None = None
        self._env: PanEnv | None = None
        self._distance: Callable[[Pose], float] | None = None
        self._last_distance = 0.0
        self.action_space = spaces.Discrete(len(actions))
        self.observation_space = self._spaces()

    @property
    def episode_key(self) -> EpisodeKey:
        """Key of the running episode."""
        return self._running()[0].key

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Starts the next episode.

        Args:
            seed: Restarts the order of episodes; the same seed gives the same order.
            options: {"episode": an EpisodeKey or "split/scene/id"} starts that one; the order continues after it.

        Raises:
            TaskStateError: The named episode does not belong to this environment.
            SceneError: The episode's scene cannot be opened.
        """
        super().reset(seed=seed)
        if seed is not None:
            self._order = iter(())
        wanted = (options or {}).get("episode")
        episode = self._next_episode() if wanted is None else self._named_episode(wanted)
        self._episode = self._env = self._distance = None  # these hold the last scene, and opening the next may fail
        scene = self._opened(episode.key.scene)
        self._episode = episode
        self._env = PanEnv(
            episode.start,
            scene.navigation,
            renderer=self._drawing(scene) if self._pictures else None,
            camera=self._camera,
            max_steps=self._max_steps,
            prompts=self._prompts(),
        )
        if self._reward == "distance_to_goal":
            self._distance = distance_to_success(episode, scene.navigation)
            self._last_distance = self._distance(self._env.pose)
        return self._observation(self._env.reset()), self._info()

    def step(self, action: np.int64 | int) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Takes one action; `terminated` after STOP, `truncated` when the step limit ended the episode.

        Raises:
            TaskStateError: No episode runs, it is over, or the number is not an action.
        """
        _, env = self._running()
        if not self.action_space.contains(action):
            names = ", ".join(f"{index} {item.value}" for index, item in enumerate(self._actions))
            raise TaskStateError(f"step: found action {action!r}; expected one of: {names}. Use action_space.")
        observation = env.step(self._actions[int(action)])
        info = self._info()
        return (self._observation(observation), self._reward_of(info), *self._ends(), info)

    def render(self) -> NDArray[np.uint8] | None:  # type: ignore[override] - Gymnasium's type is a union of all modes
        """The robot's view now, (H, W, 3); None without a render mode."""
        if self.render_mode is None:
            return None
        episode, env = self._running()
        renderer = self._drawing(self._opened(episode.key.scene))
        return renderer.render(T_world_camera(env.pose, self._camera), self._camera).rgb

    def close(self) -> None:
        """Releases the open scene; safe to call twice."""
        self._scene = self._renderer = self._episode = self._env = self._distance = None

    def _running(self) -> tuple[Episode, PanEnv]:
        if self._episode is None or self._env is None:
            raise TaskStateError("step: found no episode; expected reset() first. Call reset().")
        return self._episode, self._env

    def _read(self, splits: tuple[Split, ...], scenes: tuple[str, ...] | None) -> dict[EpisodeKey, Episode]:
        """The episodes that are played."""
        found = {episode.key: episode for episode in self._dataset.episodes(splits=splits, scenes=scenes)}
        if not found:
            raise DatasetError(
                f"{self._dataset.root}: found no episode in splits {list(splits)} of scenes "
                f"{list(scenes or self._dataset.scenes)}; expected at least one. Name other splits or scenes."
            )
        return found

    def _prompts(self) -> tuple[Prompt, ...]:
        """What the running episode's `PanEnv` tells."""
        return ()

    def _ends(self) -> tuple[bool, bool]:
        """Whether the running episode is terminated, and whether it is truncated."""
        reason = self._running()[1].end_reason
        return reason == "stop", reason == "steps"

    def _next_episode(self) -> Episode:
        key = next(self._order, None)
        if key is None:
            self._order = iter(self._round())
            key = next(self._order)
        return self._episodes[key]

    def _named_episode(self, wanted: EpisodeKey | str) -> Episode:
        for key, episode in self._episodes.items():
            if str(key) == str(wanted):
                return episode
        first = next(iter(self._episodes))
        raise TaskStateError(
            f"reset: options['episode'] is {wanted!r}; expected one of this environment's {len(self._episodes)} "
            f"episodes, such as {str(first)!r}.{did_you_mean(wanted, self._episodes)} Name it as split/scene/id, and "
            "check splits and scenes."
        )

    def _round(self) -> list[EpisodeKey]:
        """Every episode once: scene by scene, because opening a scene costs more than an episode."""
        keys = list(self._episodes)
        if not self._shuffle:
            return keys
        mixed = [keys[index] for index in self.np_random.permutation(len(keys))]
        places = {scene: place for place, scene in reversed(list(enumerate(key.scene for key in mixed)))}
        return sorted(mixed, key=lambda key: places[key.scene])

    def _opened(self, name: str) -> Scene:
        """The scene; it is opened unless it is open already."""
        if self._scene is None or self._scene.name != name:
            from sim.homes.open_home import open_scene

            self._scene = self._renderer = None  # two scans may not fit into memory together
            self._scene = open_scene(
                self._dataset, name, scenes_dir=self._scenes_dir, clutter=self._clutter, labels=self._labels
            )
        return self._scene

    def _drawing(self, scene: Scene) -> Renderer:
        """The renderer of the open scene, made when it is first needed."""
        if self._renderer is None:
            from sim.homes.renderers import renderer_of

            self._renderer = renderer_of(scene)
        return self._renderer

    def _spaces(self) -> spaces.Dict:
        tasks = [episode.task("pan") for episode in self._episodes.values()]
        found: dict[str, spaces.Space[Any]] = {}
        if self._pictures:
            low, high = (0.0, 1.0) if self._normalize_depth else self._depth_range
            size = (self._camera.height, self._camera.width)
            found["rgb"] = spaces.Box(0, 255, (*size, 3), np.uint8)
            found["depth"] = spaces.Box(low, high, (*size, 1), np.float32)
        found["gps"] = spaces.Box(-_FAR, _FAR, (2,), np.float32)
        found["compass"] = spaces.Box(-np.pi, np.pi, (1,), np.float32)
        found["description"] = text_space([task.description for task in tasks])
        found["query"] = text_space([task.queries[0] for task in tasks])
        return spaces.Dict(found)

    def _observation(self, sensed: Observation) -> dict[str, Any]:
        task = self._running()[0].task("pan")
        found: dict[str, Any] = {
            "gps": np.array(sensed.gps, np.float32),
            "compass": np.array([sensed.compass], np.float32),
            "description": task.description,
            "query": task.queries[0],
        }
        if sensed.rgb is not None and sensed.depth_m is not None:
            found["rgb"] = sensed.rgb
            found["depth"] = lab_depth(sensed.depth_m, self._depth_range, normalize=self._normalize_depth)
        return found

    def _info(self) -> dict[str, Any]:
        """The episode's name and the last collision; all measures once the episode is over.

        Gymnasium's wrappers keep the key `episode` for their own statistics.
        """
        episode, env = self._running()
        collided = bool(env.steps) and env.steps[-1].collided
        info: dict[str, Any] = {"episode_key": str(episode.key), "collided": collided}
        return {**info, **self._scored()} if env.is_over else info

    def _scored(self) -> dict[str, Any]:
        """What `info` gives once the episode is over."""
        episode, env = self._running()
        scene = self._opened(episode.key.scene)
        run = run_from_env(episode, env, scene_digest=scene.digest, navigation=scene.navigation)
        assert run.end.measures is not None, "a run that is over has measures"
        return {"measures": run.end.measures.model_dump()}

    def _reward_of(self, info: dict[str, Any]) -> float:
        if self._distance is None:
            return float("measures" in info and info["measures"]["rules"]["paper"]["success"])
        before, self._last_distance = self._last_distance, self._distance(self._running()[1].pose)
        gained = before - self._last_distance
        return gained if math.isfinite(gained) else 0.0


def lab_depth(
    depth_m: NDArray[np.float32], depth_range: tuple[float, float], *, normalize: bool
) -> NDArray[np.float32]:
    """Depth (H, W) as habitat-lab's sensor gives it: clipped to the range (metres), no return (0) as the nearest, and
    mapped to 0-1 if `normalize`.

    Returns:
        (H, W, 1).
    """
    low, high = depth_range
    clipped = np.clip(depth_m, low, high, dtype=np.float32)[..., None]
    return (clipped - np.float32(low)) / np.float32(high - low) if normalize else clipped


def distance_to_success(episode: Episode, navigation: NavigationMap) -> Callable[[Pose], float]:
    """A function of the robot's pose: geodesic metres to where rule `paper` accepts STOP; 0 there, inf out of reach."""
    region = success_region(episode, navigation)

    def distance(pose: Pose) -> float:
        if any(reaches_target(pose.position, target) for target in episode.targets):
            return 0.0
        return float(navigation.distances(np.array([pose.position]), region)[0]) if len(region) else math.inf

    return distance


def text_space(texts: Sequence[str]) -> spaces.Text:
    """The space with exactly these texts' lengths and characters."""
    lengths = [len(text) for text in texts]
    return spaces.Text(max(lengths), min_length=min(lengths), charset=frozenset("".join(texts)))
