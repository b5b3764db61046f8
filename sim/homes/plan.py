"""`HomePlan`: a home as a small JSON file before it has triangles, invented from a seed or recovered from episodes."""

import hashlib
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray
from pydantic import AllowInfNan, BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import InitErrorDetails, PydanticCustomError

from sim.cache import cached_bytes
from sim.episodes.dataset import PersonalDataset
from sim.errors import SceneError, line_from_validation_error
from sim.files import bounded_json, write_whole
from sim.types import STOREY_GAP, ClutterLevel, GridSpec
from sim.words.finishes import Material, Pattern, Rgb

from .cells import AreaRun, CellGrid, Metres, Positive, Xz, cells_from_runs

HOMES_VERSION = 7
"""Raise this when homes made of plans, seeds or episode files look different or allow different paths.

Stored plans, light and maps of explorations are made again for each new number.
"""

SCHEMA_VERSION = 3
Finite = Annotated[float, AllowInfNan(False)]
_MODEL = ConfigDict(frozen=True, extra="forbid")
_MATERIALS = {
    "fabric": "fabric", "velvet": "fabric", "woven": "fabric", "oak": "wood", "walnut": "wood", "wooden": "wood",
    "enamel": "metal", "ceramic": "ceramic", "paper": "paper", "painted": "picture", "framed": "picture",
}  # fmt: skip
"""Words that plans of version 1 used as materials."""
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
        """The rectangle with every side moved outwards by this many metres."""
        return Rect(self.x0 - by, self.z0 - by, self.x1 + by, self.z1 + by)

    def overlaps(self, other: "Rect") -> bool:
        """Whether the two share more than a border."""
        return self.x0 < other.x1 and other.x0 < self.x1 and self.z0 < other.z1 and other.z0 < self.z1

    def holds(self, x: float, z: float) -> bool:
        """Whether the point is inside or on the border."""
        return self.x0 <= x <= self.x1 and self.z0 <= z <= self.z1

    def holds_rect(self, other: "Rect") -> bool:
        """Whether `other` lies inside or on the border."""
        return self.holds(other.x0, other.z0) and self.holds(other.x1, other.z1)

    def gap(self, other: "Rect") -> float:
        """Metres between the two, 0 where they meet."""
        dx = max(self.x0 - other.x1, other.x0 - self.x1, 0.0)
        return math.hypot(dx, max(self.z0 - other.z1, other.z0 - self.z1, 0.0))

    def beside(self, yaw: float, depth: float) -> "Rect":
        """The strip of this depth (metres) along the side that faces `yaw`, a multiple of 90 degrees; 0 = +z."""
        dx, dz = round(math.sin(yaw)), round(math.cos(yaw))
        x0, x1 = (self.x0, self.x1) if not dx else (self.x1, self.x1 + depth) if dx > 0 else (self.x0 - depth, self.x0)
        z0, z1 = (self.z0, self.z1) if not dz else (self.z1, self.z1 + depth) if dz > 0 else (self.z0 - depth, self.z0)
        return Rect(x0, z0, x1, z1)

    def cells(self, grid: GridSpec, *, slack: float = 0.0) -> tuple[slice, slice]:
        """Rows and columns of the grid's cells that the rectangle touches; at least one cell, at the border if outside.

        Args:
            grid: Place of the cells.
            slack: Cells that it reaches into by less than this are left out (metres).
        """
        corners = np.array([[self.x0 + slack, self.z0 + slack], [self.x1 - slack, self.z1 - slack]])
        (row0, col0), (row1, col1) = np.clip(grid.rc_from_xz(corners), 0, np.array(grid.shape) - 1).tolist()
        return slice(row0, max(row0, row1) + 1), slice(col0, max(col0, col1) + 1)


class Finish(BaseModel):
    """Material, pattern and colours of a surface."""

    model_config = _MODEL
    material: Material = "plastic"
    pattern: Pattern = "plain"
    rgb: Rgb
    rgb2: Rgb | None = None
    """Second colour of the pattern; None = a shade of `rgb`."""


_FLOOR_NAMES = {-1: "basement", 0: "ground floor", 1: "first floor", 2: "second floor"}
_FLOORS = range(-3, 20)


def floor_name(number: int) -> str:
    """Name of a storey by its number; the ground floor is 0."""
    return _FLOOR_NAMES.get(number, f"floor {number}")


