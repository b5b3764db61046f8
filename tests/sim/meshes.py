"""Small meshes with known answers, for tests of the renderer and of navigation."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.mesh import FLAT, TriangleMesh

Quad = tuple[NDArray[np.float64], tuple[int, int, int], int]


def floor(x0: float, z0: float, x1: float, z1: float, *, y: float = 0.0, rgb=(90, 90, 90), instance: int = 0) -> Quad:
    """A level rectangle that faces up."""
    return np.array([[x0, y, z0], [x0, y, z1], [x1, y, z1], [x1, y, z0]]), rgb, instance


def ramp(x0: float, z0: float, x1: float, z1: float, *, y0: float, y1: float) -> Quad:
    """A rectangle that faces up and rises from y0 at x0 to y1 at x1."""
    return np.array([[x0, y0, z0], [x0, y0, z1], [x1, y1, z1], [x1, y1, z0]]), (90, 90, 90), 0


def box(
    low: tuple[float, float, float], high: tuple[float, float, float], *, rgb=(200, 30, 30), instance=0
) -> list[Quad]:
    """Six rectangles that face outwards."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    corners = [
        [[x0, y1, z0], [x0, y1, z1], [x1, y1, z1], [x1, y1, z0]],
        [[x0, y0, z0], [x1, y0, z0], [x1, y0, z1], [x0, y0, z1]],
        [[x0, y0, z1], [x1, y0, z1], [x1, y1, z1], [x0, y1, z1]],
        [[x1, y0, z0], [x0, y0, z0], [x0, y1, z0], [x1, y1, z0]],
        [[x1, y0, z1], [x1, y0, z0], [x1, y1, z0], [x1, y1, z1]],
        [[x0, y0, z0], [x0, y0, z1], [x0, y1, z1], [x0, y1, z0]],
    ]
    return [(np.array(quad, float), rgb, instance) for quad in corners]


def mesh_of(*quads: Quad, textures: tuple[NDArray[np.uint8], ...] = (), texture: int = -1) -> TriangleMesh:
    """A mesh of rectangles; with `texture`, the image covers each rectangle once."""
    vertices = np.concatenate([quad[0] for quad in quads]).astype(np.float32)
    corners = np.arange(len(quads))[:, None, None] * 4 + np.array([[0, 1, 2], [0, 2, 3]])
    uv = np.array([[0, 0], [0, 1], [1, 1], [1, 0]], np.float32)[[[0, 1, 2], [0, 2, 3]]]
    count = 2 * len(quads)
    return TriangleMesh(
        vertices,
        corners.reshape(-1, 3).astype(np.int32),
        np.repeat(np.array([quad[1] for quad in quads], np.uint8), 2, axis=0),
        np.repeat(np.array([quad[2] for quad in quads], np.int32), 2),
        np.full(count, texture, np.int16),
        np.tile(uv, (len(quads), 1, 1)),
        textures,
    )


def triangles(corners: NDArray, **changes: Any) -> TriangleMesh:
    """A mesh of loose grey triangles (F, 3, 3) without textures, unless `changes` say otherwise."""
    count = len(corners)
    plain = TriangleMesh(
        np.asarray(corners, np.float32).reshape(-1, 3),
        np.arange(3 * count, dtype=np.int32).reshape(-1, 3),
        np.full((count, 3), 90, np.uint8),
        np.zeros(count, np.int32),
        np.full(count, FLAT, np.int16),
        np.zeros((count, 3, 2), np.float32),
    )
    return replace(plain, **changes)


def joined(first: TriangleMesh, second: TriangleMesh) -> TriangleMesh:
    """Both meshes as one; vertices and textures are kept apart."""
    texture = np.where(second.face_texture < 0, second.face_texture, second.face_texture + len(first.textures))
    moved = replace(second, faces=second.faces + len(first.vertices), face_texture=texture.astype(np.int16))
    names = ("vertices", "faces", "face_rgb", "face_instance", "face_texture", "face_uv")
    both = {name: np.concatenate([getattr(first, name), getattr(moved, name)]) for name in names}
    return replace(first, **both, textures=first.textures + second.textures)


def area(mesh: TriangleMesh) -> NDArray[np.float64]:
    """Area of each face (F,), square metres."""
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces].astype(float), 1, 0)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
