"""A surface of triangles that share vertices, and the look of its faces at a place; compiled loops of `decimate`."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.compiled import njit

NO_AREA = 1e-14
"""Square metres below which a face has no direction."""
# Small kernels are inlined: otherwise numba counts references to each array of `Surface` at every call, which takes a
# third of the time of a copy.
_FOLD_COS = 0.7
"""Faces whose angle at an edge has a larger cosine are folded onto each other."""


class Surface(NamedTuple):
    """Faces whose corners are moved; `start` and `ring` come from `rings`."""

    points: NDArray[np.float64]
    """(V, 3) metres."""
    faces: NDArray[np.int32]
    """(F, 3) vertices."""
    look: NDArray[np.int32]
    """(F,) number of the texture or colour; different numbers never mix."""
    shown: NDArray[np.float32]
    """(F, 3, C) texture coordinates (and 0) or a colour at each corner, and the light on the texture where C is 6."""
    scale: NDArray[np.float32]
    """(F,) a change of 1 in the first three of `shown` counts like this many metres."""
    start: NDArray[np.int64]
    """(V + 1,) index in `ring` of each vertex's first face."""
    ring: NDArray[np.int32]
    """(3 F,) faces around each vertex."""


@njit(cache=True, nogil=True)
def rings(faces, num_vertices):
    """(start (V + 1,), faces around each vertex one vertex after the other (3 F,))."""
    start = np.zeros(num_vertices + 1, np.int64)
    for f in range(len(faces)):
        for k in range(3):
            start[faces[f, k] + 1] += 1
    start = np.cumsum(start)
    at = start[:-1].copy()
    ring = np.empty(3 * len(faces), np.int32)
    for f in range(len(faces)):
        for k in range(3):
            v = faces[f, k]
            ring[at[v]] = f
            at[v] += 1
    return start, ring


@njit(cache=True, nogil=True, inline="always")
def shows_same(surface, f, g, v):
    """Whether two faces show the same at their common vertex."""
    if surface.look[f] != surface.look[g]:
        return False
    i, j = corner_of(surface.faces, f, v), corner_of(surface.faces, g, v)
    a, b = surface.shown[f, i], surface.shown[g, j]
    same = True
    for channel in range(len(a)):
        same = same and a[channel] == b[channel]
    return same


@njit(cache=True, nogil=True, inline="always")
def value_at(surface, f, u, v, value):
    """Writes the look of face `f` at its corner `u` after a move of that corner to `v`.

    The move removes the faces at the edge from `u` to `v`; one that shows the same as `f` at `u` gives the look at `v`.
    Returns False where there is none: then the move is across a seam.
    """
    for k in range(surface.start[u], surface.start[u + 1]):
        g = surface.ring[k]
        if has(surface.faces, g, v) and shows_same(surface, f, g, u):
            corner = corner_of(surface.faces, g, v)
            for channel in range(len(value)):
                value[channel] = surface.shown[g, corner, channel]
            return True
    return False


@njit(cache=True, nogil=True, inline="always")
def plane_at(surface, f, i, p, value):
    """Writes the look at `p` of face `f` extended without end; returns its area (0: the look of its corner `i`)."""
    j, m = (i + 1) % 3, (i + 2) % 3
    faces, points = surface.faces, surface.points
    a, b, c = points[faces[f, i]], points[faces[f, j]], points[faces[f, m]]
    nx, ny, nz = normal(a, b, c)
    squared = nx * nx + ny * ny + nz * nz
    s = t = 0.0
    if squared > NO_AREA * NO_AREA:
        x, y, z = normal(a, p, c)
        s = (x * nx + y * ny + z * nz) / squared
        x, y, z = normal(a, b, p)
        t = (x * nx + y * ny + z * nz) / squared
    for channel in range(len(value)):
        own = surface.shown[f, i, channel]
        value[channel] = own + s * (surface.shown[f, j, channel] - own) + t * (surface.shown[f, m, channel] - own)
    return math.sqrt(squared) / 2


@njit(cache=True, nogil=True, inline="always")
def is_folded(surface, f, g, u, v):
    """Whether two faces at an edge lie nearly on each other, so that their planes do not hold the edge in place."""
    p, q = surface.points[u], surface.points[v]
    a = surface.points[third(surface.faces, f, u, v)]
    b = surface.points[third(surface.faces, g, u, v)]
    ax, ay, az = normal(p, q, a)
    bx, by, bz = normal(p, q, b)
    lengths = math.sqrt((ax * ax + ay * ay + az * az) * (bx * bx + by * by + bz * bz))
    return ax * bx + ay * by + az * bz > _FOLD_COS * lengths


@njit(cache=True, nogil=True, inline="always")
def third(faces, f, u, v):
    """The vertex of a face that is neither `u` nor `v`."""
    for corner in range(2):
        if faces[f, corner] != u and faces[f, corner] != v:
            return faces[f, corner]
    return faces[f, 2]


@njit(cache=True, nogil=True, inline="always")
def has(faces, f, v):
    return faces[f, 0] == v or faces[f, 1] == v or faces[f, 2] == v


@njit(cache=True, nogil=True, inline="always")
def corner_of(faces, f, v):
    """The index of a vertex among the corners of a face."""
    return 0 if faces[f, 0] == v else (1 if faces[f, 1] == v else 2)


@njit(cache=True, nogil=True, inline="always")
def normal(a, b, c):
    """Normal of a triangle, twice its area long."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    return uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


@njit(cache=True, nogil=True, inline="always")
def squared(a, b):
    return (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2
