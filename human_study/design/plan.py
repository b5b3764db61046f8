"""`plan.json`: the trials of each person in order, made offline from a seed. Holds no secret."""

import hashlib
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Literal, NamedTuple

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from sim.errors import StudyError, line_from_validation_error
from sim.files import bounded_json
from sim.homes.plan import HOMES_VERSION
from sim.types import SPLITS, ClutterLevel, EpisodeKey, SceneKind, Split, TaskKind

from ..private_files import write_private
from .study import OTHER_PROGRAM, Condition, StudyConfig

PLAN_FILE = "plan.json"
PRACTICE_FOLDER = "practice"
"""Dataset of the practice homes, in the study's folder."""
AGENT_RUNS = "runs"
"""Runs of agents on the study's episodes, in the study's folder; a report reads them."""
_MODEL = ConfigDict(frozen=True, extra="forbid")
Phase = Literal["practice", "check", "main"]
"""`practice` is never counted, `check` tests attention, `main` is the study."""


class StudyScene(BaseModel):
    """A home that participants meet."""

    model_config = _MODEL
    name: str = Field(pattern=r"^[A-Za-z0-9_-]{1,64}$")
    kind: SceneKind
    clutter: ClutterLevel = 0
    """Amount of furniture without a caption in the home."""
    labels: bool = False
    """Whether the robot's picture names the category of each object in view."""
    group: int = Field(default=0, ge=0)
    """Homes of one group have one condition for a person; 0 where there is one condition."""
    plan_digest: str = ""
    """`sim.homes.plan.plan_digest` of the plan from which the home is made; empty for scans, and where not known."""


def facts_of_version_2(
    scenes: tuple[StudyScene, ...], practice_scenes: tuple[StudyScene, ...]
) -> dict[str, tuple[StudyScene, ...] | int | str]:
    """Facts that plans and exports of version 2 do not name: schematic homes had labels, homes were of version 2."""
    homes = {
        name: tuple(scene.model_copy(update={"labels": scene.kind == "schematic"}) for scene in found)
        for name, found in (("scenes", scenes), ("practice_scenes", practice_scenes))
    }
    return {**homes, "homes_version": 2, "made_by": "the personal-viz 0.1.0 of 2026-11-25 or earlier that planned it"}


class Slot(NamedTuple):
    """An episode in a condition, for one person at a time."""

    task: TaskKind
    condition: Condition
    key: EpisodeKey
    rep: int
    """As in `PlannedTrial`."""


class PlannedTrial(BaseModel):
    """One trial of one participant."""

    model_config = _MODEL
    order_no: int = Field(ge=1)
    """Place in the participant's order over all phases, from 1."""
    phase: Phase = "main"
    task: TaskKind
    condition: Condition
    split: Split
    scene: str
    episode_id: str
    rep: int = Field(default=0, ge=0)
    """Number of the person among those who do this episode in this condition, from 1; 0 outside `main`."""

    @classmethod
    def of(cls, slot: Slot, *, order_no: int, phase: Phase) -> "PlannedTrial":
        """The trial that a participant does at this place of the order."""
        task, condition, (split, scene, episode_id), rep = slot
        return cls(
            order_no=order_no,
            phase=phase,
            task=task,
            condition=condition,
            split=split,
            scene=scene,
            episode_id=episode_id,
            rep=rep,
        )

    @property
    def key(self) -> EpisodeKey:
        """The episode."""
        return EpisodeKey(self.split, self.scene, self.episode_id)

    @property
    def slot(self) -> Slot:
        """The slot that the participant holds until the trial is given back."""
        return Slot(self.task, self.condition, self.key, self.rep)


class PlannedParticipant(BaseModel):
    """One participant's trials in order."""

    model_config = _MODEL
    code: str = Field(pattern=r"^p[0-9]{2,}$")
    """Public code: p01, p02, ..."""
    task: TaskKind
    arm: int = Field(default=0, ge=0)
    """Shifts the conditions over the groups of homes."""
    trials: tuple[PlannedTrial, ...]
    """The trials in order. A spare person has none of phase `main`, and later gets the trials that others leave."""


