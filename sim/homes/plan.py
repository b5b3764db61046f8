"""`HomePlan`: a home as a small JSON file, before it has triangles; from `invent` and `recover`, for `furnish`."""

import os
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import AllowInfNan, BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import InitErrorDetails, PydanticCustomError

from sim.errors import SceneError, line_from_validation_error
from sim.files import bounded_json
from sim.types import ClutterLevel
from sim.words.finishes import Material, Pattern, Rgb

from .cells import AreaRun, CellGrid, Metres, Positive, Xz
from .plan_versions import current

HOMES_VERSION = 2
"""Raised by whoever changes what homes made of plans, seeds or episode files look like or where one walks in them.

What was kept of homes of another number (plans, light, explorations' maps) is made anew.
"""

SCHEMA_VERSION = 2
Finite = Annotated[float, AllowInfNan(False)]
_MODEL = ConfigDict(frozen=True, extra="forbid")
_ADVICE = "Make the plan again with personal-viz invent, or restore the file."


class Rect(NamedTuple):
    """An axis-aligned rectangle on the floor plane, world metres."""

    x0: Metres
    z0: Metres
    x1: Metres
    z1: Metres

    @property
    def centre(self) -> tuple[float, float]:
        """(x, z)."""
        return ((self.x0 + self.x1) / 2, (self.z0 + self.z1) / 2)

    def grown(self, by: float) -> "Rect":
        """The rectangle with every side moved outwards by `by` metres."""
        return Rect(self.x0 - by, self.z0 - by, self.x1 + by, self.z1 + by)

    def overlaps(self, other: "Rect") -> bool:
        """Whether the two share more than a border."""
        return self.x0 < other.x1 and other.x0 < self.x1 and self.z0 < other.z1 and other.z0 < self.z1

    def holds(self, x: float, z: float) -> bool:
        """Whether the point is inside or on the border."""
        return self.x0 <= x <= self.x1 and self.z0 <= z <= self.z1

    def holds_rect(self, other: "Rect") -> bool:
        """Whether `other` lies inside."""
        return self.holds(other.x0, other.z0) and self.holds(other.x1, other.z1)


class Finish(BaseModel):
    """What a surface is made of."""

    model_config = _MODEL
    material: Material = "plastic"
    pattern: Pattern = "plain"
    rgb: Rgb
    rgb2: Rgb | None = None
    """Second colour of the pattern; None = a shade of `rgb`."""


class Storey(BaseModel):
    """One level of a home."""

    model_config = _MODEL
    label: str
    """How texts call it: "ground floor"."""
    floor_y: Metres
    ceiling: Positive = 2.5
    """Height of the ceiling (or of the walls' top) above the floor, metres."""


class Room(BaseModel):
    """A named part of a storey."""

    model_config = _MODEL
    name: str = Field(min_length=1)
    storey: int = Field(ge=0)
    """Index into `HomePlan.storeys`."""
    rect: Rect | None = None
    """Middle lines of its walls; None where the plan's cells say where floor is."""
    area: tuple[AreaRun, ...] = ()
    """Its cells where it has no `rect`; cells of the storey that no room names belong to the nearest one."""
    floor: Finish
    wall: Finish


class Opening(BaseModel):
    """A hole (door) or a pane (window) in a wall."""

    model_config = _MODEL
    kind: Literal["door", "window"]
    offset: Metres
    """Metres from the wall's start to the middle of the opening."""
    width: Positive
    sill: Metres = 0.0
    top: Positive = 2.05
    """Lower and upper edge above the floor, metres."""


class Wall(BaseModel):
    """A straight wall along x or z, or a railing where `height` is low."""

    model_config = _MODEL
    storey: int = Field(ge=0)
    start: Xz
    end: Xz
    """Ends of the middle line; x or z is equal."""
    height: Positive
    thickness: Positive = 0.12
    openings: tuple[Opening, ...] = ()

    @property
    def length(self) -> float:
        """Metres along the middle line."""
        return float(np.hypot(self.end[0] - self.start[0], self.end[1] - self.start[1]))

    @property
    def is_along_x(self) -> bool:
        """Else it runs along z."""
        return self.start[1] == self.end[1]

    def middle_of(self, opening: Opening) -> tuple[float, float]:
        """(x, z) of the middle of one of its openings."""
        (x0, z0), (x1, z1), share = self.start, self.end, opening.offset / self.length
        return (x0 + (x1 - x0) * share, z0 + (z1 - z0) * share)

    def floor_beside(self, opening: Opening, *, depth: float, margin: float) -> Rect:
        """The floor so far before and behind an opening, and as much wider on each side as `margin` (metres)."""
        x, z = self.middle_of(opening)
        half = opening.width / 2 + margin
        out_x, out_z = (half, depth) if self.is_along_x else (depth, half)
        return Rect(x - out_x, z - out_z, x + out_x, z + out_z)


