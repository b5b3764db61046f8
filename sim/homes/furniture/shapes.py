"""Flat-sided shapes of quads with a normal per corner and texture places in metres, and drafts of pieces made of them.

Round shapes are in lofts.py.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim.compiled import njit
from sim.homes.plan import Finish

from .families import Vec

_LEAST = 1e-12


@njit(cache=True, nogil=True)
def quad_normals(quads: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit normals (N, 3) of quads (N, 4, 3), from their diagonals."""
    found = np.empty((len(quads), 3))
    for k in range(len(quads)):
        a0, a1, a2 = quads[k, 2, 0] - quads[k, 0, 0], quads[k, 2, 1] - quads[k, 0, 1], quads[k, 2, 2] - quads[k, 0, 2]
        b0, b1, b2 = quads[k, 3, 0] - quads[k, 1, 0], quads[k, 3, 1] - quads[k, 1, 1], quads[k, 3, 2] - quads[k, 1, 2]
        x, y, z = a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0
        length = max(np.sqrt(x * x + y * y + z * z), _LEAST)
        found[k, 0], found[k, 1], found[k, 2] = x / length, y / length, z / length
    return found


@njit(cache=True, nogil=True)
def planar_uv(quads: NDArray[np.float64], normals: NDArray[np.float64]) -> NDArray[np.float64]:
    """Texture places (N, 4, 2) along the two axes of each quad, the longer side of the whole first; v runs down."""
    extent = np.zeros(3)
    for i in range(3):
        extent[i] = quads[:, :, i].max() - quads[:, :, i].min()
    uv = np.empty((len(quads), 4, 2))
    for k in range(len(quads)):
        n0, n1, n2 = abs(normals[k, 0]), abs(normals[k, 1]), abs(normals[k, 2])
        across = 0 if n0 >= n1 and n0 >= n2 else (1 if n1 >= n2 else 2)
        first, second = (across + 1) % 3, (across + 2) % 3
        if extent[second] > extent[first] or (extent[second] == extent[first] and second < first):
            first, second = second, first
        for corner in range(4):
            uv[k, corner, 0] = -quads[k, corner, first] if first == 1 else quads[k, corner, first]
            uv[k, corner, 1] = -quads[k, corner, second] if second == 1 else quads[k, corner, second]
    return uv


