"""Reads a GLB file into a `TriangleMesh` in the world frame; every scan enters here."""

import struct
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
import trimesh
from numpy.typing import NDArray
from PIL import Image
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from pydantic.alias_generators import to_camel
from trimesh.visual import TextureVisuals

from sim.errors import SceneError, line_from_validation_error
from sim.frames import world_from_glb_zup

from .scene import TriangleMesh

_BASIS = ("GOOGLE_texture_basis", "KHR_texture_basisu")
_COMPRESSED = ("KHR_draco_mesh_compression", "EXT_meshopt_compression")
_JSON_CHUNK = 0x4E4F534A
_PLAIN_RGB = (200, 200, 200)
"""Faces without any colour."""
_COPY = "Copy the file again from its source."
_DAMAGES = (
    ValueError, LookupError, TypeError, AttributeError, NameError, OSError, ArithmeticError, AssertionError,
    RuntimeError, MemoryError, struct.error,
)  # fmt: skip
"""What trimesh raises on damaged files: it trusts their numbers and types."""
_Index = Annotated[int, Field(ge=0)]


class _Json(BaseModel):
    """A part of a GLB's JSON, of which only the fields that we read ourselves are checked."""

    model_config = ConfigDict(frozen=True, strict=True, alias_generator=to_camel)


class _TextureInfo(_Json):
    index: _Index


class _Pbr(_Json):
    base_color_texture: _TextureInfo | None = None


class _Material(_Json):
    pbr_metallic_roughness: _Pbr | None = None


class _Texture(_Json):
    source: _Index | None = None


class _Primitive(_Json):
    attributes: dict[str, _Index]
    material: _Index | None = None


class _Mesh(_Json):
    primitives: list[_Primitive]


class _Node(_Json):
    mesh: _Index | None = None


class _Header(_Json):
    extensions_used: list[str] = []
    nodes: list[_Node] = []
    meshes: list[_Mesh] = []
    materials: list[_Material] = []
    textures: list[_Texture] = []


class _Part(NamedTuple):
    """One mesh of the file at one node."""

    mesh: trimesh.Trimesh
    vertices: NDArray[np.float32]
    """(V, 3) in the file's axes."""
    corners: list[int]
    """Order in which a face's corners are taken."""


def load_glb(path: Path, *, up: Literal["z", "y"] = "z") -> TriangleMesh:
    """The triangles of a GLB file, with node transforms applied, in the world frame.

    Colours are unlit, as Habitat shows scans: texture times base colour, else base colour times the mean of a face's
    vertex colours. Alpha is dropped. All faces have instance 0.

    Args:
        path: A binary glTF 2.0 file whose images, if any, are PNG or JPEG inside the file.
        up: The file's up axis; HM3D is z-up, glTF's own convention is y-up.

    Raises:
        SceneError: The file is missing, damaged, without faces, or uses textures or compression we cannot read.
    """
    header = _read_header(path)
    try:
        with path.open("rb") as file:
            loaded = trimesh.load_scene(file, file_type="glb", process=False)
        parts = _placed_parts(path, loaded)
        num_images = _num_base_images(header)
    except _DAMAGES as error:
        raise SceneError(
            f"{path}: found GLB content that cannot be read ({type(error).__name__}: {_one_line(error)}); "
            f"expected meshes of binary glTF 2.0. {_COPY}"
        ) from None
    if not parts:
        raise SceneError(f"{path}: found no faces; expected a mesh of triangles. Export the scene with its geometry.")
    mesh = _joined(path, parts, num_images=num_images)
    if not np.isfinite(mesh.vertices).all():
        bad = int(np.flatnonzero(~np.isfinite(mesh.vertices).all(axis=1))[0])
        raise SceneError(
            f"{path}: vertex {bad} is {mesh.vertices[bad].tolist()}; expected finite metres. Export the scene again."
        )
    if up == "y":
        return mesh
    vertices = world_from_glb_zup(mesh.vertices).astype(np.float32)
    return TriangleMesh(
        vertices, mesh.faces, mesh.face_rgb, mesh.face_instance, mesh.face_texture, mesh.face_uv, mesh.textures
    )


