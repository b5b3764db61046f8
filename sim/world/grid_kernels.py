"""Compiled loops over the cells of a floor grid: straight walks, snapping, and the any-angle distance field.

Coordinates here are grid units: u = column axis, v = row axis (cell (r, c) covers [c, c+1) x [r, r+1)), h = height; all
three are metres divided by the cell size. `FloorGrid` converts. A *node* is one place to stand: a cell on one layer.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

_TIE = 1e-9
"""Two crossings closer than this (share of the segment) count as passing through the cell's corner."""
_MARGIN = 2e-3
"""How far inside its cell a clamped point lies, in cells (0.1 mm at 5 cm)."""
_INSET = 1e-6
"""How far inside its cell a path's corner lies, in cells."""


class Cells(NamedTuple):
    """The nodes of a floor grid, sorted by column and height."""

    row: NDArray[np.int32]
    """(N,)."""
    col: NDArray[np.int32]
    """(N,)."""
    h: NDArray[np.float64]
    """(N,) floor height in grid units."""
    links: NDArray[np.int32]
    """(N, 8) neighbours along +u, +v, -u, -v, then the diagonals between 0-1, 1-2, 2-3, 3-0; -1 = none."""
    first: NDArray[np.int32]
    """(rows * cols + 1,) where each column's nodes start; row-major."""
    rows: int
    cols: int


class Field(NamedTuple):
    """Any-angle distances from a set of goals. Anchors are nodes (0..N-1) and goals (N..N+G-1)."""

    distance: NDArray[np.float64]
    """(N,) grid units from each node's centre to its nearest goal, inf where unreachable."""
    parent: NDArray[np.int32]
    """(N,) anchor towards the goal that is in straight reach, -1 where unreachable."""
    goal_u: NDArray[np.float64]
    goal_v: NDArray[np.float64]
    goal_node: NDArray[np.int32]
    """(G,) goals, sorted by node."""


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
def walk(cells, u, v, node, end_u, end_v):
    """Follow the segment from (u, v) on `node` through linked cells; (last node, share of the segment walked)."""
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
    """The point of the node's cell nearest to (u, v), a hair inside its border."""
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
    """Snapped (u, v, node) of points (M,); node -1 where nothing is near."""
    nodes = np.full(len(u), -1, np.int32)
    out_u, out_v = u.copy(), v.copy()
    for i in range(len(u)):
        nodes[i] = nearest_node(cells, u[i], h[i], v[i], reach, reach_h, climb)
        if nodes[i] >= 0:
            out_u[i], out_v[i] = clamp(cells, nodes[i], u[i], v[i])
    return out_u, out_v, nodes


@njit(cache=True, nogil=True)
def slide_end(cells, u, v, node, end_u, end_v):
    """Where a walk that may slide along walls ends: the point nearest to the end among the cells within reach.

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
def _push(keys, values, size, key, value):
    """Add to a binary heap that has room."""
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
def _pop(keys, values, size):
    """Remove the least of a binary heap; (value, new size)."""
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


@njit(cache=True, nogil=True)
def _anchor(cells, field, anchor):
    """(u, v, node, distance to go) of an anchor."""
    count = len(cells.row)
    if anchor >= count:
        goal = anchor - count
        return field.goal_u[goal], field.goal_v[goal], field.goal_node[goal], 0.0
    return cells.col[anchor] + 0.5, cells.row[anchor] + 0.5, np.int32(anchor), field.distance[anchor]


@njit(cache=True, nogil=True)
def _length(cells, u, v, node, other_u, other_v, other):
    """Straight 3-D length between two points on nodes."""
    dh = cells.h[node] - cells.h[other]
    return math.sqrt((u - other_u) ** 2 + (v - other_v) ** 2 + dh * dh)


@njit(cache=True, nogil=True)
def spread(cells, field):
    """Fill an empty field (distance inf, parent -1): Dijkstra in which a node may take its parent's parent in sight."""
    count = len(cells.row)
    distance, parent = field.distance, field.parent
    keys = np.empty(8 * count + len(field.goal_node) + 1)
    values = np.empty(len(keys), np.int32)
    closed = np.zeros(count, np.bool_)
    size = 0
    for goal in range(len(field.goal_node)):
        node = field.goal_node[goal]
        away = math.hypot(field.goal_u[goal] - cells.col[node] - 0.5, field.goal_v[goal] - cells.row[node] - 0.5)
        if away < distance[node]:
            distance[node], parent[node] = away, count + goal
            size = _push(keys, values, size, away, node)
    while size:
        node, size = _pop(keys, values, size)
        if closed[node]:
            continue
        closed[node] = True
        from_u, from_v, from_node, to_go = _anchor(cells, field, parent[node])
        for side in range(8):
            other = cells.links[node, side]
            if other < 0 or closed[other]:
                continue
            u, v = cells.col[other] + 0.5, cells.row[other] + 0.5
            total = to_go + _length(cells, from_u, from_v, from_node, u, v, other)
            if total >= distance[other]:
                continue
            via = parent[node]
            if walk(cells, from_u, from_v, from_node, u, v)[0] != other:
                via = node
                total = distance[node] + _length(cells, cells.col[node] + 0.5, cells.row[node] + 0.5, node, u, v, other)
                if total >= distance[other]:
                    continue
            distance[other], parent[other] = total, via
            size = _push(keys, values, size, total, other)


