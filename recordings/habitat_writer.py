"""Write PersONAL Workbench run files from a Habitat program. Copy this ONE file next to it: stdlib only, Python 3.8+.

    writer = RunWriter("vlfm.jsonl")
    for episode in env.episodes:
        env.reset(); state = env.sim.get_agent_state()
        writer.start_episode("easy", episode.scene_id, episode.episode_id, state.position, state.rotation)
        while not env.episode_over:
            env.step(action); state = env.sim.get_agent_state()
            writer.step(action, state.position, state.rotation, collided=env.sim.previous_step_collided)
        writer.end_episode()

Then `personal-viz import vlfm.jsonl --who VLFM ...` checks every step and computes all measures itself; nothing that a
program says about its own success is read. Positions: the robot's feet, metres, y up (`agent_state.position`).
Rotations: the body's (`agent_state.rotation`), never a sensor's.
"""

from __future__ import annotations

import json
import math
import os
import re
from typing import Any, SupportsIndex

SCHEMA_VERSION = 1
ACTIONS = ("stop", "forward", "left", "right", "look_up", "look_down")
"""Habitat's numbers 0-5 in this order; habitat-lab's names (move_forward, turn_left, ...) are understood too."""
REASONS = ("stop", "steps", "giveup", "timeout", "technical", "abandoned")
SPLITS = ("easy", "medium", "hard")
MAX_STEPS = 500
TURN = math.radians(30)
_UNIT_TOLERANCE = 1e-3
_LAB_NAMES = {"move_forward": "forward", "turn_left": "left", "turn_right": "right"}
_FIRST_BYTES = b'{"kind": "episode"'
_NAME = re.compile(r"[A-Za-z0-9_-]{1,64}\Z")


class RunWriter:
    """Appends finished episodes to a JSONL file; each is on disk, whole, when `end_episode` returns."""

    def __init__(self, path: str | os.PathLike[str], *, agent: str | None = None) -> None:
        """Opens the file for appending; an incomplete last episode (a killed program) is cut off.

        Args:
            path: The file, made if missing; or an existing folder, in which the file is `<agent>.jsonl`.
            agent: Name for the file inside a folder. The name in tables is given when the file is imported.

        Raises:
            ValueError: `path` is a folder and `agent` is missing or not a plain name, the file's folder is missing, or
                the file holds something other than episodes.
        """
        path = os.fspath(path)
        if os.path.isdir(path):
            if agent is None or not _NAME.match(agent):
                raise ValueError(
                    f"path is the folder {path!r} and agent is {agent!r}; expected agent to be 1-64 letters, digits, _ "
                    "or -, because it names the file. Give agent='myagent', or a file name as path."
                )
            path = os.path.join(path, agent + ".jsonl")
        folder = os.path.dirname(path) or "."
        if not os.path.isdir(folder):
            raise ValueError(f"path is {path!r}; expected its folder {folder!r} to exist. Make it first.")
        self.path = path
        self._lines: list[dict[str, Any]] = []
        self._open = False
        self._last_action: str | None = None
        self._tilt = 0.0
        _cut_incomplete_tail(path)

    def start_episode(
        self,
        split: str,
        scene_id_or_name: str,
        episode_id: SupportsIndex | str,
        position: Any,
        rotation_xyzw: Any,
        allow_sliding: bool = False,
    ) -> None:
        """Begins an episode at its start pose, before the first action.

        Args:
            split: "easy", "medium" or "hard".
            scene_id_or_name: `TEEsavR23oF`, or Habitat's whole `scene_id` path.
            episode_id: As in the dataset file, or habitat-lab's own number (its place in the file).
            position: Feet, world metres, 3 numbers in any sequence or array.
            rotation_xyzw: 4 numbers [x, y, z, w], or an object with x, y, z, w (numpy-quaternion) or vector and scalar
                (Magnum). Must be a unit quaternion about +y.
            allow_sliding: Whether the simulator lets the robot slide along walls.

        Raises:
            ValueError: The last episode has not ended, or an argument is not as described.
        """
        if self._open:
            raise ValueError("start_episode: the last episode has not ended; call end_episode first.")
        if split not in SPLITS:
            raise ValueError(f"start_episode: split is {split!r}; expected one of {list(SPLITS)}.")
        scene = re.split(r"[/\\]", str(scene_id_or_name))[-1].split(".", 1)[0]
        for field, value in (("scene", scene), ("episode_id", str(episode_id))):
            if not _NAME.match(value):
                raise ValueError(
                    f"start_episode: {field} is {value!r}; expected 1-64 letters, digits, _ or -. "
                    "Give the name as it is in the dataset file."
                )
        line = {
            "kind": "episode",
            "schema_version": SCHEMA_VERSION,
            "split": split,
            "scene": scene,
            "episode_id": str(episode_id),
            "position": _vector("start_episode", position),
            "yaw": _yaw("start_episode", rotation_xyzw),
            "allow_sliding": bool(allow_sliding),
        }
        self._lines = [line]
        self._open, self._last_action, self._tilt = True, None, 0.0

    def step(
        self,
        action: SupportsIndex | str,
        position: Any,
        rotation_xyzw: Any,
        tilt: float | None = None,
        collided: bool = False,
        t_s: float = 0.0,
    ) -> None:
        """Adds one action and the body's pose after it.

        Args:
            action: 0-5, or its name (`ACTIONS` or habitat-lab's names).
            position: As in `start_episode`.
            rotation_xyzw: As in `start_episode`.
            tilt: Camera tilt in radians, positive looks up; None = counted from the look actions, 30 degrees each.
            collided: Habitat's flag for this action; the import computes it again from the positions.
            t_s: Seconds since the episode's start, for replays; 0 if time was not measured.

        Raises:
            ValueError: No episode is open, it has stopped, has 500 steps, or an argument is not as described.
        """
        if not self._open:
            raise ValueError("step: no episode is open; call start_episode first.")
        if self._last_action == "stop":
            raise ValueError("step: the episode has stopped; expected no action after it. Call end_episode.")
        if len(self._lines) > MAX_STEPS:
            raise ValueError(f"step: the episode has {MAX_STEPS} steps; expected no more. Call end_episode.")
        name = _action(action)
        if tilt is None:
            tilt = self._tilt + TURN * ((name == "look_up") - (name == "look_down"))
        line = {
            "kind": "step",
            "action": name,
            "position": _vector("step", position),
            "yaw": _yaw("step", rotation_xyzw),
            "tilt": _number("step", "tilt", tilt),
            "collided": bool(collided),
            "t_s": _number("step", "t_s", t_s),
        }
        self._lines.append(line)
        self._last_action, self._tilt = name, line["tilt"]

    def end_episode(self, reason: str | None = None) -> None:
        """Ends the episode and writes it, with the reason: "stop", "steps" (500 without STOP), or why it was aborted.

        Args:
            reason: One of `REASONS`; None = "stop" or "steps", whichever happened.

        Raises:
            ValueError: No episode is open, or the reason does not fit the actions.
        """
        if not self._open:
            raise ValueError("end_episode: no episode is open; call start_episode first.")
        num_steps = len(self._lines) - 1
        happened = "stop" if self._last_action == "stop" else "steps" if num_steps == MAX_STEPS else None
        broken_off = happened is None and reason in REASONS and reason not in ("stop", "steps")
        if not broken_off and (happened is None or reason not in (None, happened)):
            expected = repr(happened) if happened else f"one of {list(REASONS[2:])}"
            raise ValueError(
                f"end_episode: reason is {reason!r} after {num_steps} steps, the last of which is "
                f"{self._last_action!r}; expected {expected}."
            )
        self._lines.append({"kind": "end", "reason": reason or happened})
        block = "".join(json.dumps(line, allow_nan=False) + "\n" for line in self._lines)
        with open(self.path, "a", encoding="utf-8") as file:
            file.write(block)
            file.flush()
            os.fsync(file.fileno())
        self._lines, self._open = [], False


