"""Turns pose files of other programs (CSV, TUM, JSON, npz) into poses of our world, by declared conventions.

Frames and orders are never guessed: two plausible readings of one file give two different robots.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sim.errors import RunFileError
from sim.frames import (
    POSE_FRAMES,
    ZUP_FRAMES,
    CameraAxes,
    PoseFrame,
    R_agent_axes,
    Rs_from_quats_xyzw,
    Rs_from_yaws,
    T_world_frame,
    yaw_tilt_roll_from_R,
)
from sim.types import CAMERA_HEIGHT, MAX_STEPS, SPLITS, Action, EpisodeKey, Pose, Split

from .episode_names import NumberedBy
from .pose_readers import TUM_SUFFIXES, read_csv_tables, read_json_tables, read_npz_table
from .pose_tables import ADVERTISED, GPS, LISTED_QUAT, MATRIX, NAMED_QUAT, PLANAR, POSITION, PoseTable
from .step_checks import ANGLE_TOLERANCE, POSITION_TOLERANCE

POSE_SUFFIXES = (".csv", ".tsv", ".json", ".npz", *TUM_SUFFIXES)
MAX_ROUNDING = 0.01
"""Largest rounding of positions that a person may declare, metres; two decimals."""
_UNIT_TOLERANCE = 1e-3
_FRAME_ADVICE = (
    "Give --frame: world (Habitat: y up, looks along -z), zup (HM3D's files: world (x, -z, y)), "
    "ros (world (-z, -x, y), OneMap), start or start-ros (world and ros, re-based to the start pose), "
    "gps (forward, right and compass)."
)


@dataclass(frozen=True, slots=True)
class FreeMotion:
    """Bounds of a robot with other actions than PersONAL's."""

    max_move: float
    """Largest move from row to row, metres."""
    max_turn_deg: float
    """Largest turn from row to row, degrees."""
    max_steps: int = MAX_STEPS
    """The robot's budget of steps."""


@dataclass(frozen=True, slots=True)
class PoseReading:
    """Declarations about pose files, from the command line."""

    frame: PoseFrame
    quaternion: Literal["xyzw", "wxyz"] | None = None
    """Order of quaternions without named parts."""
    poses: Literal["body", "camera"] = "body"
    """Whether poses are those of the robot's feet, or of the camera 0.88 m above them, with its tilt."""
    camera_axes: CameraAxes | None = None
    """Axes of the camera, for rotations of the camera."""
    columns: tuple[str, ...] = ()
    """Names of the columns of CSV files, in their order; () = their own header."""
    rows: Literal["after-action", "before-action"] | None = None
    """Whether a row's pose is after or before the action of that row; needed when every row has one."""
    stopped: bool | None = None
    """Whether runs ended with STOP, where the files do not say."""
    allow_sliding: bool = False
    """Whether the robot slid along walls, where the files do not say."""
    episode: EpisodeKey | None = None
    """The episode, where the files do not say."""
    rounding: float = POSITION_TOLERANCE
    """Metres of rounding in the positions; 0.001 fits four decimals and more."""
    free: FreeMotion | None = None
    """Bounds of a robot with other actions than PersONAL's; None = PersONAL's actions."""
    numbered_by: NumberedBy | None = None
    """What numbers in the files' names count; None = ids or places, whichever starts there."""
    splits: tuple[Split, ...] = SPLITS
    """Splits that were played, for names without a split."""
    actions: tuple[Action, ...] | None = None
    """The actions of all episodes, for files that hold positions only."""


def is_pose_file(path: Path) -> bool:
    """Whether a file holds poses in another format than our steps files, by its name and first bytes."""
    if path.suffix.lower() not in POSE_SUFFIXES:
        return False
    try:
        with path.open("rb") as file:
            return not file.read(256).lstrip(b"\xef\xbb\xbf \r\n").startswith((b'{"kind"', b'{ "kind"'))
    except OSError:
        return True  # its reader will report the error


def read_pose_tables(path: Path, reading: PoseReading) -> Iterator[PoseTable]:
    """The episodes of a pose file, unconverted.

    Raises:
        RunFileError: The file is unreadable or damaged; the message names the place.
    """
    suffix = path.suffix.lower()
    if suffix == ".npz":
        yield read_npz_table(path)
    elif suffix == ".json":
        yield from read_json_tables(path)
    else:
        yield from read_csv_tables(path, columns=reading.columns)


