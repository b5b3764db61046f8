"""Maps on disk: one `.npz` per home, plain arrays beside a JSON header; nothing pickled is ever written or loaded.

`HomeMemory` -> `save_memory` -> `load_memory` gives the same bits. The header (maps/header.py) names encoder,
dimension, frame and cells, so that a query with another encoder is refused before any cosine is computed.
"""

import io
import json
import zipfile
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from sim.errors import RunFileError, line_from_validation_error
from sim.files import MAX_JSON_VALUES, TooLargeError, npy_array, require_few_values, require_small_archive, write_whole

from ..encoders.protocol import TextEncoder
from ..types import require_same_encoder
from .arrays import MapArrays, arrays_of_storey, storey_of_arrays
from .header import SCHEMA_VERSION, MapHeader, StoreyHeader
from .header import MapSource as MapSource
from .home_map import HomeMemory, ObjectMap, StoreyMemory

MAX_BYTES, MAX_RATIO = 128 << 20, 64
"""Largest unpacked size of all arrays of a file together in bytes, and per byte of the file. A storey of 50 x 50 m in
cells of 0.25 m with 768 numbers each unpacks to 117 MiB."""
_HEADER = "header.json"
_EXPECTED = "a map written by personal-viz (header.json and arrays)"
_AGAIN = "Build the map again, e.g. with personal-viz map or explore."


def save_memory(path: Path, memory: HomeMemory, source: MapSource) -> None:
    """Writes a map and makes its folder; at any time the file is either the complete old one or the complete new one.

    Raises:
        RunFileError: The memory is empty, its storeys differ in encoder or layout, or the file cannot be written.
    """
    layouts = {"objects" if isinstance(item.memory, ObjectMap) else "grid" for item in memory.storeys}
    spaces = {(item.memory.encoder, item.memory.dim) for item in memory.storeys}
    if len(layouts) != 1 or len(spaces) != 1:
        raise RunFileError(
            f"{path}: the map has {len(memory.storeys)} storeys of layouts {sorted(layouts)} and encoders "
            f"{sorted(spaces)}; expected at least one storey, one layout and one encoder. Add frames, or save apart."
        )
    ((encoder, dim),), (layout,) = spaces, layouts
    header = MapHeader(
        source=source,
        layout="objects" if layout == "objects" else "grid",
        encoder=encoder,
        dim=dim,
        frame=memory.frame,
        num_frames=memory.num_frames,
        storeys=tuple(_storey_header(item) for item in memory.storeys),
    )
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        _put(archive, _HEADER, header.model_dump_json(indent=1).encode())
        for index, storey in enumerate(memory.storeys):
            for name, array in arrays_of_storey(storey).items():
                stream = io.BytesIO()
                np.lib.format.write_array(stream, np.ascontiguousarray(array), allow_pickle=False)
                _put(archive, f"storey{index}/{name}.npy", stream.getvalue())
    try:
        write_whole(path, content.getvalue())
    except OSError as error:
        raise RunFileError(
            f"{path}: cannot be written ({error.strerror}); expected a folder with room that you may write. "
            "Give another file."
        ) from None


def load_memory(path: Path, *, encoder: TextEncoder | None = None) -> HomeMemory:
    """The map in a file, bit for bit.

    Args:
        path: Written by `save_memory`.
        encoder: The encoder of later queries; None = not known yet (grounders check it then).

    Raises:
        RunFileError: The file is missing, damaged, of another version, or not a map.
        AgentError: The map was made with another encoder.
    """
    with _opened(path) as archive:
        header = _header(path, archive)
        if encoder is not None:
            require_same_encoder((header.encoder, header.dim), (encoder.name, encoder.dim), where=str(path))
        storeys = []
        for index, storey in enumerate(header.storeys):
            parts = MapArrays(str(path), f"storey{index}", lambda name: _array(path, archive, name))
            storeys.append(storey_of_arrays(parts, header, storey))
    return HomeMemory(tuple(storeys), header.frame, header.num_frames)


