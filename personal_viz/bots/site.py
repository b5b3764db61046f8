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
    StudyAggregate,
    StudyBreaks,
    StudyChecks,
    StudyConfig,
    StudyDataset,
    StudyDesign,
    StudyPractice,
    StudySequences,
    load_study,
    save_study,
)
from human_study.texts.participants import TEXT_FILES, TOLD_FOLDER
from sim.episodes.dataset import PersonalDataset
from sim.episodes.sequence_files import SequenceSet
from sim.types import SPLITS, Split, TaskKind

from ..study_app.operator.served import Person
from ..study_app.study_files import PLACES_FILE, note_places, places_of, plan_study

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
    evidence: tuple[Path, ...] = ()
    """Folders of the dataset's evidence."""

    def people(self, tasks: Sequence[TaskKind]) -> list[Person]:
        """Everybody who does one of the tasks, in the plan's order."""
        found = [person for person in self.everybody if person.task in tasks]
        return sorted(found, key=lambda person: (len(person.code), person.code))


def make_pilot(
    folder: Path,
    dataset: Path,
    *,
    participants: int,
    evidence: tuple[Path, ...] = (),
    scenes_dir: Path | None = None,
    sequence_set: Path | None = None,
    splits: dict[Split, int | Literal["all"]] | None = None,
    seed: int = 0,
    **choices: Any,
) -> StudyConfig:
    """Plans a pilot without checks, practice and breaks, in which everybody does every episode.

    Args:
        folder: A new folder.
        dataset: Dataset of its episodes.
        participants: Number for each task, and in POG for each condition.
        evidence: Folders of the dataset's evidence.
        scenes_dir: Folder of licensed scans.
        sequence_set: Set of home sequences that are done instead of episodes.
        splits: Number of episodes of each split; None = all.
        seed: Seed of the plan.
        choices: Fields of StudyConfig; by default the task is PAN.
    """
    usual = {
        "study": "bots",
        "task": ("pan",),
        "dataset": StudyDataset(
            sha256=PersonalDataset(dataset, evidence=evidence).digest(),
            splits=splits or dict.fromkeys(SPLITS, "all"),
            stratify="none",
            max_per_scene=None,
            seed=seed,
        ),
        "design": StudyDesign(kind="crossed", raters_per_episode=participants),
        "checks": StudyChecks(every=None),
        "practice": StudyPractice(pan=0, pog=0),
        "breaks": StudyBreaks(every=None, sitting_max=None),
        "storey_names": "texts",  # as `study init` writes
        "aggregate": StudyAggregate(intervals="homes"),
        "sequences": None
        if sequence_set is None
        else StudySequences(sha256=SequenceSet(sequence_set).digest(), history="visible"),
    }
    config = StudyConfig(**(usual | choices))
    save_study(folder, config)
    plan_study(folder, dataset, scenes_dir, evidence=evidence, sequences=sequence_set, pilot=True)
    return config


def make_bot_study(folder: Path, *, participants: int, seed: int, dataset: Path | None = None, **choices: Any) -> Path:
    """Plans a pilot for bots in `folder`/study; returns its dataset's folder.

    Args:
        folder: A new folder.
        participants: As in `make_pilot`.
        seed: Seed of the home and of the plan.
        dataset: None = a home is invented in `folder`.
        choices: As in `make_pilot`.
    """
    from sim.authoring.generation import invent_dataset

    if dataset is None:
        dataset = folder / "dataset"
        invent_dataset(dataset, name=HOME, seed=seed)
    make_pilot(folder / "study", dataset, participants=participants, seed=seed, **choices)
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
    if (study / PLACES_FILE).is_file():
        places = places_of(study)
        note_places(folder, places.dataset, places.evidence, places.scenes_dir, sequences=places.sequences)


def running(folder: Path, dataset: Path, scenes_dir: Path | None, url: str, *, evidence: tuple[Path, ...] = ()) -> Site:
    """A study that is already being served, on this machine or through a proxy.

    Args:
        folder: Folder of the study, which holds its tokens.
        dataset: Dataset of the study.
        scenes_dir: Folder of licensed scans.
        url: The address for browsers, such as `http://127.0.0.1:8080`.
        evidence: Folders of the dataset's evidence.
    """
    plan: StudyPlan = load_plan(folder, load_study(folder))
    tokens, address = load_secrets(folder).tokens, url.rstrip("/")
    people = (person for person in plan.participants if person.code in tokens)
    everybody = tuple(Person(one.code, one.task, f"{address}/#{tokens[one.code]}") for one in people)
    return Site(folder, dataset, scenes_dir, everybody, None, evidence)