def _read_header(path: Path) -> _Header:
    """The JSON part of a GLB; raises SceneError unless the file is whole and its extensions are ones we can read."""
    try:
        with path.open("rb") as file:
            head = file.read(20)
            magic, version, length, json_length, kind = struct.unpack("<4sIIII", head.ljust(20, b"\0"))
            text = file.read(json_length) if kind == _JSON_CHUNK else b""
        size = path.stat().st_size
    except OSError as error:
        raise SceneError(
            f"{path}: cannot be read ({error.strerror}); expected a GLB file. Check the path or --scenes-dir."
        ) from None
    if magic != b"glTF" or version != 2:
        raise SceneError(f"{path}: starts with {head[:8]!r}; expected binary glTF 2.0 (b'glTF', 2). {_COPY}")
    if size < length or len(text) < json_length:
        raise SceneError(f"{path}: found {size} bytes of a GLB of {length}; expected the whole file. {_COPY}")
    try:
        header = _Header.model_validate_json(text)
    except ValidationError as error:
        raise SceneError(line_from_validation_error(f"{path}: JSON part", error, advice=_COPY)) from None
    for name in header.extensions_used:
        if name in _BASIS:
            raise SceneError(
                f"{path}: found {name}; expected PNG or JPEG textures. Basis textures are not supported yet, "
                "use the plain <Name>.glb."
            )
        if name in _COMPRESSED:
            raise SceneError(
                f"{path}: found {name}; expected uncompressed meshes. Export the scene without mesh compression."
            )
    return header


def _num_base_images(header: _Header) -> int:
    """How many different images the meshes that the scene shows use as base colour."""
    shown = {node.mesh for node in header.nodes if node.mesh is not None}
    found = set()
    for mesh in shown:
        for primitive in header.meshes[mesh].primitives:
            if primitive.material is not None and "TEXCOORD_0" in primitive.attributes:
                pbr = header.materials[primitive.material].pbr_metallic_roughness
                if pbr is not None and pbr.base_color_texture is not None:
                    index = pbr.base_color_texture.index
                    source = header.textures[index].source
                    found.add(-1 - index if source is None else source)
    return len(found)


def _placed_parts(path: Path, loaded: trimesh.Scene) -> list[_Part]:
    """Every mesh of the scene where its nodes put it; a mirroring node turns faces, so that they keep their side."""
    parts = []
    for node in sorted(loaded.graph.nodes_geometry):
        T_glb_mesh, name = loaded.graph[node]
        geometry = loaded.geometry[name]
        if isinstance(geometry, trimesh.Trimesh) and len(geometry.faces):
            _require_vertices(path, str(name), geometry)
            vertices = geometry.vertices @ T_glb_mesh[:3, :3].T + T_glb_mesh[:3, 3]
            mirrored = np.linalg.det(T_glb_mesh[:3, :3]) < 0
            parts.append(_Part(geometry, np.asarray(vertices, np.float32), [0, 2, 1] if mirrored else [0, 1, 2]))
    return parts


def _require_vertices(path: Path, name: str, mesh: trimesh.Trimesh) -> None:
    """Raises SceneError when a face of the mesh uses a vertex that is not there."""
    wrong = np.argwhere((mesh.faces < 0) | (mesh.faces >= len(mesh.vertices)))
    if len(wrong):
        face, corner = wrong[0]
        raise SceneError(
            f"{path}: face {face} of mesh {name[:60]!r} uses vertex {mesh.faces[face, corner]}; "
            f"expected 0 to {len(mesh.vertices) - 1}, the vertices that it has. {_COPY}"
        )


