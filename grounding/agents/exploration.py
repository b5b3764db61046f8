"""An exploration of one storey, as a value and as a JSON file: enough to show it and to render its pictures again."""

from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator

from sim.errors import RunFileError, line_from_validation_error
from sim.files import bounded_json, write_whole
from sim.tasks.run_files import Step
from sim.types import Camera, Pose, SceneKind

from .frontier import StopReason

Share = Annotated[float, Field(ge=0, le=1)]
_ADVICE = "Explore the home again with personal-viz explore."


def _with_a_picture(camera: Camera) -> Camera:
    if min(camera.width, camera.height) < 1 or not 0 < camera.hfov_deg < 180:
        raise ValueError("a camera has at least one pixel and sees less than 180 degrees")
    return camera


class Exploration(BaseModel):
    """One exploration."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
    schema_version: Literal[1] = 1
    scene: str
    scene_kind: SceneKind
    scene_digest: str
    seed: int = Field(ge=0)
    camera: Annotated[Camera, AfterValidator(_with_a_picture)]
    """The agent's camera."""
    start: Pose
    storey_y: float
    """Typical height of the start's storey, metres."""
    steps: tuple[Step, ...]
    """Every action and its resulting pose; the last is STOP unless the steps ran out."""
    stop_reason: StopReason
    coverage: tuple[Share, ...]
    """(len(steps) + 1,) share of the visible floor seen at the start and after each step."""
    area_m2: float = Field(ge=0)
    """Area of the floor that an ideal sensor could see."""
    doors_passed: int | None = None
    num_doors: int | None = None
    rooms_missed: tuple[str, ...] | None = None
    """Rooms neither entered nor seen; these three are None for homes without a plan."""
    policy: str = ""
    """Version of the explorer that chose the way (`EXPLORER_VERSION`)."""

    @model_validator(mode="after")
    def _coverage_of_every_step(self) -> Self:
        """Checks that there is one share for the start and one for each step."""
        if len(self.coverage) != len(self.steps) + 1:
            raise ValueError(f"coverage has {len(self.coverage)} values; expected {len(self.steps) + 1}")
        return self

    @property
    def poses(self) -> tuple[Pose, ...]:
        """The start and the pose after each step, world frame."""
        return (self.start, *(step.pose for step in self.steps))


def save_exploration(path: Path, exploration: Exploration) -> None:
    """Writes a file that `load_exploration` reads back to an equal value; it is never half-written.

    Raises:
        RunFileError: The file cannot be written.
    """
    try:
        write_whole(path, exploration.model_dump_json() + "\n")
    except OSError as error:
        raise RunFileError(
            f"{path}: cannot be written ({error}); expected a writable folder. Give another folder."
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
        return Exploration.model_validate_json(content)
    except ValidationError as error:
        raise RunFileError(line_from_validation_error(path, error, advice=_ADVICE)) from None
