"""Reads a recording of a real robot or phone as `Frame`s, for the same map builders as simulated views.

A recording in a layout of its own -> its reader -> `Recording` (recording.py) -> `RobotFrames` in the map's frame.
Frames that cannot be used are skipped and counted by reason. Pictures are read when needed.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from sim.errors import SceneError
from sim.frames import CameraAxes
from sim.types import Camera, Frame

from .pictures import DAMAGED, is_pictures, read_pictures
from .poses import up_warning
from .record3d import is_record3d, read_record3d
from .recording import MM_PER_METRE, Entry, FrameCounts, ReadingOptions, Reason, Recording, Unusable
from .ros_bag import is_ros_bag, read_ros_bag
from .stray import is_stray, read_stray
from .upright import Reading, T_map_recording, find_up, up_from_text

NEAREST, FARTHEST = 0.5, 12.0
"""Range of a plausible median depth in metres: nearer than a desk, or farther than a hall, is a wrong unit."""
_UNITS = (MM_PER_METRE, 5000.0, 1.0, 10000.0, 100.0)
"""Depth units per metre that are proposed where the median is not plausible."""
_UP_FRAMES = 50
"""Number of frames, spread over the recording, in which the way up is sought."""
_SAME_UP = np.cos(np.radians(2.0))
_Y = np.array([0.0, 1.0, 0.0])
_SAMPLES = 20
"""Number of depth pictures whose median must be plausible."""


class _Reader(NamedTuple):
    layout: str
    is_here: Callable[[Path], bool]
    read: Callable[[Path, ReadingOptions, FrameCounts], Recording]


_ROS, _PICTURES = "ROS bag", "folder of pictures"
_READERS = (
    _Reader(_ROS, is_ros_bag, read_ros_bag),
    _Reader("Record3D recording", is_record3d, read_record3d),
    _Reader("Stray Scanner recording", is_stray, read_stray),
    _Reader(_PICTURES, is_pictures, read_pictures),
)
"""In the order in which they are asked; the first that knows the files reads them."""


class PlacedEntry(NamedTuple):
    """An entry in the map's frame; a `DepthFirstView` (grounding/maps/best_views.py)."""

    entry: Entry
    T_map_camera: NDArray[np.float64]
    """(4, 4) camera (OpenCV axes) in the map frame."""

    @property
    def camera(self) -> Camera:
        """The camera of the depth picture."""
        return self.entry.camera

    def load(self) -> Frame | None:
        """The frame; None if a picture cannot be used."""
        frame = _frame(self, colour=True)
        return frame if isinstance(frame, Frame) else None

    def load_depth(self) -> NDArray[np.float32] | None:
        """(H, W) its depth in metres without reading colours; None if it cannot be used."""
        depth_m = _depth(self.entry)
        return None if isinstance(depth_m, str) else depth_m


class RobotFrames:
    """The usable frames of a recording, in order; each pass over them reads the pictures again."""

    def __init__(self, entries: Sequence[Entry], up: Reading, *, colour: bool, counts: FrameCounts) -> None:
        """Turns the entries upright; call `read_robot_frames` instead."""
        self.up = up
        """Which way is up in the recording's own frame, and how certain that is; 1 where it was said."""
        self.T_map_recording = T_map_recording(up.up)
        """(4, 4) recording's own frame -> map frame."""
        self._places = [PlacedEntry(entry, self.T_map_recording @ entry.T_recording_camera) for entry in entries]
        self._colour = colour
        self._counts = counts

    @property
    def views(self) -> Sequence[PlacedEntry]:
        """The frames with their poses, loaded one by one when they are needed."""
        return self._places

    def __len__(self) -> int:
        """Number of frames with a pose and both pictures; iteration gives fewer if a picture is damaged."""
        return len(self._places)

    def __iter__(self) -> Iterator[Frame]:
        """The frames; damaged and empty ones are counted and left out."""
        return self._loaded(self._places, colour=self._colour)

    def some(self, count: int) -> list[Frame]:
        """At most `count` frames, spread evenly; their colours are not read and black."""
        chosen = np.unique(np.linspace(0, len(self._places) - 1, count).round().astype(np.int64))
        return list(self._loaded([self._places[index] for index in chosen.tolist()], colour=False))

    def _loaded(self, places: list[PlacedEntry], *, colour: bool) -> Iterator[Frame]:
        for place in places:
            frame = _frame(place, colour=colour)
            if isinstance(frame, Frame):
                yield frame
            else:
                self._counts.skip(frame, place.entry.name)


