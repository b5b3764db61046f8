"""From triangles to places where a robot fits: Recast's voxel rules with Habitat's settings, compiled.

A column of the height field holds *spans*, solid from `lo` to `hi` in voxels of 0.2 m; the robot stands on their tops.
Lengths inside the kernels are voxels; u, v and directions are those of grid_kernels.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sim.errors import SceneError
from sim.types import GridSpec

CELL = 0.05
"""Side of a column, metres (Habitat's cellSize)."""
VOXEL = 0.2
"""Height of a voxel, metres (Habitat's cellHeight); also the highest step, which is one voxel."""
MAX_SLOPE = math.radians(45)
"""Steeper faces are walls (Habitat's agentMaxSlope)."""
MIN_ISLAND_CELLS = 400
"""Smaller islands are dropped (Habitat's regionMinSize, 20 cells squared = 1 m2)."""
_MAX_COLUMNS = 25_000_000
"""About a square of 250 m; more is a mesh in other units and would not fit in memory."""
_CLIMB = 1
_OPEN = 1 << 20
"""Ceiling height in voxels where nothing is above."""


class StandingPlaces(NamedTuple):
    """Nodes sorted by column and height."""

    row: NDArray[np.int32]
    """(N,)."""
    col: NDArray[np.int32]
    """(N,)."""
    y: NDArray[np.float64]
    """(N,) height of the real floor, world metres."""
    sides: NDArray[np.int32]
    """(N, 4) linked nodes along +u, +v, -u, -v, -1 = none."""
    covered: NDArray[np.bool_]
    """(N,) whether something is above."""
    grid: GridSpec


def standing_places(
    vertices: NDArray[np.float32], faces: NDArray[np.int32], *, radius: float, height: float
) -> StandingPlaces:
    """Where the centre of a robot fits on a mesh; see `floor_grid_from_mesh`."""
    triangles = vertices[faces].astype(np.float64)
    low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
    cols, rows = (int((high[axis] - low[axis]) / CELL + 0.5) for axis in (0, 2))
    rows, cols = max(rows, 1), max(cols, 1)
    if rows * cols > _MAX_COLUMNS:
        raise SceneError(
            f"navigation: found a mesh of {cols * CELL:.0f} x {rows * CELL:.0f} m; expected a home, at most "
            f"{_MAX_COLUMNS * CELL**2:.0f} m2. Check that the file's unit is metres."
        )
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    is_floor = normals[:, 1] > math.cos(MAX_SLOPE) * lengths
    uhv = (triangles - low) / (CELL, VOXEL, CELL)
    column, lo, hi, top, walkable = _columns_of_triangles(uhv, is_floor, rows, cols)
    order = _order_by_column(column, lo, rows * cols)
    column, lo, hi, top, walkable = _merge(column[order], lo[order], hi[order], top[order], walkable[order])
    first = np.searchsorted(column, np.arange(rows * cols + 1))
    clearance = math.ceil(height / VOXEL - 1e-6)
    ceiling = np.where(np.append(column[1:] == column[:-1], False), np.append(lo[1:], 0), _OPEN)
    _filter(first, lo, hi, ceiling, walkable, rows, cols, clearance)
    links = _connect(first, hi, ceiling, walkable, rows, cols, clearance)
    fits = walkable & (_wall_distance(walkable, links, column) >= 2 * math.ceil(radius / CELL - 1e-6))
    fits &= _in_large_island(fits, links)
    nodes = np.flatnonzero(fits)
    number = np.full(len(fits) + 1, -1, np.int32)
    number[nodes] = np.arange(len(nodes))
    grid = GridSpec((float(low[0]), float(low[2])), CELL, (rows, cols))
    row, col = (column[nodes] // cols).astype(np.int32), (column[nodes] % cols).astype(np.int32)
    y = low[1] + top[nodes] * VOXEL
    return StandingPlaces(row, col, y, number[links[nodes]], ceiling[nodes] < _OPEN, grid)


@njit(cache=True, nogil=True)
def _cut(polygon, count, axis, at, below, above):
    """Split a convex polygon (count corners) at a plane; corner counts of both parts."""
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
def _columns_of_triangles(triangles, is_floor, rows, cols):
    """One record per triangle and column that it touches: column, lowest and highest voxel, exact top, floor or not."""
    room = max(1024, 4 * len(triangles))
    column, lo, hi = np.empty(room, np.int64), np.empty(room, np.int32), np.empty(room, np.int32)
    top, walkable = np.empty(room), np.empty(room, np.bool_)
    used = 0
    rest, strip, spare = np.empty((12, 3)), np.empty((12, 3)), np.empty((12, 3))
    part, after = np.empty((12, 3)), np.empty((12, 3))
    for index in range(len(triangles)):
        rest[:3] = triangles[index]
        num_rest = 3
        lowest, highest = _span(rest, 3, 2)
        for r in range(int(lowest), min(int(highest), rows - 1) + 1):
            num_strip, num_rest = _cut(rest, num_rest, 2, r + 1, strip, spare)
            rest, spare = spare, rest
            if num_strip < 3:
                continue
            lowest, highest = _span(strip, num_strip, 0)
            for c in range(int(lowest), min(int(highest), cols - 1) + 1):
                num_part, num_strip = _cut(strip, num_strip, 0, c + 1, part, after)
                strip, after = after, strip
                if num_part < 3:
                    continue
                if used == room:
                    room *= 2
                    column, lo, hi = _grown(column), _grown(lo), _grown(hi)
                    top, walkable = _grown(top), _grown(walkable)
                lowest, highest = _span(part, num_part, 1)
                column[used] = r * cols + c
                lo[used] = math.floor(lowest)
                hi[used] = max(math.ceil(highest), lo[used] + 1)
                top[used], walkable[used] = highest, is_floor[index]
                used += 1
    return column[:used], lo[:used], hi[:used], top[:used], walkable[:used]


@njit(cache=True, nogil=True)
def _order_by_column(column, lo, num_columns):
    """Indices that sort the records by column, then by lowest voxel; a column holds few, so each is sorted by hand."""
    start = np.zeros(num_columns + 1, np.int64)
    for at in column:
        start[at + 1] += 1
    start = np.cumsum(start)
    order = np.empty(len(column), np.int64)
    filled = start[:-1].copy()
    for record in range(len(column)):
        at = filled[column[record]]
        filled[column[record]] += 1
        while at > start[column[record]] and lo[order[at - 1]] > lo[record]:
            order[at] = order[at - 1]
            at -= 1
        order[at] = record
    return order


@njit(cache=True, nogil=True)
def _grown(array):
    grown = np.empty(2 * len(array), array.dtype)
    grown[: len(array)] = array
    return grown


@njit(cache=True, nogil=True)
def _merge(column, lo, hi, top, walkable):
    """Join records that touch in one column into spans; a span is floor if a floor lies within a step of its top."""
    used = -1
    floor_hi = -1
    for i in range(len(column)):
        if used < 0 or column[i] != column[used] or lo[i] > hi[used]:
            used += 1
            column[used], lo[used], hi[used], top[used] = column[i], lo[i], hi[i], top[i]
            floor_hi = hi[i] if walkable[i] else -1000
        else:
            hi[used] = max(hi[used], hi[i])
            top[used] = max(top[used], top[i])
            if walkable[i]:
                floor_hi = max(floor_hi, hi[i])
        walkable[used] = hi[used] - floor_hi <= _CLIMB
    used += 1
    return column[:used], lo[:used], hi[:used], top[:used], walkable[:used]


@njit(cache=True, nogil=True)
def _filter(first, lo, hi, ceiling, walkable, rows, cols, clearance):
    """Recast's three filters, in place: steps up onto obstacles, ledges, low ceilings."""
    for column in range(rows * cols):
        below_was_floor = False
        for span in range(first[column], first[column + 1]):
            was_floor = walkable[span]
            if not was_floor and below_was_floor and hi[span] - hi[span - 1] <= _CLIMB:
                walkable[span] = True
            below_was_floor = was_floor
    for column in range(rows * cols):
        for span in range(first[column], first[column + 1]):
            if walkable[span] and _is_ledge(first, lo, hi, ceiling, span, column, rows, cols, clearance):
                walkable[span] = False
    for span in range(len(lo)):
        if ceiling[span] - hi[span] < clearance:
            walkable[span] = False


@njit(cache=True, nogil=True)
def _is_ledge(first, lo, hi, ceiling, span, column, rows, cols, clearance):
    """Whether a neighbour lies more than a step below, or the neighbours within a step differ by more than one."""
    floor, roof = hi[span], ceiling[span]
    least = least_step = most_step = 0
    for side in range(4):
        r = column // cols + (side == 1) - (side == 3)
        c = column % cols + (side == 0) - (side == 2)
        if r < 0 or c < 0 or r >= rows or c >= cols:
            return True
        other = r * cols + c
        begin, end = first[other], first[other + 1]
        ground = lo[begin] if begin < end else _OPEN
        if min(roof, ground) - floor >= clearance:
            return True
        for near in range(begin, end):
            if min(roof, ceiling[near]) - max(floor, hi[near]) < clearance:
                continue
            rise = hi[near] - floor
            least = min(least, rise)
            if abs(rise) <= _CLIMB:
                least_step, most_step = min(least_step, rise), max(most_step, rise)
    return least < -_CLIMB or most_step - least_step > _CLIMB


@njit(cache=True, nogil=True)
def _connect(first, hi, ceiling, walkable, rows, cols, clearance):
    """(S, 4) walkable spans that a robot can step to, -1 = none."""
    links = np.full((len(hi), 4), -1, np.int64)
    for column in range(rows * cols):
        for span in range(first[column], first[column + 1]):
            if not walkable[span]:
                continue
            for side in range(4):
                r = column // cols + (side == 1) - (side == 3)
                c = column % cols + (side == 0) - (side == 2)
                if r < 0 or c < 0 or r >= rows or c >= cols:
                    continue
                for near in range(first[r * cols + c], first[r * cols + c + 1]):
                    gap = min(ceiling[span], ceiling[near]) - max(hi[span], hi[near])
                    if walkable[near] and abs(hi[near] - hi[span]) <= _CLIMB and gap >= clearance:
                        links[span, side] = near
                        break
    return links


@njit(cache=True, nogil=True)
def _wall_distance(walkable, links, column):
    """(S,) distance to the nearest border of the walkable spans, 2 per side step and 3 per diagonal."""
    far = 1 << 20
    distance = np.zeros(len(walkable), np.int32)
    for span in range(len(walkable)):
        if walkable[span] and links[span].min() >= 0:
            distance[span] = far
    for turn in range(2):
        backwards = turn == 0
        for i in range(len(walkable)):
            span = i if backwards else len(walkable) - 1 - i
            for k in range(2):
                side = (2 + k) if backwards else k
                near = links[span, side]
                if near < 0:
                    continue
                distance[span] = min(distance[span], distance[near] + 2)
                corner = links[near, (side + 1) % 4]
                if corner >= 0:
                    distance[span] = min(distance[span], distance[corner] + 3)
    return distance


@njit(cache=True, nogil=True)
def _in_large_island(fits, links):
    """(S,) whether a fitting span belongs to a connected part of MIN_ISLAND_CELLS or more."""
    large = np.zeros(len(fits), np.bool_)
    seen = ~fits
    queue = np.empty(len(fits), np.int64)
    for seed in range(len(fits)):
        if seen[seed]:
            continue
        queue[0], used, head = seed, 1, 0
        seen[seed] = True
        while head < used:
            for side in range(4):
                near = links[queue[head], side]
                if near >= 0 and not seen[near]:
                    seen[near] = True
                    queue[used] = near
                    used += 1
            head += 1
        if used >= MIN_ISLAND_CELLS:
            large[queue[:used]] = True
    return large