def undeclared_frame(path: Path) -> RunFileError:
    """The error of a pose file whose frame was not declared."""
    return RunFileError(f"{path}: its frame is not declared; expected one of {', '.join(POSE_FRAMES)}. {_FRAME_ADVICE}")


def poses_from_table(table: PoseTable, reading: PoseReading, start: Pose) -> tuple[Pose, ...]:
    """The robot's pose of each row, world frame.

    `start` is the episode's start pose: the origin of frames without another one, and the height of 2-D positions.

    Raises:
        RunFileError: A value is missing or not finite, columns are missing, a convention is missing, or a rotation is
            impossible for a robot on a floor.
    """
    positions, has_height = world_positions(table, reading, start)
    yaws, tilts = _yaws_and_tilts(table, reading, start)
    if abs(tilts[0]) > (math.pi / 2 if reading.free else ANGLE_TOLERANCE):
        raise RunFileError(
            f"{table.wheres[0]}: the camera is tilted by {math.degrees(tilts[0]):.1f} degrees at the start; "
            "expected 0. Check --camera-axes and --frame; the first pose is the one before the first action."
        )
    if reading.poses == "camera" and has_height:
        positions = positions - np.array([0.0, CAMERA_HEIGHT, 0.0])
    return tuple(
        Pose((float(x), float(y), float(z)), float(yaw), float(tilt))
        for (x, y, z), yaw, tilt in zip(positions, yaws, tilts, strict=True)
    )


def world_positions(table: PoseTable, reading: PoseReading, start: Pose) -> tuple[NDArray[np.float64], bool]:
    """World points (T, 3), and whether the file gives heights; if not, all points are at the start's height.

    Raises:
        RunFileError: A value is missing or not finite, or columns are missing.
    """
    frame = reading.frame
    T = T_world_frame(frame, start)
    is_zup = frame in ZUP_FRAMES
    if table.has(*MATRIX):
        points, has_height = table.numbers("m03", "m13", "m23"), True
    elif frame == "gps":
        names = next((names for names in (GPS, PLANAR, ("x", "y")) if table.has(*names)), None)
        if names is None or table.has("z"):
            raise _missing(table, "forward and right, 2-D, in frame gps")
        forward_right = table.numbers(*names)
        points, has_height = np.stack([forward_right[:, 1], 0 * forward_right[:, 0], -forward_right[:, 0]], 1), False
    elif table.has(*POSITION):
        points, has_height = table.numbers(*POSITION), True
    else:
        names = next((names for names in (PLANAR, ("x", "y" if is_zup else "z")) if table.has(*names)), None)
        if names is None:
            raise _missing(table, f"x,y,z, or in 2-D {'x,y' if is_zup else 'x,z'} in frame {frame}")
        flat = table.numbers(*names)
        points, has_height = np.insert(flat, 2 if is_zup else 1, 0.0, axis=1), False
    world = points @ T[:3, :3].T + T[:3, 3]
    if not has_height:
        world[:, 1] = start.position[1]
    return world, has_height


def tells_tilt(table: PoseTable, reading: PoseReading) -> bool:
    """Whether the rows give the camera's tilt."""
    return table.has("tilt") or table.has("tilt_deg") or (reading.poses == "camera" and _rotation(table) != "yaw")


def _rotation(table: PoseTable) -> Literal["matrix", "named", "listed", "yaw"]:
    """The columns that give the robot's rotation.

    Raises:
        RunFileError: No columns give a rotation, or several kinds do.
    """
    ways = {"matrix": MATRIX, "named": NAMED_QUAT, "listed": LISTED_QUAT, "yaw": ("yaw",), "yaw_deg": ("yaw_deg",)}
    found = [way for way, names in ways.items() if table.has(*names)]
    if not found:
        raise _missing(table, "a quaternion (qx,qy,qz,qw), yaw, yaw_deg or a 4x4 matrix")
    if len(found) > 1:
        raise RunFileError(
            f"{table.where}: found rotations twice ({' and '.join(found)}); expected one. "
            "Leave one out; --columns with '-' leaves columns of a CSV file out."
        )
    return "yaw" if found[0] == "yaw_deg" else found[0]  # type: ignore[return-value]


