"""Pose files as NumPy archives: one episode per file; nothing pickled is ever loaded."""

import io
import math
import zipfile
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sim.errors import RunFileError

from .pose_tables import MAX_BYTES, NAMES, SCALARS, PoseTable, canonical, read_limited, vector_columns, vector_name

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
            return {info.filename.removesuffix(".npy"): _array(path, archive, info) for info in archive.infolist()}
    except (zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError, EOFError) as error:
        raise RunFileError(f"{path}: is no .npz file ({error}); expected {_EXPECTED}. Write it again.") from None


def _array(path: Path, archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> NDArray[np.generic]:
    """One array; its announced size is compared with its bytes before anything is allocated."""
    where = f"{path}: {info.filename}"
    with archive.open(info) as member:
        data = member.read(MAX_BYTES + 1)
    if len(data) > MAX_BYTES:
        raise RunFileError(
            f"{where} holds more than {MAX_BYTES >> 20} MiB; expected one episode's poses. Save pictures elsewhere."
        )
    stream = io.BytesIO(data)
    try:
        version = np.lib.format.read_magic(stream)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, dtype = read(stream)
        if dtype.hasobject:
            raise RunFileError(f"{where} is pickled; expected plain numbers or text. Save it without objects.")
        left = len(data) - stream.tell()
        if math.prod(shape) * dtype.itemsize != left:
            raise RunFileError(
                f"{where} announces {shape} x {dtype.itemsize} bytes but holds {left}; "
                "expected as many. Write it again."
            )
        stream.seek(0)
        return np.lib.format.read_array(stream, allow_pickle=False)
    except (ValueError, SyntaxError, TypeError) as error:
        raise RunFileError(f"{where} is no NumPy array ({error}); expected {_EXPECTED}. Write it again.") from None


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