class Storey(BaseModel):
    """One level of a home."""

    model_config = _MODEL
    label: str
    """Name in texts: "ground floor"."""
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
    """Middle lines of its walls; None where the plan gives floor as cells."""
    area: tuple[AreaRun, ...] = ()
    """Its cells where it has no `rect`; cells of the storey in no room's area belong to the nearest room."""
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
    def line(self) -> Rect:
        """The middle line as a rectangle without width."""
        (x0, x1), (z0, z1) = (sorted((self.start[axis], self.end[axis])) for axis in (0, 1))
        return Rect(x0, z0, x1, z1)

    @property
    def is_along_x(self) -> bool:
        """Whether it runs along x, not along z."""
        return self.start[1] == self.end[1]

    def middle_of(self, opening: Opening) -> tuple[float, float]:
        """(x, z) of the middle of one of its openings."""
        (x0, z0), (x1, z1), share = self.start, self.end, opening.offset / self.length
        return (x0 + (x1 - x0) * share, z0 + (z1 - z0) * share)

    def floor_beside(self, opening: Opening, *, depth: float, margin: float) -> Rect:
        """The floor up to `depth` in front of an opening and behind it, wider by `margin` on each side (metres)."""
        x, z = self.middle_of(opening)
        half = opening.width / 2 + margin
        out_x, out_z = (half, depth) if self.is_along_x else (depth, half)
        return Rect(x - out_x, z - out_z, x + out_x, z + out_z)


class Stair(BaseModel):
    """A straight flight of solid steps with the hole above it."""

    model_config = _MODEL
    storey: int = Field(ge=0)
    """Index of the storey from which it rises to the next one."""
    rect: Rect
    """Footprint of the flight and of the hole in the floor above."""
    towards: Literal["+x", "-x", "+z", "-z"]
    """Direction in which it rises."""
    num_steps: int = Field(ge=1, le=1000)

    @property
    def yaw(self) -> float:
        """Direction in which it rises, radians about +y; 0 = +z."""
        return {"+z": 0.0, "+x": math.pi / 2, "-z": math.pi, "-x": -math.pi / 2}[self.towards]


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
    """Turn in radians about +y; at 0 its front faces +z."""
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
    def bottom_y(self) -> float:
        """World height of its lower end, metres."""
        return self.centre[1] - self.size[1] / 2

    @property
    def top_y(self) -> float:
        """World height of its upper end, metres."""
        return self.centre[1] + self.size[1] / 2

    @property
    def world_size(self) -> tuple[float, float, float]:
        """Extents along world x, y, z in metres."""
        rect = self.rect
        return (rect.x1 - rect.x0, self.size[1], rect.z1 - rect.z0)

    @property
    def box(self) -> NDArray[np.float64]:
        """The box (6,): lowest, then highest corner in the world."""
        rect = self.rect
        return np.array([rect.x0, self.bottom_y, rect.z0, rect.x1, self.top_y, rect.z1])


class Source(BaseModel):
    """What one edition of the dataset gave to a recovered home; what several editions hold counts for the first."""

    model_config = _MODEL
    digest: str
    """sha256 of the edition's files of this scene (`PersonalDataset.scene_digest`)."""
    starts: int
    """Number of places where episodes start."""
    view_points: int
    """Number of places of view points."""
    objects: int
    left_out: tuple[str, ...] = ()
    """Objects that contradict an earlier edition; neither they nor their episodes count."""


class HomePlan(BaseModel):
    """A home: its levels, rooms, walls, stairs and furniture."""

    model_config = _MODEL
    schema_version: Literal[3] = SCHEMA_VERSION
    name: str = Field(pattern=r"^[A-Za-z0-9_-]{1,64}$")
    kind: Literal["schematic", "invented"]
    storeys: tuple[Storey, ...] = Field(min_length=1)
    rooms: tuple[Room, ...]
    walls: tuple[Wall, ...] = ()
    stairs: tuple[Stair, ...] = ()
    furniture: tuple[Furniture, ...] = ()
    cells: CellGrid | None = None
    """Floor of a schematic home; None for invented homes, whose walkable floor follows from the mesh."""
    clutter: ClutterLevel = 0
    """Level of added furniture without a caption."""
    sources: tuple[Source, ...] = ()
    """Where the facts of a recovered home came from: the dataset, then its evidence; empty for other homes."""

    @property
    def missing_storeys(self) -> tuple[str, ...]:
        """Names of storeys that a schematic home must have by the names of its others, but that no record tells of."""
        found = [n for n in _FLOORS for storey in self.storeys if storey.label.startswith(floor_name(n))]
        if self.kind != "schematic" or not found:
            return ()
        return tuple(floor_name(n) for n in range(min(0, *found), max(found)) if n not in found)

    @model_validator(mode="after")
    def _every_storey_exists(self) -> "HomePlan":
        """Checks that rooms, walls and both ends of stairs are on storeys of the plan."""
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


