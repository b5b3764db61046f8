"""All frame conversions of the project. World frame = Habitat: right-handed, metres, +y up.

            +y (up)
             |
             |____ +x (right)        agent looks along -z at yaw 0; positive yaw turns left
            /
          +z (towards you)

Frames: `world`; `glb` = a file's own axes (HM3D is z-up); `agent` = on the floor under the robot, -z forward;
`camera` = OpenCV (+x right, +y down, +z forward); `start` = world re-based to the episode's start pose.
"""

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from .types import Camera, Pose

R_agent_camera = np.diag([1.0, -1.0, -1.0])
"""(3, 3): OpenCV camera axes in the agent's axes, without tilt."""
T_world_glb_zup = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
"""(4, 4): z-up file (HM3D) to world: (x, y, z) -> (x, z, -y)."""
R_agent_flu = np.array([[0.0, -1, 0], [0, 0, 1], [-1, 0, 0]])
"""(3, 3): ROS body axes (x forward, y left, z up) in the agent's axes."""
CameraAxes = Literal["opencv", "opengl", "flu"]
"""Axes of a camera in another program: `opencv` as ours; `opengl` +x right, +y up, -z forward (Habitat's sensors);
`flu` +x forward, +y left, +z up (ROS camera_link)."""
PoseFrame = Literal["world", "zup", "ros", "start", "start-ros", "gps"]
"""Frames in which another program may write poses; each is declared, never guessed.

| name | axes of the frame | body at yaw 0 | origin |
|---|---|---|---|
| `world` | Habitat: x right, y up, z back | looks along -z | the scene's |
| `zup` | HM3D's files: world (x, -z, y), z up | looks along +x | the scene's |
| `ros` | world (-z, -x, y), z up (OneMap's logs) | looks along +x | the scene's |
| `start` | x right, y up, z back at the episode's start | looks along -z | the start pose |
| `start-ros` | x forward, y left, z up at the start (VLFM) | looks along +x | the start pose |
| `gps` | 2-D: Habitat's GPS (forward, right); yaw is its compass | looks forward | the start pose |

Positive yaw turns left in all of them. The body's own axes are the agent's where y is up, `flu` where z is up.
"""
POSE_FRAMES: tuple[PoseFrame, ...] = ("world", "zup", "ros", "start", "start-ros", "gps")
ZUP_FRAMES: tuple[PoseFrame, ...] = ("zup", "ros", "start-ros")


def yaw_from_quat_xyzw(quat_xyzw: tuple[float, float, float, float]) -> float:
    """Yaw in radians of a pure-yaw quaternion [0, sin(yaw/2), 0, cos(yaw/2)], in (-pi, pi]."""
    _, y, _, w = quat_xyzw
    return wrap_angle(2.0 * math.atan2(y, w))


def quat_xyzw_from_yaw(yaw: float) -> tuple[float, float, float, float]:
    """Pure-yaw unit quaternion in Habitat's order [x, y, z, w]."""
    return (0.0, math.sin(yaw / 2), 0.0, math.cos(yaw / 2))


def wrap_angle(angle: float) -> float:
    """The same angle in (-pi, pi]."""
    return math.pi - (math.pi - angle) % (2 * math.pi)


def planar_distance(a: Sequence[float] | NDArray[np.floating], b: Sequence[float] | NDArray[np.floating]) -> float:
    """Metres between two points seen from above."""
    return math.hypot(a[0] - b[0], a[2] - b[2])


def forward_from_yaw(yaw: float) -> NDArray[np.float64]:
    """Unit vector (3,) along which a robot with this yaw moves forward."""
    return np.array([-math.sin(yaw), 0.0, -math.cos(yaw)])


def yaw_towards(from_xz: tuple[float, float], to_xz: tuple[float, float]) -> float:
    """Yaw in radians of a robot at `from_xz` that faces `to_xz`."""
    return math.atan2(from_xz[0] - to_xz[0], from_xz[1] - to_xz[1])


def T_world_agent(pose: Pose) -> NDArray[np.float64]:
    """(4, 4) of the robot's base in the world."""
    cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
    T = np.eye(4)
    T[:3, :3] = [[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]]
    T[:3, 3] = pose.position
    return T