@njit(cache=True, nogil=True)
def _first_anchor(cells, field, u, v, node):
    """The anchor to walk to first from a point, -1 if no goal can be reached."""
    count = len(cells.row)
    best, found = math.inf, -1
    for side in range(-1, 8):
        near = node if side < 0 else cells.links[node, side]
        if near < 0 or field.parent[near] < 0:
            continue
        goal = np.searchsorted(field.goal_node, near)
        while goal < len(field.goal_node) and field.goal_node[goal] == near:
            total = _length(cells, u, v, node, field.goal_u[goal], field.goal_v[goal], near)
            if total < best and walk(cells, u, v, node, field.goal_u[goal], field.goal_v[goal])[0] == near:
                best, found = total, count + goal
            goal += 1
        for anchor in (field.parent[near], near):
            to_u, to_v, to_node, to_go = _anchor(cells, field, anchor)
            total = to_go + _length(cells, u, v, node, to_u, to_v, to_node)
            if total < best and walk(cells, u, v, node, to_u, to_v)[0] == to_node:
                best, found = total, anchor
    return found


@njit(cache=True, nogil=True)
def _pull(cells, at_u, at_v, at_node):
    """Leave out corners of a polyline whose neighbours see each other, in place."""
    i = 1
    while i < len(at_u) - 1:
        if walk(cells, at_u[i - 1], at_v[i - 1], at_node[i - 1], at_u[i + 1], at_v[i + 1])[0] == at_node[i + 1]:
            at_u.pop(i)
            at_v.pop(i)
            at_node.pop(i)
            i = max(i - 1, 1)
        else:
            i += 1


@njit(cache=True, nogil=True)
def _into_corners(cells, at_u, at_v, at_node):
    """Move corners of a polyline from cell centres to the corner of their cell that is shortest, in place."""
    moved = False
    for i in range(1, len(at_u) - 1):
        before, here, after = at_node[i - 1], at_node[i], at_node[i + 1]
        best = _length(cells, at_u[i - 1], at_v[i - 1], before, at_u[i], at_v[i], here)
        best += _length(cells, at_u[i], at_v[i], here, at_u[i + 1], at_v[i + 1], after)
        for k in range(4):
            u = cells.col[here] + (_INSET if k % 2 else 1 - _INSET)
            v = cells.row[here] + (_INSET if k // 2 else 1 - _INSET)
            total = _length(cells, at_u[i - 1], at_v[i - 1], before, u, v, here)
            total += _length(cells, u, v, here, at_u[i + 1], at_v[i + 1], after)
            if total >= best or walk(cells, at_u[i - 1], at_v[i - 1], before, u, v)[0] != here:
                continue
            if walk(cells, u, v, here, at_u[i + 1], at_v[i + 1])[0] == after:
                best, at_u[i], at_v[i], moved = total, u, v, True
    return moved


@njit(cache=True, nogil=True)
def trace(cells, field, u, v, node):
    """Taut polyline (K, 2) of u, v and nodes (K,) from a point to its nearest goal; K = 0 if unreachable."""
    at_u, at_v, at_node = [u], [v], [node]
    anchor = _first_anchor(cells, field, u, v, node)
    if anchor < 0:
        return np.empty((0, 2)), np.empty(0, np.int32)
    while True:
        to_u, to_v, to_node, _ = _anchor(cells, field, anchor)
        at_u.append(to_u)
        at_v.append(to_v)
        at_node.append(to_node)
        if anchor >= len(cells.row):
            break
        anchor = field.parent[anchor]
    _pull(cells, at_u, at_v, at_node)
    if _into_corners(cells, at_u, at_v, at_node):
        _pull(cells, at_u, at_v, at_node)
    points = np.empty((len(at_u), 2))
    nodes = np.empty(len(at_u), np.int32)
    for i in range(len(at_u)):
        points[i, 0], points[i, 1], nodes[i] = at_u[i], at_v[i], at_node[i]
    return points, nodes


@njit(cache=True, nogil=True)
def lengths_to_goals(cells, field, u, v, nodes):
    """(M,) lengths in grid units of the traced paths of points on nodes; inf where the node is -1 or unreachable."""
    lengths = np.full(len(u), math.inf)
    for i in range(len(u)):
        if nodes[i] < 0 or field.parent[nodes[i]] < 0:
            continue
        points, at = trace(cells, field, u[i], v[i], nodes[i])
        if len(at) == 0:
            continue
        total = 0.0
        for k in range(len(at) - 1):
            total += _length(cells, points[k, 0], points[k, 1], at[k], points[k + 1, 0], points[k + 1, 1], at[k + 1])
        lengths[i] = total
    return lengths
