"""Meshes that Draco packed (`KHR_draco_mesh_compression`) as arrays. Needs the extra `draco`."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from sim.extras import require

from .scene_files import COPY_AGAIN, Bytes, FilePart

_HEAD = 11
_SEQUENTIAL, _EDGEBREAKER = 0, 1
_HAS_METADATA = 0x8000


def unpacked(
    data: Bytes, attributes: Mapping[int, int], indices: int | None, part: FilePart, *, most: int
) -> dict[int, NDArray]:
    """The values of each accessor of a packed primitive: (V, width) per attribute, and (3F, 1) corners of triangles.

    Args:
        data: The packed bytes.
        attributes: Draco's id of an attribute, by accessor.
        indices: The accessor of the corners; None = the primitive has none.
        part: The part of the file, for errors.
        most: Most faces or vertices that the data may announce.

    Raises:
        SceneError: The data are damaged or too large, or lack an attribute.
        MissingDependencyError: The extra `draco` is not installed.
    """
    _require_small(bytes(data[:32]), part, most)
    draco = require("DracoPy", extra="draco")
    try:
        mesh = draco.decode(bytes(data))
    except (draco.FileTypeException, ValueError, RuntimeError, MemoryError) as error:
        reason = " ".join(str(error).split())[:120]
        raise part.refused(
            f"holds Draco data that cannot be read ({reason})", "whole data", advice=COPY_AGAIN
        ) from None
    values = {one["unique_id"]: one["data"] for one in mesh.attributes}
    missing = sorted(set(attributes.values()) - set(values))
    if missing:
        raise part.refused(f"names Draco's attribute {missing[0]}", f"one of {sorted(values)}", advice=COPY_AGAIN)
    found = {accessor: np.asarray(values[number]) for accessor, number in attributes.items()}
    found = {accessor: array.reshape(len(array), -1) for accessor, array in found.items()}
    if indices is not None:
        faces = getattr(mesh, "faces", None)  # a cloud of points has none
        if faces is None:
            raise part.refused("holds a cloud of points", "triangles", advice="Export the scene with its faces.")
        found[indices] = np.asarray(faces, np.uint32).reshape(-1, 1)
    return found


def _require_small(head: bytes, part: FilePart, most: int) -> None:
    """Refuses data whose first bytes announce more than we read; a few bytes may hold very many equal faces."""
    whole = "a mesh of Draco's version 2.2 without metadata, as glTF has it"
    if len(head) < 32 or head[:5] != b"DRACO" or head[7] != 1 or head[5:7] != b"\x02\x02":
        raise part.refused(f"holds Draco data that begin with {head[:9]!r}", whole)
    if int.from_bytes(head[9:11], "little") & _HAS_METADATA or head[8] not in (_SEQUENTIAL, _EDGEBREAKER):
        raise part.refused(f"holds Draco data of method {head[8]} and flags {head[9:11].hex()}", whole)
    first, at = _varint(head, _HEAD + (head[8] == _EDGEBREAKER))
    second, _ = _varint(head, at)
    if max(first, second) > most:
        raise part.refused(
            f"holds Draco data of {first} and {second} elements", f"at most {most}", advice="Split the scene."
        )


def _varint(data: bytes, at: int) -> tuple[int, int]:
    """A number in groups of seven bits, lowest first, and the place behind it."""
    number = shift = 0
    while at < len(data):
        number |= (data[at] & 0x7F) << shift
        shift, at = shift + 7, at + 1
        if data[at - 1] < 0x80:
            break
    return number, at
