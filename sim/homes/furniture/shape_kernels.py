"""Compiled loops behind shapes.py and lofts.py: normals and texture places of quads; a home has tens of thousands."""

import numpy as np
from numpy.typing import NDArray

from sim.compiled import njit

_LEAST = 1e-12


@njit(cache=True, nogil=True)
def quad_normals(quads: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, 3) unit normals of quads (N, 4, 3), from their diagonals."""
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
    """(N, 4, 2): the two axes that a quad lies along, the one along which the whole is longer first; v runs down."""
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
    """Corners, normals (N, 4, 3) and places (N, 4, 2) of the skin over rings (M, P, 3).

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
    """Mean of two unit normals where they are alike, else the own one; into `out` (3,)."""
    if own[0] * other[0] + own[1] * other[1] + own[2] * other[2] > smooth:
        x, y, z = own[0] + other[0], own[1] + other[1], own[2] + other[2]
        length = max(np.sqrt(x * x + y * y + z * z), _LEAST)
        out[0], out[1], out[2] = x / length, y / length, z / length
    else:
        out[:] = own


@njit(cache=True, nogil=True)
def _arc_lengths(rings: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Metres around (P + 1,) along the longest ring and upwards (M,) along the longest side."""
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