class StudyPlan(BaseModel):
    """The whole plan of one frozen study."""

    model_config = _MODEL
    schema_version: Literal[2, 3] = 3
    """Version 2 did not say anything about labels and versions of homes."""
    study_version: str
    homes_version: int = HOMES_VERSION
    """`HOMES_VERSION` of the program that made the plan: homes that are no scans look as in that version."""
    made_by: str = "the release that made the plan"
    """Name and commit of that release."""
    scenes: tuple[StudyScene, ...] = Field(min_length=1)
    """The study's homes."""
    practice_scenes: tuple[StudyScene, ...] = ()
    """Homes of practice and attention trials; invented, in the folder `practice`."""
    texts: dict[str, str] = {}
    """sha256 of the texts that participants read, by file name."""
    is_pilot: bool = False
    """Whether the study may be served without an ethics id; its records say so for ever."""
    participants: tuple[PlannedParticipant, ...] = Field(min_length=1)
    changes: tuple[str, ...] = ()
    """Requests of the study file that the plan does not meet, and why; a sentence each, without its full stop."""

    @model_validator(mode="after")
    def _read_version_2(self) -> "StudyPlan":
        """Reads version 2."""
        if self.schema_version == 3:
            return self
        return self.model_copy(update=facts_of_version_2(self.scenes, self.practice_scenes))

    @property
    def plan_version(self) -> str:
        """sha256 of the canonical JSON: 64 hex digits."""
        return hashlib.sha256(self.canonical_json().encode()).hexdigest()

    def canonical_json(self) -> str:
        """The text that is hashed and stored; without empty `changes` and newer fields, as plans of its version."""
        of_scenes = {"__all__": {"labels", "plan_digest"}}
        newer = {"scenes": of_scenes, "practice_scenes": of_scenes, "homes_version": True, "made_by": True}
        left_out = newer if self.schema_version == 2 else {}
        return self.model_dump_json(exclude=left_out | ({} if self.changes else {"changes": True}))

    def scene(self, name: str) -> StudyScene:
        """One of the plan's homes, practice homes included.

        Raises:
            StudyError: The plan does not have the home.
        """
        for known in (*self.scenes, *self.practice_scenes):
            if known.name == name:
                return known
        names = ", ".join(known.name for known in (*self.scenes, *self.practice_scenes))
        raise StudyError(f"plan: scene is {name!r}; expected one of: {names}. Make the plan again.")

    def participant(self, code: str) -> PlannedParticipant:
        """One of the plan's participants.

        Raises:
            StudyError: The plan does not have the participant.
        """
        for known in self.participants:
            if known.code == code:
                return known
        raise StudyError(f"plan: found no participant {code!r}; expected p01 to p{len(self.participants):02d}.")

    def episodes(self, task: TaskKind) -> dict[Condition, tuple[EpisodeKey, ...]]:
        """The episodes that people do and that count, by condition: each once, sorted; {} if nobody does the task."""
        found: dict[Condition, set[EpisodeKey]] = {}
        for trial in (trial for person in self.participants for trial in person.trials):
            if trial.phase == "main" and trial.task == task:
                found.setdefault(trial.condition, set()).add(trial.key)
        return {condition: tuple(sorted(keys)) for condition, keys in sorted(found.items())}

    def conditions_of(self, config: StudyConfig, person: PlannedParticipant) -> dict[str, Condition]:
        """The condition that a person has in each of the study's homes."""
        conditions = config.conditions(person.task)
        return {scene.name: conditions[(scene.group + person.arm) % len(conditions)] for scene in self.scenes}


def with_groups(config: StudyConfig, scenes: Sequence[StudyScene], order: Sequence[int]) -> tuple[StudyScene, ...]:
    """The homes, dealt in the given order into as many groups as the task with the most conditions has conditions."""
    num_groups = max(len(config.conditions(task)) for task in config.task)
    return tuple(scenes[place].model_copy(update={"group": number % num_groups}) for number, place in enumerate(order))


def per_person(people: Sequence[PlannedParticipant]) -> dict[Split, tuple[int, int]]:
    """Least and largest number of counted trials of each split that one person has; spare people do not count."""
    counts = [Counter(trial.split for trial in person.trials if trial.phase == "main") for person in people]
    counts = [found for found in counts if found]
    splits: list[Split] = [split for split in SPLITS if any(split in found for found in counts)]
    return {split: (min(found[split] for found in counts), max(found[split] for found in counts)) for split in splits}


def save_plan(folder: Path, plan: StudyPlan) -> Path:
    """Writes `plan.json`; returns its path.

    Raises:
        StudyError: The folder cannot be written.
    """
    path = folder / PLAN_FILE
    write_private(path, plan.model_dump_json(indent=1) + "\n")
    return path


MAX_BYTES, MAX_VALUES = 256 << 20, 10_000_000
"""Limits of `plan.json`; a thousand participants with 150 trials each need a tenth of this."""


def load_plan(folder: Path, config: StudyConfig) -> StudyPlan:
    """Reads `plan.json` of a study folder.

    Raises:
        StudyError: The file is missing, not valid, or made for another study.
    """
    path = folder / PLAN_FILE
    try:
        plan = StudyPlan.model_validate_json(bounded_json(path, most=MAX_BYTES, most_values=MAX_VALUES), strict=True)
    except OSError as error:
        raise StudyError(
            f"{path}: cannot be read ({error.strerror}); expected a plan. Run personal-viz study plan first."
        ) from None
    except ValidationError as error:
        is_other = any(problem["loc"] == ("schema_version",) for problem in error.errors())
        advice = OTHER_PROGRAM if is_other else "Make the plan again."
        raise StudyError(line_from_validation_error(path, error, advice=advice)) from None
    if plan.study_version != config.study_version:
        raise StudyError(
            f"{path}: study_version is {plan.study_version[:12]}; expected {config.study_version[:12]}. "
            "study.yaml was changed after the plan: restore it, or make the plan again."
        )
    return plan
