"""The benchmark's scenes: a house divided into any number of triangles, uneven and textured like a scan.

Also writes such a mesh as a GLB file in HM3D's form: z-up, one primitive per texture, JPEG.
"""

import io
from functools import lru_cache
from pathlib import Path

import imagecodecs
import numpy as np
import trimesh
from numpy.typing import NDArray
from PIL import Image
from trimesh.exchange.gltf import export_glb
from trimesh.remesh import subdivide
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from sim.frames import glb_zup_from_world
from sim.mesh import TriangleMesh

from .house import Solid, clutter_quads, house_solids

CLUTTER_SHARE = 0.5
"""Share of a cluttered scene's triangles in its heaps of small pieces."""
CLUTTER_OBJECTS = 1500
"""Number of heaps in a cluttered scene; smaller if heaps would have fewer than _HEAP pieces."""
_HEAP = 60
_ISLAND = 1.25
"""Largest side of one piece of texture, metres: the surfaces of scans are cut into such islands."""
_TEXELS_PER_METRE = 340.0
"""Density of the textures of an HM3D scan."""
_NOISE_M = 0.0015
"""Standard deviation of each wave that displaces surfaces, metres."""
_NUM_WAVES = 8
_ROUGHNESS = 0.35
"""How fast the textures' finer octaves grow weaker; this value makes JPEG files about as large as HM3D's."""
_JPEG_QUALITY = 85


