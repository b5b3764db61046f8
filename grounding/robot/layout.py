"""Finds the files of a robot's recording (colour, depth, poses, intrinsics) and matches them.

It knows our own names and those of ScanNet's exporter, Replica as NICE-SLAM renders it, TUM RGB-D and 7-Scenes.
"""

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import AliasChoices, BaseModel, ConfigDict, Field, ValidationError

from sim.errors import SceneError, line_from_validation_error
from sim.files import bounded_json
from sim.types import Camera

from .poses import MAX_APART

_PICTURES = (".jpg", ".jpeg", ".png")
_COLOUR = ("color", "colour", "rgb", "images", "results/frame", "*.color")
_DEPTH = ("depth", "results/depth", "*.depth")
_POSES = ("poses", "pose", "*.pose")
_TRAJECTORIES = ("poses.txt", "trajectory.txt", "groundtruth.txt", "traj.txt")
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
HALF_PIXEL = 0.5
"""Files put the first pixel's centre at 0 (OpenCV, ROS); ours is at 0.5 (`Camera`)."""


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
    intrinsics: Path


class IntrinsicsFile(BaseModel):
    """`intrinsics.json`, or `cam_params.json` of Replica."""

    model_config = ConfigDict(frozen=True, allow_inf_nan=False)

    fx: float = Field(gt=0)
    fy: float = Field(gt=0)
    cx: float
    cy: float
    width: int = Field(gt=0, validation_alias=AliasChoices("width", "w"))
    height: int = Field(gt=0, validation_alias=AliasChoices("height", "h"))
    scale: float | None = Field(default=None, gt=0)
    """Depth units per metre."""


def find_files(folder: Path) -> RobotFiles:
    """All files of a recording.

    Raises:
        SceneError: Colour, depth, poses or intrinsics are missing, or two pictures have the same number.
    """
    colour, depth, poses = (
        _first(folder, places, suffixes)
        for places, suffixes in ((_COLOUR, _PICTURES), (_DEPTH, (".png",)), (_POSES, (".txt",)))
    )
    trajectory = next((folder / name for name in _TRAJECTORIES if (folder / name).is_file()), None)
    intrinsics = next((folder / name for name in _INTRINSICS if (folder / name).is_file()), None)
    for found, what, expected in (
        (colour, "colour picture", "color/*.jpg or color/*.png"),
        (depth, "depth picture", "depth/*.png (16 bit)"),
        (poses or trajectory, "pose", f"poses/*.txt, or one of {', '.join(_TRAJECTORIES)}"),
        (intrinsics, "intrinsics", "intrinsics.json (fx fy cx cy width height) or intrinsics.txt (3 x 3 or 4 x 4)"),
    ):
        if not found:
            raise SceneError(f"{folder}: found no {what}; expected {expected}. Rename the files, or add them.")
    assert intrinsics is not None
    return RobotFiles(colour, depth, poses, None if poses else trajectory, intrinsics)


def matching(key: str, files: dict[str, Path]) -> Path | None:
    """The file with this key; for time stamps the nearest one, at most MAX_APART seconds away."""
    if key in files or "." not in key:
        return files.get(key)
    stamps = [other for other in files if "." in other]
    if not stamps:
        return None
    apart = np.abs(np.array([float(other) for other in stamps]) - float(key))
    return files[stamps[int(apart.argmin())]] if apart.min() <= MAX_APART else None


def read_intrinsics(
    path: Path, *, colour_size: tuple[int, int], depth_size: tuple[int, int]
) -> tuple[Camera, float | None]:
    """The camera of pictures of the depth's size, and depth units per metre where the file gives them.

    A file that gives width and height, or has `depth` or `color` in its name, may be for either size; it is scaled.
    Colour and depth must be registered: the same camera, or one mapped onto the other.

    Args:
        colour_size: (width, height) of colour pictures.
        depth_size: (width, height) of depth pictures.

    Raises:
        SceneError: The file is damaged, or does not say to which of two sizes it belongs.
    """
    if path.suffix == ".json":
        found = _json(path)
        values, size, scale = (found.fx, found.fy, found.cx, found.cy), (found.width, found.height), found.scale
    else:
        values, scale = _matrix(path), None
        named: dict[Literal["depth", "color"], tuple[int, int]] = {"depth": depth_size, "color": colour_size}
        size = next((value for name, value in named.items() if name in path.stem), depth_size)
        if colour_size != depth_size and not any(name in path.stem for name in named):
            raise SceneError(
                f"{path}: colour is {colour_size[0]} x {colour_size[1]}, depth {depth_size[0]} x {depth_size[1]}; "
                "expected intrinsics that say which size they belong to. Name the file intrinsics_depth.txt or "
                "intrinsics_color.txt, or write intrinsics.json with width and height."
            )
    fx, fy, cx, cy = values
    across, down = depth_size[0] / size[0], depth_size[1] / size[1]
    cx, cy = (cx + HALF_PIXEL) * across, (cy + HALF_PIXEL) * down
    if not (fx > 0 and fy > 0 and 0 < cx < depth_size[0] and 0 < cy < depth_size[1]):
        raise SceneError(
            f"{path}: fx fy cx cy are {values} for pictures of {size[0]} x {size[1]}; expected positive focal lengths "
            "and a principal point inside the picture, in pixels. Correct the file."
        )
    return Camera.of_lens(*depth_size, fx=fx * across, fy=fy * down, cx=cx, cy=cy), scale


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


def _json(path: Path) -> IntrinsicsFile:
    advice = "Write fx, fy, cx, cy, width and height, in pixels."
    try:
        content = json.loads(bounded_json(path))
        return IntrinsicsFile.model_validate(content.get("camera", content) if isinstance(content, dict) else content)
    except (OSError, ValueError, RecursionError) as error:
        if isinstance(error, ValidationError):
            raise SceneError(line_from_validation_error(str(path), error, advice=advice)) from None
        raise SceneError(f"{path}: cannot be read ({error}); expected JSON. {advice}") from None


def _matrix(path: Path) -> tuple[float, float, float, float]:
    try:
        numbers = np.array([float(word) for word in path.read_text().replace(",", " ").split()])
    except (OSError, ValueError) as error:
        raise SceneError(f"{path}: cannot be read ({error}); expected a 3 x 3 or 4 x 4 matrix. Correct it.") from None
    if len(numbers) not in (9, 16) or not np.isfinite(numbers).all():
        raise SceneError(
            f"{path}: holds {len(numbers)} numbers; expected 9 or 16, a 3 x 3 or 4 x 4 matrix in pixels. Correct it."
        )
    K: NDArray[np.float64] = numbers.reshape(3 if len(numbers) == 9 else 4, -1)
    return float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2])
