"""Value types that every package shares; numpy only, so that importing them is cheap. Frames: sim/frames.py."""

import enum
import math
from dataclasses import dataclass
from typing import Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict

CUT_HEIGHT = 1.9
"""Storeys are cut at most this far above the floor (metres) where they have no ceiling, and in homes built from plans,
whose walls have a rim at this height."""
STOREY_GAP = 1.5
"""Two points are on one storey when their floor heights differ by less than this (metres, DESIGN.md)."""
SUCCESS_RADIUS = 1.0
"""Metres (paper, Sec. III); planar is our reading: a picture at 1.7 m is never within 1 m of a robot's base in 3-D."""
RELAXED_RADIUS = 1.5
"""For targets without an original view point within SUCCESS_RADIUS (paper, Sec. IV: 1 m relaxed to 1.5 m; choosing
these targets is our reading)."""
FORWARD_STEP = 0.25
"""Length of MOVE_FORWARD (metres; paper, Sec. III-A)."""
TURN_STEP = math.radians(30)
"""Angle of one turn and of one look (radians; paper, Sec. III-A)."""
MAX_STEPS = 500
"""Step budget of PAN, in a home sequence of each search; STOP as the 500th action still counts (paper, Sec. III-A;
HABITAT_SEMANTICS.md)."""
AGENT_RADIUS = 0.18
AGENT_HEIGHT = 0.88
CAMERA_HEIGHT = 0.88
"""LoCoBot of ObjectNav-HM3D (metres; paper, Sec. III-A)."""

Split = Literal["easy", "medium", "hard"]
SPLITS: tuple[Split, ...] = ("easy", "medium", "hard")
TaskKind = Literal["pan", "pog"]
SceneKind = Literal["scan", "schematic", "invented"]
ClutterLevel = Literal[0, 1, 2]
"""Amount of furniture without a caption that was added to a home without a scan."""
WhoKind = Literal["human", "agent"]
EndReason = Literal["stop", "steps", "click", "giveup", "timeout", "technical", "abandoned"]
SuccessRule = Literal["paper", "habitat", "authors", "paper-strict"]
SUCCESS_RULES: tuple[SuccessRule, ...] = ("paper", "habitat", "authors", "paper-strict")
RULE_NOTES: dict[SuccessRule, str] = {
    "paper": "paper = our reading of the PersONAL paper: STOP within 1 m of the object's centre on the floor plan of "
    "its storey, 1.5 m where no view point is within 1 m; walls between do not count",
    "paper-strict": "paper-strict = STOP within 1 m of the object's centre on the floor plan of its storey, for every "
    "object",
    "habitat": "habitat = STOP less than 0.1 m of walking from a view point of the object, as ObjectNav counts",
    "authors": "authors = the robot ends within 0.2 m, on the floor plan, of a view point that the episode lists, with "
    "or without STOP, as the authors' result reader counts",
}
"""The meaning of each rule, for help texts and notes below tables (sim/tasks/rules.py has the figures)."""


class Action(enum.StrEnum):
    """An action of an agent or a person in PAN. Habitat numbers the first six 0-5 in this order."""

    STOP = "stop"
    FORWARD = "forward"
    LEFT = "left"
    RIGHT = "right"
    LOOK_UP = "look_up"
    LOOK_DOWN = "look_down"
    FOUND = "found"
    """Ends a search of a home sequence (GOAT-Bench's `subtask_stop`); never in an episode, which STOP ends."""


PAPER4 = (Action.STOP, Action.FORWARD, Action.LEFT, Action.RIGHT)
"""The four actions that people had in the paper."""
PAPER6 = (*PAPER4, Action.LOOK_UP, Action.LOOK_DOWN)
"""All six actions that the paper lists for agents."""
SEQUENCE7 = (*PAPER6, Action.FOUND)
"""The actions in a home sequence, where STOP ends all searches."""


class EpisodeKey(NamedTuple):
    """The name of one episode: ids alone repeat across splits and scenes."""

    split: Split
    scene: str
    episode_id: str

    def __str__(self) -> str:
        return f"{self.split}/{self.scene}/{self.episode_id}"


@dataclass(frozen=True, slots=True)
class Pose:
    """Place of the robot's base and the direction in which it looks, world frame."""

    position: tuple[float, float, float]
    """Feet on the floor, metres."""
    yaw: float
    """Radians about +y, positive to the left; 0 looks along -z."""
    tilt: float = 0.0
    """Camera tilt in radians, positive looks up; body pose is not affected."""


@dataclass(frozen=True, slots=True)
class Camera:
    """A pinhole camera without distortion; pixel centres are at +0.5, row 0 is the top.

    A simulated camera has square pixels and looks through the middle of its picture. A real one is `measured`.
    """

    width: int = 640
    height: int = 480
    hfov_deg: float = 79.0
    """Horizontal field of view in degrees (paper, Sec. III-A)."""
    mount_height: float = CAMERA_HEIGHT
    """Height of the camera above the robot's feet, metres."""
    measured: tuple[float, float, float, float] | None = None
    """(fx, fy, cx, cy) of a real camera in pixels; None for a simulated one."""

    @classmethod
    def of_lens(cls, width: int, height: int, *, fx: float, fy: float, cx: float, cy: float) -> Self:
        """A real camera from its measured intrinsics, in pixels of a picture of this size."""
        hfov_deg = math.degrees(math.atan(cx / fx) + math.atan((width - cx) / fx))
        return cls(width, height, hfov_deg, measured=(fx, fy, cx, cy))

    @property
    def lens(self) -> tuple[float, float, float, float]:
        """(fx, fy, cx, cy) in pixels: focal lengths and principal point."""
        if self.measured is not None:
            return self.measured
        focal = self.width / 2 / math.tan(math.radians(self.hfov_deg) / 2)
        return focal, focal, self.width / 2, self.height / 2

    @property
    def focal(self) -> float:
        """Focal length in pixels; the same for both axes of a simulated camera."""
        return self.lens[0]


