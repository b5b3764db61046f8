"""Explorations on disk: one JSON file each, enough to show them and to make their pictures and maps again."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AllowInfNan, BaseModel, ConfigDict, Field, ValidationError, model_validator

from sim.episodes.schema import Vector3
from sim.errors import RunFileError, line_from_validation_error
from sim.files import bounded_json, write_whole
from sim.tasks.run_files import Step
from sim.types import Camera, Pose, SceneKind

from .explore import Exploration
from .frontier import StopReason

SCHEMA_VERSION = 1
Finite = Annotated[float, AllowInfNan(False)]
Share = Annotated[float, Field(ge=0, le=1)]
_MODEL = ConfigDict(frozen=True, extra="forbid")
_ADVICE = "Explore the home again with personal-viz explore."


class CameraFile(BaseModel):
    """As `sim.types.Camera`."""

    model_config = _MODEL
    width: int = Field(ge=1)
    height: int = Field(ge=1)
    hfov_deg: float = Field(gt=0, lt=180)
    mount_height: Finite


class StartFile(BaseModel):
    """As `sim.types.Pose`."""

    model_config = _MODEL
    position: Vector3
    yaw: Finite
    tilt: Finite = 0.0


class ExplorationFile(BaseModel):
    """As `Exploration`."""

    model_config = _MODEL
    schema_version: Literal[1] = SCHEMA_VERSION
    scene: str
    scene_kind: SceneKind
    scene_digest: str
    seed: int = Field(ge=0)
    camera: CameraFile
    start: StartFile
    storey_y: Finite
    steps: tuple[Step, ...]
    stop_reason: StopReason
    coverage: tuple[Share, ...]
    area_m2: float = Field(ge=0)
    doors_passed: int | None = None
    num_doors: int | None = None
    rooms_missed: tuple[str, ...] | None = None
    policy: str = ""

    @model_validator(mode="after")
    def _coverage_of_every_step(self) -> "ExplorationFile":
        """There is one share for the start and one for each step."""
        if len(self.coverage) != len(self.steps) + 1:
            raise ValueError(f"coverage has {len(self.coverage)} values; expected {len(self.steps) + 1}")
        return self


def save_exploration(path: Path, exploration: Exploration) -> None:
    """Writes a file that `load_exploration` reads back to an equal value; it is never half-written.

    Raises:
        RunFileError: The file cannot be written.
    """
    fields = {name: getattr(exploration, name) for name in ExplorationFile.model_fields if name != "schema_version"}
    places = {"camera": asdict(exploration.camera), "start": asdict(exploration.start)}
    found = ExplorationFile.model_validate(fields | places)
    try:
        write_whole(path, found.model_dump_json() + "\n")
    except OSError as error:
        raise RunFileError(
            f"{path}: cannot be written ({error}); expected a place for a file. Give a folder that you can write."
        ) from None


def load_exploration(path: Path) -> Exploration:
    """The exploration that a file holds.

    Raises:
        RunFileError: The file is missing, damaged, or of another version.
    """
    try:
        content = bounded_json(path)
    except OSError as error:
        raise RunFileError(f"{path}: cannot be read ({error}); expected an exploration. {_ADVICE}") from None
    try:
        found = ExplorationFile.model_validate_json(content)
    except ValidationError as error:
        raise RunFileError(line_from_validation_error(path, error, advice=_ADVICE)) from None
    fields = {name: getattr(found, name) for name in ExplorationFile.model_fields if name != "schema_version"}
    fields["camera"] = Camera(**found.camera.model_dump())
    fields["start"] = Pose(**found.start.model_dump())
    return Exploration(**fields)
