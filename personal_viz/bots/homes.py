"""The homes of a study with their ground truth, for bots that know the way or the target."""

import itertools
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from human_study.design.plan import PRACTICE_FOLDER, load_plan
from human_study.design.study import load_study
from human_study.export.verify import TrialHome
from human_study.store.records import read_study
from sim.episodes.dataset import PersonalDataset
from sim.episodes.sequence_files import HomeSequence, SequenceSet
from sim.sequences.playing import SequenceJob, open_job
from sim.tasks.agent_makers import MakesShortestPath
from sim.tasks.agents import ShortestPathAgent
from sim.tasks.pan import PanEnv
from sim.tasks.run_files import Vector3
from sim.tasks.runner import WalkTerms
from sim.types import SEQUENCE7, Action, EpisodeKey

from ..study_app.home.trial_homes import open_trial_home
from ..study_app.study_files import places_of
from ..study_app.study_sequences import PRACTICE_SET
from .site import Site

_BESIDE = 0.3
"""Distance of places beside a place, metres."""


@dataclass(frozen=True, slots=True)
class Aim:
    """A place to point at."""

    storey: int
    """Index of its storey, from 0, as the page counts them."""
    point: Vector3
    """World metres, on the storey's floor."""


def beside(aim: Aim) -> list[Aim]:
    """Four places around a place, for when a click at the place itself meets nothing."""
    x, y, z = aim.point
    sides = ((_BESIDE, 0.0), (0.0, _BESIDE), (-_BESIDE, 0.0), (0.0, -_BESIDE))
    return [Aim(aim.storey, (x + dx, y, z + dz)) for dx, dz in sides]


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
        self._homes: dict[str, TrialHome] = {}
        self._ways: dict[EpisodeKey, tuple[tuple[Action, ...], ...]] = {}
        self._lock = threading.RLock()

    def due(self, code: str) -> EpisodeKey | None:
        """Episode of the participant's present trial; None if there is none."""
        with read_study(self._site.folder) as reader:
            return next((status.key for status in reader.trials(code) if status.is_due), None)

    def home(self, name: str) -> TrialHome:
        """A home as trials show it, with its episodes and their targets."""
        with self._lock:
            if name not in self._homes:
                is_practice, site = name in self._practice, self._site
                counted = PersonalDataset(site.dataset, evidence=site.evidence)
                dataset = PersonalDataset(site.folder / PRACTICE_FOLDER) if is_practice else counted
                scans = None if is_practice else site.scenes_dir
                told = None if self.config.sequences is None else SequenceSet(self._set_of(name))
                self._homes[name] = open_trial_home(dataset, self._plan.scene(name), scans, sequences=told)
            return self._homes[name]

    def way(self, code: str) -> Sequence[Sequence[Action]]:
        """The shortest way to the target of each search of the participant's present trial, STOP or FOUND last.

        An episode is one search; () without a trial.
        """
        key = self.due(code)
        if key is None:
            return ()
        with self._lock:
            if key not in self._ways:
                self._ways[key] = self._walk(key)
            return self._ways[key]

    def goals(self, code: str, search: int = 0) -> list[Aim]:
        """The targets of a search of the present trial: one, or all that are wanted; [] without a trial."""
        key = self.due(code)
        if key is None:
            return []
        home = self.home(key.scene)
        trial = home.trial(key)
        if isinstance(trial, HomeSequence):
            targets = trial.targets[search] if search < len(trial.targets) else ()
            targets = targets if trial.record.subtasks[search].mode == "all" else targets[:1]
        else:
            targets = trial.targets[:1]
        heights = home.navigation.storey_heights
        storeys = [int(np.argmin([abs(height - target.floor_y) for height in heights])) for target in targets]
        return [
            Aim(storey, (target.position[0], heights[storey], target.position[2]))
            for storey, target in zip(storeys, targets, strict=True)
        ]

    def anywhere(self, code: str, rng: np.random.Generator) -> Aim | None:
        """A random place to stand in the home of the participant's present trial; None without a trial."""
        key = self.due(code)
        if key is None:
            return None
        navigation = self.home(key.scene).navigation
        storey = int(rng.integers(len(navigation.storey_heights)))
        floor_y = navigation.storey_heights[storey]
        free = navigation.top_down(floor_y)
        cells = np.argwhere(free.free)
        x, z = free.grid.xz_from_rc(cells[int(rng.integers(len(cells)))]).tolist()
        return Aim(storey, (x, floor_y, z))

    def _walk(self, key: EpisodeKey) -> tuple[tuple[Action, ...], ...]:
        home = self.home(key.scene)
        trial, navigation = home.trial(key), home.navigation
        if isinstance(trial, HomeSequence):
            return self._walk_sequence(key, trial)
        episode = trial
        env = PanEnv(episode.start, navigation, renderer=None, max_steps=self.config.steps)
        agent = ShortestPathAgent(episode, navigation)
        agent.reset(self.config.task_for(episode, "pan"), env.camera, seed=0)
        observation, actions = env.reset(), []
        while not env.is_over:
            actions.append(agent.act(observation))
            observation = env.step(actions[-1])
        return (tuple(actions),)

    def _walk_sequence(self, key: EpisodeKey, sequence: HomeSequence) -> tuple[tuple[Action, ...], ...]:
        """The oracle's actions in each search."""
        is_practice, site = key.scene in self._practice, self._site
        job = SequenceJob(
            site.folder / PRACTICE_FOLDER if is_practice else site.dataset,
            key.scene,
            (key,),
            evidence=() if is_practice else site.evidence,
            sequences=self._set_of(key.scene),
            scenes_dir=None if is_practice else site.scenes_dir,
            agent=MakesShortestPath(),
            seed=0,
            clutter=self._plan.scene(key.scene).clutter,
            terms=WalkTerms(actions=SEQUENCE7, max_steps=self.config.steps),
        )
        run = open_job(job)(key)
        steps, ways = iter(run.steps), []
        for search in run.end.searches:
            num_steps = 0 if search.measures is None else search.measures.num_steps
            ways.append(tuple(step.action for step in itertools.islice(steps, num_steps)))
        return tuple(ways)

    def _set_of(self, name: str) -> Path:
        """Folder of the set with the sequences of a home."""
        if name in self._practice:
            return self._site.folder / PRACTICE_SET
        found = places_of(self._site.folder).sequences
        assert found is not None, "a study of home sequences notes the place of its set"
        return found
