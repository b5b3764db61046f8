"""Compiled loops over the cells of a floor grid: links, straight walks, snapping, sliding, and a heap for searches.

Coordinates here are grid units: u = column axis, v = row axis (cell (r, c) covers [c, c+1) x [r, r+1)), h = height; all
three are metres divided by the cell size. `FloorGrid` converts. A *node* is one place to stand: a cell on one layer.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.compiled import njit

_TIE = 1e-9
"""Two crossings closer than this (share of the segment) count as passing through the cell's corner."""
_MARGIN = 2e-3
"""Distance of a clamped point from its cell's border, in cells (0.1 mm at 5 cm)."""
INSET = 1e-6
"""Distance of a constructed point from its cell's border, in cells, so that rounding never moves it to the next one."""


class Cells(NamedTuple):
    """The nodes of a floor grid, sorted by column and height."""

    row: NDArray[np.int32]
    """(N,) row of each node."""
    col: NDArray[np.int32]
    """(N,) column of each node."""
    h: NDArray[np.float64]
    """(N,) floor height in grid units."""
    links: NDArray[np.int32]
    """(N, 8) neighbours along +u, +v, -u, -v, then the diagonals between 0-1, 1-2, 2-3, 3-0; -1 = none."""
    first: NDArray[np.int32]
    """(rows * cols + 1,) index of each column's first node; row-major."""
    rows: int
    cols: int


def first_of_columns(row: NDArray[np.int32], col: NDArray[np.int32], rows: int, cols: int) -> NDArray[np.int32]:
    """(rows * cols + 1,) index of the first node of each column, for nodes sorted by column."""
    counts = np.bincount(row.astype(np.int64) * cols + col, minlength=rows * cols)
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)


@njit(cache=True, nogil=True)
def length(u, v, h, other_u, other_v, other_h):
    """Straight 3-D length between two points."""
    return math.sqrt((u - other_u) ** 2 + (v - other_v) ** 2 + (h - other_h) ** 2)


@njit(cache=True, nogil=True)
def linked_layers(row, col, h, first, rows, cols, max_climb):
    """(N, 4) nearest layer of each side's column that is at most `max_climb` higher or lower, -1 = none."""
    links = np.full((len(row), 4), -1, np.int32)
    for node in range(len(row)):
        for side in range(4):
            r = row[node] + (side == 1) - (side == 3)
            c = col[node] + (side == 0) - (side == 2)
            if r < 0 or c < 0 or r >= rows or c >= cols:
                continue
            least = max_climb
            for other in range(first[r * cols + c], first[r * cols + c + 1]):
                climb = abs(h[other] - h[node])
                if climb <= least:
                    least = climb
                    links[node, side] = other
    return links


@njit(cache=True, nogil=True)
def with_diagonals(sides, h, max_climb):
    """(N, 8) links from the four sides' (N, 4): a diagonal exists where it can be walked around one corner."""
    count = len(sides)
    links = np.full((count, 8), -1, np.int32)
    links[:, :4] = sides
    for node in range(count):
        for side in range(4):
            turn = (side + 1) % 4
            one, two = sides[node, side], sides[node, turn]
            over_one = sides[one, turn] if one >= 0 else -1
            over_two = sides[two, side] if two >= 0 else -1
            corner = over_one if over_one >= 0 else over_two
            if corner < 0 or (over_one >= 0 and over_two >= 0 and over_one != over_two):
                continue
            if abs(h[corner] - h[node]) <= max_climb:
                links[node, 4 + side] = corner
    return links


@njit(cache=True, nogil=True)
def connected_parts(links, is_free):
    """(N,) number of each free node's connected part by `links` (N, K), in order of nodes; -1 on other nodes."""
    parts = np.full(len(links), -1, np.int32)
    queue = np.empty(len(links), np.int32)
    count = 0
    for first in range(len(links)):
        if parts[first] >= 0 or not is_free[first]:
            continue
        parts[first] = count
        queue[0] = first
        head, tail = 0, 1
        while head < tail:
            node = queue[head]
            head += 1
            for other in links[node]:
                if other >= 0 and parts[other] < 0 and is_free[other]:
                    parts[other] = count
                    queue[tail] = other
                    tail += 1
        count += 1
    return parts


@njit(cache=True, nogil=True)
def walk(cells, u, v, node, end_u, end_v):
    """Follows the segment from (u, v) on `node` through linked cells; (last node, share of the segment walked)."""
    du, dv = end_u - u, end_v - v
    r, c = cells.row[node], cells.col[node]
    while True:
        at_u, at_v = math.inf, math.inf
        if du > 0:
            at_u = (c + 1 - u) / du
        elif du < 0:
            at_u = (c - u) / du
        if dv > 0:
            at_v = (r + 1 - v) / dv
        elif dv < 0:
            at_v = (r - v) / dv
        crosses_u = at_u < 1 or (at_u == 1 and du > 0)
        crosses_v = at_v < 1 or (at_v == 1 and dv > 0)
        if not crosses_u and not crosses_v:
            return node, 1.0
        side_u = 0 if du > 0 else 2
        side_v = 1 if dv > 0 else 3
        if crosses_u and crosses_v and abs(at_u - at_v) < _TIE:
            side = 4 + (side_u if (side_u + 1) % 4 == side_v else side_v)
            at = min(at_u, at_v)
        elif crosses_u and (at_u < at_v or not crosses_v):
            side, at = side_u, at_u
        else:
            side, at = side_v, at_v
        following = cells.links[node, side]
        if following < 0:
            return node, max(at, 0.0)
        node = following
        r, c = cells.row[node], cells.col[node]


