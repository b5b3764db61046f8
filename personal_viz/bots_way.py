"""Where `shortest` bots get their actions: from the study's records, its dataset and the shortest-path agent."""

import threading
from collections.abc import Sequence

from human_study.plan import PRACTICE_FOLDER, load_plan
from human_study.records import read_study
from human_study.study import load_study
from sim.episodes.dataset import PersonalDataset
from sim.scenes.scene import Scene
from sim.scenes.sources import open_scene
from sim.tasks.agents import ShortestPathAgent
from sim.tasks.pan import PanEnv
from sim.types import Action, EpisodeKey

from .bots_site import Site


class WayFinder:
    """The way to the target of each participant's present trial: ground truth, for bots on our own machine only."""

    def __init__(self, site: Site) -> None:
        """Opens no home yet.

        Raises:
            StudyError: The folder has no plan.
        """
        self._site = site
        self._config = load_study(site.folder)
        self._plan = load_plan(site.folder, self._config)
        self._practice = {scene.name for scene in self._plan.practice_scenes}
        self._scenes: dict[str, Scene] = {}
        self._ways: dict[EpisodeKey, tuple[Action, ...]] = {}
        self._lock = threading.Lock()

    def way(self, code: str) -> Sequence[Action]:
        """All actions of the participant's present trial; () when there is none."""
        with read_study(self._site.folder) as reader:
            key = next((status.key for status in reader.trials(code) if status.is_due), None)
        if key is None:
            return ()
        with self._lock:
            if key not in self._ways:
                self._ways[key] = self._walk(key)
            return self._ways[key]

    def _walk(self, key: EpisodeKey) -> tuple[Action, ...]:
        is_practice = key.scene in self._practice
        dataset = PersonalDataset(self._site.folder / PRACTICE_FOLDER if is_practice else self._site.dataset)
        if key.scene not in self._scenes:
            planned = self._plan.scene(key.scene)
            folder = None if is_practice else self._site.scenes_dir
            self._scenes[key.scene] = open_scene(dataset, key.scene, scenes_dir=folder, clutter=planned.clutter)
        scene, episode = self._scenes[key.scene], dataset.episode(key)
        env = PanEnv(episode.start, scene.navigation, renderer=None, max_steps=self._config.steps)
        agent = ShortestPathAgent(episode, scene.navigation)
        agent.reset(self._config.task_for(episode, "pan"), env.camera, seed=0)
        observation, actions = env.reset(), []
        while not env.is_over:
            actions.append(agent.act(observation))
            observation = env.step(actions[-1])
        return tuple(actions)