def bench_mesh(
    num_faces: int, *, cluttered: bool, seed: int = 0, texture_size: int = 2048, num_textures: int = 28
) -> TriangleMesh:
    """The benchmark's house with `num_faces` triangles (up to three fewer), the same for the same seed.

    Args:
        num_faces: Number of triangles; the house alone needs about 20,000.
        cluttered: Whether CLUTTER_SHARE of the triangles are small slanted pieces in up to CLUTTER_OBJECTS heaps.
        seed: Seed of furniture, unevenness, clutter and textures.
        texture_size: Side of each square texture, pixels.
        num_textures: Number of textures, at least 1.

    Returns:
        A mesh like those of `like_scan`, with floors at y = 0 and 2.88.
    """
    rng = np.random.default_rng(seed)
    solids = house_solids(rng)
    surfaces = [_surface(solid) for solid in solids]
    mesh = trimesh.util.concatenate(surfaces)
    assert isinstance(mesh, trimesh.Trimesh)
    instance = np.repeat([solid.instance for solid in solids], [len(surface.faces) for surface in surfaces])
    num_quads = int(num_faces * CLUTTER_SHARE) // 2 if cluttered else 0
    num_heaps = min(CLUTTER_OBJECTS, -(-num_quads // _HEAP))
    return like_scan(
        mesh.vertices,
        mesh.faces,
        instance.astype(np.int32),
        num_faces=num_faces - 2 * num_quads,
        loose=clutter_quads(num_quads, num_heaps=num_heaps, rng=rng) if cluttered else None,
        seed=seed,
        texture_size=texture_size,
        num_textures=num_textures,
    )


def like_scan(
    points: NDArray[np.floating],
    faces: NDArray[np.integer],
    instance: NDArray[np.int32],
    *,
    num_faces: int,
    seed: int,
    loose: NDArray[np.float64] | None = None,
    texture_size: int = 2048,
    num_textures: int = 28,
) -> TriangleMesh:
    """A surface divided into about `num_faces` triangles, uneven, and textured with noise in islands.

    Args:
        points: (V, 3) world metres.
        faces: (F, 3) indices of points.
        instance: (F,) object ids.
        num_faces: Number of triangles (up to three fewer), unless the surface has more.
        seed: Seed of unevenness and textures.
        loose: (N, 4, 3) further quads, two triangles each, which stay even.
        texture_size: Side of each square texture, pixels.
        num_textures: Number of textures, at least 1.

    Returns:
        Every face is textured, and no vertex is on two islands.
    """
    vertices, index = np.unique(points.astype(np.float64), axis=0, return_inverse=True)
    faces = index.reshape(-1)[faces]
    while (missing := (num_faces - len(faces)) // 3) > 0:
        is_large = np.zeros(len(faces), bool)
        is_large[np.argsort(-_areas(vertices, faces), kind="stable")[: min(missing, -(-len(faces) // 4))]] = True
        vertices, faces, *_ = subdivide(vertices, faces, np.flatnonzero(is_large))
        instance = np.concatenate([instance[~is_large], np.repeat(instance[is_large], 4)])
    rng = np.random.default_rng(seed)
    moved = vertices + displacement(vertices, rng)
    if loose is not None:
        added = np.arange(4 * len(loose)).reshape(-1, 4)[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
        faces = np.concatenate([faces, added + len(vertices)])
        vertices = np.concatenate([vertices, loose.reshape(-1, 3)])
        moved = np.concatenate([moved, loose.reshape(-1, 3)])
        instance = np.concatenate([instance, np.full(2 * len(loose), instance.max() + 1, np.int32)])
    owner, used, uv, faces = _islands(vertices, faces, texture_size, rng)
    texture = rng.integers(num_textures, size=owner[-1] + 1).astype(np.int16)
    return TriangleMesh(
        moved[used].astype(np.float32),
        faces,
        np.full((len(faces), 3), 200, np.uint8),
        instance,
        texture[owner[faces[:, 0]]],
        uv[faces],
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
    """Writes a mesh of `like_scan` as z-up binary glTF 2.0: one primitive and one JPEG image per texture."""
    scene = trimesh.Scene()
    uv = np.zeros((len(mesh.vertices), 2))
    uv[mesh.faces] = mesh.face_uv
    for number, texture in enumerate(mesh.textures):
        used, index = np.unique(mesh.faces[mesh.face_texture == number], return_inverse=True)
        if not len(used):
            continue
        image = Image.open(io.BytesIO(imagecodecs.jpeg_encode(texture, level=_JPEG_QUALITY)))
        visual = TextureVisuals(
            uv[used] * (1, -1) + (0, 1),  # trimesh's origin is at the bottom
            material=PBRMaterial(baseColorTexture=image),
        )
        points = glb_zup_from_world(mesh.vertices[used])
        scene.add_geometry(trimesh.Trimesh(points, index.reshape(-1, 3), visual=visual, process=False))
    path.write_bytes(export_glb(scene))


def displacement(points: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float32]:
    """(N, 3) metres: waves of 5 to 80 cm in all directions. A function of the place, so neighbours stay joined."""
    waves = rng.normal(size=(_NUM_WAVES, 3))
    waves *= (2 * np.pi / np.geomspace(0.05, 0.8, _NUM_WAVES) / np.linalg.norm(waves, axis=1))[:, None]
    amplitudes = rng.normal(scale=_NOISE_M, size=(_NUM_WAVES, 3)).astype(np.float32)
    phases = points.astype(np.float32) @ waves.T.astype(np.float32) + rng.uniform(0, 2 * np.pi, _NUM_WAVES).astype("f4")
    return np.sin(phases, out=phases) @ amplitudes


def _surface(solid: Solid) -> trimesh.Trimesh:
    """The surface of a box or an ellipsoid."""
    low, high = np.array([solid.low, solid.high])
    if not solid.is_round:
        return trimesh.creation.box(bounds=(low, high))
    ball = trimesh.creation.icosphere(subdivisions=1)
    return trimesh.Trimesh(ball.vertices * (high - low) / 2 + (low + high) / 2, ball.faces, process=False)


def _islands(
    vertices: NDArray[np.float64], faces: NDArray[np.int64], texture_size: int, rng: np.random.Generator
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float32], NDArray[np.int32]]:
    """Cuts a surface into islands: the triangles of a cube of space that face along one axis.

    Returns:
        The island and the old index (N,) of each new vertex, island by island; its uv (N, 2), at a random place within
        0-1; and the faces (F, 3) of new vertices.
    """
    corners = vertices[faces]
    axis = np.abs(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])).argmax(axis=1)
    cube = np.floor((corners.mean(axis=1) - vertices.min(axis=0)) / _ISLAND).astype(np.int64) @ (1 << 40, 1 << 20, 1)
    codes, island = np.unique(3 * cube + axis, return_inverse=True)
    keys, index = np.unique(island[:, None] * len(vertices) + faces, return_inverse=True)
    owner, used = np.divmod(keys, len(vertices))
    flat = vertices[used][np.arange(len(used))[:, None], np.array([[1, 2], [0, 2], [0, 1]])[codes[owner] % 3]]
    first = np.searchsorted(owner, np.arange(len(codes)))
    low, high = np.minimum.reduceat(flat, first), np.maximum.reduceat(flat, first)
    scale = np.minimum(_TEXELS_PER_METRE / texture_size, 1 / (high - low).max(axis=1))[:, None]
    place = rng.random((len(codes), 2)) * (1 - (high - low) * scale)
    uv = ((flat - low[owner]) * scale[owner] + place[owner]).clip(0, 1)
    return owner, used, uv.astype(np.float32), index.reshape(faces.shape).astype(np.int32)


def _areas(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> NDArray[np.float64]:
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2


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
