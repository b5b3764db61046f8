"""Verbs `study init` and `study plan`: the files of a study before anybody takes part."""

import hashlib
import re
from collections import Counter
from pathlib import Path
from typing import Literal

import numpy as np

from human_study.design.plan import PLAN_FILE, PRACTICE_FOLDER, StudyPlan, StudyScene, save_plan
from human_study.design.planning import Practice, make_plan
from human_study.design.sampling import sample_episodes
from human_study.design.study import (
    MAX_STUDY_NAME,
    STUDY_FILE,
    StudyConfig,
    StudyDataset,
    StudyDesign,
    load_study,
    save_study,
)
from human_study.private_files import write_private
from human_study.store.records import DATABASE_FILE
from human_study.texts.participants import TEXT_FILES, freeze_texts, write_texts
from human_study.texts.words import empty_fields, open_places
from personal_viz.study_app.recruit_codes import CODES_FILE
from sim.episodes.dataset import PersonalDataset
from sim.errors import StudyError
from sim.homes.kind import scene_kind
from sim.types import SPLITS, EpisodeKey, Split

CODES_TEMPLATE = """# Codes that the recruiting platform gave for this study; uncomment with
# recruit.kind: prolific. Never share this file.
# [prolific]
# completion = ""
# screen_out = ""
# no_consent = ""
"""
PRACTICE_HOME = "PracticeHome"
_IN_VIEW = 0.004
"""Least share of the first picture that the target of an attention trial fills."""


def init(
    *,
    folder: Path,
    dataset: Path,
    name: str | None,
    task: tuple[Literal["pan", "pog"], ...],
    design: Literal["house-once", "crossed"],
    per_split: int,
    seed: int,
) -> int:
    """Writes study.yaml, consent.md, instructions.md and secrets.toml for the researcher to read and change."""
    episodes = PersonalDataset(dataset)
    found = {episode.key.split for episode in episodes.episodes()}
    splits: dict[Split, int | Literal["all"]] = {split: per_split for split in SPLITS if split in found}
    if (folder / STUDY_FILE).exists():
        raise StudyError(f"{folder / STUDY_FILE}: exists already; expected a new folder. Give another, or edit it.")
    config = StudyConfig(
        study=name or _study_name(folder),
        dataset=StudyDataset(sha256=episodes.digest(), splits=splits, seed=seed),
        task=task,
        design=StudyDesign(kind=design),
    )
    save_study(folder, config)
    write_texts(folder)
    write_private(folder / CODES_FILE, CODES_TEMPLATE)
    print(f"Written to {folder}: {STUDY_FILE}, {', '.join(TEXT_FILES)}, {CODES_FILE}")
    left = [field for field in empty_fields(config) if field != "ethics.duration_min"]  # the plan estimates it
    print(f"Before people take part, fill these in {STUDY_FILE}: {', '.join(left)}")
    print(f"Next: personal-viz study plan {folder} --dataset {dataset}")
    return 0


def _study_name(folder: Path) -> str:
    """The folder's name as a study can have it."""
    return re.sub(r"[^A-Za-z0-9_-]+", "-", folder.resolve().name).strip("-")[:MAX_STUDY_NAME] or "study"


def plan(*, folder: Path | None, dataset: Path | None, scenes_dir: Path | None, pilot: bool) -> int:
    """Draws the episodes, assigns them and writes plan.json; refuses once the study has begun."""
    if folder is None or dataset is None:
        raise StudyError(
            f"study plan: found no {'study' if folder is None else '--dataset'}; expected a study folder and its "
            "dataset. Give both, or --power to simulate only."
        )
    if (folder / DATABASE_FILE).exists():
        raise StudyError(
            f"{folder / DATABASE_FILE}: the study has begun; expected one without records. A plan never changes after "
            "that: give a new study another folder."
        )
    made = plan_study(folder, dataset, scenes_dir, pilot=pilot)
    config = load_study(folder)
    per_person = Counter(sum(trial.phase == "main" for trial in person.trials) for person in made.participants)
    spare = per_person.pop(0, 0)
    num_trials = sum(number * people for number, people in per_person.items())
    keys = {trial.key for person in made.participants for trial in person.trials if trial.phase == "main"}
    homes = f"{len(made.scenes)} home{'s' if len(made.scenes) > 1 else ''}"
    print(f"{config.study}: {len(keys)} episodes in {homes}, design {config.design.kind}")
    sizes = ", ".join(f"{people} people x {number} trials" for number, people in sorted(per_person.items()))
    print(f"  {num_trials} counted trials: {sizes}" + (f"; {spare} spare people" if spare else ""))
    for change in made.changes:
        print(f"  Other than asked: {change}.")
    print(f"  most meetings of one person with one home: {_most_visits(made)}")
    kinds = Counter(scene.kind for scene in made.scenes)
    print("  homes: " + ", ".join(f"{count} {kind}" for kind, count in sorted(kinds.items())))
    if set(kinds) != {"scan"}:
        print("  Not a human baseline for PersONAL: that is claimed on scans only.")
    print(f"Written to {folder / PLAN_FILE}. Next: personal-viz study serve {folder} --dataset {dataset}")
    return 0


