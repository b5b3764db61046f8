"""Reads the intrinsics of a robot's camera, and knows those of public recordings that come without a file."""

import json
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import AliasChoices, BaseModel, ConfigDict, Field, ValidationError

from sim.errors import SceneError, line_from_validation_error
from sim.files import bounded_json
from sim.types import Camera

Lens = tuple[float, float, float, float]
"""fx, fy, cx, cy in pixels; the first pixel's centre is 0 (OpenCV, ROS)."""
Size = tuple[int, int]
"""(width, height) in pixels."""
HALF_PIXEL = 0.5
"""Files put the first pixel's centre at 0 (OpenCV, ROS); ours is at 0.5 (`Camera`)."""
KINECT_SIZE: Size = (640, 480)
KINECT: Lens = (525.0, 525.0, 319.5, 239.5)
"""ROS's default for a Kinect, with which TUM's page projects all its sequences (vision.in.tum.de/data/datasets/
rgbd-dataset/intrinsic_calibration)."""
FREIBURG: dict[str, Lens] = {
    "freiburg1": (517.3, 516.5, 318.6, 255.3),
    "freiburg2": (520.9, 521.0, 325.1, 249.7),
    "freiburg3": (535.4, 539.2, 320.1, 247.6),
}
"""TUM's calibration of each Kinect's colour camera (same page), by the word in the sequence's name; distortion is
not removed."""
SEVEN_SCENES: Lens = (585.0, 585.0, 319.5, 239.5)
"""7-Scenes' depth camera: focal length 585, principal point (320, 240), the middle of the picture."""


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


def read_intrinsics(path: Path, *, colour_size: Size, depth_size: Size) -> tuple[Camera, float | None]:
    """The camera of pictures of the depth's size, and depth units per metre where the file gives them.

    A file that gives width and height, or has `depth` or `color` in its name, may be for either size; it is scaled.
    Colour and depth must be registered: the same camera, or one mapped onto the other.

    Raises:
        SceneError: The file is damaged, or does not say to which of two sizes it belongs.
    """
    if path.suffix == ".json":
        found = _json(path)
        lens, size, scale = (found.fx, found.fy, found.cx, found.cy), (found.width, found.height), found.scale
    else:
        lens, scale = lens_of_matrix(path), None
        named: dict[Literal["depth", "color"], Size] = {"depth": depth_size, "color": colour_size}
        size = next((value for name, value in named.items() if name in path.stem), depth_size)
        if colour_size != depth_size and not any(name in path.stem for name in named):
            raise SceneError(
                f"{path}: colour is {colour_size[0]} x {colour_size[1]}, depth {depth_size[0]} x {depth_size[1]}; "
                "expected intrinsics that say which size they belong to. Name the file intrinsics_depth.txt or "
                "intrinsics_color.txt, or write intrinsics.json with width and height."
            )
    return camera_of(path, lens, of_size=size, to_size=depth_size), scale


def camera_of(where: Path | str, lens: Lens, *, of_size: Size, to_size: Size) -> Camera:
    """The camera of pictures of another size that show the same view.

    Args:
        where: The file that gave the intrinsics, for errors.
        lens: For pictures of `of_size`.
        of_size: (width, height) of the pictures that the intrinsics belong to.
        to_size: (width, height) of the pictures of the camera.

    Raises:
        SceneError: The focal lengths are not positive, or the principal point is outside of the picture.
    """
    fx, fy, cx, cy = lens
    across, down = to_size[0] / of_size[0], to_size[1] / of_size[1]
    x, y = (cx + HALF_PIXEL) * across, (cy + HALF_PIXEL) * down
    if not (fx > 0 and fy > 0 and 0 < x < to_size[0] and 0 < y < to_size[1]):
        raise SceneError(
            f"{where}: fx fy cx cy are {lens} for pictures of {of_size[0]} x {of_size[1]}; expected positive focal "
            "lengths and a principal point inside the picture, in pixels. Correct the file."
        )
    return Camera.of_lens(*to_size, fx=fx * across, fy=fy * down, cx=x, cy=y)


def lens_of_matrix(path: Path) -> Lens:
    """The intrinsics in a text file with a 3 x 3 or 4 x 4 matrix, separated by spaces or commas.

    Raises:
        SceneError: The file holds something else.
    """
    try:
        numbers = np.array([float(word) for word in path.read_text().replace(",", " ").split()])
    except (OSError, ValueError) as error:
        raise SceneError(f"{path}: cannot be read ({error}); expected a 3 x 3 or 4 x 4 matrix. Correct it.") from None
    if len(numbers) not in (9, 16):
        raise SceneError(
            f"{path}: holds {len(numbers)} numbers; expected 9 or 16, a 3 x 3 or 4 x 4 matrix in pixels. Correct it."
        )
    if not np.isfinite(numbers).all():
        at = int(np.flatnonzero(~np.isfinite(numbers))[0])
        raise SceneError(
            f"{path}: number {at + 1} of {len(numbers)} is {numbers[at]}; expected finite numbers, a 3 x 3 or 4 x 4 "
            "matrix in pixels. Correct it."
        )
    K: NDArray[np.float64] = numbers.reshape(3 if len(numbers) == 9 else 4, -1)
    return float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2])


def _json(path: Path) -> IntrinsicsFile:
    advice = "Write fx, fy, cx, cy, width and height, in pixels."
    try:
        content = json.loads(bounded_json(path))
        return IntrinsicsFile.model_validate(content.get("camera", content) if isinstance(content, dict) else content)
    except (OSError, ValueError, RecursionError) as error:
        if isinstance(error, ValidationError):
            raise SceneError(line_from_validation_error(str(path), error, advice=advice)) from None
        raise SceneError(f"{path}: cannot be read ({error}); expected JSON. {advice}") from None