@njit(cache=True, nogil=True)
def loft_quads(
    rings: NDArray[np.float64], smooth: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Corners (N, 4, 3), normals (N, 4, 3) and texture places (N, 4, 2) of the skin over rings (M, P, 3).

    Args:
        rings: Closed rings.
        smooth: Cosine of the angle up to which neighbouring quads are lit as one curved surface.
    """
    num, sides = rings.shape[0] - 1, rings.shape[1]
    corners = np.empty((num, sides, 4, 3))
    for m in range(num):
        for p in range(sides):
            after = (p + 1) % sides
            corners[m, p, 0], corners[m, p, 1] = rings[m, p], rings[m, after]
            corners[m, p, 2], corners[m, p, 3] = rings[m + 1, after], rings[m + 1, p]
    flat = quad_normals(corners.reshape(-1, 4, 3)).reshape(num, sides, 3)
    around = np.empty((num, sides, 2, 3))  # blended with the quad before and with the one after
    for m in range(num):
        for p in range(sides):
            _blend(flat[m, p], flat[m, p - 1], smooth, around[m, p, 0])
            _blend(flat[m, p], flat[m, (p + 1) % sides], smooth, around[m, p, 1])
    normals = np.empty_like(corners)
    for m in range(num):
        below, above = max(m - 1, 0), min(m + 1, num - 1)
        for p in range(sides):
            for corner, side, other in ((0, 0, below), (1, 1, below), (2, 1, above), (3, 0, above)):
                _blend(around[m, p, side], around[other, p, side], smooth, normals[m, p, corner])
    u, v = _arc_lengths(rings)
    uv = np.empty((num, sides, 4, 2))
    for m in range(num):
        for p in range(sides):
            uv[m, p, 0, 0] = uv[m, p, 3, 0] = u[p]
            uv[m, p, 1, 0] = uv[m, p, 2, 0] = u[p + 1]
            uv[m, p, 0, 1] = uv[m, p, 1, 1] = v[m]
            uv[m, p, 2, 1] = uv[m, p, 3, 1] = v[m + 1]
    return corners.reshape(-1, 4, 3), normals.reshape(-1, 4, 3), uv.reshape(-1, 4, 2)


@njit(cache=True, nogil=True)
def _blend(own: NDArray[np.float64], other: NDArray[np.float64], smooth: float, out: NDArray[np.float64]) -> None:
    """Writes the mean of two unit normals into `out` (3,) if they are alike, else the first one."""
    if own[0] * other[0] + own[1] * other[1] + own[2] * other[2] > smooth:
        x, y, z = own[0] + other[0], own[1] + other[1], own[2] + other[2]
        length = max(np.sqrt(x * x + y * y + z * z), _LEAST)
        out[0], out[1], out[2] = x / length, y / length, z / length
    else:
        out[:] = own


@njit(cache=True, nogil=True)
def _arc_lengths(rings: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Distances in metres around the longest ring (P + 1,), and upwards along the longest side (M,)."""
    num, sides = rings.shape[0], rings.shape[1]
    u, v = np.zeros(sides + 1), np.zeros(num)
    for p in range(sides):
        longest = 0.0
        for m in range(num):
            longest = max(longest, _distance(rings[m, p], rings[m, (p + 1) % sides]))
        u[p + 1] = u[p] + longest
    for m in range(num - 1):
        longest = 0.0
        for p in range(sides):
            longest = max(longest, _distance(rings[m, p], rings[m + 1, p]))
        v[m + 1] = v[m] + longest
    return u, v


@njit(cache=True, nogil=True)
def _distance(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    return np.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


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
    """Quads in the frame of a piece: x points to its right, y up from its bottom, and its front faces +z."""

    corners: NDArray[np.float64]
    """(N, 4, 3) metres, counter-clockwise from outside; a triangle repeats a corner."""
    normals: NDArray[np.float64]
    """(N, 4, 3) unit vectors."""
    uv: NDArray[np.float64]
    """(N, 4, 2) metres on the finish."""

    def moved(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> "Shape":
        """The shape moved by (x, y, z) metres."""
        return self._replace(corners=self.corners + np.array([x, y, z]))

    def turned(self, axis: str, angle: float) -> "Shape":
        """The shape turned about the piece's axis x, y or z through the origin; radians, right-handed."""
        R = rotation(axis, angle)
        return self._replace(corners=self.corners @ R.T, normals=self.normals @ R.T)

    def chosen(self, keep: NDArray[np.bool_]) -> "Shape":
        """The shape's quads where `keep` (N,) is true."""
        return Shape(self.corners[keep], self.normals[keep], self.uv[keep])

    def scaled(self, factors: Vec) -> "Shape":
        """The shape stretched along the piece's axes by positive factors, about the origin."""
        return self._replace(corners=self.corners * factors, normals=unit(self.normals / factors))


def rotation(axis: str, angle: float) -> NDArray[np.float64]:
    """The matrix (3, 3) that turns column vectors about an axis of the piece."""
    cos, sin = np.cos(angle), np.sin(angle)
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    R = np.eye(3)
    R[i, i] = R[j, j] = cos
    R[i, j], R[j, i] = -sin, sin
    return R


def merged(shapes: Iterable[Shape]) -> Shape:
    """One shape with the quads of several."""
    corners, normals, uv = zip(*shapes, strict=True)
    return Shape(np.concatenate(corners), np.concatenate(normals), np.concatenate(uv))


def both(*shapes: Shape, axis: str = "x") -> Shape:
    """The shapes and their mirror images across the piece's middle."""
    one = merged(shapes)
    flip = np.where(np.arange(3) == "xyz".index(axis), -1.0, 1.0)
    return merged([one, Shape((one.corners * flip)[:, ::-1], (one.normals * flip)[:, ::-1], one.uv[:, ::-1])])


def four(*shapes: Shape) -> Shape:
    """The shapes at all four corners of a piece, mirrored across its middle."""
    return both(both(*shapes), axis="z")


def facets(corners: ArrayLike) -> Shape:
    """Flat quads (N, 4, 3), each with its own normal; the texture's u runs along the longer side of the whole."""
    quads = np.ascontiguousarray(corners, float).reshape(-1, 4, 3)
    normals = quad_normals(quads)
    return Shape(quads, np.repeat(normals[:, None], 4, axis=1), planar_uv(quads, normals))


def box(centre: Vec, size: Vec) -> Shape:
    """A box with sharp edges; 12 triangles."""
    return facets(_FACES * (np.array(size) / 2) + np.array(centre))


def picture_quad(centre: Vec, size: tuple[float, float]) -> Shape:
    """One upright rectangle that faces +z, `size` along x and y, with the texture upright on it."""
    x, y, z = centre
    w, h = size[0] / 2, size[1] / 2
    signs = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    flat = facets([[(x + sx * w, y + sy * h, z) for sx, sy in signs]])
    return flat._replace(uv=np.array([[((sx + 1) * w, (1 - sy) * h) for sx, sy in signs]]))


def flat(points: Sequence[tuple[float, float]], z: float) -> Shape:
    """One upright quad of four points (x, y) that faces +z."""
    return facets([[(x, y, z) for x, y in points]])


def slab(centre: Vec, size: Vec, *, faces: str) -> Shape:
    """Some faces of a box, listed as "+x", "-x", "+y" and so on in one text; for boxes that touch other things."""
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
        low: Start of the prism on the axis, metres.
        high: End of the prism on the axis, metres.
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
    """Quads (N, 4, 3) that fill a convex ring (P, 3), in the ring's order."""
    num = len(ring)
    index = [[0, k, k + 1, min(k + 2, num - 1)] for k in range(1, num - 1, 2)]
    return ring[index]


def _rounded() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The 6 faces, 12 edges and 8 corners of a bevelled box: sides (26, 4, 3) of -1 and 1, and normals (26, 4, 3)."""
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


def unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Vectors (..., 3) at length 1; zeros stay zeros."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), _LEAST)


_ROUNDED = _rounded()
_ROUNDED_FACING = _ROUNDED[1].mean(axis=1)


class Part(NamedTuple):
    """A shape of one finish in the frame of its piece (see `Shape`)."""

    shape: Shape
    finish: Finish


@dataclass
class Draft:
    """A piece of furniture that its family's builder fills with parts."""

    size: Vec
    """Width, height, depth in metres, large enough for the family's builder; parts.py shrinks the result."""
    finish: Finish
    """Finish of its main surface."""
    words: frozenset[str]
    """Lower-case words of the category, and of the caption about the thing itself."""
    rng: np.random.Generator
    """Seeded by the piece's name; draws details that neither category nor caption gives."""
    parts: list[Part] = field(default_factory=list)

    def says(self, *words: str) -> bool:
        """Whether any of the words is in the category or the caption."""
        return not self.words.isdisjoint(words)

    def add(self, finish: Finish, *shapes: Shape) -> None:
        """Adds one more part, made of several shapes."""
        self.parts.append(Part(merged(shapes), finish))

    def section(self, size: Vec, finish: Finish | None = None) -> "Draft":
        """An empty draft for a section of the piece, built about its own middle; `put` sets it in its place."""
        return Draft(size, finish or self.finish, self.words, self.rng)

    def put(self, section: "Draft", *, x: float = 0.0, y: float = 0.0) -> None:
        """Adds the parts of a section, moved by (x, y, 0) metres."""
        self.parts += [Part(part.shape.moved(x, y), part.finish) for part in section.parts]


Builder = Callable[[Draft, float, float, float], None]
"""Adds the parts of a family to a draft of this width, height and depth (metres)."""