def read_map_header(path: Path) -> MapHeader:
    """The header of a map file, without its arrays.

    Raises:
        RunFileError: The file is missing, damaged, of another version, or not a map.
    """
    with _opened(path) as archive:
        return _header(path, archive)


def _storey_header(storey: StoreyMemory) -> StoreyHeader:
    memory = storey.memory
    has_objects = isinstance(memory, ObjectMap)
    return StoreyHeader(
        floor_y=memory.floor_y,
        centre_xz=memory.centre_xz,
        occupancy=storey.occupancy.grid,
        grid=None if has_objects else memory.grid,
        merge_m=memory.merge_m if has_objects else None,
        captions=tuple(item.caption for item in memory.objects) if has_objects else None,
    )


def _put(archive: zipfile.ZipFile, name: str, data: bytes) -> None:
    """Writes an entry without a time stamp, so that the same map gives the same bytes."""
    entry = zipfile.ZipInfo(name)
    entry.compress_type = zipfile.ZIP_DEFLATED
    archive.writestr(entry, data, compresslevel=1)


def _opened(path: Path) -> zipfile.ZipFile:
    try:
        archive = zipfile.ZipFile(path)
    except FileNotFoundError:
        raise RunFileError(f"{path}: found no file; expected {_EXPECTED}. Check the path, or build the map.") from None
    except OSError as error:
        raise RunFileError(
            f"{path}: cannot be read ({error.strerror}); expected {_EXPECTED}. Check the path."
        ) from None
    except zipfile.BadZipFile as error:
        raise RunFileError(f"{path}: is no .npz file ({error}); expected {_EXPECTED}. {_AGAIN}") from None
    try:
        require_small_archive(archive, most=MAX_BYTES + MAX_RATIO * path.stat().st_size)
    except TooLargeError as error:
        archive.close()
        raise RunFileError(f"{path}: {error}; expected {_EXPECTED}. {_AGAIN}") from None
    return archive


def _header(path: Path, archive: zipfile.ZipFile) -> MapHeader:
    data = _read(path, archive, _HEADER)
    try:
        require_few_values(data, MAX_JSON_VALUES)
    except TooLargeError as error:
        raise RunFileError(f"{path}: {_HEADER} {error}; expected {_EXPECTED}. {_AGAIN}") from None
    data = _of_this_version(path, data)
    try:
        return MapHeader.model_validate_json(data)
    except ValidationError as error:
        raise RunFileError(line_from_validation_error(f"{path}: {_HEADER}", error, advice=_AGAIN)) from None


def _of_this_version(path: Path, data: bytes) -> bytes:
    """The header in the present version; what is no header stays as it is, for the model to name its fault."""
    try:
        document = json.loads(data)
        version = document["schema_version"]
    except (ValueError, KeyError, TypeError, RecursionError):
        return data
    if version == 1 and isinstance(version, int):
        return json.dumps({**document, "schema_version": SCHEMA_VERSION}).encode()
    if version != SCHEMA_VERSION:
        is_newer = isinstance(version, int) and version > SCHEMA_VERSION
        advice = "It was made by a newer version of personal-viz; update." if is_newer else _AGAIN
        raise RunFileError(f"{path}: schema_version is {version!r}; expected 1 to {SCHEMA_VERSION}. {advice}")
    return data


def _array(path: Path, archive: zipfile.ZipFile, name: str) -> NDArray[np.generic]:
    data = _read(path, archive, f"{name}.npy")
    try:
        return npy_array(data)
    except (ValueError, SyntaxError, TypeError, EOFError) as error:
        raise RunFileError(f"{path}: {name} is no plain array ({error}); expected {_EXPECTED}. {_AGAIN}") from None


def _read(path: Path, archive: zipfile.ZipFile, name: str) -> bytes:
    try:
        return archive.read(name)
    except KeyError:
        found = archive.namelist()[:5]
        raise RunFileError(f"{path}: holds {found} and no {name}; expected {_EXPECTED}. {_AGAIN}") from None
    except (zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError, EOFError, OSError) as error:
        raise RunFileError(f"{path}: {name} is damaged ({error}); expected {_EXPECTED}. {_AGAIN}") from None
