"""The homes of a study as bots on our own machine know them: from its plan and dataset, with the ground truth."""

import threading

from human_study.design.plan import PRACTICE_FOLDER, load_plan
from human_study.design.study import load_study
from human_study.store.records import read_study
from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode
from sim.homes.open_home import open_scene
from sim.mesh import Scene
from sim.types import EpisodeKey

from .site import Site


class BotHomes:
    """Opens each home once; many threads may ask."""

    def __init__(self, site: Site) -> None:
        """Opens no home yet.

        Raises:
            StudyError: The folder has no plan.
        """
        self._site = site
        self.config = load_study(site.folder)
        self._plan = load_plan(site.folder, self.config)
        self._practice = {scene.name for scene in self._plan.practice_scenes}
        self._scenes: dict[str, Scene] = {}
        self._lock = threading.Lock()

    def due(self, code: str) -> EpisodeKey | None:
        """Episode of the participant's present trial; None when there is none."""
        with read_study(self._site.folder) as reader:
            return next((status.key for status in reader.trials(code) if status.is_due), None)

    def episode(self, key: EpisodeKey) -> Episode:
        """An episode with its targets."""
        return self._dataset(key.scene).episode(key)

    def scene(self, name: str) -> Scene:
        """A home as its trials have it."""
        with self._lock:
            if name not in self._scenes:
                folder = None if name in self._practice else self._site.scenes_dir
                clutter = self._plan.scene(name).clutter
                self._scenes[name] = open_scene(self._dataset(name), name, scenes_dir=folder, clutter=clutter)
            return self._scenes[name]

    def _dataset(self, scene: str) -> PersonalDataset:
        return PersonalDataset(self._site.folder / PRACTICE_FOLDER if scene in self._practice else self._site.dataset)
