"""Solid spans of a height field, from triangles: each is cut to the columns that it touches and merged at once.

Only the spans are kept, never a record per triangle, so memory grows with the home and not with its triangles.
Lengths here are voxels (see height_field): u, v in columns, h in voxels, all from the mesh's lower corner.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.compiled import njit

CLIMB = 1
"""Highest step in voxels."""
_ROOM = 1 << 16
"""Number of spans for which there is room at first; doubled when needed."""
_NO_FLOOR = -1000
"""`floor` of spans without a walkable face."""
_CORNERS = 9
"""A triangle cut by four planes has at most seven corners; one more per cut while it is being cut."""


class Spans(NamedTuple):
    """Solid matter per column, sorted by column and height; a robot may stand on the tops."""

    first: NDArray[np.int64]
    """(columns + 1,) index of each column's first span."""
    lo: NDArray[np.int32]
    """(S,) lowest voxel."""
    hi: NDArray[np.int32]
    """(S,) end of the highest voxel."""
    top: NDArray[np.float64]
    """(S,) exact height of the highest point."""
    walkable: NDArray[np.bool_]
    """(S,) whether a walkable face is within a step of the end."""


class _Chains(NamedTuple):
    """Spans as linked lists while they grow; row `column` of `head` starts a list, -1 ends it."""

    head: NDArray[np.int32]
    """(columns,) first span of each column."""
    following: NDArray[np.int32]
    lo: NDArray[np.int32]
    hi: NDArray[np.int32]
    floor: NDArray[np.int32]
    """`hi` of the highest walkable face."""
    top: NDArray[np.float64]


@njit(cache=True, nogil=True)
def bounds_of(vertices, faces):
    """(2, 3) lower and upper corner of all faces; NaN where a corner is not finite."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for index in range(len(faces)):
        for corner in range(3):
            for axis in range(3):
                value = np.float64(vertices[faces[index, corner], axis])
                if not math.isfinite(value):
                    return np.full((2, 3), np.nan)
                low[axis], high[axis] = min(low[axis], value), max(high[axis], value)
    return np.stack((low, high))


@njit(cache=True, nogil=True)
def spans_of(vertices, faces, low, sides, rows, cols, least_up, both_sides):
    """The spans of a mesh.

    Args:
        vertices: (V, 3) metres.
        faces: (F, 3).
        low: (3,) corner at which column (0, 0) and voxel 0 begin, metres.
        sides: (3,) sides of a column and height of a voxel, metres.
        rows: Number of columns along z.
        cols: Number of columns along x.
        least_up: A face is walkable if the y of its unit normal is more than this.
        both_sides: Whether faces may be wound either way.
    """
    chains = _Chains(
        np.full(rows * cols, -1, np.int32),
        np.empty(_ROOM, np.int32),
        np.empty(_ROOM, np.int32),
        np.empty(_ROOM, np.int32),
        np.empty(_ROOM, np.int32),
        np.empty(_ROOM),
    )
    used = face = 0
    while face < len(faces):
        face, used = _fill(vertices, faces, face, low, sides, rows, cols, least_up, both_sides, chains, used)
        if face < len(faces):
            chains = _roomier(chains)
    return _sorted(chains, used)


@njit(cache=True, nogil=True)
def _fill(vertices, faces, face, low, sides, rows, cols, least_up, both_sides, chains, used):
    """Adds faces from `face` on; (first face that did not fit, spans used). Adding a face again changes nothing."""
    room = len(chains.lo)
    rest, strip, spare = np.empty((_CORNERS, 3)), np.empty((_CORNERS, 3)), np.empty((_CORNERS, 3))
    part, after = np.empty((_CORNERS, 3)), np.empty((_CORNERS, 3))
    for index in range(face, len(faces)):
        for corner in range(3):
            vertex = faces[index, corner]
            for axis in range(3):
                rest[corner, axis] = (np.float64(vertices[vertex, axis]) - low[axis]) / sides[axis]
        is_floor = _is_level(rest, sides, least_up, both_sides)
        num_rest = 3
        lowest, highest = _span(rest, 3, 2)
        last_r = int(highest)
        for r in range(int(lowest), min(last_r, rows - 1) + 1):
            if r == last_r:
                num_strip = num_rest
                strip, rest = rest, strip
            else:
                num_strip, num_rest = _cut(rest, num_rest, 2, r + 1, strip, spare)
                rest, spare = spare, rest
            if num_strip < 3:
                continue
            lowest, highest = _span(strip, num_strip, 0)
            last_c = int(highest)
            for c in range(int(lowest), min(last_c, cols - 1) + 1):
                if c == last_c:
                    num_part = num_strip
                    part, strip = strip, part
                else:
                    num_part, num_strip = _cut(strip, num_strip, 0, c + 1, part, after)
                    strip, after = after, strip
                if num_part < 3:
                    continue
                if used == room:
                    return index, used
                lowest, highest = _span(part, num_part, 1)
                used = _add(chains, used, r * cols + c, lowest, highest, is_floor)
    return len(faces), used


@njit(cache=True, nogil=True)
def _is_level(corners, sides, least_up, both_sides):
    """Whether a face, its corners (3, 3) in voxels, is level enough to walk on and wound like a floor."""
    x0, x1 = (corners[1, 0] - corners[0, 0]) * sides[0], (corners[2, 0] - corners[0, 0]) * sides[0]
    y0, y1 = (corners[1, 1] - corners[0, 1]) * sides[1], (corners[2, 1] - corners[0, 1]) * sides[1]
    z0, z1 = (corners[1, 2] - corners[0, 2]) * sides[2], (corners[2, 2] - corners[0, 2]) * sides[2]
    x, y, z = y0 * z1 - z0 * y1, z0 * x1 - x0 * z1, x0 * y1 - y0 * x1
    return (abs(y) if both_sides else y) > least_up * math.sqrt(x * x + y * y + z * z)


@njit(cache=True, nogil=True)
def _cut(polygon, count, axis, at, below, above):
    """Splits a convex polygon (count corners) at a plane; returns the corner counts of both parts."""
    num_below = num_above = 0
    for i in range(count):
        j = (i + 1) % count
        a, b = polygon[i, axis], polygon[j, axis]
        if a <= at:
            for k in range(3):
                below[num_below, k] = polygon[i, k]
            num_below += 1
        if a >= at:
            for k in range(3):
                above[num_above, k] = polygon[i, k]
            num_above += 1
        if (a < at < b) or (b < at < a):
            share = (at - a) / (b - a)
            for k in range(3):
                corner = polygon[i, k] + share * (polygon[j, k] - polygon[i, k])
                below[num_below, k] = corner
                above[num_above, k] = corner
            num_below += 1
            num_above += 1
    return num_below, num_above


@njit(cache=True, nogil=True)
def _span(polygon, count, axis):
    """Least and largest coordinate of a polygon's corners along an axis."""
    least = most = polygon[0, axis]
    for i in range(1, count):
        least, most = min(least, polygon[i, axis]), max(most, polygon[i, axis])
    return least, most


