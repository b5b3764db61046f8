"""A glTF 2.0 file, binary or text, as its JSON part and views of its buffers; every length in it is checked here."""

import shlex
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError
from pydantic.alias_generators import to_camel

from sim.errors import SceneError, line_from_validation_error, short

from .gltf_schema import Accessor, Document, Primitive
from .scene_files import COPY_AGAIN, Bytes, FilePart, mapped, refused, resource

MAX_ELEMENTS = 1 << 25
"""Most vertices, faces or elements of one accessor: ten times the largest scans that we know."""
_MAX_JSON = 1 << 26
"""Most bytes of the JSON part of a binary file."""
_MAX_TEXT = 1 << 29
"""Most bytes of a text file, which may hold its buffers as base64."""
_MAX_OBJECTS = 400_000
_MAX_VALUES = 8_000_000
"""Most objects and values in the JSON part: about 0.4 GB of memory while it is read."""
_JSON_CHUNK, _BINARY_CHUNK = 0x4E4F534A, 0x004E4942
_PLAIN = "Export the scene without it."
_UNPACK = "Run: npx @gltf-transform/cli copy {file} {other}"
"""Command that writes a file without compressed meshes; it was tried with version 4.5.1."""
_AS_PNG = "Run: npx @gltf-transform/cli png {file} {other} --formats avif"
_KNOWN = {
    "EXT_texture_webp",
    "GOOGLE_texture_basis",
    "KHR_texture_basisu",
    "KHR_texture_transform",
    "KHR_draco_mesh_compression",
    "KHR_mesh_quantization",
    "KHR_lights_punctual",
}
_GEOMETRY = {
    "EXT_meshopt_compression": ("uncompressed meshes", _UNPACK),
    "KHR_meshopt_compression": ("uncompressed meshes", _UNPACK),
    "EXT_mesh_gpu_instancing": ("one node per copy of a mesh", _PLAIN),
}
"""What is expected instead, and what to do, of extensions without which a part of the geometry is missing, even where
the file calls them optional."""
_COMPONENTS = {
    5120: np.dtype("<i1"),
    5121: np.dtype("<u1"),
    5122: np.dtype("<i2"),
    5123: np.dtype("<u2"),
    5125: np.dtype("<u4"),
    5126: np.dtype("<f4"),
}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