def read_robot_frames(
    path: Path,
    *,
    up: str = "auto",
    camera_axes: CameraAxes | None = None,
    depth_per_metre: float | None = None,
    topics: Mapping[str, str] | None = None,
    T_base_camera: NDArray[np.float64] | None = None,
    every: int = 1,
    colour: bool = True,
) -> tuple[RobotFrames, FrameCounts]:
    """The usable frames of a recording, and the counts of the others.

    Colour and depth show the same view; where their sizes differ, the colours are resized to the depth's size, because
    depth between two surfaces cannot be interpolated.

    Args:
        path: A folder of pictures (layout.py), a Stray Scanner folder, a `.r3d` file or its unpacked folder, a ROS bag.
        up: Which way is up in the poses' frame: an axis such as `z` or `-y`, a direction `x,y,z`, or `auto`: as the
            recording says, else found from its depth and poses (upright.py). The map is y-up: (x, y, z) of a z-up
            frame becomes (x, z, -y).
        camera_axes: Camera axes of the poses in a folder of pictures; None = `opencv`, along +z with y down.
        depth_per_metre: Depth units per metre; None = as the recording or its layout says, or else metres for floats
            and millimetres for integers.
        topics: Topics of a ROS bag by role (colour, depth, info, odom), where its own names are ambiguous.
        T_base_camera: (4, 4) camera (OpenCV axes) on the robot, for a ROS bag whose tf does not hold it.
        every: Takes every n-th usable frame.
        colour: False leaves the colours black and does not read them, for geometry alone.

    Raises:
        SceneError: Files are missing or damaged, no frame can be used, the depth's unit is not plausible, or it is
            doubtful which way is up.
        MissingDependencyError: The extra `robot` is not installed.
    """
    counts = FrameCounts()
    options = ReadingOptions(camera_axes, depth_per_metre, topics or {}, T_base_camera)
    recording = _recording(path, options, counts)
    entries = recording.entries[::every]
    require_plausible_depth(path, entries, per_metre=recording.depth_per_metre)
    frames = RobotFrames(entries, _upright(path, recording, entries, up), colour=colour, counts=counts)
    said = up_warning([view.T_map_camera for view in frames.views]) if up != "auto" else ""
    counts.warning = "; ".join(filter(None, (*recording.warnings, said)))
    return frames, counts


def _upright(path: Path, recording: Recording, entries: Sequence[Entry], up: str) -> Reading:
    """Which way is up: as the option says, as the recording says, or as its depth and poses show."""
    given = up_from_text(up)
    known = None if recording.up is None else up_from_text(recording.up)
    if given is not None and known is not None and given @ known < _SAME_UP:
        raise SceneError(
            f"{path}: --up is {up!r} for a recording in which {recording.up} points up; expected {recording.up!r}. "
            f"Give --up {recording.up}."
        )
    said = known if given is None else given
    if said is not None:
        return Reading(said, 1.0)
    as_recorded = RobotFrames(entries, Reading(_Y, 1.0), colour=False, counts=FrameCounts())
    some = as_recorded.some(_UP_FRAMES)
    if not some:
        raise SceneError(
            f"{path}: none of {len(entries)} depth pictures can be used; expected whole ones with some depth in them. "
            "Copy them again."
        )
    try:
        return find_up(some)
    except SceneError as error:
        raise SceneError(f"{path}: {error}") from None