def plan_study(folder: Path, dataset: Path, scenes_dir: Path | None, *, pilot: bool) -> StudyPlan:
    """The plan of a study folder, written.

    Raises:
        PersonalVizError: The study file, the dataset or a home cannot be used.
    """
    config, episodes = load_study(folder), PersonalDataset(dataset)
    digest = episodes.digest()
    if config.dataset.sha256 != digest:
        raise StudyError(
            f"{folder / STUDY_FILE}: dataset.sha256 is {config.dataset.sha256[:12]}; expected {digest[:12]}, that of "
            f"{dataset}. Give the dataset that the study is about, or correct the field."
        )
    keys = sample_episodes(config, [episode.key for episode in episodes.episodes()])
    scenes = [
        StudyScene(name=name, kind=kind, clutter=0 if kind == "scan" else config.clutter)
        for name in sorted({key.scene for key in keys})
        for kind in (scene_kind(episodes, name, scenes_dir),)
    ]
    made = make_plan(config, scenes, keys, practice=_practice(folder, config), is_pilot=pilot)
    made = made.model_copy(update={"texts": freeze_texts(folder, config, made)})
    save_plan(folder, made)
    return made


def require_texts(folder: Path, config: StudyConfig, made: StudyPlan) -> None:
    """Refuses texts that were changed after the plan, and open places that an earlier version planned.

    A study that has begun keeps its texts.

    Raises:
        StudyError: Names the file.
    """
    for name, expected in made.texts.items():
        path = folder / name
        found = hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else "nothing"
        if found != expected:
            raise StudyError(
                f"{path}: sha256 is {found[:12]}; expected {expected[:12]}, the text that was planned. Restore it, or "
                "make the plan again before anybody takes part."
            )
        left = open_places(path.read_text(encoding="utf-8"))
        if left and path.stem in config.flow and name in TEXT_FILES and not (folder / DATABASE_FILE).exists():
            raise StudyError(
                f"{path}: {', '.join(left)} to be filled in; expected a text that people can read. Fill in study.yaml "
                "and make the plan again."
            )


def _practice(folder: Path, config: StudyConfig) -> Practice | None:
    """Practice and attention trials in an invented home outside the pool, made from the study's seed."""
    wanted = sum(config.practice.pan if task == "pan" else config.practice.pog for task in config.task)
    if not wanted and config.checks.every is None:
        return None
    from sim.authoring.generation import invent_dataset

    root = folder / PRACTICE_FOLDER
    if not (root / "scenes" / f"{PRACTICE_HOME}.plan.json").is_file():
        invent_dataset(root, name=PRACTICE_HOME, seed=config.dataset.seed + 1)
    in_view = _by_view(PersonalDataset(root), config)
    plain = tuple(key for key, share in in_view if share >= _IN_VIEW)
    if config.checks.every is not None and not plain:
        raise StudyError(
            f"study {config.study}: no episode of the practice home begins with its target in plain view; expected one "
            "for attention trials. Change dataset.seed, or set checks.every to null."
        )
    scene = StudyScene(name=PRACTICE_HOME, kind="invented")
    return Practice((scene,), tuple(key for key, _ in in_view), plain)


def _by_view(dataset: PersonalDataset, config: StudyConfig) -> list[tuple[EpisodeKey, float]]:
    """Episodes of the practice home with the share of the first picture that their target fills, largest first."""
    from sim.frames import T_world_camera
    from sim.homes.labels import renderer_of
    from sim.homes.open_home import open_scene

    scene = open_scene(dataset, PRACTICE_HOME)
    renderer = renderer_of(scene)
    ids = {item.name: item.instance_id for item in scene.objects}
    shares = []
    for episode in dataset.episodes(scenes=(PRACTICE_HOME,)):
        camera = config.robot_camera
        seen = renderer.render(T_world_camera(episode.start, camera), camera).instance_ids
        targets = [ids[goal.object_name] for goal in episode.targets if goal.object_name in ids]
        shares.append((episode.key, float(np.isin(seen, targets).mean())))
    return sorted(shares, key=lambda item: (-item[1], item[0]))


def _most_visits(made: StudyPlan) -> int:
    return max(
        (
            count
            for person in made.participants
            for count in Counter(trial.scene for trial in person.trials if trial.phase == "main").values()
        ),
        default=0,
    )
