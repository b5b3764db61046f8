"""Reads the poses of a robot's recording: text files with a 4 x 4 matrix each, or one file of TUM or matrix lines."""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.errors import SceneError
from sim.exchange.pose_readers import text_rows
from sim.frames import CameraAxes, R_agent_axes, R_agent_camera, Rs_from_quats_xyzw

BadPose = Literal["no pose", "pose not readable", "pose not finite", "pose not a rotation"]
MAX_APART = 0.02
"""A pose or depth picture belongs to a picture taken at most this many seconds earlier or later (TUM's own tools)."""
_ROTATION_TOLERANCE = 0.02
_ADVICE = "Write one pose per frame, camera to world, and leave out frames whose pose was lost."


class PoseLines(NamedTuple):
    """The poses of one file."""

    times: NDArray[np.float64] | None
    """(N,) seconds; None = the lines are in the order of the pictures."""
    poses: tuple[NDArray[np.float64] | BadPose, ...]
    """(4, 4) camera to the recording's frame, or the pose's error."""

    def nearest(self, time: float) -> NDArray[np.float64] | BadPose:
        """The pose of a picture that was taken at this time."""
        assert self.times is not None
        if not len(self.times):
            return "no pose"
        index = int(np.abs(self.times - time).argmin())
        return self.poses[index] if abs(self.times[index] - time) <= MAX_APART else "no pose"


def pose_of_file(path: Path) -> NDArray[np.float64] | BadPose:
    """The pose in a text file with a 4 x 4 (or 3 x 4) matrix, or the reason why there is none."""
    try:
        return pose_of_numbers([float(word) for word in path.read_text().replace(",", " ").split()])
    except FileNotFoundError:
        return "no pose"
    except (OSError, ValueError):
        return "pose not readable"


def pose_of_numbers(numbers: Sequence[float]) -> NDArray[np.float64] | BadPose:
    """The pose given by 16 or 12 numbers, row by row; its rotation is made exact, because files hold few decimals."""
    if len(numbers) not in (12, 16):
        return "pose not readable"
    T = np.eye(4)
    T.flat[: len(numbers)] = numbers
    if not np.isfinite(T).all():
        return "pose not finite"
    left, _, right = np.linalg.svd(T[:3, :3])
    R = left @ right
    is_rotation = np.abs(T[:3, :3] - R).max() <= _ROTATION_TOLERANCE and np.linalg.det(R) > 0
    if not is_rotation or not np.allclose(T[3], (0, 0, 0, 1), atol=_ROTATION_TOLERANCE):
        return "pose not a rotation"
    T[:3, :3], T[3] = R, (0, 0, 0, 1)
    return T


def pose_lines(path: Path) -> PoseLines:
    """The poses in a file with lines `time tx ty tz qx qy qz qw` (TUM), or in the pictures' order without the time.

    Lines in the pictures' order may hold 16 or 12 numbers (a matrix) instead.

    Raises:
        SceneError: A line has another form.
    """
    rows: list[list[float]] = []
    for number, cells in text_rows(path.read_text(errors="replace").splitlines()):
        try:
            rows.append([float(cell) for cell in cells])
        except ValueError:
            rows.append([])
        if len(rows[-1]) not in (7, 8, 12, 16) or len(rows[-1]) != len(rows[0]):
            found = " ".join(cells)[:60]
            raise SceneError(
                f"{path}:{number}: found {found!r}; expected 8 numbers (time tx ty tz qx qy qz qw), 7 without "
                f"the time, or 16 (a 4 x 4 matrix) in every line. {_ADVICE}"
            )
    if not rows or len(rows[0]) != 8:
        pose_of = pose_of_quat if rows and len(rows[0]) == 7 else pose_of_numbers
        return PoseLines(None, tuple(pose_of(row) for row in rows))
    times = np.array([row[0] for row in rows])
    return PoseLines(times, tuple(pose_of_quat(row[1:]) for row in rows))


def pose_of_quat(numbers: Sequence[float]) -> NDArray[np.float64] | BadPose:
    """The pose given by tx ty tz qx qy qz qw."""
    if not np.isfinite(numbers).all():
        return "pose not finite"
    quat_xyzw = np.array(numbers[3:])
    length = np.linalg.norm(quat_xyzw)
    if abs(length - 1) > _ROTATION_TOLERANCE:
        return "pose not a rotation"
    T = np.eye(4)
    T[:3, :3] = Rs_from_quats_xyzw(quat_xyzw[None] / length)[0]
    T[:3, 3] = numbers[:3]
    return T


def T_body_camera(camera_axes: CameraAxes) -> NDArray[np.float64]:
    """(4, 4) camera with OpenCV axes in a camera with these axes; poses are multiplied by it from the right."""
    T = np.eye(4)
    T[:3, :3] = R_agent_axes(camera_axes).T @ R_agent_camera
    return T


def up_warning(Ts_map_camera: Sequence[NDArray[np.float64]]) -> str:
    """A warning if the pictures' mean up axis points sideways or down, as few cameras are mounted so; else ""."""
    if not len(Ts_map_camera):
        return ""
    mean = -np.mean([T[:3, 1] for T in Ts_map_camera], axis=0)
    if mean[1] > 0.2:
        return ""
    x, y, z = mean.tolist()
    return (
        f"the pictures' own up is ({x:.2f}, {y:.2f}, {z:.2f}) on average, in a frame whose y should point up: check "
        "which axis is up, and the camera's axes"
    )
