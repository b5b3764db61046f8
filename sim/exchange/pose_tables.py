"""Rows of other programs' pose files in any format: named columns of one episode, read but not yet converted.

CSV, JSON and npz readers make these tables; `pose_files` turns them into poses of our world.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sim.errors import RunFileError, short

MAX_BYTES = 64 * 2**20
"""Largest file that is read: about 1,000 episodes of 500 steps as CSV."""

POSITION, PLANAR, GPS = ("x", "y", "z"), ("p0", "p1"), ("forward", "right")
NAMED_QUAT = ("qx", "qy", "qz", "qw")
LISTED_QUAT = ("r0", "r1", "r2", "r3")
"""Columns of a quaternion whose order the file does not give."""
MATRIX = tuple(f"m{row}{col}" for row in range(4) for col in range(4))
NUMBERS = (*POSITION, *PLANAR, *GPS, *NAMED_QUAT, *LISTED_QUAT, *MATRIX)
SCALARS = ("yaw", "yaw_deg", "tilt", "tilt_deg", "t_s", "timestamp", "step")
NAMES = ("split", "scene", "episode_id", "episode", "stopped", "allow_sliding")
COLUMNS = (*NUMBERS, *SCALARS, "action", *NAMES)
ADVERTISED = "x,y,z, qx,qy,qz,qw or yaw or yaw_deg, action, t_s, tilt, stopped, split,scene,episode_id; forward,right"
"""Names of the columns in error texts."""

_ALIASES = {
    **{f"{before}{axis}": axis for before in ("t", "pos_", "position_") for axis in POSITION},
    **{f"{before}{axis[1]}": axis for before in ("quat_", "rotation_") for axis in NAMED_QUAT},
    **{"theta": "yaw", "compass": "yaw", "yaws": "yaw", "theta_deg": "yaw_deg", "tilts": "tilt"},
    **{"gps_forward": "forward", "gps_right": "right"},
    **{"t": "timestamp", "time": "timestamp", "timestamps": "timestamp", "time_s": "t_s", "actions": "action"},
    **{"scene_id": "scene", "stop": "stopped"},
}
_VECTORS: dict[str, dict[int, tuple[str, ...]]] = {
    "position": {3: POSITION, 2: PLANAR},
    "rotation": {4: LISTED_QUAT},
    "pose": {7: (*POSITION, *LISTED_QUAT), 4: (*POSITION, "yaw"), 16: MATRIX},
    "gps": {2: GPS},
}
_VECTOR_ALIASES = {
    **{"positions": "position", "rotations": "rotation", "poses": "pose", "matrices": "pose"},
    **{"quaternion": "rotation", "quaternions": "rotation", "orientation": "rotation", "orientations": "rotation"},
}


@dataclass(frozen=True, slots=True)
class PoseTable:
    """One episode's rows in the file's own conventions."""

    where: str
    """The file, and the place of the episode in it."""
    path: Path
    wheres: tuple[str, ...]
    """`file:line` of each row."""
    columns: Mapping[str, Sequence[object]]
    """Columns by name (`COLUMNS`), one value per row, None for an empty cell; frames and orders are not applied yet."""
    actions: tuple[object, ...] | None = None
    """One action per row, or one fewer; None = the file has none."""
    facts: Mapping[str, object] = field(default_factory=dict)
    """Facts about the whole episode in the file (`NAMES`)."""
    ignored: tuple[str, ...] = ()
    """Columns that we do not use."""

    def has(self, *names: str) -> bool:
        """Whether all these columns are there."""
        return all(name in self.columns for name in names)

    def numbers(self, *names: str) -> NDArray[np.float64]:
        """Finite values (T, K) of K columns.

        Raises:
            RunFileError: A value is missing, not a number, or not finite.
        """
        return np.array([[self._number(name, row) for name in names] for row in range(len(self.wheres))], np.float64)

    def angles(self, name: str) -> NDArray[np.float64] | None:
        """(T,) radians of a column that is in radians or, as `<name>_deg`, in degrees; None without either."""
        if self.has(name):
            return self.numbers(name)[:, 0]
        return np.radians(self.numbers(f"{name}_deg")[:, 0]) if self.has(f"{name}_deg") else None

    def _number(self, name: str, row: int) -> float:
        value = self.columns[name][row]
        number = number_of(value)
        if number is None:
            found = "missing" if value is None else short(value)
            raise RunFileError(
                f"{self.wheres[row]}: {name} is {found}; expected a finite number in every row. "
                "Write the row again, or leave the column out of all rows."
            )
        return number


def canonical(name: str) -> str | None:
    """Our name of a column, or None."""
    name = name.strip().lower()
    name = _ALIASES.get(name, name)
    return name if name in COLUMNS else None


def vector_name(name: str) -> str | None:
    """`position`, `rotation`, `pose` or `gps` when a field holds one of these, or None."""
    name = name.strip().lower()
    name = _VECTOR_ALIASES.get(name, name)
    return name if name in _VECTORS else None


def vector_columns(where: str, name: str, length: int) -> tuple[str, ...]:
    """The columns in a vector of this length.

    Raises:
        RunFileError: The field cannot have this length.
    """
    if length not in _VECTORS[name]:
        expected = {"pose": "7 (x,y,z and a quaternion), 4 (x,y,z,yaw) or a 4x4 matrix"}.get(
            name, " or ".join(str(count) for count in _VECTORS[name])
        )
        raise RunFileError(f"{where}: {name} has {length} numbers; expected {expected}. Write the row again.")
    return _VECTORS[name][length]


def number_of(value: object) -> float | None:
    """The value as a finite number, from a number or a text; None for anything else."""
    if isinstance(value, bool) or not isinstance(value, (int, float, str, np.integer, np.floating)):
        return None
    try:
        number = float(value)
    except (ValueError, OverflowError):
        return None
    return number if math.isfinite(number) else None


def truth_of(where: str, name: str, value: object) -> bool:
    """A yes or no, given as a bool, a number or text.

    Raises:
        RunFileError: The value is something else.
    """
    text = str(value).strip().lower()
    if text in ("true", "1", "1.0", "yes"):
        return True
    if text in ("false", "0", "0.0", "no", "", "none"):
        return False
    raise RunFileError(f"{where}: {name} is {short(value)}; expected true or false. Write it again.")


def read_limited(path: Path) -> bytes:
    """All bytes of a file.

    Raises:
        RunFileError: The file cannot be read, or is larger than `MAX_BYTES`.
    """
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise RunFileError(f"{path}: cannot be read ({error}); expected a pose file. Check the path.") from None
    if len(data) > MAX_BYTES:
        raise RunFileError(
            f"{path}: is larger than {MAX_BYTES >> 20} MiB; expected pose files up to that. "
            "Write one file per scene or episode and give all of them."
        )
    return data


def read_text(path: Path) -> str:
    """The text of a file.

    Raises:
        RunFileError: The file cannot be read, is too large, or is not UTF-8 text.
    """
    try:
        text = read_limited(path).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise RunFileError(f"{path}: is not UTF-8 text ({error}); expected text. Save it as UTF-8.") from None
    if "\0" in text:
        raise RunFileError(f"{path}: holds NUL characters; expected text. Save it as UTF-8.")
    return text