def _action(action: SupportsIndex | str) -> str:
    """Our name of an action given as a number (numpy's too) or a name."""
    if isinstance(action, str):
        name = _LAB_NAMES.get(action.lower(), action.lower())
        if name in ACTIONS:
            return name
    elif hasattr(action, "__index__") and not isinstance(action, bool) and 0 <= int(action) < len(ACTIONS):
        return ACTIONS[int(action)]
    raise ValueError(f"step: action is {action!r}; expected 0-5 or one of {list(ACTIONS)}.")


def _number(where: str, field: str, value: Any) -> float:
    """A finite float."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise ValueError(f"{where}: {field} is {value!r}; expected a finite number.")
    return number


def _vector(where: str, position: Any) -> list[float]:
    """Three finite floats from any sequence."""
    try:
        values = list(position)
    except TypeError:
        values = []
    if len(values) != 3:
        raise ValueError(f"{where}: position is {position!r}; expected 3 numbers (x, y, z) in metres.")
    return [_number(where, "position", value) for value in values]


def _yaw(where: str, rotation: Any) -> float:
    """Radians about +y of a unit quaternion that turns about +y only."""
    if hasattr(rotation, "vector") and hasattr(rotation, "scalar"):
        values = [*rotation.vector, rotation.scalar]
    elif all(hasattr(rotation, axis) for axis in "xyzw"):
        values = [rotation.x, rotation.y, rotation.z, rotation.w]
    else:
        try:
            values = list(rotation)
        except TypeError:
            values = []
    if len(values) != 4:
        raise ValueError(f"{where}: rotation is {rotation!r}; expected a quaternion [x, y, z, w].")
    x, y, z, w = (_number(where, "rotation", value) for value in values)
    norm = math.sqrt(x * x + y * y + z * z + w * w)
    if abs(norm - 1.0) > _UNIT_TOLERANCE:
        raise ValueError(f"{where}: rotation {values!r} has length {norm:.4f}; expected a unit quaternion.")
    if math.hypot(x, z) > _UNIT_TOLERANCE:
        raise ValueError(
            f"{where}: rotation {values!r} tilts; expected a turn about +y only, [0, sin(yaw/2), 0, cos(yaw/2)]. "
            "Give the body's rotation, not the camera's, in the order x, y, z, w."
        )
    yaw = 2.0 * math.atan2(y, w)
    return math.pi - (math.pi - yaw) % (2.0 * math.pi)


def _cut_incomplete_tail(path: str) -> None:
    """Removes everything after the last whole episode; never touches a file that is not ours."""
    if not os.path.isfile(path):
        return
    whole, size, tail = 0, 0, b""
    with open(path, "rb") as file:
        for line in file:
            size += len(line)
            tail = tail or line
            if line.endswith(b"\n") and _is_end(line):
                whole, tail = size, b""
    if whole == size:
        return
    if tail[: len(_FIRST_BYTES)] != _FIRST_BYTES[: len(tail)]:
        raise ValueError(f"path is {path!r}, which holds something else than episodes; give the name of a new file.")
    with open(path, "r+b") as file:
        file.truncate(whole)


def _is_end(line: bytes) -> bool:
    try:
        parsed = json.loads(line.decode("utf-8"))
    except ValueError:
        return False
    return isinstance(parsed, dict) and parsed.get("kind") == "end"
