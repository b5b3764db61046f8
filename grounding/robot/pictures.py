"""Reads a folder of colour and depth pictures with poses; layout.py finds the files."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from sim.errors import SceneError
from sim.types import Camera

from .intrinsics import FREIBURG, KINECT, KINECT_SIZE, SEVEN_SCENES, Size, camera_of, read_intrinsics
from .layout import RobotFiles, find_files, matching
from .poses import BadPose, T_body_camera, pose_lines, pose_of_file
from .recording import Entry, FrameCounts, ReadingOptions, Recording, Unusable, metres, units_of

TUM_PER_METRE = 5000.0
"""Depth units of TUM RGB-D (vision.in.tum.de/data/datasets/rgbd-dataset/file_formats)."""
DAMAGED = (OSError, ValueError, SyntaxError, EOFError, Image.DecompressionBombError)
"""What readers of damaged pictures raise."""
_Usable = tuple[Path, Path, NDArray[np.float64]]


def is_pictures(path: Path) -> bool:
    """Whether this is a folder; every folder that no other reader knows is read as one of pictures."""
    return path.is_dir()


def read_pictures(folder: Path, options: ReadingOptions, counts: FrameCounts) -> Recording:
    """The recording in a folder of pictures; unusable pictures are counted.

    Raises:
        SceneError: Files are missing or damaged, or no frame can be used.
    """
    files = find_files(folder)
    counts.num_found = len(files.colour)
    poses = _poses(files)
    usable: list[_Usable] = []
    for key, colour in files.colour.items():
        depth, pose = matching(key, files.depth), poses[key]
        if depth is None:
            counts.skip("no depth picture", colour.name)
        elif isinstance(pose, str):
            counts.skip(pose, colour.name)
        else:
            usable.append((colour, depth, pose))
    colour_size, depth_size, dtype, usable = _of_one_size(usable, counts)
    if not usable:
        raise SceneError(
            f"{folder}: none of {counts.num_found} colour pictures can be used: {dict(counts.by_reason)}; expected "
            f"pictures with depth and a pose ({_examples(files)}). Rename the files so that their numbers or times "
            "match."
        )
    camera, scale, warnings = _camera(folder, files, colour_size, depth_size)
    given = options.depth_per_metre or (scale if dtype.kind != "f" else None)
    T = T_body_camera(options.camera_axes or "opencv")
    entries = tuple(
        Entry(colour.name, pose @ T, camera, partial(_depth, depth, given), partial(read_colour, colour))
        for colour, depth, pose in usable
    )
    return Recording(entries, units_of(dtype, given=given), warnings)


def read_colour(path: Path) -> NDArray[np.uint8]:
    """(h, w, 3) colours of a picture file."""
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"))


def read_depth(path: Path) -> NDArray[np.generic]:
    """(H, W) depth as a `.npy` or picture file holds it, in its own units."""
    if path.suffix == ".npy":
        return np.load(path, allow_pickle=False).squeeze()
    with Image.open(path) as image:
        return np.asarray(image)


def size_of_depth(path: Path) -> tuple[Size, np.dtype]:
    """Size of a depth file and the type of its numbers; only its beginning is read."""
    if path.suffix == ".npy":
        array = np.load(path, allow_pickle=False, mmap_mode="r").squeeze()
        if array.ndim != 2:
            raise Unusable("depth not 16 bit or float")
        return (array.shape[1], array.shape[0]), array.dtype
    with Image.open(path) as image:
        kinds = {"I": np.int32, "F": np.float32} | dict.fromkeys(("I;16", "I;16B", "I;16L"), np.uint16)
        return image.size, np.dtype(kinds.get(image.mode, np.uint8))


def _depth(path: Path, per_metre: float | None) -> NDArray[np.float32]:
    return metres(read_depth(path), per_metre=per_metre)


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


def _of_one_size(usable: list[_Usable], counts: FrameCounts) -> tuple[Size, Size, np.dtype, list[_Usable]]:
    """Sizes of the first good colour and depth pictures, the depth's numbers, and the frames that have them."""
    first: tuple[Size, Size, np.dtype] | None = None
    kept: list[_Usable] = []
    for colour, depth, pose in usable:
        try:
            with Image.open(colour) as picture:
                colour_size = picture.size
            depth_size, dtype = size_of_depth(depth)
        except Unusable as error:
            counts.skip(error.reason, colour.name)
            continue
        except DAMAGED:
            counts.skip("picture not readable", colour.name)
            continue
        if dtype.kind not in "uif" or dtype.itemsize < 2:
            counts.skip("depth not 16 bit or float", colour.name)
        elif first is not None and (colour_size, depth_size, dtype) != first:
            counts.skip("another size", colour.name)
        else:
            first = (colour_size, depth_size, dtype)
            kept.append((colour, depth, pose))
    colour_size, depth_size, dtype = first or ((0, 0), (0, 0), np.dtype(np.uint16))
    return colour_size, depth_size, dtype, kept


def _camera(
    folder: Path, files: RobotFiles, colour_size: Size, depth_size: Size
) -> tuple[Camera, float | None, tuple[str, ...]]:
    """The camera, depth units per metre where the files or their layout say them, and warnings."""
    known = TUM_PER_METRE if files.public_set == "TUM" else None
    if files.intrinsics is not None:
        camera, scale = read_intrinsics(files.intrinsics, colour_size=colour_size, depth_size=depth_size)
        return camera, scale or known, ()
    if depth_size != KINECT_SIZE:
        raise SceneError(
            f"{folder}: depth is {depth_size[0]} x {depth_size[1]} without intrinsics; expected 640 x 480, as "
            f"{files.public_set} has it, or a file with the intrinsics. Add intrinsics.json (fx fy cx cy width height)."
        )
    warnings = ()
    if files.public_set == "7-Scenes":
        lens = SEVEN_SCENES
        warnings = ("7-Scenes' depth is not registered to its colours, so colours may be off by some pixels",)
    else:
        lens = next((lens for name, lens in FREIBURG.items() if name in folder.resolve().name), KINECT)
        if lens is KINECT:
            warnings = (
                "neither an intrinsics file nor freiburg1, 2 or 3 in the folder's name says which camera it was: took "
                "a Kinect's default, fx fy cx cy = 525 525 319.5 239.5",
            )
    return camera_of(folder, lens, of_size=KINECT_SIZE, to_size=depth_size), known, warnings


def _examples(files: RobotFiles) -> str:
    parts = [next(iter(files.colour.values())).name, next(iter(files.depth.values())).name]
    poses = files.trajectory or next(iter(files.poses.values()))
    return "here " + ", ".join([*parts, poses.name])