class GltfFile:
    """An open file; `read_gltf` makes it."""

    def __init__(self, path: Path, document: Document, binary: Bytes | None) -> None:
        """An open file; `binary` is its binary part, None without."""
        self.path = path
        self.document = document
        self._buffers: dict[int, Bytes] = {}
        self._binary = binary
        self._sparse: dict[int, NDArray] = {}
        self._packed = _draco_accessors(document)
        self._unpacked: dict[int, NDArray] = {}

    def get(self, kind: str, index: int, *, of: str) -> Any:
        """Element `index` of a list of the document, e.g. `accessors`; `of` is the part of the file that names it, for
        the error.

        Raises:
            SceneError: The list has no such element.
        """
        items = getattr(self.document, kind)
        if index >= len(items):
            name = to_camel(kind)
            raise self.refused(
                f"{of} names {name}.{index}", f"{name} 0 to {len(items) - 1}" if items else f"any {name}"
            )
        return items[index]

    def refused(self, found: str, expected: str, *, advice: str = COPY_AGAIN) -> SceneError:
        """The error of this file; see `scene_files.refused`."""
        return refused(self.path, found, expected, advice=advice)

    def view(self, index: int, *, of: str) -> Bytes:
        """The bytes (N,) of a buffer view.

        Raises:
            SceneError: The view reaches outside its buffer, or the buffer is missing.
        """
        view = self.get("buffer_views", index, of=of)
        data = self._buffer(view.buffer, of=f"bufferViews.{index}")
        end = view.byte_offset + view.byte_length
        if end > len(data):
            raise self.refused(
                f"bufferViews.{index} ends at byte {end} of buffer {view.buffer}", f"at most {len(data)}"
            )
        return data[view.byte_offset : end]

    def elements(self, index: int, *, of: str) -> NDArray:
        """The values (count, width) of an accessor in the file's own type; a view of the file where possible.

        `of` is the part of the file that names the accessor, for the error.

        Raises:
            SceneError: The accessor reaches outside its buffer view, or its types are not those of glTF.
        """
        accessor = self.get("accessors", index, of=of)
        where = f"accessors.{index}"
        if accessor.count > MAX_ELEMENTS:
            raise self.refused(
                f"{where} announces {accessor.count} elements", f"at most {MAX_ELEMENTS}", advice="Split the scene."
            )
        dtype, width = self._types(accessor, where)
        if index in self._packed:
            return self._draco(index, dtype, width, accessor.count, where)
        if accessor.sparse is not None:
            return self._with_sparse(index, accessor, dtype, width)
        if accessor.buffer_view is None:
            raise self.refused(f"{where} has no bufferView", "one")
        return self._strided(accessor.buffer_view, accessor.byte_offset, accessor.count, dtype, width, of=where)

    def _draco(self, index: int, dtype: np.dtype, width: int, count: int, where: str) -> NDArray:
        """The values of an accessor that Draco packed, in the accessor's type; a primitive is unpacked once."""
        if index not in self._unpacked:
            from .draco import unpacked  # needs the extra `draco`

            primitive = self._packed[index]
            part = primitive.extensions.draco
            assert part is not None
            data = self.view(part.buffer_view, of=f"{where}'s Draco data")
            named = {
                primitive.attributes[name]: number
                for name, number in part.attributes.items()
                if name in primitive.attributes
            }
            self._unpacked |= unpacked(data, named, primitive.indices, FilePart(self.path, where), most=MAX_ELEMENTS)
        values = self._unpacked[index]
        if values.shape != (count, width):
            raise self.refused(f"{where} unpacks to {values.shape}", f"the {(count, width)} that it announces")
        return values if values.dtype.kind == "f" and dtype.kind == "f" else values.astype(dtype)

    def _types(self, accessor: Accessor, where: str) -> tuple[np.dtype, int]:
        dtype, width = _COMPONENTS.get(accessor.component_type), _WIDTHS.get(accessor.type)
        if dtype is None or width is None:
            found = f"{where} has componentType {accessor.component_type} and type {short(accessor.type)}"
            raise self.refused(found, "one of glTF 2.0's component types and SCALAR or VEC2 to VEC4")
        return dtype, width

    def _strided(self, index: int, offset: int, count: int, dtype: np.dtype, width: int, *, of: str) -> NDArray:
        """Values (count, width) at `offset` in a buffer view, whose stride is kept."""
        data = self.view(index, of=of)
        size = dtype.itemsize * width
        stride = self.document.buffer_views[index].byte_stride or size
        end = offset + (count - 1) * stride + size if count else 0
        if end > len(data) or stride < size:
            raise self.refused(
                f"{of} needs {end} bytes of bufferViews.{index} in steps of {stride}",
                f"at most {len(data)} bytes and steps of at least {size}",
            )
        return np.ndarray((count, width), dtype, data, offset if count else 0, (stride, dtype.itemsize))

    def _with_sparse(self, index: int, accessor: Accessor, dtype: np.dtype, width: int) -> NDArray:
        """The values of a sparse accessor: those of its buffer view, or zeros, with some of them replaced."""
        if index in self._sparse:
            return self._sparse[index]
        where, sparse = f"accessors.{index}.sparse", accessor.sparse
        assert sparse is not None
        if accessor.count + sum(map(len, self._sparse.values())) > MAX_ELEMENTS:
            raise self.refused("too many sparse elements", f"at most {MAX_ELEMENTS} together", advice=_PLAIN)
        kind = _COMPONENTS.get(sparse.indices.component_type, np.dtype("<f4"))
        if kind.kind != "u" or sparse.count > accessor.count:
            raise self.refused(f"{where} has other indices", f"at most {accessor.count} unsigned integers")
        indices, values = sparse.indices, sparse.values
        rows = self._strided(indices.buffer_view, indices.byte_offset, sparse.count, kind, 1, of=where)[:, 0]
        given = self._strided(values.buffer_view, values.byte_offset, sparse.count, dtype, width, of=where)
        if len(rows) and int(rows.max()) >= accessor.count:
            raise self.refused(f"{where} names element {int(rows.max())}", f"0 to {accessor.count - 1}")
        full = np.zeros((accessor.count, width), dtype)
        if accessor.buffer_view is not None:
            offset = accessor.byte_offset
            full[...] = self._strided(accessor.buffer_view, offset, accessor.count, dtype, width, of=where)
        full[rows] = given
        self._sparse[index] = full
        return full

    def _buffer(self, index: int, *, of: str) -> Bytes:
        buffer = self.get("buffers", index, of=of)
        if index not in self._buffers:
            where = f"buffers.{index}"
            if buffer.uri is not None:
                data = resource(FilePart(self.path, where), buffer.uri)
            elif index == 0 and self._binary is not None:
                data = self._binary
            else:
                raise self.refused(f"{where} has no uri", "one, or the binary part of a GLB")
            if len(data) < buffer.byte_length:
                raise self.refused(f"{where} has {len(data)} bytes", f"the {buffer.byte_length} that it announces")
            self._buffers[index] = data[: buffer.byte_length]
        return self._buffers[index]


