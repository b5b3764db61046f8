"""Small glTF files written by hand, so that tests know every byte in them."""

import base64
import io
import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from sim.mesh import TriangleMesh
from sim.scans.glb import load_glb

DATA = Path(__file__).parent / "data"
SQUARE = np.array([[0.0, 0, 0], [2, 0, 0], [2, 3, 0], [0, 3, 0]], np.float32)
FACES = np.array([0, 1, 2, 0, 2, 3], np.uint16)
UV = np.array([[0.0, 1], [1, 1], [1, 0], [0, 0]], np.float32)
"""Texture coordinates of SQUARE that show an image upright; v = 0 is its top."""
RED, GREEN, BLUE, YELLOW = (200, 40, 40), (40, 180, 60), (50, 70, 200), (220, 210, 90)
COMPONENTS = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}


class GltfWriter:
    """Collects the parts of a file; a test may change `json` before it is written."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.json: dict[str, Any] = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": []}],
            "nodes": [],
            "meshes": [],
            "bufferViews": [],
            "accessors": [],
            "buffers": [{"byteLength": 0}],
        }

    def view(self, content: bytes, **more: Any) -> int:
        """Index of a new bufferView."""
        self.json["bufferViews"].append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(content)} | more)
        self.data += content + b"\0" * (-len(content) % 4)
        return len(self.json["bufferViews"]) - 1

    def accessor(self, values: NDArray, **more: Any) -> int:
        """Index of a new accessor; (N,) = SCALAR, (N, K) = VECK."""
        kind = "SCALAR" if values.ndim == 1 else f"VEC{values.shape[1]}"
        component = COMPONENTS[values.dtype.str[1:]]
        view = self.view(values.tobytes())
        self.json["accessors"].append(
            {"bufferView": view, "componentType": component, "count": len(values), "type": kind} | more
        )
        return len(self.json["accessors"]) - 1

    def add(self, kind: str, item: dict[str, Any]) -> int:
        """Index of a new element of one of the lists."""
        self.json.setdefault(kind, []).append(item)
        return len(self.json[kind]) - 1

    def image(self, content: bytes, mime: str = "image/png", **sampler: int) -> int:
        """Index of a new texture that shows the encoded image."""
        source = self.add("images", {"bufferView": self.view(content), "mimeType": mime})
        more = {"sampler": self.add("samplers", sampler)} if sampler else {}
        return self.add("textures", {"source": source} | more)

    def material(self, texture: int, factor: list[float] | None = None, **info: Any) -> int:
        """Index of a new material with a base colour texture."""
        pbr: dict[str, Any] = {"baseColorTexture": {"index": texture} | info}
        return self.add("materials", {"pbrMetallicRoughness": pbr | ({"baseColorFactor": factor} if factor else {})})

    def show(self, *primitives: dict[str, Any], **node: Any) -> int:
        """Index of a new node of the scene with a new mesh of these primitives."""
        mesh = self.add("meshes", {"primitives": list(primitives)})
        index = self.add("nodes", {"mesh": mesh} | node)
        self.json["scenes"][0]["nodes"].append(index)
        return index

    def square(
        self, *, points: NDArray = SQUARE, uv: NDArray | None = None, colours: NDArray | None = None, **more: Any
    ) -> dict[str, Any]:
        """A primitive of two triangles, unless `more` says otherwise; unsigned integer colours are normalized."""
        attributes = {"POSITION": self.accessor(points)}
        if uv is not None:
            attributes["TEXCOORD_0"] = self.accessor(uv)
        if colours is not None:
            attributes["COLOR_0"] = self.accessor(colours, normalized=colours.dtype.kind == "u")
        return {"attributes": attributes, "indices": self.accessor(FACES)} | more

    def glb(self) -> bytes:
        """The file in its binary form."""
        self.json["buffers"][0]["byteLength"] = self.json["buffers"][0].get("byteLength") or len(self.data)
        text = json.dumps(self.json).encode()
        text += b" " * (-len(text) % 4)
        content = struct.pack("<II", len(self.data), 0x4E4942) + bytes(self.data)
        head = struct.pack("<4sIIII", b"glTF", 2, 20 + len(text) + len(content), len(text), 0x4E4F534A)
        return head + text + content

    def save(self, path: Path) -> Path:
        """Writes a `.glb`, or a `.gltf` with its buffer as a data: URI, and returns `path`."""
        if path.suffix == ".gltf":
            uri = "data:application/octet-stream;base64," + base64.b64encode(self.data).decode()
            self.json["buffers"] = [{"byteLength": len(self.data), "uri": uri}]
            path.write_text(json.dumps(self.json))
        else:
            path.write_bytes(self.glb())
        return path


def png(texels: NDArray[np.uint8]) -> bytes:
    """A PNG file."""
    file = io.BytesIO()
    Image.fromarray(texels).save(file, "PNG")
    return file.getvalue()


def four_colours(size: int = 8) -> NDArray[np.uint8]:
    """(size, size, 3): red, green above; blue, yellow below. The colours of `data/corners.png`."""
    half = size // 2
    image = np.zeros((size, size, 3), np.uint8)
    image[:half, :half], image[:half, half:] = RED, GREEN
    image[half:, :half], image[half:, half:] = BLUE, YELLOW
    return image


def plain_square(change: Callable[[GltfWriter], object] | None = None) -> GltfWriter:
    """One white-textured square, after `change`."""
    writer = GltfWriter()
    material = writer.material(writer.image(png(four_colours())))
    writer.show(writer.square(uv=UV, material=material))
    if change is not None:
        change(writer)
    return writer


def loaded(writer: GltfWriter, tmp_path: Path, name: str = "a.glb") -> TriangleMesh:
    """The mesh of a y-up file, written below `tmp_path`."""
    return load_glb(writer.save(tmp_path / name), up="y")


def shown(mesh: TriangleMesh, face: int = 0) -> list[tuple[int, ...]]:
    """The nearest texel (R, G, B) at each corner of a face, taken a little inside the corner."""
    texture = mesh.textures[mesh.face_texture[face]]
    uv = mesh.face_uv[face] + 0.01 * (mesh.face_uv[face].mean(axis=0) - mesh.face_uv[face])
    height, width = texture.shape[:2]
    return [tuple(texture[int(v % 1 * height), int(u % 1 * width)].tolist()) for u, v in uv.tolist()]


def with_image(content: bytes) -> GltfWriter:
    """One square that shows an encoded image."""
    writer = GltfWriter()
    writer.show(writer.square(uv=UV, material=writer.material(writer.image(content))))
    return writer


def with_basis(name: str, *, points: NDArray = SQUARE) -> GltfWriter:
    """One square with a Basis texture of `data`."""
    is_basis = name.endswith(".basis")
    extension, mime = ("GOOGLE_texture_basis", "image/x-basis") if is_basis else ("KHR_texture_basisu", "image/ktx2")
    writer = GltfWriter()
    source = writer.add("images", {"bufferView": writer.view((DATA / name).read_bytes()), "mimeType": mime})
    texture = writer.add("textures", {"extensions": {extension: {"source": source}}})
    writer.json["extensionsUsed"] = writer.json["extensionsRequired"] = [extension]
    writer.show(writer.square(points=points, uv=UV, material=writer.material(texture)))
    return writer


def drawn(
    tmp_path: Path, draw: Callable[[GltfWriter], dict[str, Any] | list[dict[str, Any]]], **node: Any
) -> TriangleMesh:
    """The mesh of a y-up file whose only node shows the primitives that `draw` makes."""
    writer = GltfWriter()
    primitives = draw(writer)
    writer.show(*(primitives if isinstance(primitives, list) else [primitives]), **node)
    return loaded(writer, tmp_path)


def jpeg() -> bytes:
    """A JPEG file of noise, 64 x 64."""
    file = io.BytesIO()
    Image.fromarray(np.random.default_rng(0).integers(0, 255, (64, 64, 3)).astype(np.uint8)).save(file, "JPEG")
    return file.getvalue()
