"""`study.json`: what a study asks of people. Frozen once written; its hash names every record made under it."""

import dataclasses
import hashlib
import json
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from sim import files
from sim.episodes.schema import Episode
from sim.errors import StudyError, line_from_validation_error
from sim.types import CAMERA_HEIGHT, MAX_STEPS, PAPER4, PAPER6, Action, Camera, ClutterLevel, SceneKind, Task, TaskKind

STUDY_FILE = "study.json"
_MODEL = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
_ADVICE = "Correct the field; personal-viz study init writes a valid file."


class StudyScene(BaseModel):
    """A home that participants meet."""

    model_config = _MODEL
    name: str = Field(pattern=r"^[A-Za-z0-9_-]{1,64}$")
    kind: SceneKind
    clutter: ClutterLevel = 0
    """How much furniture without a caption stands in it."""


class StudyCamera(BaseModel):
    """What the robot's camera shows to people."""

    model_config = _MODEL
    width: Annotated[int, Field(ge=16, le=4096)] = 640
    height: Annotated[int, Field(ge=16, le=4096)] = 480
    hfov_deg: Annotated[float, Field(gt=0, lt=180)] = 79.0
    mount_height: Annotated[float, Field(gt=0)] = CAMERA_HEIGHT


class StudyConfig(BaseModel):
    """All choices of a study that can change a result."""

    model_config = _MODEL
    schema_version: Literal[1] = 1
    study: str = Field(pattern=r"^[A-Za-z0-9_-]{1,32}$")
    """Public name, part of every run id."""
    dataset_digest: str = Field(min_length=1)
    scenes: tuple[StudyScene, ...] = Field(min_length=1)
    tasks: Annotated[tuple[TaskKind, ...], Field(min_length=1)] = ("pan", "pog")
    actions: Literal["paper4", "paper6"] = "paper4"
    """What people can do in PAN (HUMAN_STUDY.md, section 1, row 1)."""
    max_steps: Annotated[int, Field(ge=1, le=MAX_STEPS)] = MAX_STEPS
    query_index: Annotated[int, Field(ge=0)] = 0
    """Which paraphrase of the query everybody reads."""
    resume_within_s: Annotated[float, Field(ge=0)] = 600.0
    """Who comes back later than this finds the trial ended as `abandoned`."""
    seed: Annotated[int, Field(ge=0)] = 0
    camera: StudyCamera = StudyCamera()

    @model_validator(mode="after")
    def _names_once(self) -> "StudyConfig":
        for field, names in (("scenes", [scene.name for scene in self.scenes]), ("tasks", list(self.tasks))):
            if len(set(names)) != len(names):
                raise ValueError(f"each of {field} once, found {names}")
        return self

    @property
    def study_version(self) -> str:
        """sha256 of the canonical JSON: 64 hex digits."""
        return hashlib.sha256(self.canonical_json().encode()).hexdigest()

    @property
    def action_set(self) -> tuple[Action, ...]:
        """The actions that people have in PAN."""
        return PAPER4 if self.actions == "paper4" else PAPER6

    @property
    def robot_camera(self) -> Camera:
        """The camera as the simulator takes it."""
        return Camera(self.camera.width, self.camera.height, self.camera.hfov_deg, self.camera.mount_height)

    def canonical_json(self) -> str:
        """The same text for the same choices: sorted keys, no spaces, only what differs from the defaults.

        So a field that a later version adds leaves the hash of a running study alone; a default that a later version
        changes does not.
        """
        choices = self.model_dump(mode="json", exclude_defaults=True)
        return json.dumps(choices, sort_keys=True, separators=(",", ":"), ensure_ascii=False)

    def scene_kind(self, scene: str) -> SceneKind:
        """Kind of one of the study's scenes.

        Raises:
            StudyError: The study does not have the scene.
        """
        return self.scene(scene).kind

    def scene(self, scene: str) -> StudyScene:
        """One of the study's scenes.

        Raises:
            StudyError: The study does not have the scene.
        """
        for known in self.scenes:
            if known.name == scene:
                return known
        names = ", ".join(known.name for known in self.scenes)
        raise StudyError(f"study {self.study}: scene is {scene!r}; expected one of: {names}. Make the plan again.")

    def task_for(self, episode: Episode, kind: TaskKind) -> Task:
        """What a participant may see of the episode.

        Raises:
            StudyError: The episode has no query with the study's `query_index`.
        """
        num_queries = len(episode.record.query)
        if self.query_index >= num_queries:
            raise StudyError(
                f"study {self.study}: query_index is {self.query_index}, but episode {episode.key} has {num_queries} "
                f"queries; expected 0 to {num_queries - 1}. Make a study with a smaller query_index."
            )
        task = episode.task(kind, query_index=self.query_index, actions=self.action_set)
        return dataclasses.replace(task, max_steps=self.max_steps)


def save_study(folder: Path, config: StudyConfig) -> Path:
    """Write `study.json` once; the same study again changes nothing. Returns its path.

    Raises:
        StudyError: The folder holds another study, or cannot be written.
    """
    path = folder / STUDY_FILE
    if path.exists():
        found = load_study(folder)
        if found.study_version != config.study_version:
            raise StudyError(
                f"{path}: found study_version {found.study_version[:12]}; expected {config.study_version[:12]}. "
                "A study never changes: give the new one another folder."
            )
        return path
    write_whole(path, config.model_dump_json(indent=2) + "\n")
    return path


def load_study(folder: Path) -> StudyConfig:
    """Read `study.json` of a study folder.

    Raises:
        StudyError: The file is missing or not a valid study.
    """
    path = folder / STUDY_FILE
    try:
        return StudyConfig.model_validate_json(path.read_bytes(), strict=True)
    except OSError as error:
        raise StudyError(
            f"{path}: cannot be read ({error.strerror}); expected a study file. Run personal-viz study init first."
        ) from None
    except ValidationError as error:
        raise StudyError(line_from_validation_error(path, error, advice=_ADVICE)) from None


def write_whole(path: Path, text: str) -> None:
    """Write a text file that is never half-written. Makes the folder.

    Raises:
        StudyError: The folder cannot be written.
    """
    try:
        files.write_whole(path, text)
    except OSError as error:
        raise StudyError(
            f"{path}: cannot be written ({error.strerror}); expected a folder that you can write. Give another folder."
        ) from None