class Stair(BaseModel):
    """A straight flight of solid steps with the hole above it."""

    model_config = _MODEL
    storey: int = Field(ge=0)
    """The storey it rises from, to the next one."""
    rect: Rect
    """Footprint of the flight and of the hole in the floor above."""
    towards: Literal["+x", "-x", "+z", "-z"]
    """Direction in which it rises."""
    num_steps: int = Field(ge=1, le=1000)


class Furniture(BaseModel):
    """One object."""

    model_config = _MODEL
    name: str = Field(pattern=r"^.+_\d+$")
    """`<category>_<int>`; unique in the plan."""
    category: str = Field(min_length=1)
    centre: tuple[Metres, Metres, Metres]
    size: tuple[Positive, Positive, Positive]
    """Width, height, depth in its own axes, metres."""
    yaw: Finite = 0.0
    """Radians about +y; at 0 its front looks along +z."""
    finish: Finish
    caption: str = ""
    room: str = ""
    role: Literal["captioned", "clutter", "decoy"] = "captioned"
    """Clutter and decoys are in no caption; a decoy has the category of a captioned object."""

    @property
    def rect(self) -> Rect:
        """Axis-aligned bounds on the floor plane."""
        cos, sin = abs(np.cos(self.yaw)), abs(np.sin(self.yaw))
        half_x = float(self.size[0] * cos + self.size[2] * sin) / 2
        half_z = float(self.size[0] * sin + self.size[2] * cos) / 2
        x, _, z = self.centre
        return Rect(x - half_x, z - half_z, x + half_x, z + half_z)

    @property
    def world_size(self) -> tuple[float, float, float]:
        """Extents along world x, y, z in metres."""
        rect = self.rect
        return (rect.x1 - rect.x0, self.size[1], rect.z1 - rect.z0)

    @property
    def box(self) -> NDArray[np.float64]:
        """(6,) lowest and highest corner in the world."""
        rect, y, half = self.rect, self.centre[1], self.size[1] / 2
        return np.array([rect.x0, y - half, rect.z0, rect.x1, y + half, rect.z1])


class HomePlan(BaseModel):
    """A home: its levels, rooms, walls, stairs and furniture."""

    model_config = _MODEL
    schema_version: Literal[2] = SCHEMA_VERSION
    name: str = Field(pattern=r"^[A-Za-z0-9_-]{1,64}$")
    kind: Literal["schematic", "invented"]
    storeys: tuple[Storey, ...] = Field(min_length=1)
    rooms: tuple[Room, ...]
    walls: tuple[Wall, ...] = ()
    stairs: tuple[Stair, ...] = ()
    furniture: tuple[Furniture, ...] = ()
    cells: CellGrid | None = None
    """Floor of a schematic home; None for invented homes, whose mesh says where one can walk."""
    clutter: ClutterLevel = 0
    """How much furniture without a caption was added."""

    @model_validator(mode="after")
    def _every_storey_exists(self) -> "HomePlan":
        """Rooms, walls and both ends of stairs stand on storeys of the plan."""
        last = len(self.storeys) - 1
        parts = (("rooms", self.rooms, last), ("walls", self.walls, last), ("stairs", self.stairs, last - 1))
        wrong = [
            InitErrorDetails(type=_no_storey(last, highest), loc=(name, index, "storey"), input=item.storey)
            for name, items, highest in parts
            for index, item in enumerate(items)
            if item.storey > highest
        ]
        if wrong:
            raise ValidationError.from_exception_data("HomePlan", wrong)
        return self


def _no_storey(last: int, highest: int) -> PydanticCustomError:
    above = "" if highest == last else ", with a storey above it"
    template = "one of the plan's storeys, 0 to {last}{above}"
    return PydanticCustomError("no_storey", template, {"last": last, "above": above})


MAX_PLAN_VALUES = 1_000_000
"""Most values in a plan file."""


def load_plan(path: Path) -> HomePlan:
    """Read and check a plan.

    Raises:
        SceneError: The file is missing, damaged, or of another version.
    """
    try:
        data = bounded_json(path, most_values=MAX_PLAN_VALUES)
    except OSError as error:
        raise SceneError(f"{path}: cannot be read ({error}); expected a home plan. {_ADVICE}") from None
    try:
        return HomePlan.model_validate_json(current(data))
    except ValidationError as error:
        raise SceneError(line_from_validation_error(path, error, advice=_ADVICE)) from None


def save_plan(plan: HomePlan, path: Path) -> None:
    """Write a plan; the same plan gives the same bytes, and the file is never half-written.

    Raises:
        SceneError: The file cannot be written.
    """
    beside = path.with_name(path.name + ".part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        beside.write_bytes(plan_bytes(plan))
        os.replace(beside, path)
    except OSError as error:
        raise SceneError(f"{path}: cannot be written ({error}). Give a folder that you can write.") from None


def plan_bytes(plan: HomePlan) -> bytes:
    """The plan as its file holds it."""
    return plan.model_dump_json().encode() + b"\n"
