"""Writes a `TriangleMesh` as binary glTF 2.0; three.js, Rerun and our loader show it the same: unlit, both sides."""

import io
import json
import math
import struct

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ..mesh import FLAT, VERTEX_COLOURS, TriangleMesh
from ..scans.equal_rows import numbered

MAX_TEXTURE = 1024
"""Longest side of a texture in the file (pixels)."""
_JPEG_QUALITY = 85
_MAX_COLOURS = 1 << 16
_NEAREST, _LINEAR, _CLAMP, _REPEAT = 9728, 9729, 33071, 10497
_ARRAY_BUFFER, _INDEX_BUFFER, _FLOAT, _UINT8, _UINT16, _UINT32 = 34962, 34963, 5126, 5121, 5123, 5125


def glb_from_mesh(mesh: TriangleMesh, *, srgb_colours: bool = False) -> bytes:
    """A mesh as binary glTF 2.0 in the axes of its vertices; the same mesh gives the same bytes.

    It has one primitive per texture (JPEG, at most MAX_TEXTURE), one for flat colours (a palette) and one for vertex
    colours. Textured primitives have vertex colours too where these change the look.

    Args:
        mesh: Any mesh with faces; object ids are not written.
        srgb_colours: Whether vertex colours are written as sRGB, as Rerun 0.41 reads them, instead of the linear light
            of the standard.
    """
    writer = _GlbWriter()
    flat = mesh.face_texture == FLAT
    if flat.any():
        index, palette = _palette(mesh.face_rgb[flat])
        rows, side = palette.shape[:2]
        uv = np.stack([(index % side + 0.5) / side, (index // side + 0.5) / rows], axis=1)
        image = _encoded(Image.fromarray(palette), "PNG")
        writer.add_textured(mesh.vertices[mesh.faces[flat]], np.repeat(uv[:, None], 3, axis=1), image, mime="image/png")
    blended = mesh.face_texture == VERTEX_COLOURS
    if blended.any():
        assert mesh.vertex_rgb is not None
        faces = mesh.faces[blended]
        rgb = mesh.vertex_rgb[faces]
        writer.add_coloured(mesh.vertices[faces], rgb / 255 if srgb_colours else linear_from_srgb(rgb))
    for texture in np.unique(mesh.face_texture[mesh.face_texture >= 0]):
        uses = mesh.face_texture == texture
        image = _encoded(_downsized(mesh.textures[texture]), "JPEG")
        light = _light(mesh, mesh.faces[uses], srgb=srgb_colours)
        writer.add_textured(mesh.vertices[mesh.faces[uses]], mesh.face_uv[uses], image, mime="image/jpeg", light=light)
    return writer.glb()


def linear_from_srgb(rgb: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Light (0-1) of sRGB colours, the form of vertex colours in glTF (2.0, 3.7.2.1)."""
    share = rgb / 255.0
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)


def _light(mesh: TriangleMesh, faces: NDArray[np.int32], *, srgb: bool) -> NDArray[np.uint8] | None:
    """(N, 3, 3) light at the corners of textured faces, 255 = full; None where all of it is full.

    Bytes are as fine as a screen, except in very dark places, and half as large as the values of `add_coloured`.
    """
    if mesh.vertex_rgb is None or (rgb := mesh.vertex_rgb[faces]).min(initial=255) == 255:
        return None
    return rgb if srgb else np.rint(255 * linear_from_srgb(rgb)).astype(np.uint8)


def _palette(face_rgb: NDArray[np.uint8]) -> tuple[NDArray[np.int64], NDArray[np.uint8]]:
    """(index of each face's colour, image (rows, side, 3) of the colours, row by row)."""
    packed = (face_rgb.astype(np.int64) << np.array([16, 8, 0])).sum(axis=1)
    colours, index = np.unique(packed, return_inverse=True)
    if len(colours) > _MAX_COLOURS:  # five bits each are enough for an overview
        return _palette(face_rgb & np.uint8(0xF8) | np.uint8(0x04))
    side = math.ceil(math.sqrt(len(colours)))
    image = np.zeros((math.ceil(len(colours) / side) * side, 3), np.uint8)
    image[: len(colours)] = (colours[:, None] >> np.array([16, 8, 0])) & 0xFF
    return index, image.reshape(-1, side, 3)


def _downsized(texture: NDArray[np.uint8]) -> Image.Image:
    image = Image.fromarray(texture)
    image.thumbnail((MAX_TEXTURE, MAX_TEXTURE), Image.Resampling.BOX)
    return image


def _encoded(image: Image.Image, kind: str) -> bytes:
    file = io.BytesIO()
    image.save(file, kind, **({"quality": _JPEG_QUALITY} if kind == "JPEG" else {}))
    return file.getvalue()


class _GlbWriter:
    """Collects primitives and their buffers."""

    def __init__(self) -> None:
        self._data = bytearray()
        self._views: list[dict] = []
        self._accessors: list[dict] = []
        self._primitives: list[dict] = []
        self._materials: list[dict] = []
        self._textures: list[dict] = []
        self._images: list[dict] = []

    def add_textured(
        self,
        corners: NDArray[np.float32],
        uv: NDArray[np.floating],
        image: bytes,
        *,
        mime: str,
        light: NDArray[np.uint8] | None = None,
    ) -> None:
        """Triangles (N, 3, 3) with texture coordinates (N, 3, 2) into an encoded image; PNG is a palette.

        The image is multiplied by `light` (N, 3, 3); 255 leaves it unchanged.
        """
        values = [uv.reshape(-1, 2).astype("<f4")]
        if light is not None:
            values.append(_four(light, 0xFF))
        (points, *values), index = _shared(corners.reshape(-1, 3), *values)
        attributes = {"TEXCOORD_0": self._accessor(values[0], "VEC2", _FLOAT, _ARRAY_BUFFER)}
        if light is not None:
            attributes["COLOR_0"] = self._colours(values[1], _UINT8)
        self._textures.append({"source": len(self._images), "sampler": 0 if mime == "image/png" else 1})
        self._images.append({"bufferView": self._view(image), "mimeType": mime})
        self._add(points, attributes, index, baseColorTexture={"index": len(self._textures) - 1})

    def add_coloured(self, corners: NDArray[np.float32], colours: NDArray[np.float64]) -> None:
        """Triangles (N, 3, 3) with colours (N, 3, 3) in 0-1 at their corners."""
        light = _four(np.rint(colours * 0xFFFF).astype("<u2"), 0xFFFF)
        (points, light), index = _shared(corners.reshape(-1, 3), light)
        self._add(points, {"COLOR_0": self._colours(light, _UINT16)}, index)

    def glb(self) -> bytes:
        """The file."""
        content = {
            "asset": {"version": "2.0", "generator": "personal-viz"},
            "extensionsUsed": ["KHR_materials_unlit"],
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": self._primitives}],
            "materials": self._materials,
            "textures": self._textures,
            "samplers": [
                {"magFilter": _NEAREST, "minFilter": _NEAREST, "wrapS": _CLAMP, "wrapT": _CLAMP},
                {"magFilter": _LINEAR, "minFilter": _LINEAR, "wrapS": _REPEAT, "wrapT": _REPEAT},
            ],
            "images": self._images,
            "accessors": self._accessors,
            "bufferViews": self._views,
            "buffers": [{"byteLength": len(self._data)}],
        }
        text = json.dumps({key: value for key, value in content.items() if value != []}, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        header = struct.pack("<4sII", b"glTF", 2, 12 + 8 + len(text) + 8 + len(self._data))
        chunks = struct.pack("<I4s", len(text), b"JSON") + text
        return header + chunks + struct.pack("<I4s", len(self._data), b"BIN\0") + bytes(self._data)

    def _add(self, points: NDArray, attributes: dict[str, int], index: NDArray[np.int32], **pbr: dict) -> None:
        position = self._accessor(points, "VEC3", _FLOAT, _ARRAY_BUFFER)
        self._accessors[position] |= {"min": points.min(axis=0).tolist(), "max": points.max(axis=0).tolist()}
        indices = self._accessor(index.astype("<u4"), "SCALAR", _UINT32, _INDEX_BUFFER)
        self._primitives.append(
            {"attributes": {"POSITION": position, **attributes}, "indices": indices, "material": len(self._materials)}
        )
        self._materials.append(
            {
                "pbrMetallicRoughness": {**pbr, "metallicFactor": 0.0, "roughnessFactor": 1.0},
                "doubleSided": True,
                "extensions": {"KHR_materials_unlit": {}},
            }
        )

    def _colours(self, array: NDArray, component: int) -> int:
        colour = self._accessor(array, "VEC4", component, _ARRAY_BUFFER)
        self._accessors[colour]["normalized"] = True
        return colour

    def _accessor(self, array: NDArray, kind: str, component: int, target: int) -> int:
        view = self._view(array.tobytes(), target=target)
        self._accessors.append({"bufferView": view, "componentType": component, "count": len(array), "type": kind})
        return len(self._accessors) - 1

    def _view(self, data: bytes, *, target: int | None = None) -> int:
        self._views.append({"buffer": 0, "byteOffset": len(self._data), "byteLength": len(data)})
        if target is not None:
            self._views[-1]["target"] = target
        self._data += data
        self._data += b"\0" * (-len(self._data) % 4)
        return len(self._views) - 1


def _four(colours: NDArray, full: int) -> NDArray:
    """Colours (..., 3) as (N, 4), because attributes are aligned to 4 bytes."""
    result = np.full((colours.size // 3, 4), full, colours.dtype)
    result[:, :3] = colours.reshape(-1, 3)
    return result


def _shared(points: NDArray[np.float32], *values: NDArray) -> tuple[list[NDArray], NDArray[np.int32]]:
    """The distinct rows of (points, values) in order of first appearance, and the index of each row among them."""
    parts = [np.ascontiguousarray(array) for array in (points.astype("<f4"), *values)]
    first, number = numbered(np.concatenate([array.view("<i4") for array in parts], axis=1))
    return [part[first] for part in parts], number
