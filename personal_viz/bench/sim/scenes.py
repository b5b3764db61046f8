"""The benchmark's own scenes: the house of `house` as a mesh of any size, noisy and textured like a scan.

Also writes the mesh as a GLB file in HM3D's form: z-up, one primitive per texture, JPEG.
"""

import json
import struct
from functools import lru_cache
from pathlib import Path

import imagecodecs
import numpy as np
from numpy.typing import NDArray

from sim.frames import glb_zup_from_world
from sim.mesh import TriangleMesh

from .house import Patch, clutter_quads, house_patches

CLUTTER_SHARE = 0.5
"""Share of a cluttered scene's triangles in its heaps of small pieces."""
CLUTTER_OBJECTS = 1500
"""Number of heaps in a cluttered scene; smaller if heaps would have fewer than _HEAP pieces."""
_HEAP = 60
_ISLAND = 1.25
"""Largest side of one piece of texture, metres: the surfaces of scans are cut into such islands."""
_TEXELS_PER_METRE = 340.0
"""Density of 28 textures of 2048^2 over the house's surface."""
_NOISE_M = 0.0015
"""Standard deviation of each wave that displaces surfaces, metres."""
_NUM_WAVES = 8
_ROUGHNESS = 0.35
"""How fast the textures' finer octaves grow weaker; this value makes JPEG files about as large as HM3D's."""
_JPEG_QUALITY = 85
_ARRAY_BUFFER, _INDEX_BUFFER, _FLOAT, _UINT32 = 34962, 34963, 5126, 5125


