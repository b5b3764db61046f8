"""The header of a map file; pydantic, read and written by files.py."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from sim.types import GridSpec, SceneKind

SCHEMA_VERSION: Literal[1] = 1
Side = Annotated[int, Field(gt=0, lt=1 << 15)]
"""Rows or columns; cells are stored as int16."""


class _Frozen(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


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


class GridHeader(_Frozen):
    """A `GridSpec` in a file."""

    origin_xz: tuple[float, float]
    cell: float = Field(gt=0)
    shape: tuple[Side, Side]

    @property
    def spec(self) -> GridSpec:
        """The grid as a `GridSpec`."""
        return GridSpec(self.origin_xz, self.cell, self.shape)


class StoreyHeader(_Frozen):
    """Facts about one storey that its arrays do not hold."""

    floor_y: float
    centre_xz: tuple[float, float]
    occupancy: GridHeader
    grid: GridHeader | None = None
    """The grid of a grid map."""
    merge_m: float | None = Field(default=None, ge=0)
    """The distance at which an object map merged views of one thing."""
    captions: tuple[str, ...] | None = None
    """Captions of an object map's things."""


class MapHeader(_Frozen):
    """Everything in a map file except its arrays."""

    schema_version: Literal[1] = SCHEMA_VERSION
    source: MapSource
    layout: Literal["grid", "objects"]
    encoder: str
    dim: int = Field(gt=0)
    frame: str
    num_frames: int = Field(ge=0)
    storeys: tuple[StoreyHeader, ...] = Field(min_length=1)