def T_world_camera(pose: Pose, camera: Camera) -> NDArray[np.float64]:
    """(4, 4) of the camera (OpenCV axes) in the world; tilt turns it about its own x axis."""
    cos, sin = math.cos(pose.tilt), math.sin(pose.tilt)
    T_agent_camera = np.eye(4)
    T_agent_camera[:3, :3] = np.array([[1, 0, 0], [0, cos, -sin], [0, sin, cos]]) @ R_agent_camera
    T_agent_camera[1, 3] = camera.mount_height
    return T_world_agent(pose) @ T_agent_camera


def T_start_camera(start: Pose, pose: Pose, camera: Camera) -> NDArray[np.float64]:
    """(4, 4) of the camera in the start frame, the only pose that an agent is told."""
    return np.linalg.inv(T_world_agent(start)) @ T_world_camera(pose, camera)


def gps_from_poses(start: Pose, pose: Pose) -> tuple[float, float]:
    """(forward, right) metres of `pose` seen from `start` (Habitat's 2-D GPS)."""
    offset = np.linalg.inv(T_world_agent(start)) @ np.array([*pose.position, 1.0])
    return (float(-offset[2]), float(offset[0]))


def world_from_glb_zup(points_glb: NDArray[np.floating]) -> NDArray[np.floating]:
    """World points of a z-up file's points; (N, 3) in and out."""
    return points_glb @ T_world_glb_zup[:3, :3].T.astype(points_glb.dtype)


def glb_zup_from_world(points: NDArray[np.floating]) -> NDArray[np.floating]:
    """A z-up file's points of world points; (N, 3) in and out."""
    return points @ T_world_glb_zup[:3, :3].astype(points.dtype)


def T_world_frame(frame: PoseFrame, start: Pose) -> NDArray[np.float64]:
    """(4, 4) of the frame of another program's poses; `start` is the episode's start pose."""
    T = np.eye(4)
    if frame == "zup":
        return T_world_glb_zup.copy()
    if frame in ("ros", "start-ros"):
        T[:3, :3] = R_agent_flu
    return T_world_agent(start) @ T if frame in ("start", "start-ros", "gps") else T


def R_agent_axes(axes: CameraAxes) -> NDArray[np.float64]:
    """(3, 3) of a body's or camera's own axes in the agent's axes, when both look the same way."""
    return {"opencv": R_agent_camera, "opengl": np.eye(3), "flu": R_agent_flu}[axes].copy()


def Rs_from_quats_xyzw(quats_xyzw: NDArray[np.floating]) -> NDArray[np.float64]:
    """(N, 3, 3) rotations of unit quaternions (N, 4) in the order x, y, z, w."""
    x, y, z, w = np.asarray(quats_xyzw, np.float64).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def Rs_from_yaws(yaws: NDArray[np.floating], *, frame: PoseFrame) -> NDArray[np.float64]:
    """(N, 3, 3) rotations of bodies with these yaws (N,) about the frame's up axis."""
    halves = np.asarray(yaws, np.float64) / 2
    zeros, up = np.zeros_like(halves), np.sin(halves)
    parts = [zeros, zeros, up] if frame in ZUP_FRAMES else [zeros, up, zeros]
    return Rs_from_quats_xyzw(np.stack([*parts, np.cos(halves)], axis=1))


def yaw_tilt_roll_from_R(R_world_body: NDArray[np.floating]) -> tuple[float, float, float]:
    """(yaw, tilt, roll) in radians of a body or camera in the agent's axes (-z forward): turned, tilted, then rolled.

    Roll is how far the body's x axis leaves the horizontal; where it is 0, tilt may be any angle in (-pi, pi].
    """
    R = R_world_body
    roll = math.asin(max(-1.0, min(1.0, float(R[1, 0]))))
    return (
        wrap_angle(math.atan2(-R[2, 0], R[0, 0])),
        wrap_angle(math.atan2(-R[1, 2], R[1, 1])),
        roll,
    )