def bench_mesh(
    num_faces: int, *, cluttered: bool, seed: int = 0, texture_size: int = 2048, num_textures: int = 28
) -> TriangleMesh:
    """The benchmark's house with about `num_faces` triangles (within 2 % from 50,000 up), the same for the same seed.

    Args:
        num_faces: Wanted number of triangles; the furniture's shape needs about 20,000 even if nothing is divided.
        cluttered: Whether CLUTTER_SHARE of the triangles are small slanted pieces in up to CLUTTER_OBJECTS heaps.
        seed: Seed of furniture, noise, clutter and textures.
        texture_size: Side of each square texture, pixels.
        num_textures: Number of textures, at least 1.

    Returns:
        World frame, floors at y = 0 and 2.88; every face is textured, and no vertex is on two texture islands.
    """
    rng = np.random.default_rng(seed)
    islands = [island for patch in house_patches(rng) for island in _islands(patch)]
    num_clutter = int(num_faces * CLUTTER_SHARE) // 2 if cluttered else 0
    sides = np.array([_side_lengths(island) for island in islands])
    segments = _segments(sides, num_faces - 2 * num_clutter)
    texture, corner_uv = _layout(sides, num_textures, texture_size, rng)
    vertices, vertex_uv, faces, face_island = _divided(islands, segments, corner_uv)
    vertices += displacement(vertices, rng)
    face_instance = np.array([island.instance for island in islands], np.int32)[face_island]
    face_texture = texture[face_island]
    if num_clutter:
        quads = clutter_quads(num_clutter, num_objects=min(CLUTTER_OBJECTS, -(-num_clutter // _HEAP)), rng=rng)
        first = np.arange(num_clutter, dtype=np.int32)[:, None] * 4 + len(vertices)
        added = np.stack([first + np.array([0, 1, 2]), first + np.array([0, 2, 3])], axis=1).reshape(-1, 3)
        lengths = np.linalg.norm(np.stack([quads[:, 1] - quads[:, 0], quads[:, 3] - quads[:, 0]], axis=1), axis=2)
        clutter_texture, uv = _layout(lengths, num_textures, texture_size, rng)
        vertices = np.concatenate([vertices, quads.reshape(-1, 3)])
        vertex_uv = np.concatenate([vertex_uv, uv.reshape(-1, 2)])
        faces = np.concatenate([faces, added.astype(np.int32)])
        face_texture = np.concatenate([face_texture, np.repeat(clutter_texture, 2)])
        face_instance = np.concatenate([face_instance, np.full(2 * num_clutter, face_instance.max() + 1, np.int32)])
    return TriangleMesh(
        vertices.astype(np.float32),
        faces,
        np.full((len(faces), 3), 200, np.uint8),
        face_instance,
        face_texture,
        vertex_uv.astype(np.float32)[faces],
        bench_textures(texture_size, num_textures, seed),
    )


@lru_cache(maxsize=2)
def bench_textures(size: int, num: int, seed: int) -> tuple[NDArray[np.uint8], ...]:
    """`num` images (size, size, 3) of coloured noise with detail down to one pixel; read-only, made once."""
    rng = np.random.default_rng([seed, size])
    noise = _noise(size, rng)
    images = []
    for _ in range(num):
        base, swing = rng.uniform(90, 180) + rng.normal(0, 14, 3), rng.uniform(30, 60) + rng.normal(0, 8, 3)
        palette = np.clip(base + np.linspace(-1, 1, 256)[:, None] * swing, 0, 255).astype(np.uint8)
        shift = rng.integers(size, size=2)
        image = palette[np.roll(noise, shift, axis=(0, 1))]
        image.flags.writeable = False
        images.append(image)
    return tuple(images)


def write_bench_glb(path: Path, mesh: TriangleMesh) -> None:
    """Writes a mesh of `bench_mesh` as z-up binary glTF 2.0: one primitive and one JPEG image per texture.

    Args:
        path: File to write.
        mesh: World frame, every face textured, no vertex on two texture islands.
    """
    images = [bytes(imagecodecs.jpeg_encode(texture, level=_JPEG_QUALITY)) for texture in mesh.textures]
    vertex_uv = np.zeros((len(mesh.vertices), 2), np.float32)
    vertex_uv[mesh.faces] = mesh.face_uv
    vertices_glb = glb_zup_from_world(mesh.vertices).astype("<f4")
    data, views, accessors, primitives = bytearray(), [], [], []

    def add_view(content: bytes, **more: int) -> int:
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": len(content), **more})
        data.extend(content)
        data.extend(b"\0" * (-len(data) % 4))
        return len(views) - 1

    def add_accessor(array: NDArray, kind: str, component: int, target: int, **more: list[float]) -> int:
        view = add_view(array.tobytes(), target=target)
        accessors.append({"bufferView": view, "componentType": component, "count": len(array), "type": kind, **more})
        return len(accessors) - 1

    for texture in range(len(mesh.textures)):
        used, index = np.unique(mesh.faces[mesh.face_texture == texture], return_inverse=True)
        if not len(used):
            continue
        points = vertices_glb[used]
        span = {"min": points.min(axis=0).tolist(), "max": points.max(axis=0).tolist()}
        attributes = {
            "POSITION": add_accessor(points, "VEC3", _FLOAT, _ARRAY_BUFFER, **span),
            "TEXCOORD_0": add_accessor(vertex_uv[used].astype("<f4"), "VEC2", _FLOAT, _ARRAY_BUFFER),
        }
        indices = add_accessor(index.reshape(-1).astype("<u4"), "SCALAR", _UINT32, _INDEX_BUFFER)
        primitives.append({"attributes": attributes, "indices": indices, "material": texture})
    image_views = [add_view(image) for image in images]
    content = {
        "asset": {"version": "2.0", "generator": "personal-viz bench"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": primitives}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": k}}} for k in range(len(images))],
        "textures": [{"source": k} for k in range(len(images))],
        "images": [{"bufferView": view, "mimeType": "image/jpeg"} for view in image_views],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(data)}],
    }
    text = json.dumps(content, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    with path.open("wb") as file:
        file.write(struct.pack("<4sII", b"glTF", 2, 12 + 8 + len(text) + 8 + len(data)))
        file.write(struct.pack("<I4s", len(text), b"JSON") + text)
        file.write(struct.pack("<I4s", len(data), b"BIN\0"))
        file.write(data)


def _side_lengths(patch: Patch) -> tuple[float, float]:
    """Lengths of a patch along its first and its last edge."""
    a, b, _, d = patch.corners
    return float(np.linalg.norm(b - a)), float(np.linalg.norm(d - a))


def _islands(patch: Patch) -> list[Patch]:
    """The patch cut into pieces of at most _ISLAND."""
    rows, cols = (max(1, int(np.ceil(side / _ISLAND))) for side in _side_lengths(patch))
    if rows * cols == 1:
        return [patch]
    a, b, c, d = patch.corners
    s, t = np.linspace(0, 1, rows + 1)[:, None, None], np.linspace(0, 1, cols + 1)[None, :, None]
    at = a * (1 - s) * (1 - t) + b * s * (1 - t) + c * s * t + d * (1 - s) * t
    corners = np.stack([at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]], axis=2).reshape(-1, 4, 3)
    return [patch._replace(corners=piece) for piece in corners]


