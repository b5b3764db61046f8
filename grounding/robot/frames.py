"""Reads a folder of a real robot's posed RGB-D pictures as `Frame`s, for the same map builders as simulated views.

`color/*.jpg|png`, `depth/*.png` (16 bit, mm), `poses/*.txt` or a trajectory file, `intrinsics.json|txt`; other names
are in layout.py. Frames that cannot be used are skipped and counted by reason. Pictures are read when needed.
"""

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from sim.errors import SceneError
from sim.frames import CameraAxes
from sim.scans.up_axis import Up
from sim.types import Camera, Frame

from .layout import RobotFiles, find_files, matching, read_intrinsics
from .poses import BadPose, T_map_camera_of, pose_lines, pose_of_file, up_warning

MM_PER_METRE = 1000.0
_NO_RETURN = 65535
"""Another value besides 0 that means no return in 16-bit depth (7-Scenes)."""
Reason = (
    Literal["no depth picture", "picture not readable", "another size", "depth not 16 bit", "empty depth"] | BadPose
)


class FrameCounts:
    """Counts the pictures found, and the unused ones by reason; it grows while the pictures are read."""

    def __init__(self, num_found: int) -> None:
        """Starts without skipped pictures."""
        self.num_found = num_found
        """Number of colour pictures."""
        self.skipped: dict[Reason, set[str]] = {}
        """File names by reason."""
        self.warning = ""
        """A likely error in all poses; "" = none."""

    def skip(self, reason: Reason, name: str) -> None:
        """Counts a picture as not used; repeated calls count once."""
        self.skipped.setdefault(reason, set()).add(name)

    @property
    def by_reason(self) -> Mapping[Reason, int]:
        """Number of skipped pictures for each reason."""
        return {reason: len(names) for reason, names in sorted(self.skipped.items())}


class _Place(NamedTuple):
    colour: Path
    depth: Path
    T_map_camera: NDArray[np.float64]


class RobotFrames:
    """The usable frames of a recording, in order; each pass over them reads the pictures again."""

    def __init__(self, places: list[_Place], camera: Camera, *, depth_per_metre: float, counts: FrameCounts) -> None:
        """Takes the matched files; call `read_robot_frames` instead."""
        self._places = places
        self._camera = camera
        self._depth_per_metre = depth_per_metre
        self._counts = counts

    def __len__(self) -> int:
        """Number of frames with a pose and both pictures; iteration gives fewer if a picture is damaged."""
        return len(self._places)

    def __iter__(self) -> Iterator[Frame]:
        """The frames; damaged and empty ones are counted and left out."""
        return self._loaded(self._places)

    def some(self, count: int) -> list[Frame]:
        """At most `count` frames, spread evenly."""
        chosen = np.unique(np.linspace(0, len(self._places) - 1, count).round().astype(np.int64))
        return list(self._loaded([self._places[index] for index in chosen.tolist()]))

    def _loaded(self, places: list[_Place]) -> Iterator[Frame]:
        for place in places:
            frame = self._frame(place)
            if isinstance(frame, Frame):
                yield frame
            else:
                self._counts.skip(frame, place.colour.name)

    def _frame(self, place: _Place) -> Frame | Reason:
        size = (self._camera.width, self._camera.height)
        try:
            with Image.open(place.colour) as image:
                rgb = np.asarray(_resized(image.convert("RGB"), size))
            with Image.open(place.depth) as image:
                depth = np.asarray(image)
        except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):
            return "picture not readable"
        depth_m = np.where(depth == _NO_RETURN, 0, depth).astype(np.float32) / np.float32(self._depth_per_metre)
        if not depth_m.any():
            return "empty depth"
        return Frame(rgb, depth_m, place.T_map_camera, self._camera)


