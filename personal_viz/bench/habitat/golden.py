"""Reads a folder of Habitat's answers (layout: recordings/habitat_golden.py, which writes one) into checked values.

Only the parts that the comparison needs are read. Every part except `NAME.info.json` may be missing. A file that
announces or holds more than the limits below is refused before it is unpacked.
"""

import lzma
import math
import tokenize
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, Self, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from sim.errors import SceneError, line_from_validation_error
from sim.files import bounded_json

Point = tuple[float, float, float]
_ADVICE = "Write the folder again with recordings/habitat_golden.py, or copy it again from its source."
_SUFFIX = ".info.json"
MAX_PART_BYTES = 64 << 20
"""Largest size of a JSON part, unpacked; those of the golden houses are below 2 MB."""
_MAX_PART_VALUES = 4_000_000
MAX_POSES = 1000
"""Largest number of poses of a house; the golden houses have 12."""
MAX_IMAGE_SIDE = 4096
"""Largest width and height of a depth image, pixels."""
_MAX_DEPTH_BYTES = 1 << 30
"""Largest size of a depth archive, unpacked: 1,700 images of 640 x 480."""
_NO_ARCHIVE = (
    *(OSError, EOFError, KeyError, ValueError, TypeError, SyntaxError, RuntimeError, MemoryError),
    *(zipfile.BadZipFile, zlib.error, lzma.LZMAError, tokenize.TokenError),
)
"""Errors that zipfile and numpy's header reader raise for damaged, encrypted and hostile files."""
_Part = TypeVar("_Part", bound=BaseModel)


class _Row(BaseModel):
    """A frozen model; unknown keys are allowed, because folders hold more than is compared. null = not finite."""

    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False)


class NavmeshSettings(_Row):
    """Size of the robot for which a navmesh was built, metres."""

    agent_height: float
    agent_radius: float


class NavmeshInfo(_Row):
    """Habitat's facts about one navmesh."""

    settings: NavmeshSettings
    navigable_area: Annotated[float, Field(gt=0)]
    """Square metres."""
    bounds: tuple[Point, Point] | None = None
    """Lowest and highest corner of the mesh that the navmesh was built from, world metres."""


class Info(_Row):
    """`NAME.info.json`."""

    navmeshes: dict[str, NavmeshInfo]
    """Navmeshes by file name."""
    up: Literal["y", "z"] | None = None
    """The up axis of the scene file's own coordinates; None = the one that fits the bounds of a navmesh."""
    made_with: str = ""
    """Versions of Habitat, for reports."""


class Pair(_Row):
    """One geodesic distance."""

    navmesh: str
    kind: str
    start: Point
    goal: Point
    distance: float | None
    """None = unreachable."""
    reverse_distance: float | None = None


class MultiGoal(_Row):
    """One distance to the nearest of several goals."""

    navmesh: str
    start: Point
    goals: Annotated[tuple[Point, ...], Field(min_length=1)]
    distance: float | None


class Geodesic(_Row):
    """`NAME.geodesic.json`."""

    pairs: tuple[Pair, ...]
    multi_goal: tuple[MultiGoal, ...] = ()


class StepEnd(_Row):
    """Where a rule let a forward end."""

    position: Point
    collided: bool


class StepRow(_Row):
    """One forward; a rule that was not asked is None."""

    start_used: Point
    requested_end: Point
    sensitive: bool
    """Whether two micrometres decide the answer, so that it is not compared."""
    no_slide_le_0_3_3: StepEnd | None = None
    slide: StepEnd | None = None


class Steps(_Row):
    """`NAME.steps.json`."""

    navmesh: str
    steps: tuple[StepRow, ...]


class SnapRow(_Row):
    """One point moved onto the navmesh."""

    point: Point
    snap: Point | None
    is_navigable: bool
    is_navigable_dy_0_1: bool | None = None
    island_radius: float | None = None
    distance_to_obstacle: float | None = None
    """None = not asked, or not projectable."""


class Snap(_Row):
    """`NAME.snap.json`."""

    navmesh: str
    obstacle_max_radius: float = 2.0
    queries: tuple[SnapRow, ...]


class PoseRow(_Row):
    """The pose from which a depth image was taken."""

    body_position: Point
    yaw: float
    tilt_deg: float


class Poses(_Row):
    """`NAME.poses.json`."""

    width: Annotated[int, Field(ge=1, le=MAX_IMAGE_SIDE)]
    height: Annotated[int, Field(ge=1, le=MAX_IMAGE_SIDE)]
    hfov_deg: Annotated[float, Field(gt=0, lt=180)]
    sensor_offset: Point
    poses: Annotated[tuple[PoseRow, ...], Field(max_length=MAX_POSES)]


class EpisodeGoal(_Row):
    """One goal object."""

    position: Point
    view_points: tuple[Point, ...] = ()


class EpisodeSettings(_Row):
    """Settings of habitat-lab."""

    distance_to: Literal["VIEW_POINTS", "POINT"]
    success_distance: float


class LabMeasures(_Row):
    """Measures from habitat-lab; None = not finite, see `nonfinite`."""

    distance_to_goal: float | None
    success: float
    spl: float | None
    soft_spl: float | None
    num_steps: int
    collisions: int