def read_gltf(path: Path) -> GltfFile:
    """Opens a `.glb` or `.gltf` file.

    Raises:
        SceneError: The file is missing, cut off, not glTF 2.0, or needs an extension that we cannot read.
    """
    data = mapped(path, what="a glTF file")
    if path.suffix.lower() == ".gltf" and bytes(data[:4]) != b"glTF":
        if len(data) > _MAX_TEXT:
            raise refused(path, f"has {len(data)} bytes", f"at most {_MAX_TEXT}", advice="Export the scene as .glb.")
        text, binary = bytes(data), None
    else:
        text, binary = _chunks(path, data)
    file = GltfFile(path, _document(path, text), binary)
    _require_known_extensions(file)
    return file


def floats(values: NDArray, *, normalized: bool) -> NDArray[np.float32]:
    """Accessor values as float32; integers that the file calls normalized become 0 to 1 or -1 to 1."""
    if values.dtype.kind == "f":
        return np.asarray(values, np.float32)
    numbers = values.astype(np.float32)
    if normalized:
        numbers /= np.float32(np.iinfo(values.dtype).max)
        np.maximum(numbers, -1, out=numbers)
    return numbers


def _chunks(path: Path, data: Bytes) -> tuple[bytes, Bytes | None]:
    """JSON text and binary part of a GLB."""
    head = bytes(data[:20])
    magic, version, length, json_length, kind = struct.unpack("<4sIIII", head.ljust(20, b"\0"))
    if magic != b"glTF" or version != 2:
        raise refused(path, f"starts with {head[:8]!r}", "binary glTF 2.0 (b'glTF', 2)")
    if kind != _JSON_CHUNK and len(data) >= 20:
        raise refused(path, f"has a first part of kind {kind:#x}", f"JSON ({_JSON_CHUNK:#x})")
    start = 20 + json_length
    if len(data) < length or length < start:
        raise refused(path, f"found {len(data)} bytes of a GLB of {max(length, start)}", "the whole file")
    if json_length > _MAX_JSON:
        raise refused(path, f"has {json_length} bytes of JSON", f"at most {_MAX_JSON}", advice="Split the scene.")
    text = bytes(data[20:start])
    if length < start + 8:
        return text, None
    binary_length, kind = struct.unpack("<II", bytes(data[start : start + 8]))
    if kind != _BINARY_CHUNK:
        return text, None
    if start + 8 + binary_length > length:
        raise refused(path, f"found {length} bytes of a GLB of {start + 8 + binary_length}", "the whole file")
    return text, data[start + 8 : start + 8 + binary_length]


def _document(path: Path, text: bytes) -> Document:
    if text.count(b"{") > _MAX_OBJECTS or text.count(b",") + text.count(b"[") > _MAX_VALUES:
        expected = f"at most {_MAX_OBJECTS} objects and {_MAX_VALUES} values"
        raise refused(path, "has a JSON part of too many values", expected, advice="Split the scene.")
    try:
        return Document.model_validate_json(text)
    except ValidationError as error:
        raise SceneError(line_from_validation_error(f"{path}: JSON part", error, advice=COPY_AGAIN)) from None


def _draco_accessors(document: Document) -> dict[int, Primitive]:
    """The primitive that packs each accessor with Draco, by the accessor's number; plain data, where given, count."""
    found: dict[int, Primitive] = {}
    for mesh in document.meshes:
        for primitive in mesh.primitives:
            if primitive.extensions.draco is not None:
                names = [name for name in primitive.extensions.draco.attributes if name in primitive.attributes]
                indices = [] if primitive.indices is None else [primitive.indices]
                for accessor in (*(primitive.attributes[name] for name in names), *indices):
                    if accessor < len(document.accessors) and document.accessors[accessor].buffer_view is None:
                        found.setdefault(accessor, primitive)
    return found


def _command(advice: str, path: Path) -> str:
    names = (path, path.with_stem(f"{path.stem}-plain"))
    file, other = (shlex.quote(str(name)) for name in names)
    return advice.format(file=file, other=other)


def _require_known_extensions(file: GltfFile) -> None:
    document = file.document
    for name in (*document.extensions_used, *document.extensions_required):
        if name in _GEOMETRY:
            expected, advice = _GEOMETRY[name]
            raise file.refused(f"found {name}", expected, advice=_command(advice, file.path))
    for name in document.extensions_required:
        if name == "EXT_texture_avif":
            raise file.refused(f"found {name}", "PNG, JPEG or WebP", advice=_command(_AS_PNG, file.path))
        if name not in _KNOWN and not name.startswith("KHR_materials_"):  # materials change light, which we leave out
            raise file.refused(f"needs the extension {short(name)}", "extensions that we can read", advice=_PLAIN)
