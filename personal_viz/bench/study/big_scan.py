"""A scan of any size on disk: an invented home whose triangles are divided and made uneven, as scans are."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sim.copies.glb_writer import glb_from_mesh
from sim.episodes.dataset import PersonalDataset
from sim.frames import glb_zup_from_world
from sim.homes.open_home import open_scene
from sim.mesh import TriangleMesh

from ..sim.scenes import displacement

BIG_HOME = "WideHome"
"""Behind the small home's name, so that workers open the small one first."""


@dataclass(frozen=True, slots=True)
class BigScan:
    """What was written."""

    faces: int
    file_mb: float
    """MB of 10^6 bytes."""


def write_big_scan(dataset: Path, scans: Path, *, num_faces: int, seed: int) -> BigScan:
    """Writes the scan of BIG_HOME into `scans`; its episodes and plan are in the dataset.

    Args:
        dataset: With BIG_HOME.
        scans: Folder of scans.
        num_faces: At least so many triangles.
        seed: Of the unevenness.

    Raises:
        DatasetError, SceneError: The dataset does not have the home.
    """
    mesh = open_scene(PersonalDataset(dataset), BIG_HOME).mesh
    while len(mesh.faces) < num_faces:
        mesh = divided(mesh)
    uneven = mesh.vertices + displacement(mesh.vertices.astype(np.float64), np.random.default_rng(seed))
    zup = glb_zup_from_world(uneven).astype(np.float32)
    path = scans / f"{BIG_HOME}.glb"
    path.write_bytes(glb_from_mesh(replace(mesh, vertices=zup)))
    return BigScan(len(mesh.faces), path.stat().st_size / 1e6)


def divided(mesh: TriangleMesh) -> TriangleMesh:
    """The same surface with four triangles for each; neighbours stay joined."""
    corners = mesh.faces.astype(np.int64)
    ends = np.sort(np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]]), axis=1)
    edges, edge_of = np.unique(ends[:, 0] * len(mesh.vertices) + ends[:, 1], return_inverse=True)
    first, second = edges // len(mesh.vertices), edges % len(mesh.vertices)
    ab, bc, ca = len(mesh.vertices) + edge_of.reshape(3, -1)
    a, b, c = corners.T
    faces = np.concatenate([np.stack(three, axis=1) for three in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    rgb = mesh.vertex_rgb
    return TriangleMesh(
        np.concatenate([mesh.vertices, (mesh.vertices[first] + mesh.vertices[second]) / 2]).astype(np.float32),
        faces.astype(np.int32),
        np.tile(mesh.face_rgb, (4, 1)),
        np.tile(mesh.face_instance, 4),
        np.tile(mesh.face_texture, 4),
        _divided_uv(mesh.face_uv),
        mesh.textures,
        None if rgb is None else np.concatenate([rgb, ((rgb[first].astype(int) + rgb[second]) // 2).astype(np.uint8)]),
    )


def _divided_uv(uv: NDArray[np.float32]) -> NDArray[np.float32]:
    """(4 F, 3, 2) texture coordinates of the corners, in the order of `divided`."""
    a, b, c = uv[:, 0], uv[:, 1], uv[:, 2]
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    parts = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
    return np.concatenate([np.stack(three, axis=1) for three in parts]).astype(np.float32)