def _joined(path: Path, parts: list[_Part], *, num_images: int) -> TriangleMesh:
    """One mesh of all parts; images that several parts share are kept once."""
    vertices, faces, rgbs, indices, uvs = [], [], [], [], []
    textures: list[NDArray[np.uint8]] = []
    known: dict[tuple[int, tuple[float, ...]], int] = {}
    images: list[Any] = []  # keeps the images alive, so that id() stays theirs
    count = 0
    for part, placed, corners in parts:
        image, factor = _image_and_factor(part)
        rgb, texture = _face_colours(part, factor), -1
        uv = getattr(part.visual, "uv", None)
        if image is not None and uv is not None and len(uv) == len(part.vertices):
            key = (id(image), tuple(factor))
            if key not in known:
                known[key] = len(textures)
                images.append(image)
                textures.append(_texels(path, image, factor))
            texture = known[key]
            corner_uv = np.asarray(uv, np.float32)[part.faces[:, corners]]
            corner_uv[..., 1] = 1 - corner_uv[..., 1]  # trimesh counts v from the bottom
        else:
            corner_uv = np.zeros((len(part.faces), 3, 2), np.float32)
        vertices.append(placed)
        faces.append(np.asarray(part.faces, np.int32)[:, corners] + count)
        rgbs.append(rgb)
        indices.append(np.full(len(part.faces), texture, np.int16))
        uvs.append(corner_uv)
        count += len(placed)
    num_found = len({id(image) for image in images})
    if num_found < num_images:
        raise SceneError(
            f"{path}: found {num_found} readable of {num_images} textures; expected PNG or JPEG images "
            f"inside the file. {_COPY}"
        )
    face_instance = np.zeros(sum(map(len, faces)), np.int32)
    return TriangleMesh(
        np.concatenate(vertices),
        np.concatenate(faces),
        np.concatenate(rgbs),
        face_instance,
        np.concatenate(indices),
        np.nan_to_num(np.concatenate(uvs)),
        tuple(textures),
    )


def _image_and_factor(part: trimesh.Trimesh) -> tuple[Image.Image | None, NDArray[np.float64]]:
    """Base colour texture (None without) and base colour factor (3,) in [0, 1] of a part's material."""
    material = getattr(part.visual, "material", None)
    factor = getattr(material, "baseColorFactor", None)
    if factor is None:
        return getattr(material, "baseColorTexture", None), np.ones(3)
    factor = np.asarray(factor)
    scale = 255.0 if factor.dtype.kind in "ui" else 1.0
    return getattr(material, "baseColorTexture", None), factor[:3].astype(float) / scale


def _face_colours(part: trimesh.Trimesh, factor: NDArray[np.float64]) -> NDArray[np.uint8]:
    """(F, 3) flat colours: vertex colours averaged per face, or the material's base colour, or grey."""
    visual: Any = part.visual
    if isinstance(visual, TextureVisuals):
        colours = visual.vertex_attributes.get("color")
    else:
        colours = visual.vertex_colors if visual.kind == "vertex" else None
    if colours is not None and len(colours) == len(part.vertices):
        colours = np.asarray(colours)
        scale = 1.0 if colours.dtype.kind in "ui" else 255.0
        mean = colours[part.faces][..., :3].mean(axis=1) * scale * factor
        return np.clip(mean + 0.5, 0, 255).astype(np.uint8)
    material = getattr(part.visual, "material", None)
    plain = _PLAIN_RGB if getattr(material, "baseColorFactor", None) is None else 255 * factor
    return np.tile(np.clip(np.asarray(plain) + 0.5, 0, 255).astype(np.uint8), (len(part.faces), 1))


def _texels(path: Path, image: Image.Image, factor: NDArray[np.float64]) -> NDArray[np.uint8]:
    """(h, w, 3) of an image times its factor."""
    try:
        texels = np.asarray(image.convert("RGB"))
    except (OSError, ValueError) as error:
        raise SceneError(
            f"{path}: a texture cannot be read ({_one_line(error)}); expected PNG or JPEG. {_COPY}"
        ) from None
    if np.allclose(factor, 1.0):
        return texels
    return np.clip(texels * factor + 0.5, 0, 255).astype(np.uint8)


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:120]