def _segments(sides: NDArray[np.float64], num_faces: int) -> NDArray[np.int64]:
    """(N, 2) divisions of each island along its sides, for about `num_faces` triangles in all islands together."""
    fine, coarse = 1e-4, 10.0
    for _ in range(60):
        edge = (fine * coarse) ** 0.5
        segments = np.maximum(np.ceil(sides / edge - 1e-6), 1).astype(np.int64)
        if 2 * np.prod(segments, axis=1).sum() > num_faces:
            fine = edge
        else:
            coarse = edge
    return np.maximum(np.ceil(sides / coarse - 1e-6), 1).astype(np.int64)


def _layout(
    sides: NDArray[np.float64], num_textures: int, size: int, rng: np.random.Generator
) -> tuple[NDArray[np.int16], NDArray[np.float64]]:
    """A random texture (N,), and a place in it (N, 4, 2), for each island with sides (N, 2) in metres."""
    texture = rng.integers(num_textures, size=len(sides)).astype(np.int16)
    extent = np.minimum(sides * _TEXELS_PER_METRE / size, 1.0)
    low = rng.random((len(sides), 2)) * (1 - extent)
    unit = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)
    return texture, low[:, None] + unit * extent[:, None]


def _divided(
    islands: list[Patch], segments: NDArray[np.int64], corner_uv: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int32], NDArray[np.int64]]:
    """Vertices (V, 3), their uv (V, 2), faces (F, 3) and the island of each face, island after island."""
    num_vertices, num_faces = np.prod(segments + 1, axis=1), 2 * np.prod(segments, axis=1)
    first_vertex, first_face = np.cumsum(num_vertices) - num_vertices, np.cumsum(num_faces) - num_faces
    vertices, uv = np.empty((num_vertices.sum(), 3)), np.empty((num_vertices.sum(), 2))
    faces = np.empty((num_faces.sum(), 3), np.int32)
    corners = np.concatenate([np.stack([island.corners for island in islands]), corner_uv], axis=2)  # (N, 4, 5)
    kinds, kind = np.unique(segments, axis=0, return_inverse=True)
    for k, (n, m) in enumerate(kinds):
        members = np.flatnonzero(kind == k)
        s, t = (
            axis.reshape(-1, 1)
            for axis in np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, m + 1), indexing="ij")
        )
        weights = np.concatenate([(1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t], axis=1)
        points = np.einsum("wc,ncd->nwd", weights, corners[members])
        place = first_vertex[members][:, None] + np.arange((n + 1) * (m + 1))
        vertices[place], uv[place] = points[..., :3], points[..., 3:]
        base = (np.arange(n)[:, None] * (m + 1) + np.arange(m)).reshape(-1, 1)
        quad = np.concatenate([base, base + m + 1, base + m + 2, base, base + m + 2, base + 1], axis=1).reshape(-1, 3)
        rows = first_face[members][:, None] + np.arange(2 * n * m)
        faces[rows] = (quad + first_vertex[members][:, None, None]).astype(np.int32)
    for index, island in enumerate(islands):
        if island.ball is not None:
            own = slice(first_vertex[index], first_vertex[index] + num_vertices[index])
            unit = (vertices[own] - island.ball[0]) / island.ball[1]
            vertices[own] = island.ball[0] + unit / np.linalg.norm(unit, axis=1, keepdims=True) * island.ball[1]
    return vertices, uv, faces, np.repeat(np.arange(len(islands)), num_faces)


def displacement(points: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float32]:
    """(N, 3) metres: waves of 5 to 80 cm in all directions. A function of the place, so neighbours stay joined."""
    waves = rng.normal(size=(_NUM_WAVES, 3))
    waves *= (2 * np.pi / np.geomspace(0.05, 0.8, _NUM_WAVES) / np.linalg.norm(waves, axis=1))[:, None]
    amplitudes = rng.normal(scale=_NOISE_M, size=(_NUM_WAVES, 3)).astype(np.float32)
    phases = points.astype(np.float32) @ waves.T.astype(np.float32) + rng.uniform(0, 2 * np.pi, _NUM_WAVES).astype("f4")
    return np.sin(phases, out=phases) @ amplitudes


def _noise(size: int, rng: np.random.Generator) -> NDArray[np.uint8]:
    """(size, size) noise in octaves from a quarter of the image to one pixel; larger ones are stronger."""
    total = np.zeros((size, size), np.float32)
    cells = 4
    while cells <= size:
        octave = rng.normal(size=(cells, cells)).astype(np.float32)
        repeats = -(-size // cells)
        total += np.repeat(np.repeat(octave, repeats, 0), repeats, 1)[:size, :size] / cells**_ROUGHNESS
        cells *= 2
    low, high = np.quantile(total[:: max(1, size // 256)], [0.01, 0.99])
    return np.clip((total - low) / (high - low) * 255, 0, 255).astype(np.uint8)