def _yaws_and_tilts(
    table: PoseTable, reading: PoseReading, start: Pose
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """World yaw and camera tilt of each row (T,), radians."""
    way, frame = _rotation(table), reading.frame
    is_turned_camera = reading.poses == "camera" and way != "yaw"
    tilts = table.angles("tilt")
    if tilts is not None and is_turned_camera:
        raise RunFileError(
            f"{table.where}: found a tilt beside a camera's rotation, which has one; expected one of them. "
            "Leave the tilt out."
        )
    tilts = np.zeros(len(table.wheres)) if tilts is None else tilts
    if is_turned_camera and reading.camera_axes is None:
        raise RunFileError(
            f"{table.where}: the camera's axes are not declared; expected opencv, opengl or flu. Give --camera-axes: "
            "opencv (z forward, y down), opengl (z back, y up; Habitat's sensors) or flu (x forward, z up)."
        )
    own = "flu" if frame in ZUP_FRAMES else "opengl"
    axes = reading.camera_axes if is_turned_camera and reading.camera_axes else own
    Rs = T_world_frame(frame, start)[:3, :3] @ _rotations(table, reading, way) @ R_agent_axes(axes).T
    yaws = np.zeros(len(table.wheres))
    for row, R in enumerate(Rs):
        yaws[row], tilt, roll = yaw_tilt_roll_from_R(R)
        _require_upright(table.wheres[row], tilt, roll, may_tilt=is_turned_camera)
        tilts[row] = tilt if is_turned_camera else tilts[row]
    return yaws, tilts


def _rotations(table: PoseTable, reading: PoseReading, way: str) -> NDArray[np.float64]:
    """Rotations (T, 3, 3) in the file's frame."""
    if (yaws := table.angles("yaw")) is not None:
        return Rs_from_yaws(yaws, frame=reading.frame)
    if reading.frame == "gps":
        raise RunFileError(f"{table.where}: found a rotation in frame gps; expected a compass. Give --frame start.")
    if way == "matrix":
        Ts = table.numbers(*MATRIX).reshape(-1, 4, 4)
        for row, T in enumerate(Ts):
            is_rigid = np.allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=_UNIT_TOLERANCE)
            if not is_rigid or np.linalg.det(T[:3, :3]) < 0 or not np.allclose(T[3], [0, 0, 0, 1], atol=1e-9):
                raise RunFileError(
                    f"{table.wheres[row]}: the matrix is not a rigid transform; expected T_frame_body: a rotation, "
                    "metres in the last column, (0, 0, 0, 1) in the last row. Write it again in row-major order."
                )
        return Ts[:, :3, :3]
    if way == "named":
        quats_xyzw = table.numbers(*NAMED_QUAT)
    elif reading.quaternion is None:
        raise RunFileError(
            f"{table.where}: the order of its quaternions is not declared; expected xyzw or wxyz. "
            "Give --quaternion: xyzw (Habitat's episodes, SciPy, ROS) or wxyz (numpy-quaternion, viser)."
        )
    else:
        quats = table.numbers(*LISTED_QUAT)
        quats_xyzw = quats if reading.quaternion == "xyzw" else quats[:, [1, 2, 3, 0]]
    norms = np.linalg.norm(quats_xyzw, axis=1)
    for row in np.flatnonzero(np.abs(norms - 1.0) > _UNIT_TOLERANCE)[:1]:
        raise RunFileError(
            f"{table.wheres[row]}: the quaternion {np.round(quats_xyzw[row], 4).tolist()} has length {norms[row]:.4f}; "
            "expected 1. Write it with four decimals or more."
        )
    return Rs_from_quats_xyzw(quats_xyzw / norms[:, None])


def _require_upright(where: str, tilt: float, roll: float, *, may_tilt: bool) -> None:
    if abs(roll) > ANGLE_TOLERANCE or (abs(tilt) > ANGLE_TOLERANCE and not may_tilt):
        expected = "no roll" if may_tilt else "a turn about the up axis only"
        raise RunFileError(
            f"{where}: the rotation is tilted by {math.degrees(tilt):.1f} and rolled by {math.degrees(roll):.1f} "
            f"degrees in the world; expected {expected}. Check --frame, --quaternion, --poses and --camera-axes."
        )


def _missing(table: PoseTable, expected: str) -> RunFileError:
    found = ", ".join(table.columns) or "none"
    return RunFileError(
        f"{table.where}: found columns {found}; expected {expected}. Known columns: {ADVERTISED}; "
        "--columns names those of a CSV file."
    )
