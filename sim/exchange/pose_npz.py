"""Pose files as NumPy archives: one episode per file; nothing pickled is ever loaded."""

import io
import zipfile
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sim.errors import RunFileError
from sim.files import TooLargeError, npy_array, require_small_archive

from .pose_tables import NAMES, SCALARS, PoseTable, canonical, read_limited, vector_columns, vector_name

MAX_UNPACKED = 16 << 20
"""Of all arrays of a file; an episode of 500 steps has 60 kB."""
MAX_ARRAYS = 100
_EXPECTED = (
    "arrays positions (T, 3) with rotations (T, 4) or yaw (T,), or poses (T, 7) or (T, 4, 4); and, if you have them, "
    "actions, t_s, tilt, stopped, split, scene, episode_id"
)


def read_npz_table(path: Path) -> PoseTable:
    """The episode of a `.npz` file.

    Raises:
        RunFileError: The file is no archive of plain arrays, is too large, or its arrays do not fit together.
    """
    columns: dict[str, list[object]] = {}
    facts: dict[str, object] = {}
    actions: tuple[object, ...] | None = None
    ignored = []
    first_array = ""
    for name, array in _read_arrays(path).items():
        where, scalar, vector = f"{path}: {name}", canonical(name), vector_name(name)
        if scalar in NAMES and array.size == 1:
            facts[scalar] = array.reshape(-1)[0].item()
        elif scalar == "action":
            actions = tuple(_column(where, array))
        elif vector is not None or scalar in SCALARS:
            first_array = first_array or name
            more = _vectors(where, vector, array) if vector else {str(scalar): _column(where, array)}
            _add(where, columns, more)
        else:
            ignored.append(name)
    if not columns:
        raise RunFileError(f"{path}: found arrays {ignored}; expected {_EXPECTED}. Save them with numpy.savez.")
    length = len(next(iter(columns.values())))
    wheres = tuple(f"{path}: {first_array}[{row}]" for row in range(length))
    return PoseTable(str(path), path, wheres, columns, actions, facts, tuple(ignored))


def _read_arrays(path: Path) -> dict[str, NDArray[np.generic]]:
    try:
        with zipfile.ZipFile(io.BytesIO(read_limited(path))) as archive:
            require_small_archive(archive, most=MAX_UNPACKED, most_members=MAX_ARRAYS)
            return {info.filename.removesuffix(".npy"): _array(path, archive, info) for info in archive.infolist()}
    except TooLargeError as error:
        raise RunFileError(
            f"{path}: {error}; expected one episode's poses, {MAX_UNPACKED >> 20} MB at most in {MAX_ARRAYS} arrays. "
            "Save pictures elsewhere."
        ) from None
    except (zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError, EOFError) as error:
        raise RunFileError(f"{path}: is no .npz file ({error}); expected {_EXPECTED}. Write it again.") from None


def _array(path: Path, archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> NDArray[np.generic]:
    try:
        return npy_array(archive.read(info))
    except (ValueError, SyntaxError, TypeError) as error:
        raise RunFileError(
            f"{path}: {info.filename} is no NumPy array ({error}); expected {_EXPECTED}. Write it again."
        ) from None


def _column(where: str, array: NDArray[np.generic]) -> list[object]:
    if array.ndim == 2 and array.shape[1] == 1:
        array = array[:, 0]
    if array.ndim != 1:
        raise RunFileError(f"{where} has shape {array.shape}; expected (T,). Save it again.")
    return array.tolist()


def _vectors(where: str, name: str, array: NDArray[np.generic]) -> dict[str, list[object]]:
    if name == "pose" and array.ndim == 3 and array.shape[1:] == (4, 4):
        array = array.reshape(len(array), 16)
    if array.ndim != 2:
        raise RunFileError(f"{where} has shape {array.shape}; expected (T, numbers per row). Save it again.")
    names = vector_columns(where, name, array.shape[1])
    return dict(zip(names, array.T.tolist(), strict=True))


def _add(where: str, columns: dict[str, list[object]], more: dict[str, list[object]]) -> None:
    length = len(next(iter(columns.values()))) if columns else None
    for name, values in more.items():
        if name in columns:
            raise RunFileError(f"{where}: gives {name} a second time; expected it once. Leave one array out.")
        if length is not None and len(values) != length:
            raise RunFileError(f"{where}: has {len(values)} rows; expected {length} as before. Save it again.")
        columns[name] = values