def read_robot_frames(
    folder: Path,
    *,
    up: Up,
    camera_axes: CameraAxes = "opencv",
    depth_per_metre: float | None = None,
) -> tuple[RobotFrames, FrameCounts]:
    """The usable frames of a recording, and the counts of the others.

    Colour and depth show the same view; where their sizes differ, the colours are resized to the depth's size, because
    depth between two surfaces cannot be interpolated.

    Args:
        folder: Folder as described in this module and layout.py.
        up: Which axis of the poses' frame points up. The map is y-up: (x, y, z) of a z-up frame becomes (x, z, -y).
        camera_axes: Camera axes of the poses; `opencv` looks along +z with y down.
        depth_per_metre: Depth units per metre; None = the value in the intrinsics file, or else millimetres.

    Raises:
        SceneError: Files are missing or damaged, or no frame can be used.
    """
    files = find_files(folder)
    counts = FrameCounts(len(files.colour))
    poses = _poses(files)
    usable: list[tuple[Path, Path, NDArray[np.float64]]] = []
    for key, colour in files.colour.items():
        depth, pose = matching(key, files.depth), poses[key]
        if depth is None:
            counts.skip("no depth picture", colour.name)
        elif isinstance(pose, str):
            counts.skip(pose, colour.name)
        else:
            usable.append((colour, depth, pose))
    colour_size, depth_size, usable = _of_one_size(usable, counts)
    if not usable:
        raise SceneError(
            f"{folder}: none of {counts.num_found} colour pictures can be used: {dict(counts.by_reason)}; expected "
            f"pictures with depth and a pose ({_examples(files)}). Rename the files so that their numbers or times "
            "match."
        )
    camera, scale = read_intrinsics(files.intrinsics, colour_size=colour_size, depth_size=depth_size)
    places = [
        _Place(colour, depth, T_map_camera_of(pose, up=up, camera_axes=camera_axes)) for colour, depth, pose in usable
    ]
    counts.warning = up_warning([place.T_map_camera for place in places])
    units = depth_per_metre or scale or MM_PER_METRE
    return RobotFrames(places, camera, depth_per_metre=units, counts=counts), counts


def _poses(files: RobotFiles) -> dict[str, NDArray[np.float64] | BadPose]:
    """The pose of each colour picture."""
    if files.trajectory is None:
        found = {key: matching(key, files.poses) for key in files.colour}
        return {key: "no pose" if path is None else pose_of_file(path) for key, path in found.items()}
    lines = pose_lines(files.trajectory)
    if lines.times is not None:
        return {key: _pose_at(key, lines.nearest) for key in files.colour}
    if len(lines.poses) != len(files.colour):
        raise SceneError(
            f"{files.trajectory}: holds {len(lines.poses)} poses for {len(files.colour)} colour pictures; expected one "
            "per picture, in the same order. Write them with times, or one file per picture."
        )
    return dict(zip(files.colour, lines.poses, strict=True))


def _pose_at(key: str, nearest: Callable[[float], NDArray[np.float64] | BadPose]) -> NDArray[np.float64] | BadPose:
    try:
        return nearest(float(key))
    except ValueError:
        return "no pose"


def _of_one_size(
    usable: list[tuple[Path, Path, NDArray[np.float64]]], counts: FrameCounts
) -> tuple[tuple[int, int], tuple[int, int], list[tuple[Path, Path, NDArray[np.float64]]]]:
    """Sizes of the first good colour and depth pictures, and the frames that have them; only headers are read."""
    sizes: tuple[tuple[int, int], tuple[int, int]] | None = None
    kept = []
    for colour, depth, pose in usable:
        try:
            with Image.open(colour) as first, Image.open(depth) as second:
                found, mode = (first.size, second.size), second.mode
        except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):
            counts.skip("picture not readable", colour.name)
            continue
        if not mode.startswith("I"):
            counts.skip("depth not 16 bit", colour.name)
        elif sizes is not None and found != sizes:
            counts.skip("another size", colour.name)
        else:
            sizes = found
            kept.append((colour, depth, pose))
    colour_size, depth_size = sizes or ((0, 0), (0, 0))
    return colour_size, depth_size, kept


def _resized(image: Image.Image, size: tuple[int, int]) -> Image.Image:
    if image.size == size:
        return image
    is_smaller = size[0] < image.size[0]
    return image.resize(size, Image.Resampling.BOX if is_smaller else Image.Resampling.BILINEAR)


def _examples(files: RobotFiles) -> str:
    parts = [next(iter(files.colour.values())).name, next(iter(files.depth.values())).name]
    poses = files.trajectory or next(iter(files.poses.values()))
    return "here " + ", ".join([*parts, poses.name])
