"""A planned study with its dataset, opened again for agents that do what people do."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from human_study.design.plan import AGENT_RUNS, StudyPlan, StudyScene, load_plan
from human_study.design.study import STUDY_FILE, Condition, StudyConfig, load_study
from sim.episodes.dataset import PersonalDataset
from sim.errors import StudyError
from sim.types import EpisodeKey, TaskKind

from .study_files import PLACES_FILE, places_of, require_same_homes
from .study_sequences import study_set


@dataclass(frozen=True, slots=True)
class PlannedStudy:
    """A frozen study, its plan, and the dataset on which it was planned."""

    folder: Path
    config: StudyConfig
    plan: StudyPlan
    dataset: PersonalDataset
    scenes_dir: Path | None
    sequences: Path | None = None
    """Folder of the set, in a study of home sequences."""

    def episodes(self, task: TaskKind) -> dict[Condition, tuple[EpisodeKey, ...]]:
        """The episodes, or home sequences, that people do in each condition of a task.

        Raises:
            StudyError: Nobody does the task.
        """
        found = self.plan.episodes(task)
        if not found:
            verb = "ground" if task == "pan" else "run"
            raise StudyError(
                f"{self.folder / STUDY_FILE}: task is {', '.join(self.config.task)!r}; expected {task!r} among them. "
                f"Agents do the tasks of people: use personal-viz {verb} --study."
            )
        return found

    def keys(self, task: TaskKind) -> tuple[EpisodeKey, ...]:
        """The same of all conditions, each once, sorted; raises StudyError as `episodes`."""
        return tuple(sorted({key for keys in self.episodes(task).values() for key in keys}))

    def scenes(self, task: TaskKind) -> tuple[StudyScene, ...]:
        """The homes of a task's episodes, by name."""
        return tuple(self.plan.scene(name) for name in sorted({key.scene for key in self.keys(task)}))


class StudyOptions(Protocol):
    """The options of a verb with `--study`."""

    study: Path | None
    dataset: Path | None
    """Where the dataset is now; None = where it was when the study was planned."""
    evidence: tuple[Path, ...]
    """Its evidence; used with `dataset` only."""
    scenes_dir: Path | None
    """The folder of scans now; None = with `dataset`, there are none, otherwise as planned."""
    sequences: Path | None
    """Where the set of a study of home sequences is now; None = where it was."""


def open_planned(verb: StudyOptions, task: TaskKind) -> PlannedStudy:
    """A planned study with the dataset of its plan, or of the verb's options, checked by its digest and its homes.

    Args:
        verb: The options.
        task: The task whose homes must be as planned.

    Raises:
        StudyError: There is no plan, nobody does the task, or the dataset, the set or a home is another one or cannot
            be found.
    """
    folder, dataset, evidence, scenes_dir = verb.study, verb.dataset, verb.evidence, verb.scenes_dir
    assert folder is not None, "--study"
    config = load_study(folder)
    plan = load_plan(folder, config)
    set_root = verb.sequences
    if set_root is None and config.sequences is not None:
        set_root = places_of(folder).sequences
    told = study_set(folder, config, set_root)
    if dataset is None:
        places = places_of(folder)
        dataset, evidence, scenes_dir = places.dataset, places.evidence, scenes_dir or places.scenes_dir
        if not dataset.is_dir():
            raise StudyError(
                f"{folder / PLACES_FILE}: the dataset of the plan is no longer at {dataset}; expected it there. Give "
                "its --dataset."
            )
    episodes = PersonalDataset(dataset, evidence=evidence)
    if episodes.digest() != config.dataset.sha256:
        raise StudyError(
            f"--dataset {episodes.root}: has digest {episodes.digest()[:12]}; expected {config.dataset.sha256[:12]}, "
            "the study's. Give the --dataset that was planned, with the same --evidence."
        )
    found = PlannedStudy(folder, config, plan, episodes, scenes_dir, None if told is None else told.root)
    require_same_homes(plan, found.scenes(task), episodes, scenes_dir)
    return found


def agent_runs(study: PlannedStudy, out: Path | None) -> Path:
    """The folder of the runs of agents: `out`, or the study's own, where `study report` finds them."""
    return out or study.folder / AGENT_RUNS


def require_plans_choices(verb: object, names: Sequence[str]) -> None:
    """Refuses options beside `--study` that say what the plan says.

    Args:
        verb: The verb with its options.
        names: Fields of the options; one that is None, empty, 0 or `off` was not given.

    Raises:
        StudyError: One was given.
    """
    for name in names:
        value = getattr(verb, name)
        if value not in (None, (), 0, "off"):
            raise StudyError(
                f"--{name.replace('_', '-')}: found {value!r} beside --study; expected none, because the study's "
                "plan names its episodes and homes. Leave it out."
            )