@njit(cache=True, nogil=True)
def _add(chains, used, column, lowest, highest, is_floor):
    """Puts matter from `lowest` to `highest` into a column; touching spans become one. Returns the spans used."""
    lo = np.int32(math.floor(lowest))
    hi = max(np.int32(math.ceil(highest)), lo + 1)
    floor = hi if is_floor else _NO_FLOOR
    before, at = -1, chains.head[column]
    while at >= 0 and chains.hi[at] < lo:
        before, at = at, chains.following[at]
    if at < 0 or chains.lo[at] > hi:
        chains.lo[used], chains.hi[used], chains.floor[used], chains.top[used] = lo, hi, floor, highest
        chains.following[used] = at
        if before < 0:
            chains.head[column] = used
        else:
            chains.following[before] = used
        return used + 1
    chains.lo[at], chains.hi[at] = min(chains.lo[at], lo), max(chains.hi[at], hi)
    chains.floor[at], chains.top[at] = max(chains.floor[at], floor), max(chains.top[at], highest)
    after = chains.following[at]
    while after >= 0 and chains.lo[after] <= chains.hi[at]:
        chains.hi[at], chains.floor[at] = (
            max(chains.hi[at], chains.hi[after]),
            max(chains.floor[at], chains.floor[after]),
        )
        chains.top[at] = max(chains.top[at], chains.top[after])
        after = chains.following[after]
    chains.following[at] = after
    return used


@njit(cache=True, nogil=True)
def _roomier(chains):
    """The same lists with room for twice as many spans."""
    return _Chains(
        chains.head,
        np.concatenate((chains.following, np.empty_like(chains.following))),
        np.concatenate((chains.lo, np.empty_like(chains.lo))),
        np.concatenate((chains.hi, np.empty_like(chains.hi))),
        np.concatenate((chains.floor, np.empty_like(chains.floor))),
        np.concatenate((chains.top, np.empty_like(chains.top))),
    )


@njit(cache=True, nogil=True)
def _sorted(chains, used):
    """The lists as flat arrays, without spans that were merged into others."""
    first = np.zeros(len(chains.head) + 1, np.int64)
    lo, hi, top = np.empty(used, np.int32), np.empty(used, np.int32), np.empty(used)
    walkable = np.empty(used, np.bool_)
    count = 0
    for column in range(len(chains.head)):
        at = chains.head[column]
        while at >= 0:
            lo[count], hi[count], top[count] = chains.lo[at], chains.hi[at], chains.top[at]
            walkable[count] = chains.hi[at] - chains.floor[at] <= CLIMB
            count += 1
            at = chains.following[at]
        first[column + 1] = count
    return Spans(first, lo[:count], hi[:count], top[:count], walkable[:count])