@njit(cache=True, nogil=True)
def clamp(cells, node, u, v):
    """The point of the node's cell nearest to (u, v), slightly inside its border."""
    c, r = cells.col[node], cells.row[node]
    if not (c <= u < c + 1):
        u = min(max(u, c + _MARGIN), c + 1 - _MARGIN)
    if not (r <= v < r + 1):
        v = min(max(v, r + _MARGIN), r + 1 - _MARGIN)
    return u, v


@njit(cache=True, nogil=True)
def nearest_node(cells, u, h, v, reach, reach_h, climb):
    """Node nearest to a point, -1 if none within `reach` sideways and `reach_h` in height.

    Over or under a cell the distance is the height difference less `climb`; elsewhere it is 3-D (Detour's rule).
    """
    r0, c0 = math.floor(v), math.floor(u)
    best, found = math.inf, -1
    for ring in range(math.ceil(reach) + 1):
        if ring - 1 > best:
            break
        for r in range(max(r0 - ring, 0), min(r0 + ring, cells.rows - 1) + 1):
            whole_row = abs(r - r0) == ring
            for c in range(c0 - ring, c0 + ring + 1, 1 if whole_row else max(2 * ring, 1)):
                if c < 0 or c >= cells.cols:
                    continue
                away_u = max(c - u, 0.0, u - (c + 1))
                away_v = max(r - v, 0.0, v - (r + 1))
                if away_u > reach or away_v > reach:
                    continue
                for node in range(cells.first[r * cells.cols + c], cells.first[r * cells.cols + c + 1]):
                    away_h = abs(cells.h[node] - h)
                    if away_h > reach_h:
                        continue
                    distance = math.sqrt(away_u**2 + away_v**2 + away_h**2) if ring else max(away_h - climb, 0.0)
                    if distance < best:
                        best, found = distance, node
    return found


@njit(cache=True, nogil=True)
def snap_all(cells, u, h, v, reach, reach_h, climb):
    """Snapped (u, v, h, node) of points (M,); node -1 where nothing is near.

    The height is the floor's; a point over its cell keeps its height above (or below) the floor beyond `climb`.
    """
    nodes = np.full(len(u), -1, np.int32)
    out_u, out_v, out_h = u.copy(), v.copy(), h.copy()
    for i in range(len(u)):
        node = nearest_node(cells, u[i], h[i], v[i], reach, reach_h, climb)
        if node < 0:
            continue
        nodes[i] = node
        out_u[i], out_v[i] = clamp(cells, node, u[i], v[i])
        is_over = out_u[i] == u[i] and out_v[i] == v[i]
        above = h[i] - cells.h[node] if is_over else 0.0
        out_h[i] = cells.h[node] + math.copysign(max(abs(above) - climb, 0.0), above)
    return out_u, out_v, out_h, nodes


@njit(cache=True, nogil=True)
def slide_end(cells, u, v, node, end_u, end_v):
    """End of a walk that may slide along walls: the point nearest to the wanted end among the cells within reach.

    Reach, as in Detour's moveAlongSurface: cells joined side by side that touch the circle over the segment.
    """
    mid_u, mid_v = (u + end_u) / 2, (v + end_v) / 2
    radius_sq = (math.hypot(end_u - u, end_v - v) / 2 + 0.02) ** 2
    seen = np.zeros(len(cells.row), np.bool_)
    seen[node] = True
    queue = [node]
    best, found, best_u, best_v = math.inf, node, u, v
    head = 0
    while head < len(queue):
        here = queue[head]
        head += 1
        at_u, at_v = clamp(cells, here, end_u, end_v)
        away = (at_u - end_u) ** 2 + (at_v - end_v) ** 2
        if away < best:
            best, found, best_u, best_v = away, here, at_u, at_v
        for side in range(4):
            other = cells.links[here, side]
            if other < 0 or seen[other]:
                continue
            seen[other] = True
            near_u = min(max(mid_u, cells.col[other]), cells.col[other] + 1)
            near_v = min(max(mid_v, cells.row[other]), cells.row[other] + 1)
            if (near_u - mid_u) ** 2 + (near_v - mid_v) ** 2 <= radius_sq:
                queue.append(other)
    return best_u, best_v, found


@njit(cache=True, nogil=True)
def push(keys, values, size, key, value):
    """Adds to a binary heap that has room."""
    at = size
    while at > 0:
        up = (at - 1) // 2
        if keys[up] <= key:
            break
        keys[at], values[at] = keys[up], values[up]
        at = up
    keys[at], values[at] = key, value
    return size + 1


@njit(cache=True, nogil=True)
def pop(keys, values, size):
    """Removes the least entry of a binary heap; (value, new size)."""
    least = values[0]
    size -= 1
    key, value = keys[size], values[size]
    at = 0
    while True:
        down = 2 * at + 1
        if down >= size:
            break
        if down + 1 < size and keys[down + 1] < keys[down]:
            down += 1
        if keys[down] >= key:
            break
        keys[at], values[at] = keys[down], values[down]
        at = down
    keys[at], values[at] = key, value
    return least, size
