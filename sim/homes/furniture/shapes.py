"""Flat-sided shapes of quads with a normal per corner and texture places in metres; round ones: lofts.py."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .families import Vec
from .shape_kernels import planar_uv, quad_normals

_AXES = np.eye(3)
_FACES = np.array(
    [
        [[1, -1, 1], [1, -1, -1], [1, 1, -1], [1, 1, 1]],  # +x
        [[-1, -1, -1], [-1, -1, 1], [-1, 1, 1], [-1, 1, -1]],  # -x
        [[-1, 1, -1], [-1, 1, 1], [1, 1, 1], [1, 1, -1]],  # +y
        [[-1, -1, -1], [1, -1, -1], [1, -1, 1], [-1, -1, 1]],  # -y
        [[-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]],  # +z
        [[1, -1, -1], [-1, -1, -1], [-1, 1, -1], [1, 1, -1]],  # -z
    ],
    float,
)  # (6, 4, 3), counter-clockwise from outside


class Shape(NamedTuple):
    """Quads in the frame of a piece: x to its right, y up from its bottom, its front looks along +z."""

    corners: NDArray[np.float64]
    """(N, 4, 3) metres, counter-clockwise from outside; a triangle repeats a corner."""
    normals: NDArray[np.float64]
    """(N, 4, 3) unit vectors."""
    uv: NDArray[np.float64]
    """(N, 4, 2) metres on the finish."""

    def moved(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> "Shape":
        """The shape by (x, y, z) metres further on."""
        return self._replace(corners=self.corners + np.array([x, y, z]))

    def turned(self, axis: str, angle: float) -> "Shape":
        """The shape turned about the piece's axis x, y or z through the origin; radians, right-handed."""
        R = rotation(axis, angle)
        return self._replace(corners=self.corners @ R.T, normals=self.normals @ R.T)

    def scaled(self, factors: Vec) -> "Shape":
        """The shape stretched along the piece's axes by positive factors, about the origin."""
        normals = self.normals / np.array(factors)
        corners = self.corners * np.array(factors)
        return self._replace(corners=corners, normals=_unit(normals))


def rotation(axis: str, angle: float) -> NDArray[np.float64]:
    """(3, 3) matrix that turns column vectors about an axis of the piece."""
    cos, sin = np.cos(angle), np.sin(angle)
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    R = np.eye(3)
    R[i, i] = R[j, j] = cos
    R[i, j], R[j, i] = -sin, sin
    return R


def merged(shapes: Iterable[Shape]) -> Shape:
    """One shape of several."""
    corners, normals, uv = zip(*shapes, strict=True)
    return Shape(np.concatenate(corners), np.concatenate(normals), np.concatenate(uv))


def facets(corners: ArrayLike) -> Shape:
    """Flat quads (N, 4, 3), each with its own normal; the texture's u runs along the longer side of the whole."""
    quads = np.ascontiguousarray(corners, float).reshape(-1, 4, 3)
    normals = quad_normals(quads)
    return Shape(quads, np.repeat(normals[:, None], 4, axis=1), planar_uv(quads, normals))


def box(centre: Vec, size: Vec) -> Shape:
    """A box with sharp edges; 12 triangles."""
    return facets(_FACES * (np.array(size) / 2) + np.array(centre))


def picture_quad(centre: Vec, size: tuple[float, float]) -> Shape:
    """One upright rectangle that looks along +z, `size` along x and y; the texture stands upright on it."""
    x, y, z = centre
    w, h = size[0] / 2, size[1] / 2
    signs = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    flat = facets([[(x + sx * w, y + sy * h, z) for sx, sy in signs]])
    return flat._replace(uv=np.array([[((sx + 1) * w, (1 - sy) * h) for sx, sy in signs]]))


def slab(centre: Vec, size: Vec, *, faces: str) -> Shape:
    """Some faces of a box, named by "+x", "-x", "+y", ... one after the other; for what touches other things."""
    names = ("+x", "-x", "+y", "-y", "+z", "-z")
    chosen = [names.index(faces[k : k + 2]) for k in range(0, len(faces), 2)]
    return facets(_FACES[chosen] * (np.array(size) / 2) + np.array(centre))


def rounded_box(centre: Vec, size: Vec, bevel: float) -> Shape:
    """A box whose edges are bevelled and lit as if round; 44 triangles."""
    half = np.array(size) / 2
    edge = min(bevel, 0.49 * min(size))
    signs, lit = _ROUNDED
    corners = signs * (half - edge) + lit * edge
    return Shape(corners + np.array(centre), lit, planar_uv(corners, _ROUNDED_FACING))


def prism(outline: Sequence[tuple[float, float]], *, low: float, high: float, axis: str = "z") -> Shape:
    """A convex outline pushed along an axis from `low` to `high`.

    Args:
        outline: Points counter-clockwise as seen from the axis' positive end: (x, y) for z, (z, x) for y, (y, z) for x.
        low: Where it begins on the axis, metres.
        high: Where it ends.
        axis: "x", "y" or "z".
    """
    flat = np.asarray(outline, float)
    k = "xyz".index(axis)
    ends = []
    for level in (low, high):
        points = np.empty((len(flat), 3))
        points[:, k], points[:, (k + 1) % 3], points[:, (k + 2) % 3] = level, flat[:, 0], flat[:, 1]
        ends.append(points)
    bottom, top = ends
    sides = np.stack([bottom, np.roll(bottom, -1, 0), np.roll(top, -1, 0), top], axis=1)
    return facets(np.concatenate([sides, fan(top), fan(bottom)[:, ::-1]]))


def fan(ring: NDArray[np.float64]) -> NDArray[np.float64]:
    """Quads (N, 4, 3) that fill a convex ring (P, 3), in its order."""
    num = len(ring)
    index = [[0, k, k + 1, min(k + 2, num - 1)] for k in range(1, num - 1, 2)]
    return ring[index]


def _rounded() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Of a bevelled box's 6 faces, 12 edges, 8 corners: sides (26, 4, 3) of -1 and 1, and normals (26, 4, 3)."""
    signs, normals = [], []
    for axis in range(3):
        i, j = (axis + 1) % 3, (axis + 2) % 3
        for sign in (-1, 1):
            signs.append([_at({axis: sign, i: a, j: b}) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
            normals.append([_AXES[axis] * sign] * 4)
        for a, b in np.ndindex(2, 2):  # the edges along the axis
            at_i, at_j = 2 * a - 1, 2 * b - 1
            near, far = (_at({axis: end, i: at_i, j: at_j}) for end in (-1, 1))
            signs.append([near, near, far, far])
            normals.append([_AXES[i] * at_i, _AXES[j] * at_j, _AXES[j] * at_j, _AXES[i] * at_i])
    for corner in np.ndindex(2, 2, 2):
        sides = np.array(corner) * 2.0 - 1
        signs.append([sides] * 4)
        normals.append([_AXES[axis] * sides[axis] for axis in (0, 1, 2, 2)])
    sides, lit = np.array(signs), np.array(normals)
    inwards = (quad_normals(sides + lit) * lit.mean(axis=1)).sum(axis=1) < 0
    sides[inwards], lit[inwards] = sides[inwards, ::-1], lit[inwards, ::-1]
    return sides, lit


def _at(of_axis: dict[int, float]) -> NDArray[np.float64]:
    return np.array([of_axis[0], of_axis[1], of_axis[2]], float)


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)


_ROUNDED = _rounded()
_ROUNDED_FACING = _ROUNDED[1].mean(axis=1)
