"""Finds the files of a folder of pictures (colour, depth, poses, intrinsics) and matches them.

It knows our own names and those of ScanNet's exporter, Replica as NICE-SLAM renders it, TUM RGB-D and 7-Scenes.
"""

import re
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Literal

import numpy as np

from sim.errors import SceneError
from sim.exchange.pose_readers import text_rows

from .poses import MAX_APART

PublicSet = Literal["TUM", "7-Scenes"]
"""Recordings whose cameras are known, so that they need no intrinsics file."""
_PICTURES = (".jpg", ".jpeg", ".png")
_DEPTHS = (".png", ".tif", ".tiff", ".npy")
_COLOUR = ("color", "colour", "rgb", "images", "results/frame", "*.color")
_DEPTH = ("depth", "results/depth", "*.depth")
_POSES = ("poses", "pose", "*.pose")
_COLOUR_LIST, _DEPTH_LIST = "rgb.txt", "depth.txt"
"""TUM's lists of pictures with their times, which go before the times in the pictures' names."""
_TRAJECTORIES = ("poses.txt", "trajectory.txt", "groundtruth.txt", "traj.txt", "pose.txt")
_INTRINSICS = (
    "intrinsics.json",
    "intrinsics.txt",
    "intrinsic/intrinsic_depth.txt",
    "intrinsics_depth.txt",
    "intrinsic_depth.txt",
    "intrinsic/intrinsic_color.txt",
    "intrinsics_color.txt",
    "intrinsic_color.txt",
    "camera-intrinsics.txt",
    "cam_params.json",
    "../cam_params.json",
)
_NUMBER = re.compile(r"\d+(?:\.\d+)?")


@dataclass(frozen=True, slots=True)
class RobotFiles:
    """The files of one recording; keys are the numbers or time stamps in the files' names."""

    colour: dict[str, Path]
    """Colour pictures by key, in order."""
    depth: dict[str, Path]
    poses: dict[str, Path]
    """Files with one matrix each; empty if there is a trajectory."""
    trajectory: Path | None
    """One file with all poses."""
    intrinsics: Path | None
    """None = the camera of a public set is known."""
    public_set: PublicSet | None
    """The public set whose names the files have."""


def find_files(folder: Path) -> RobotFiles:
    """All files of a recording.

    Raises:
        SceneError: Colour, depth, poses or intrinsics are missing, a list of pictures is damaged, or two pictures have
            the same number.
    """
    colour = _timed(folder / _COLOUR_LIST) or _first(folder, _COLOUR, _PICTURES)
    depth = _timed(folder / _DEPTH_LIST) or _first(folder, _DEPTH, _DEPTHS)
    poses = _first(folder, _POSES, (".txt",))
    trajectory = next((folder / name for name in _TRAJECTORIES if (folder / name).is_file()), None)
    intrinsics = next((folder / name for name in _INTRINSICS if (folder / name).is_file()), None)
    public_set: PublicSet | None = None
    has_tum_names = (folder / "rgb").is_dir() or (folder / _COLOUR_LIST).is_file()
    if not poses and trajectory == folder / "groundtruth.txt" and has_tum_names:
        public_set = "TUM"
    elif colour and next(iter(colour.values())).stem.endswith(".color"):
        public_set = "7-Scenes"
    for found, what, expected in (
        (colour, "colour picture", "color/*.jpg or color/*.png"),
        (depth, "depth picture", "depth/*.png (16 bit), *.npy or *.tiff (float metres)"),
        (poses or trajectory, "pose", f"poses/*.txt, or one of {', '.join(_TRAJECTORIES)}"),
        (
            intrinsics or public_set,
            "intrinsics",
            "intrinsics.json (fx fy cx cy width height) or intrinsics.txt (3 x 3 or 4 x 4)",
        ),
    ):
        if not found:
            raise SceneError(f"{folder}: found no {what}; expected {expected}. Rename the files, or add them.")
    return RobotFiles(colour, depth, poses, None if poses else trajectory, intrinsics, public_set)


def matching(key: str, files: dict[str, Path]) -> Path | None:
    """The file with this key; for time stamps the nearest one, at most MAX_APART seconds away."""
    if key in files or "." not in key:
        return files.get(key)
    stamps = [other for other in files if "." in other]
    if not stamps:
        return None
    apart = np.abs(np.array([float(other) for other in stamps]) - float(key))
    return files[stamps[int(apart.argmin())]] if apart.min() <= MAX_APART else None


def _timed(path: Path) -> dict[str, Path]:
    """The pictures of a list with lines `time file`, by time in seconds, in order; empty if there is no list."""
    if not path.is_file():
        return {}
    timed: dict[float, Path] = {}
    for number, cells in text_rows(path.read_text(errors="replace").splitlines()):
        try:
            time, name = cells
            is_new = isfinite(float(time)) and float(time) not in timed
            timed[float(time)] = path.parent / name
        except ValueError:
            is_new = False
        if not is_new:
            raise SceneError(
                f"{path}:{number}: found {' '.join(cells)[:60]!r}; expected a time in seconds and a file in every "
                "line, each time once. Correct the line, or remove the list if the files are named by their times."
            )
    return {f"{time:.6f}": timed[time] for time in sorted(timed)}


def _first(folder: Path, places: tuple[str, ...], suffixes: tuple[str, ...]) -> dict[str, Path]:
    """The files in the first of these places that holds any, by key, in the order of the keys."""
    for place in places:
        head, _, start = place.rpartition("/")
        if place.startswith("*"):
            paths = [path for path in _listed(folder, suffixes) if path.stem.endswith(place[1:])]
        elif head:
            paths = [path for path in _listed(folder / head, suffixes) if path.stem.startswith(start)]
        else:
            paths = _listed(folder / place, suffixes)
        if paths:
            return _by_key(paths)
    return {}


def _listed(folder: Path, suffixes: tuple[str, ...]) -> list[Path]:
    if not folder.is_dir():
        return []
    return sorted(path for path in folder.iterdir() if path.suffix.lower() in suffixes and path.is_file())


def _by_key(paths: list[Path]) -> dict[str, Path]:
    keyed: dict[str, Path] = {}
    for path in paths:
        key = _key(path)
        if key in keyed:
            raise SceneError(
                f"{path.parent}: {keyed[key].name} and {path.name} have the same number; expected one file per frame. "
                "Rename or remove one."
            )
        keyed[key] = path
    numbered = all(_NUMBER.fullmatch(key) for key in keyed)
    return dict(sorted(keyed.items(), key=lambda item: (float(item[0]) if numbered else 0.0, item[0])))


def _key(path: Path) -> str:
    """The last number in a file's name without leading zeros; a name without numbers is its own key."""
    numbers = _NUMBER.findall(path.stem)
    if not numbers:
        return path.stem
    whole, dot, decimals = numbers[-1].partition(".")
    return f"{int(whole)}{dot}{decimals}"
