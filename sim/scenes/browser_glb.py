"""Small GLB copies of a home for viser and Rerun: one storey without its ceiling, flat colours as a palette, unlit."""

import io
import json
import math
import struct

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from sim.errors import SceneError

from .scene import Scene, TriangleMesh, cut_storey

MAX_TEXTURE = 1024
"""Longest side of a texture in the copy (pixels)."""
_JPEG_QUALITY = 85
_MAX_COLOURS = 1 << 16
_NEAREST, _LINEAR, _CLAMP, _REPEAT = 9728, 9729, 33071, 10497
_ARRAY_BUFFER, _INDEX_BUFFER, _FLOAT, _UINT32 = 34962, 34963, 5126, 5125


def browser_glb(scene: Scene, floor_y: float) -> bytes:
    """One storey of a scene as binary glTF 2.0: world axes (y up), unlit, same bytes for the same scene.

    Args:
        scene: Any home.
        floor_y: Height of the storey's floor, metres.

    Raises:
        SceneError: No face of the scene is on that storey.
    """
    storey = cut_storey(scene.mesh, floor_y)
    if not len(storey.faces):
        heights = ", ".join(f"{height:.2f}" for height in scene.navigation.storey_heights)
        raise SceneError(
            f"{scene.label}: found no face on a storey at {floor_y!r} m; expected a height near one of [{heights}]. "
            "Take one of the scene's storey heights."
        )
    return glb_from_mesh(storey)


def glb_from_mesh(mesh: TriangleMesh) -> bytes:
    """A mesh as binary glTF 2.0 in the axes of its vertices; one primitive per texture and one for flat colours."""
    writer = _GlbWriter()
    flat = mesh.face_texture < 0
    if flat.any():
        index, palette = _palette(mesh.face_rgb[flat])
        rows, side = palette.shape[:2]
        uv = np.stack([(index % side + 0.5) / side, (index // side + 0.5) / rows], axis=1).astype(np.float32)
        image = _encoded(Image.fromarray(palette), "PNG")
        writer.add(mesh.vertices[mesh.faces[flat]], np.repeat(uv[:, None], 3, axis=1), image, mime="image/png")
    for texture in np.unique(mesh.face_texture[~flat]):
        uses = mesh.face_texture == texture
        image = _encoded(_downsized(mesh.textures[texture]), "JPEG")
        writer.add(mesh.vertices[mesh.faces[uses]], mesh.face_uv[uses], image, mime="image/jpeg")
    return writer.glb()


def _palette(face_rgb: NDArray[np.uint8]) -> tuple[NDArray[np.int64], NDArray[np.uint8]]:
    """(index of each face's colour, image (rows, side, 3) of the colours, row by row)."""
    packed = (face_rgb.astype(np.int64) << np.array([16, 8, 0])).sum(axis=1)
    colours, index = np.unique(packed, return_inverse=True)
    if len(colours) > _MAX_COLOURS:  # scans with vertex colours: five bits each are enough for an overview
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
        self._images: list[dict] = []

    def add(self, corners: NDArray[np.float32], uv: NDArray[np.float32], image: bytes, *, mime: str) -> None:
        """Triangles (N, 3, 3) with texture coordinates (N, 3, 2) into an encoded image; equal corners are shared."""
        rows = np.concatenate([corners.reshape(-1, 3), uv.reshape(-1, 2)], axis=1).astype("<f4")
        _, first, index = np.unique(rows.view(np.dtype((np.void, 20))).ravel(), return_index=True, return_inverse=True)
        points, coordinates = rows[first, :3], rows[first, 3:]
        position = self._accessor(points, "VEC3", _FLOAT, _ARRAY_BUFFER)
        self._accessors[position] |= {"min": points.min(axis=0).tolist(), "max": points.max(axis=0).tolist()}
        texcoord = self._accessor(coordinates, "VEC2", _FLOAT, _ARRAY_BUFFER)
        indices = self._accessor(index.astype("<u4").reshape(-1), "SCALAR", _UINT32, _INDEX_BUFFER)
        material = len(self._images)
        self._images.append({"bufferView": self._view(image), "mimeType": mime})
        attributes = {"POSITION": position, "TEXCOORD_0": texcoord}
        self._primitives.append({"attributes": attributes, "indices": indices, "material": material})

    def glb(self) -> bytes:
        """The file."""
        materials = [
            {
                "pbrMetallicRoughness": {
                    "baseColorTexture": {"index": k},
                    "metallicFactor": 0.0,
                    "roughnessFactor": 1.0,
                },
                "doubleSided": True,
                "extensions": {"KHR_materials_unlit": {}},
            }
            for k in range(len(self._images))
        ]
        is_palette = [image["mimeType"] == "image/png" for image in self._images]
        content = {
            "asset": {"version": "2.0", "generator": "personal-viz"},
            "extensionsUsed": ["KHR_materials_unlit"],
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": self._primitives}],
            "materials": materials,
            "textures": [{"source": k, "sampler": 0 if palette else 1} for k, palette in enumerate(is_palette)],
            "samplers": [
                {"magFilter": _NEAREST, "minFilter": _NEAREST, "wrapS": _CLAMP, "wrapT": _CLAMP},
                {"magFilter": _LINEAR, "minFilter": _LINEAR, "wrapS": _REPEAT, "wrapT": _REPEAT},
            ],
            "images": self._images,
            "accessors": self._accessors,
            "bufferViews": self._views,
            "buffers": [{"byteLength": len(self._data)}],
        }
        text = json.dumps(content, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        header = struct.pack("<4sII", b"glTF", 2, 12 + 8 + len(text) + 8 + len(self._data))
        chunks = struct.pack("<I4s", len(text), b"JSON") + text
        return header + chunks + struct.pack("<I4s", len(self._data), b"BIN\0") + bytes(self._data)

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
