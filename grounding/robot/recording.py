"""A recording as its own program wrote it: entries with poses in its own frame, whose pictures are read when needed.

A reader per layout (pictures.py, stray.py, record3d.py, ros_bag.py) makes a `Recording`; frames.py turns it into the
map's frame.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sim.frames import CameraAxes
from sim.scans.up_axis import Up
from sim.types import Camera

from .poses import BadPose

MM_PER_METRE = 1000.0
_NO_RETURN = 65535
"""Another value besides 0 that means no return in 16-bit depth (7-Scenes)."""
Reason = (
    Literal[
        "no colour picture",
        "no depth picture",
        "picture not readable",
        "another size",
        "depth not 16 bit or float",
        "empty depth",
    ]
    | BadPose
)


class Unusable(Exception):
    """Raised by an entry's loaders when its picture cannot be used."""

    def __init__(self, reason: Reason) -> None:
        """Takes the reason under which the frame is counted."""
        super().__init__(reason)
        self.reason: Reason = reason


@dataclass(frozen=True, slots=True)
class Entry:
    """One colour picture with its depth and pose."""

    name: str
    """The colour picture's file name, number or time stamp; unique in the recording."""
    T_recording_camera: NDArray[np.float64]
    """(4, 4) camera (OpenCV axes) in the recording's own frame, metres."""
    camera: Camera
    """The camera of the depth picture; colours are resized to its size."""
    load_depth: Callable[[], NDArray[np.float32]]
    """(H, W) planar depth in metres, 0 = no return; raises `Unusable` or what a damaged file raises."""
    load_rgb: Callable[[], NDArray[np.uint8]]
    """(h, w, 3) colours of the same view, of any size; raises `Unusable` or what a damaged file raises."""


@dataclass(frozen=True, slots=True)
class Recording:
    """What a reader found."""

    entries: tuple[Entry, ...]
    """Entries with a pose and both pictures, in order."""
    depth_per_metre: float
    """Depth units per metre with which the depth is read; named where the result is not plausible."""
    warnings: tuple[str, ...] = ()
    """Likely errors that the person should know, without a full stop."""
    up: Up | None = None
    """The axis that points up, where the program that wrote the recording guarantees one."""


@dataclass(frozen=True, slots=True)
class ReadingOptions:
    """What a person says about a recording; None = as the recording says or its layout has it."""

    camera_axes: CameraAxes | None = None
    """Camera axes of the poses in a folder of pictures; None = `opencv`."""
    depth_per_metre: float | None = None
    """Depth units per metre."""
    topics: Mapping[str, str] = field(default_factory=dict)
    """Topics of a ROS bag by role: colour, depth, info, odom."""
    T_base_camera: NDArray[np.float64] | None = None
    """(4, 4) camera (OpenCV axes) on the robot whose odometry is in a ROS bag."""


class FrameCounts:
    """Counts the pictures found, and the unused ones by reason; it grows while the pictures are read."""

    def __init__(self) -> None:
        """Starts without pictures."""
        self.num_found = 0
        """Number of colour pictures."""
        self.skipped: dict[Reason, set[str]] = {}
        """File names by reason."""
        self.warning = ""
        """Likely errors in the whole recording; "" = none."""

    def skip(self, reason: Reason, name: str) -> None:
        """Counts a picture as not used; repeated calls count once."""
        self.skipped.setdefault(reason, set()).add(name)

    @property
    def by_reason(self) -> Mapping[Reason, int]:
        """Number of skipped pictures for each reason."""
        return {reason: len(names) for reason, names in sorted(self.skipped.items())}


def units_of(dtype: np.dtype, *, given: float | None) -> float:
    """Depth units per metre: the given ones, or metres for floats and millimetres for integers."""
    return given or (1.0 if dtype.kind == "f" else MM_PER_METRE)


def metres(depth: NDArray[np.generic], *, per_metre: float | None) -> NDArray[np.float32]:
    """(H, W) depth in metres, 0 = no return, of stored depth; nan, negative and 65535 mean no return too.

    Args:
        depth: (H, W) integers or floats.
        per_metre: Units per metre; None = metres for floats, millimetres for integers.

    Raises:
        Unusable: The array is no depth, or it has no return at all.
    """
    if depth.ndim != 2 or depth.dtype.kind not in "uif" or depth.dtype.itemsize < 2:
        raise Unusable("depth not 16 bit or float")
    values = depth.astype(np.float32)
    is_valid = np.isfinite(values) & (values > 0)
    if depth.dtype.kind != "f":
        is_valid &= values != _NO_RETURN
    if not is_valid.any():
        raise Unusable("empty depth")
    return np.where(is_valid, values, 0).astype(np.float32) / np.float32(units_of(depth.dtype, given=per_metre))
