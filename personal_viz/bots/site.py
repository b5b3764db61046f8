"""Studies in which bots take part: made for them, copied without records, or served by somebody else."""

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from human_study.design.plan import PLAN_FILE, PRACTICE_FOLDER, StudyPlan, load_plan
from human_study.design.secrets import load_secrets
from human_study.design.study import (
    STUDY_FILE,
    FlowStep,
    PogCondition,
    StudyBreaks,
    StudyChecks,
    StudyConfig,
    StudyDataset,
    StudyDesign,
    StudyPog,
    StudyPractice,
    load_study,
    save_study,
)
from human_study.texts.participants import TEXT_FILES, TOLD_FOLDER
from sim.episodes.dataset import PersonalDataset
from sim.types import SPLITS, Split, TaskKind

from ..study_app.operator.served import Person

HOME = "BotHome"


@dataclass(frozen=True, slots=True)
class Site:
    """A study that is being served."""

    folder: Path
    dataset: Path
    scenes_dir: Path | None
    everybody: tuple[Person, ...]
    pid: int | None
    """Id of the serving process; None if somebody else started it."""

    def people(self, tasks: Sequence[TaskKind]) -> list[Person]:
        """Everybody who does one of the tasks, in the plan's order."""
        found = [person for person in self.everybody if person.task in tasks]
        return sorted(found, key=lambda person: (len(person.code), person.code))


def make_pilot(
    study: Path,
    dataset: Path,
    *,
    name: str,
    scenes_dir: Path | None = None,
    splits: dict[Split, int | Literal["all"]] | None = None,
    scenes: tuple[str, ...] = (),
    seed: int = 0,
    **choices: Any,
) -> StudyConfig:
    """Plans a pilot without checks, in which everybody may do every episode.

    Args:
        study: A new folder.
        dataset: Dataset of its episodes.
        name: Name of the study.
        scenes_dir: Folder of licensed scans.
        splits: Number of episodes of each split; None = all.
        scenes: Only these homes of the dataset; () = all.
        seed: Seed of the plan.
        choices: Further fields of StudyConfig.
    """
    from personal_viz.study_app.study_files import plan_study

    config = StudyConfig(
        study=name,
        dataset=StudyDataset(
            sha256=PersonalDataset(dataset).digest(),
            splits=splits or dict.fromkeys(SPLITS, "all"),
            scenes=scenes,
            stratify="none",
            max_per_scene=None,
            seed=seed,
        ),
        checks=StudyChecks(every=None),
        **choices,
    )
    save_study(study, config)
    plan_study(study, dataset, scenes_dir, pilot=True)
    return config


def make_bot_study(
    folder: Path,
    *,
    participants: int,
    seed: int,
    dataset: Path | None = None,
    scenes: tuple[str, ...] = (),
    flow: tuple[FlowStep, ...] = ("device", "consent", "instructions", "quiz"),
    task: tuple[TaskKind, ...] = ("pan",),
    pog_conditions: tuple[PogCondition, ...] = ("map_first",),
    practice: int = 0,
    breaks_every: int | None = None,
    confidence: bool = False,
) -> Path:
    """Plans a study for bots, in which everybody does every episode; returns its dataset's folder.

    Args:
        folder: A new folder.
        participants: Number for each task, and in POG for each condition.
        seed: Seed of the home and of the plan.
        dataset: None = a home is invented in `folder`.
        scenes: Only these homes of the dataset; () = all.
        flow: The pages before the first trial.
        task: Tasks of the study, one for each participant.
        pog_conditions: Conditions of POG.
        practice: Number of practice trials.
        breaks_every: Number of trials between two breaks; None = no breaks.
        confidence: Whether people are asked how sure they are.
    """
    from sim.authoring.generation import invent_dataset

    if dataset is None:
        dataset = folder / "dataset"
        invent_dataset(dataset, name=HOME, seed=seed)
    make_pilot(
        folder / "study",
        dataset,
        name="bots",
        scenes=scenes,
        seed=seed,
        task=task,
        design=StudyDesign(kind="crossed", raters_per_episode=participants),
        flow=flow,
        pog=StudyPog(conditions=pog_conditions),
        practice=StudyPractice(pan=practice, pog=practice),
        breaks=StudyBreaks(every=breaks_every, sitting_max=None),
        confidence=confidence,
    )
    return dataset


def copy_plan(study: Path, folder: Path) -> None:
    """Copies a planned study without its records, so that bots never stand among people.

    Raises:
        StudyError: The study has no plan.
    """
    load_plan(study, load_study(study))
    folder.mkdir(parents=True)
    for name in (STUDY_FILE, PLAN_FILE, *TEXT_FILES):
        if (study / name).is_file():
            shutil.copy(study / name, folder / name)
    for name in (PRACTICE_FOLDER, TOLD_FOLDER):
        if (study / name).is_dir():
            shutil.copytree(study / name, folder / name)


def running(folder: Path, dataset: Path, scenes_dir: Path | None, url: str) -> Site:
    """A study that is already being served, on this machine or through a proxy.

    Args:
        folder: Folder of the study, which holds its tokens.
        dataset: Dataset of the study.
        scenes_dir: Folder of licensed scans.
        url: The address for browsers, such as `http://127.0.0.1:8080`.
    """
    plan: StudyPlan = load_plan(folder, load_study(folder))
    tokens, address = load_secrets(folder).tokens, url.rstrip("/")
    people = (person for person in plan.participants if person.code in tokens)
    everybody = tuple(Person(one.code, one.task, f"{address}/#{tokens[one.code]}") for one in people)
    return Site(folder, dataset, scenes_dir, everybody, None)
