"""Log the home: the storeys that runs visited, without ceilings, as Rerun meshes."""

from collections.abc import Iterator, Sequence

import numpy as np
import rerun as rr
from numpy.typing import NDArray
from PIL import Image

from sim.scenes.scene import Scene, TriangleMesh, cut_storey

from . import paths

MAX_TEXTURE = 512
"""Longest side of a logged texture (pixels); a scan's 2048 would make recordings of hundreds of megabytes."""
LIGHT = np.array([0.35, 0.85, 0.4])
"""Towards the light, world; flat colours are shaded once here, because Rerun draws meshes without normals unlit."""
AMBIENT = 0.7


def log_scene(stream: rr.RecordingStream, scene: Scene, *, storeys: Sequence[int]) -> None:
    """Logs the mesh of each storey in `storeys` (indices into the scene's storey heights) below `/scene/mesh`."""
    for index in storeys:
        cut = cut_storey(scene.mesh, scene.navigation.storey_heights[index])
        for name, part in mesh_parts(cut):
            stream.log(f"{paths.MESH}/{paths.storey_part(index)}/{name}", part, static=True)


def mesh_parts(mesh: TriangleMesh) -> Iterator[tuple[str, rr.Mesh3D]]:
    """(name, Rerun mesh) of the faces with flat colours and of each texture's faces."""
    for texture in np.unique(mesh.face_texture):
        part = mesh.select(mesh.face_texture == texture)
        if texture < 0:
            yield "flat", _flat(part)
        else:
            yield f"texture_{texture}", _textured(part, mesh.textures[texture])


def _flat(mesh: TriangleMesh) -> rr.Mesh3D:
    corners = mesh.vertices[mesh.faces]
    rgb = np.clip(mesh.face_rgb * _shade(corners)[:, None], 0, 255).astype(np.uint8)
    return rr.Mesh3D(
        vertex_positions=corners.reshape(-1, 3),
        triangle_indices=_one_vertex_per_corner(mesh),
        vertex_colors=np.repeat(rgb, 3, axis=0),
    )


def _textured(mesh: TriangleMesh, texture: NDArray[np.uint8]) -> rr.Mesh3D:
    image = Image.fromarray(texture)
    image.thumbnail((MAX_TEXTURE, MAX_TEXTURE))
    return rr.Mesh3D(
        vertex_positions=mesh.vertices[mesh.faces].reshape(-1, 3),
        triangle_indices=_one_vertex_per_corner(mesh),
        vertex_texcoords=mesh.face_uv.reshape(-1, 2),
        albedo_texture=np.asarray(image),
    )


def _one_vertex_per_corner(mesh: TriangleMesh) -> NDArray[np.uint32]:
    """Colours and texture coordinates belong to faces, so corners cannot share vertices; (F, 3)."""
    return np.arange(3 * len(mesh.faces), dtype=np.uint32).reshape(-1, 3)


def _shade(corners: NDArray[np.float32]) -> NDArray[np.float64]:
    """Brightness (F,) of faces (F, 3, 3) between AMBIENT and 1; both sides alike, windings may differ."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).astype(float)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return AMBIENT + (1 - AMBIENT) * np.abs(normals @ (LIGHT / np.linalg.norm(LIGHT)))