class EpisodeRow(_Row):
    """One trajectory with its measures."""

    id: int | str
    settings: EpisodeSettings
    goals: Annotated[tuple[EpisodeGoal, ...], Field(min_length=1)]
    actions: tuple[Annotated[int, Field(ge=0, le=5)], ...]
    trajectory: tuple[Annotated[tuple[float, ...], Field(min_length=3)], ...]
    """Rows that begin with x, y, z."""
    collided: tuple[bool, ...]
    measures: LabMeasures
    nonfinite: dict[str, Literal["inf", "nan"]] = {}
    distance_after_step: tuple[float | None, ...] | None = None

    @property
    def goal_points(self) -> NDArray[np.float64]:
        """(N, 3) the points to which distance_to_goal is measured."""
        if self.settings.distance_to == "POINT":
            return np.array([goal.position for goal in self.goals])
        return np.array([point for goal in self.goals for point in goal.view_points]).reshape(-1, 3)

    @model_validator(mode="after")
    def _lengths_fit(self) -> Self:
        count = len(self.actions)
        if (len(self.trajectory), len(self.collided)) != (count + 1, count):
            raise ValueError(
                f"{count + 1} trajectory rows and {count} collided flags for {count} actions, found "
                f"{len(self.trajectory)} and {len(self.collided)}"
            )
        if self.distance_after_step is not None and len(self.distance_after_step) != count + 1:
            raise ValueError(f"{count + 1} rows of distance_after_step, found {len(self.distance_after_step)}")
        if not len(self.goal_points):
            raise ValueError("at least one goal point, found none")
        return self


class Episodes(_Row):
    """`NAME.episodes.json`."""

    navmesh: str
    episodes: tuple[EpisodeRow, ...]


@dataclass(frozen=True, slots=True)
class House:
    """One house of a golden folder; parts are read on request."""

    root: Path
    name: str
    info: Info

    def scene_file(self) -> Path | None:
        """The mesh, if it is there."""
        return next((path for path in self._candidates("glb", "basis.glb")), None)

    def navmesh_file(self, name: str) -> Path | None:
        """One of `info.navmeshes`, if it is there."""
        path = self.root / Path(name).name
        return path if path.is_file() else None

    def part(self, name: str, kind: type[_Part]) -> _Part | None:
        """`NAME.<name>.json` or `.json.gz`, checked; None if it is not there.

        Raises:
            SceneError: The file is damaged or not as described.
        """
        for path in self._candidates(f"{name}.json.gz", f"{name}.json"):
            return _read(path, kind)
        return None

    def depth(self, poses: Poses) -> tuple[NDArray[np.uint16], float] | None:
        """(N, H, W) depth in units of the second value in metres; None if it is not there.

        Raises:
            SceneError: The file is damaged, or does not hold one image of the poses' size per pose; checked in the
                headers, before anything is unpacked.
        """
        expected = (len(poses.poses), poses.height, poses.width)
        for path in self._candidates("depth.npz"):
            try:
                with zipfile.ZipFile(path) as archive:
                    shape = _shape(archive, "depth_u16", kind="u", size=2)
                    if shape != expected or 2 * math.prod(expected) > _MAX_DEPTH_BYTES:
                        raise SceneError(
                            f"{path}: depth_u16 has shape {shape}; expected {expected}, one (height, width) image per "
                            f"pose of {self.name}.poses.json, and at most {_MAX_DEPTH_BYTES >> 20} MB. {_ADVICE}"
                        )
                    if _shape(archive, "scale_m", kind="f", size=8) not in ((), (1,)):
                        raise ValueError("scale_m is not one number")
                    images, scale_m = _array(archive, "depth_u16"), float(_array(archive, "scale_m").item())
            except _NO_ARCHIVE as error:
                wanted = "expected an .npz file with depth_u16 and scale_m"
                raise SceneError(f"{path}: found no depth archive ({error}); {wanted}. {_ADVICE}") from None
            if not 0 < scale_m < math.inf:
                raise SceneError(f"{path}: scale_m is {scale_m}; expected metres per unit, above 0. {_ADVICE}")
            return images, scale_m
        return None

    def _candidates(self, *endings: str) -> list[Path]:
        return [path for ending in endings if (path := self.root / f"{self.name}.{ending}").is_file()]


def read_houses(root: Path) -> list[House]:
    """All houses of a golden folder, by name.

    Raises:
        SceneError: The folder is missing or holds no house, or an info file is damaged.
    """
    if not root.is_dir():
        raise SceneError(f"{root}: found no folder; expected one with NAME{_SUFFIX} and its parts. {_ADVICE}")
    paths = sorted(root.glob(f"*{_SUFFIX}"))
    if not paths:
        raise SceneError(f"{root}: found no NAME{_SUFFIX}; expected one per house. {_ADVICE}")
    return [House(root, path.name.removesuffix(_SUFFIX), _read(path, Info)) for path in paths]


def _shape(archive: zipfile.ZipFile, name: str, *, kind: str, size: int) -> tuple[int, ...]:
    """Shape of an array in an archive, from the first bytes of its file.

    Raises:
        ValueError: The array is not in numpy's format, or is not of `kind` with at most `size` bytes per number.
    """
    with archive.open(f"{name}.npy") as file:
        version = np.lib.format.read_magic(file)
        if version != (1, 0):  # a header of a later version may be 4 GB long
            raise ValueError(f"{name}.npy is of version {version}")
        shape, _, dtype = np.lib.format.read_array_header_1_0(file)
    if dtype.kind != kind or dtype.itemsize > size:
        raise ValueError(f"{name} is of type {dtype}")
    return shape


def _array(archive: zipfile.ZipFile, name: str) -> NDArray:
    with archive.open(f"{name}.npy") as file:
        return np.lib.format.read_array(file, allow_pickle=False)


def _read(path: Path, kind: type[_Part]) -> _Part:
    try:
        content = bounded_json(path, most=MAX_PART_BYTES, most_values=_MAX_PART_VALUES)
        return kind.model_validate_json(content)
    except (OSError, EOFError, zlib.error) as error:
        raise SceneError(f"{path}: found a file that cannot be read ({error}). {_ADVICE}") from None
    except ValidationError as error:
        raise SceneError(line_from_validation_error(path, error, advice=_ADVICE)) from None