def room_middle(room: Room, plan: HomePlan) -> tuple[float, float] | None:
    """World (x, z) of a place well inside a room; None where the room has no cells.

    It is a rectangle's centre, or the cell nearest to the mean of the room's cells. A room without an area has all
    walkable cells of its storey.
    """
    if room.rect is not None:
        return room.rect.centre
    if plan.cells is None:
        return None
    if room.area:
        rc = np.array([(run.row, run.col + step) for run in room.area for step in range(run.length)])
    else:
        cells = cells_from_runs(plan.cells.walkable)
        rc = cells.rc[np.abs(cells.y - plan.storeys[room.storey].floor_y) < STOREY_GAP / 2]
    if not len(rc):
        return None
    x, z = plan.cells.grid.xz_from_rc(rc[np.linalg.norm(rc - rc.mean(axis=0), axis=1).argmin()]).tolist()
    return x, z


MAX_PLAN_VALUES = 1_000_000
"""Most values in a plan file."""


def load_plan(path: Path) -> HomePlan:
    """Reads and checks a plan.

    Raises:
        SceneError: The file is missing, damaged, or of another version.
    """
    try:
        data = bounded_json(path, most_values=MAX_PLAN_VALUES)
    except OSError as error:
        raise SceneError(f"{path}: cannot be read ({error}); expected a home plan. {_ADVICE}") from None
    try:
        return HomePlan.model_validate_json(_current(data))
    except ValidationError as error:
        raise SceneError(line_from_validation_error(path, error, advice=_ADVICE)) from None


def plan_of(dataset: PersonalDataset, scene: str) -> HomePlan | None:
    """The plan beside the episodes, `<dataset.root>/scenes/<scene>.plan.json`; None when there is none.

    Raises:
        SceneError: The plan is damaged or of another home.
    """
    path = dataset.root / "scenes" / f"{scene}.plan.json"
    if not path.is_file():
        return None
    plan = load_plan(path)
    if plan.name != scene:
        raise SceneError(f"{path}: name is {plan.name!r}; expected {scene!r}. Rename the file or correct the plan.")
    return plan


def save_plan(plan: HomePlan, path: Path) -> None:
    """Writes a plan; the same plan gives the same bytes, and the file is never half-written.

    Raises:
        SceneError: The file cannot be written.
    """
    try:
        write_whole(path, plan_bytes(plan))
    except OSError as error:
        raise SceneError(f"{path}: cannot be written ({error}). Give a folder that you can write to.") from None


def plan_bytes(plan: HomePlan) -> bytes:
    """The bytes of a plan's file."""
    return plan.model_dump_json().encode() + b"\n"


def plan_digest(plan: HomePlan) -> str:
    """sha256 of what a plan says: 64 hex digits. New fields of later versions leave it as it is until they are used."""
    return hashlib.sha256(plan.model_dump_json(exclude={"schema_version"}, exclude_defaults=True).encode()).hexdigest()


def stored_plan(key: str, make: Callable[[], HomePlan]) -> HomePlan:
    """The plan that `make` gives, made once and kept in the cache folder.

    `key` holds everything that the plan depends on besides the versions of homes, of their files and of numerical
    libraries.
    """
    versions = f"{HOMES_VERSION} {SCHEMA_VERSION} {np.__version__} {scipy.__version__}"
    return HomePlan.model_validate_json(cached_bytes("plan", f"{key} {versions}", lambda: plan_bytes(make())))


def _current(data: bytes) -> bytes:
    """A plan file converted to the current version; files that hold no earlier plan are returned unchanged."""
    try:
        plan = json.loads(data)
    except (ValueError, RecursionError):
        return data
    if not isinstance(plan, dict) or plan.get("schema_version") not in (1, 2):
        return data
    try:
        found = _from_version_1(plan) if plan["schema_version"] == 1 else plan
        return json.dumps({**found, "schema_version": SCHEMA_VERSION}).encode()  # version 2 had no sources
    except (AttributeError, TypeError):  # not a plan of version 1 either: the current check reports it
        return data


def _from_version_1(plan: dict[str, Any]) -> dict[str, Any]:
    rooms = [_room(room) for room in plan.get("rooms", [])]
    furniture = [_piece(piece) for piece in plan.get("furniture", [])]
    return {**plan, "rooms": rooms, "furniture": furniture}


def _room(room: dict[str, Any]) -> dict[str, Any]:
    kept = {key: value for key, value in room.items() if key not in ("floor_rgb", "wall_rgb")}
    floor, wall = ({"material": m, "rgb": room.get(key)} for m, key in (("wood", "floor_rgb"), ("plaster", "wall_rgb")))
    return {**kept, "floor": floor, "wall": wall}


def _piece(piece: dict[str, Any]) -> dict[str, Any]:
    kept = {key: value for key, value in piece.items() if key not in ("rgb", "material")}
    material = _MATERIALS.get(piece.get("material", ""), "plastic")
    return {**kept, "finish": {"material": material, "rgb": piece.get("rgb")}}