def require_plausible_depth(path: Path, entries: Sequence[Entry], *, per_metre: float) -> None:
    """Refuses a recording whose median depth says that its unit is wrong.

    Args:
        path: The recording, for the error.
        entries: A few of them, spread evenly, are read.
        per_metre: The units with which they are read.

    Raises:
        SceneError: The median is below NEAREST or above FARTHEST; the message names units that would fit.
    """
    chosen = np.unique(np.linspace(0, len(entries) - 1, _SAMPLES).round().astype(np.int64))
    depths = [_depth(entries[index]) for index in chosen.tolist()]
    valid = [depth[::4, ::4][depth[::4, ::4] > 0] for depth in depths if not isinstance(depth, str)]
    values = np.concatenate(valid) if valid else np.empty(0)
    median = float(np.median(values)) if len(values) else 1.0
    if NEAREST <= median <= FARTHEST:
        return
    fitting = [unit for unit in _UNITS if NEAREST <= median * per_metre / unit <= FARTHEST]
    advice = (
        f"Give --depth-per-metre {fitting[0]:g}, with which it is {median * per_metre / fitting[0]:.2f} m."
        if fitting
        else "Give its units as --depth-per-metre."
    )
    raise SceneError(
        f"{path}: the median depth of {len(valid)} frames is {median:.3g} m at {per_metre:g} units per metre; expected "
        f"{NEAREST:g} to {FARTHEST:g} m. {advice}"
    )


def _recording(path: Path, options: ReadingOptions, counts: FrameCounts) -> Recording:
    """The recording by the first reader that knows it, with options that it does not have refused."""
    if not path.exists():
        raise SceneError(
            f"{path}: is not there; expected a folder of pictures, a Stray Scanner folder, a .r3d file or a ROS bag. "
            "Check the path."
        )
    reader = next((reader for reader in _READERS if reader.is_here(path)), None)
    if reader is None:
        raise SceneError(
            f"{path}: is a file of an unknown kind; expected a folder, or a file that ends in .r3d, .bag, .mcap or "
            ".db3. Give the recording's folder."
        )
    for option, is_given, layout in (
        ("--camera-axes", options.camera_axes is not None, _PICTURES),
        ("--topics", bool(options.topics), _ROS),
        ("--base-to-camera", options.T_base_camera is not None, _ROS),
    ):
        if is_given and reader.layout != layout:
            raise SceneError(
                f"{path}: {option} is given for a {reader.layout}, which does not need it; expected it with a "
                f"{layout} only. Leave it out."
            )
    return reader.read(path, options, counts)


def _frame(place: PlacedEntry, *, colour: bool) -> Frame | Reason:
    entry = place.entry
    depth_m = _depth(entry)
    if isinstance(depth_m, str):
        return depth_m
    size = (entry.camera.width, entry.camera.height)
    try:
        rgb = _resized(entry.load_rgb(), size) if colour else np.zeros((*size[::-1], 3), np.uint8)
    except Unusable as error:
        return error.reason
    except DAMAGED:
        return "picture not readable"
    return Frame(rgb, depth_m, place.T_map_camera, entry.camera)


def _depth(entry: Entry) -> NDArray[np.float32] | Reason:
    try:
        depth_m = entry.load_depth()
    except Unusable as error:
        return error.reason
    except DAMAGED:
        return "picture not readable"
    return depth_m if depth_m.shape == (entry.camera.height, entry.camera.width) else "another size"


def _resized(rgb: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
    if rgb.shape[:2] == size[::-1]:
        return rgb
    is_smaller = size[0] < rgb.shape[1]
    return np.asarray(
        Image.fromarray(rgb).resize(size, Image.Resampling.BOX if is_smaller else Image.Resampling.BILINEAR)
    )