@dataclass(frozen=True, slots=True)
class Frame:
    """One view: pictures, and the camera that took them with its pose. Renderers make it, maps are built from it."""

    rgb: NDArray[np.uint8]
    """(H, W, 3) colours."""
    depth_m: NDArray[np.float32]
    """(H, W) planar depth in metres, 0 = no return."""
    T_world_camera: NDArray[np.float64]
    """(4, 4) camera (OpenCV axes) in the world; for a robot's recording, in the frame of its map (y up, metres)."""
    camera: Camera
    ids: NDArray[np.int32] | None = None
    """(H, W) object ids of the simulator, 0 = none. Ground truth; None for views of a real robot."""

    def __post_init__(self) -> None:
        size = (self.camera.height, self.camera.width)
        assert self.rgb.shape == (*size, 3), self.rgb.shape
        assert self.depth_m.shape == size, self.depth_m.shape
        assert self.T_world_camera.shape == (4, 4), self.T_world_camera.shape
        assert self.ids is None or self.ids.shape == size, "object ids of another size"

    @property
    def instance_ids(self) -> NDArray[np.int32]:
        """`ids` of a view that a renderer made; code that also takes a robot's views asks for `ids` first."""
        assert self.ids is not None, "a view of a real robot has no object ids"
        return self.ids


class News(NamedTuple):
    """A message of a home sequence."""

    text: str
    searches_ago: int
    """Number of searches that have begun since; 0 = it was told before the present one."""


@dataclass(frozen=True, slots=True)
class Task:
    """All that an agent or a participant may know of an episode; holds no ground truth."""

    kind: TaskKind
    description: str
    """The paragraph that says who owns what (the dataset's `summary`)."""
    queries: tuple[str, ...]
    """Objects to find, in order; one query today."""
    max_steps: int = MAX_STEPS
    actions: tuple[Action, ...] = PAPER6
    news: tuple[News, ...] = ()
    """In a home sequence: what was told after the intro, oldest first; the description ends with its texts."""


@dataclass(frozen=True, slots=True)
class Prompt:
    """What is told at the beginning of one search of a home sequence; holds no ground truth."""

    query: str
    message: str | None = None
    """What has changed since the search before; None = nothing was told."""
    is_for_all: bool = False
    """Whether all right objects are wanted: each FOUND marks one, and FOUND twice in a row ends the search."""


@dataclass(frozen=True, slots=True)
class Observation:
    """The robot's senses after one action."""

    rgb: NDArray[np.uint8] | None
    """(H, W, 3); None when the environment draws no colours."""
    depth_m: NDArray[np.float32] | None
    """(H, W) planar depth in metres, 0 = no return; None without rendering."""
    gps: tuple[float, float]
    """(forward, right) metres from the start, in the start's frame."""
    compass: float
    """Yaw relative to the start in [-pi, pi], positive to the left."""
    T_start_camera: NDArray[np.float64]
    """(4, 4) camera (OpenCV axes) in the start frame."""
    camera: Camera
    collided: bool
    """Whether the last action was a forward step that a wall shortened."""
    step: int
    """Number of actions taken so far, 0 at reset."""
    message: str | None = None
    """In a home sequence: what is told at this step; None = nothing."""
    query: str | None = None
    """In a home sequence: the object to find from this step on; None = still the last one."""


@dataclass(frozen=True, slots=True)
class GridSpec:
    """A regular grid on the floor plane: rows grow with z, columns with x."""

    __pydantic_config__ = ConfigDict(extra="forbid")  # in files: unknown fields are refused

    origin_xz: tuple[float, float]
    """World (x, z) of the corner of cell (0, 0), metres."""
    cell: float
    """Side of a cell, metres."""
    shape: tuple[int, int]
    """(rows, cols)."""

    def rc_from_xz(self, xz: NDArray[np.floating]) -> NDArray[np.int64]:
        """Row and column of the cells that hold the points; (..., 2) in, (..., 2) out, may lie outside `shape`."""
        xz = np.asarray(xz, float)
        cells = np.floor((xz - np.asarray(self.origin_xz)) / self.cell).astype(np.int64)
        return cells[..., ::-1]

    def xz_from_rc(self, rc: NDArray[np.integer]) -> NDArray[np.float64]:
        """World (x, z) of cell centres; (..., 2) in, (..., 2) out."""
        rc = np.asarray(rc)
        return np.asarray(self.origin_xz, np.float64) + (rc[..., ::-1].astype(np.float64) + 0.5) * self.cell

    def uv_from_xz(self, xz: NDArray[np.floating]) -> NDArray[np.float64]:
        """(columns, rows) from the grid's corner, with fractions: cell (0, 0) has its centre at (0.5, 0.5)."""
        return (np.asarray(xz, np.float64) - np.asarray(self.origin_xz)) / self.cell

    def xz_from_uv(self, uv: NDArray[np.floating]) -> NDArray[np.float64]:
        """World (x, z) of places on the grid, the inverse of `uv_from_xz`; (..., 2) in, (..., 2) out."""
        return np.asarray(self.origin_xz, np.float64) + np.asarray(uv, np.float64) * self.cell

    def contains(self, rc: NDArray[np.integer]) -> NDArray[np.bool_]:
        """Which (row, col) pairs lie inside the grid; (..., 2) in, (...) out."""
        rc = np.asarray(rc)
        return np.all((rc >= 0) & (rc < np.asarray(self.shape)), axis=-1)
