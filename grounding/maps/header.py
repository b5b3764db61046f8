"""The header of a map file; pydantic, read and written by files.py."""

import math
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from sim.frames import CameraAxes
from sim.types import GridSpec, SceneKind

SCHEMA_VERSION: Literal[2] = 2
"""Version 1 knew neither the encoder that an option names nor a robot's recording; everything else is the same."""
_MOST_ROWS = 1 << 15
"""Cells are stored as int16."""


def _with_cells(grid: GridSpec) -> GridSpec:
    is_finite = all(map(math.isfinite, (*grid.origin_xz, grid.cell)))
    if not is_finite or grid.cell <= 0 or not all(0 < side < _MOST_ROWS for side in grid.shape):
        raise ValueError(f"a grid has a finite corner, a cell above 0, and 1 to {_MOST_ROWS - 1} rows and columns")
    return grid


Grid = Annotated[GridSpec, AfterValidator(_with_cells)]
"""A `GridSpec` in a file."""


_Row = tuple[float, float, float, float]
Matrix = tuple[_Row, _Row, _Row, _Row]


def matrix_of(T: NDArray[np.float64]) -> Matrix:
    """The rows of a matrix (4, 4)."""
    return tuple(tuple(row) for row in T.tolist())  # type: ignore[return-value]  # lengths are those of the array


class _Frozen(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class RecordingSource(_Frozen):
    """A robot's recording, and how it was read, so that its pictures are found again."""

    path: str
    """Its folder or file."""
    T_map_recording: Matrix
    """(4, 4) rows of the recording's own frame -> map frame."""
    camera_axes: CameraAxes | None = None
    depth_per_metre: float | None = None
    topics: dict[str, str] = {}
    T_base_camera: Matrix | None = None
    every: int = Field(default=1, gt=0)
    """The last five are as in `grounding.robot.frames.read_robot_frames`."""


class MapSource(_Frozen):
    """The place that was mapped, and how."""

    scene: str
    """Name of the scene or the place."""
    kind: SceneKind | Literal["robot"]
    """Tables never mix kinds."""
    digest: str = ""
    """`Scene.digest`, or "" where there is none."""
    builder: str = ""
    """`MapBuilder.name`: how the map was made; contains "oracle-perception" where ground truth was used."""
    encoder: str = ""
    """The encoder's name as an option gives it (`EncoderName`), which loads it again; "" = not known."""
    recording: RecordingSource | None = None
    """The robot's recording; None = there is none."""


class StoreyHeader(_Frozen):
    """Facts about one storey that its arrays do not hold."""

    floor_y: float
    centre_xz: tuple[float, float]
    occupancy: Grid
    grid: Grid | None = None
    """The grid of a grid map."""
    merge_m: float | None = Field(default=None, ge=0)
    """The distance at which an object map merged views of one thing."""
    captions: tuple[str, ...] | None = None
    """Captions of an object map's things."""


class MapHeader(_Frozen):
    """Everything in a map file except its arrays."""

    schema_version: Literal[2] = SCHEMA_VERSION
    source: MapSource
    layout: Literal["grid", "objects"]
    encoder: str
    dim: int = Field(gt=0)
    frame: str
    num_frames: int = Field(ge=0)
    storeys: tuple[StoreyHeader, ...] = Field(min_length=1)
