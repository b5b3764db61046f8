"""Runs written the way other programs log them; the formulas are written out here, not taken from sim/frames.py."""

import csv
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from sim.tasks.run_files import EpisodeRun

Y_UP = ("world", "start")
FRAMES = ("world", "zup", "ros", "start", "start-ros")
CAMERA_HEIGHT = 0.88


def positions_and_rotations(run: EpisodeRun, frame: str, *, camera: str | None = None) -> tuple[np.ndarray, Rotation]:
    """Points (T, 3) in metres and rotations of the body, or of the camera with these axes, in a frame."""
    points = np.array([pose.position for pose in run.poses])
    turns = Rotation.from_euler("YX", [[pose.yaw, pose.tilt if camera else 0.0] for pose in run.poses])
    if camera:
        points = points + np.array([0.0, CAMERA_HEIGHT, 0.0])
        own = {"opengl": np.eye(3), "opencv": np.diag([1, -1, -1]), "flu": [[0, -1, 0], [0, 0, 1], [-1, 0, 0]]}[camera]
        turns = turns * Rotation.from_matrix(own)
    if frame in ("start", "start-ros"):
        undo = Rotation.from_euler("Y", -run.start.yaw)
        points, turns = undo.apply(points - np.array(run.start.position)), undo * turns
    if frame in Y_UP:
        return points, turns
    x, y, z = points.T
    if frame == "zup":
        turned, points = Rotation.from_matrix([[1, 0, 0], [0, 0, -1], [0, 1, 0]]), np.stack([x, -z, y], axis=1)
    else:
        turned, points = Rotation.from_matrix([[0, 0, -1], [-1, 0, 0], [0, 1, 0]]), np.stack([-z, -x, y], axis=1)
    body = Rotation.identity() if camera else Rotation.from_matrix([[0, -1, 0], [0, 0, 1], [-1, 0, 0]])
    return points, turned * turns * body


def quats(rotations: Rotation, order: str) -> np.ndarray:
    """(T, 4) in the order xyzw or wxyz."""
    found = rotations.as_quat()
    return found if order == "xyzw" else found[:, [3, 0, 1, 2]]


def numbers(run: EpisodeRun) -> list[int]:
    """Habitat's number of each action."""
    order = ["stop", "forward", "left", "right", "look_up", "look_down"]
    return [order.index(step.action) for step in run.steps]


def write_csv(
    path: Path,
    run: EpisodeRun,
    frame: str,
    *,
    camera: str | None = None,
    actions: bool = True,
    delimiter: str = ",",
    named: bool = True,
    **more: Any,
) -> Path:
    """One row per pose, full precision; the first row has no action."""
    points, rotations = positions_and_rotations(run, frame, camera=camera)
    rows = [[*point, *quat] for point, quat in zip(points.tolist(), quats(rotations, "xyzw").tolist(), strict=True)]
    header = ["x", "y", "z", "qx", "qy", "qz", "qw"]
    if actions:
        header.append("action")
        rows = [[*row, action] for row, action in zip(rows, ["", *numbers(run)], strict=True)]
    if named:
        header += ["split", "scene", "episode_id"]
        rows = [[*row, *run.key] for row in rows]
    for name, value in more.items():
        header.append(name)
        rows = [[*row, value] for row in rows]
    with path.open("w", newline="") as file:
        file.write("# a log of another program\n")
        writer = csv.writer(file, delimiter=delimiter)
        writer.writerows([header, *rows])
    return path


def write_json(
    path: Path, runs: list[EpisodeRun], frame: str, *, order: str, camera: str | None = None, actions: bool = True
) -> Path:
    """Writes one object per episode, with arrays of positions and rotations, and returns `path`."""
    episodes = []
    for run in runs:
        points, rotations = positions_and_rotations(run, frame, camera=camera)
        episode: dict[str, Any] = {
            "split": run.key.split,
            "scene_id": f"hm3d/val/{run.key.scene}.basis.glb",
            "episode_id": run.key.episode_id,
            "positions": points.tolist(),
            "rotations": quats(rotations, order).tolist(),
            "allow_sliding": run.start.allow_sliding,
        }
        if actions:
            episode["actions"] = [step.action for step in run.steps]
        else:
            episode["stopped"] = run.end.reason == "stop"
        episodes.append(episode)
    path.write_text(json.dumps({"episodes": episodes}))
    return path


def write_npz(
    path: Path, run: EpisodeRun, frame: str, *, camera: str | None = None, actions: bool = True, **more: Any
) -> Path:
    """Writes poses as matrices (T, 4, 4) and returns `path`."""
    points, rotations = positions_and_rotations(run, frame, camera=camera)
    matrices = np.tile(np.eye(4), (len(points), 1, 1))
    matrices[:, :3, :3], matrices[:, :3, 3] = rotations.as_matrix(), points
    named = {"split": run.key.split, "scene": run.key.scene, "episode_id": run.key.episode_id}
    told = {"actions": np.array(numbers(run))} if actions else {"stopped": run.end.reason == "stop"}
    np.savez(path, poses=matrices, allow_sliding=run.start.allow_sliding, **named, **told, **more)
    return path


def write_gps(path: Path, run: EpisodeRun) -> Path:
    """Habitat's observations: 2-D GPS (forward, right) and compass."""
    points, _ = positions_and_rotations(run, "start")
    compass = [math.remainder(pose.yaw - run.start.yaw, 2 * math.pi) for pose in run.poses]
    records = [
        {"observations": {"gps": [-z, x], "compass": [angle]}, "action": action}
        for (x, _, z), angle, action in zip(points.tolist(), compass, [None, *numbers(run)], strict=True)
    ]
    path.write_text(json.dumps({**run.key._asdict(), "steps": records}))
    return path
