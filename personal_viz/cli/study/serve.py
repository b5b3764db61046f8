"""Verb `study serve`: serves a planned study, or one home for a try, until Ctrl-C."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from human_study.design.plan import PLAN_FILE, PRACTICE_FOLDER, StudyPlan, StudyScene, load_plan, save_plan
from human_study.design.planning import make_plan
from human_study.design.secrets import StudySecrets, make_secrets, token_hash
from human_study.design.study import STUDY_FILE, StudyConfig, load_study, save_study
from human_study.store.database import require_free_space
from human_study.store.store import StudyStore, open_store
from personal_viz.study_app.gateway.http import listen
from personal_viz.study_app.gateway.options import ServeOptions, require_may_serve
from personal_viz.study_app.study_files import (
    note_places,
    places_of,
    require_same_homes,
    require_texts,
    study_scene,
)
from personal_viz.study_app.study_sequences import study_set
from sim.episodes.dataset import PersonalDataset, sample_keys
from sim.errors import StudyError
from sim.homes.kind import scene_kind
from sim.types import SPLITS, EpisodeKey

from ..options import Clutter, Dataset, Evidence, Labels, Limit, Rerun, ScenesDir, Sequences, Splits, WithPixels
from ..refusals import check_options, require_folder, require_no_scan, require_same_dataset


@dataclass
class StudyServe:
    """Serve a planned study, or try one home's episodes with --scene; prints a personal link per participant."""

    dataset: Dataset
    study: Positional[Path | None] = None
    """Folder that `study plan` has planned."""
    scene: Annotated[str | None, arg(help="Without a study: one POG and one PAN participant on this home.")] = None
    evidence: Evidence = ()
    scenes_dir: ScenesDir = None
    sequences: Sequences = None
    out: Annotated[Path | None, arg(help="With --scene: the folder; runs/study-<scene> by default.")] = None
    split: Splits = ()
    limit: Limit = None
    seed: int = 0
    actions: Literal["paper4", "paper6"] = "paper4"
    clutter: Clutter = 0
    labels: Labels = "off"
    rerun: Rerun = None
    with_pixels: WithPixels = False
    serving: ServeOptions = field(default_factory=ServeOptions)

    def run(self) -> int:
        from personal_viz.study_app.operator.service import require_many_recordings, serve_study

        if (self.study is None) == (self.scene is None):
            found = "both a study and --scene" if self.study else "neither a study nor --scene"
            raise StudyError(
                f"study serve: found {found}; expected one. Give a planned folder, or --scene to try a home."
            )
        options = self.serving
        if self.study is not None:
            folder, config, plan, sequences = self._planned(self.study)
        else:
            (folder, config, plan), sequences = self._of_scene(self.scene or ""), None
            options = dataclasses.replace(options, pilot=True)
        require_may_serve(options, config, [scene.kind for scene in plan.scenes])
        require_many_recordings(self.rerun, plan)
        require_free_space(folder)
        with open_store(folder, config, plan) as store:
            secrets = make_secrets(folder, [person.code for person in plan.participants])
            _register(store, plan, secrets)
            if options.pilot and not plan.is_pilot:
                store.mark_pilot()
            serve_study(
                store,
                folder=folder,
                dataset=self.dataset,
                evidence=self.evidence,
                scenes_dir=self.scenes_dir,
                sequences=sequences,
                platform_key=secrets.key_bytes,
                links=[(person.task.upper(), person.code, secrets.tokens[person.code]) for person in plan.participants],
                options=options,
                rerun=self.rerun,
                with_pixels=self.with_pixels,
            )
        print(f"Stopped. Everything is in {folder}; see it with: personal-viz study export {folder}")
        return 0

    def _planned(self, folder: Path) -> tuple[Path, StudyConfig, StudyPlan, Path | None]:
        """A study that `study plan` has planned, and the checked set of its sequences: the given one, or the plan's."""
        for name in ("out", "split", "limit", "seed", "clutter", "labels"):
            if getattr(self, name) not in (None, (), 0, "off"):
                raise StudyError(
                    f"--{name}: is for --scene; expected it in {STUDY_FILE} of a planned study. Leave it out."
                )
        config = load_study(folder)
        plan = load_plan(folder, config)
        require_texts(folder, config, plan)
        episodes = PersonalDataset(self.dataset, evidence=self.evidence)
        require_same_dataset(episodes, {config.dataset.sha256}, whose="the study's")
        require_same_homes(plan, plan.scenes, episodes, self.scenes_dir)
        given = self.sequences
        if given is None and config.sequences is not None:
            given = places_of(folder).sequences
        study_set(folder, config, given)
        if plan.practice_scenes:
            require_same_homes(plan, plan.practice_scenes, PersonalDataset(folder / PRACTICE_FOLDER), None)
        return folder, config, plan, given

    def _of_scene(self, scene: str) -> tuple[Path, StudyConfig, StudyPlan]:
        """The episodes of one home for a POG and a PAN participant, without pages before; always a pilot."""
        check_options(self)
        episodes = PersonalDataset(self.dataset, evidence=self.evidence)
        episodes.require_scene(scene)
        folder = self.out or Path("runs") / f"study-{scene}"
        listen(self.serving.bind, self.serving.port).close()  # a taken port is reported before anything is written
        require_folder(folder)
        kind = scene_kind(episodes, scene, self.scenes_dir)
        require_no_scan(kind, clutter=self.clutter)
        config = self._config(episodes, scene)
        keys = [episode.key for episode in episodes.episodes(splits=self.split or SPLITS, scenes=(scene,))]
        if not keys:
            raise StudyError(
                f"{self.dataset}: scene {scene!r} has no episode in {self.split}; expected one. Leave --split out."
            )
        home = study_scene(config, episodes, scene, self.scenes_dir)
        plan = self._kept_plan(folder, config, home, keys)
        require_same_homes(plan, plan.scenes, episodes, self.scenes_dir)
        note_places(folder, self.dataset, self.evidence, self.scenes_dir)
        return folder, config, plan

    def _config(self, episodes: PersonalDataset, scene: str) -> StudyConfig:
        """The settings of a study in one home."""
        return StudyConfig.model_validate(
            {
                "study": f"{scene[:20]}-{self.seed}"[:32],
                "dataset": {
                    "sha256": episodes.digest(),
                    "splits": dict.fromkeys(self.split or SPLITS, "all"),
                    "scenes": (scene,),
                    "stratify": "none",
                    "max_per_scene": None,
                    "seed": self.seed,
                },
                "task": ("pog", "pan"),
                "actions": self.actions,
                "design": {"kind": "crossed", "raters_per_episode": 1},
                "pog": {"conditions": ("map_open",)},
                "flow": ("instructions",),
                "practice": {"pan": 0, "pog": 0},
                "checks": {"every": None},
                "breaks": {"every": None, "sitting_max": None},
                "clutter": self.clutter,
                "labels": self.labels == "on",
            }
        )

    def _kept_plan(self, folder: Path, config: StudyConfig, home: StudyScene, keys: Sequence[EpisodeKey]) -> StudyPlan:
        """The folder's plan, which is made only once.

        Raises:
            StudyError: The folder's plan was made with other options.
        """
        save_study(folder, config)
        drawn = sample_keys(sorted(keys), per_split=self.limit, seed=config.dataset.seed)
        plan = make_plan(config, [home], drawn, is_pilot=True)
        if not (folder / PLAN_FILE).is_file():
            save_plan(folder, plan)
            return plan
        found = load_plan(folder, config)
        if found.participants != plan.participants and (self.split or self.limit is not None):
            raise StudyError(
                f"{folder / PLAN_FILE}: was made with another --split or --limit; expected the same. "
                "Leave both out to go on with it, or give another --out."
            )
        return found


def _register(store: StudyStore, plan: StudyPlan, secrets: StudySecrets) -> None:
    """Registers the participants that the store does not know yet.

    The tokens are already on disk, so a kill in between loses nothing.
    """
    for person in plan.participants:
        token = secrets.tokens[person.code]
        if store.code_of_token(token) is None:
            store.add_participant(person, token_hash(token))
