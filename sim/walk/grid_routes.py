"""The cheapest path between two places over free and unknown floor of a floor grid. Units: see grid_kernels.

grid_field.py answers for all places at once, where all floor costs the same. Here floor has prices, and a search serves
one pair of places: it leaves out floor that a path of a given length cannot reach.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.compiled import njit

from .grid_kernels import Cells, length, pop, push

_TIE = 1e-9
_SAME_HEIGHT = 5.0
"""A node this near to a polyline's height is on it (cells)."""
_STEP = 0.5  # cells between the samples of a polyline


class PricedFloor(NamedTuple):
    """Free and unknown floor; callers may change `price` and `is_free` between searches."""

    cells: Cells
    is_free: NDArray[np.bool_]
    """(N,) whether each node is free floor."""
    price: NDArray[np.float64]
    """(N,) extra cost of unknown floor per cell of length; a search multiplies it by its `reluctance`."""


class Work(NamedTuple):
    """Memory of one search, used again by the next; `distance` is inf and `is_closed` False between searches."""

    distance: NDArray[np.float64]
    parent: NDArray[np.int32]
    is_closed: NDArray[np.bool_]
    keys: NDArray[np.float64]
    values: NDArray[np.int32]
    touched: NDArray[np.int32]


class End(NamedTuple):
    """A place on a node."""

    u: float
    v: float
    h: float
    node: int


def work_for(count: int) -> Work:
    """Memory for searches over `count` nodes."""
    return Work(
        np.full(count, np.inf),
        np.full(count, -1, np.int32),
        np.zeros(count, bool),
        np.empty(8 * count + 8),
        np.empty(8 * count + 8, np.int32),
        np.empty(count, np.int32),
    )


@njit(cache=True, nogil=True)
def _rate(ground, node, reluctance):
    """Cost per length on a node; unknown floor has none (inf) where reluctance is inf."""
    return 1.0 if ground.is_free[node] else 1.0 + reluctance * ground.price[node]


@njit(cache=True, nogil=True)
def _rate_along(ground, reluctance, u, v, node, end_u, end_v, end_node):
    """Mean cost per length of a straight segment; inf where it leaves the linked cells or ends on another node."""
    cells = ground.cells
    du, dv = end_u - u, end_v - v
    side_u, side_v = (0 if du > 0 else 2), (1 if dv > 0 else 3)
    corner = 4 + (side_u if (side_u + 1) % 4 == side_v else side_v)
    # shares of the segment at its next border of either kind, and between two borders of one kind
    every_u, every_v = (1 / abs(du) if du != 0 else math.inf), (1 / abs(dv) if dv != 0 else math.inf)
    at_u = ((cells.col[node] + 1 - u) if du > 0 else (u - cells.col[node])) * every_u if du != 0 else math.inf
    at_v = ((cells.row[node] + 1 - v) if dv > 0 else (v - cells.row[node])) * every_v if dv != 0 else math.inf
    rate, total, last = _rate(ground, node, reluctance), 0.0, 0.0
    while rate < math.inf:
        at = min(at_u, at_v)
        if at >= 1:
            return total + (1.0 - last) * rate if node == end_node else math.inf
        total += (at - last) * rate
        last = at
        if abs(at_u - at_v) < _TIE:
            side = corner
            at_u += every_u
            at_v += every_v
        elif at_u < at_v:
            side = side_u
            at_u += every_u
        else:
            side = side_v
            at_v += every_v
        node = cells.links[node, side]
        if node < 0:
            break
        rate = _rate(ground, node, reluctance)
    return math.inf


@njit(cache=True, nogil=True)
def _anchor(cells, work, node, goal):
    """(u, v, h, node, cost to go) of a node's parent; parent -1 is the goal itself."""
    parent = work.parent[node]
    if parent < 0:
        return goal.u, goal.v, goal.h, goal.node, 0.0
    return cells.col[parent] + 0.5, cells.row[parent] + 0.5, cells.h[parent], np.int64(parent), work.distance[parent]


@njit(cache=True, nogil=True)
def _relax(ground, work, counts, node, start, goal, reluctance, limit):
    """Offers the way over `node` to its neighbours, straight from its parent where that costs no more."""
    cells = ground.cells
    size, touched = counts
    u, v, h = cells.col[node] + 0.5, cells.row[node] + 0.5, cells.h[node]
    from_u, from_v, from_h, from_node, to_go = _anchor(cells, work, node, goal)
    for side in range(8):
        other = cells.links[node, side]
        if other < 0 or work.is_closed[other]:
            continue
        other_u, other_v, other_h = cells.col[other] + 0.5, cells.row[other] + 0.5, cells.h[other]
        straight = length(from_u, from_v, from_h, other_u, other_v, other_h)
        if to_go + straight >= work.distance[other]:
            continue  # neither way can be shorter
        rate = _rate(ground, other, reluctance)
        ahead = length(start.u, start.v, start.h, other_u, other_v, other_h)
        if rate == math.inf or ahead + length(goal.u, goal.v, goal.h, other_u, other_v, other_h) > limit:
            continue
        step = length(u, v, h, other_u, other_v, other_h)
        total = work.distance[node] + step * (_rate(ground, node, reluctance) + rate) / 2
        via = node
        if to_go + straight < total:
            mean = _rate_along(ground, reluctance, from_u, from_v, from_node, other_u, other_v, other)
            if to_go + straight * mean <= total + _TIE:
                total, via = to_go + straight * mean, work.parent[node]
        if total < work.distance[other]:
            if work.distance[other] == math.inf:
                work.touched[touched] = other
                touched += 1
            work.distance[other], work.parent[other] = total, via
            size = push(work.keys, work.values, size, total + ahead, other)
    return size, touched


@njit(cache=True, nogil=True)
def _last_leg(ground, work, node, start, goal, reluctance):
    """(cost, anchor) of the whole way when the start is reached from `node` or its parent."""
    cells = ground.cells
    u, v, h = cells.col[node] + 0.5, cells.row[node] + 0.5, cells.h[node]
    rate = _rate_along(ground, reluctance, u, v, node, start.u, start.v, start.node)
    best, found = work.distance[node] + rate * length(u, v, h, start.u, start.v, start.h), np.int64(node)
    from_u, from_v, from_h, from_node, to_go = _anchor(cells, work, node, goal)
    rate = _rate_along(ground, reluctance, from_u, from_v, from_node, start.u, start.v, start.node)
    total = to_go + rate * length(from_u, from_v, from_h, start.u, start.v, start.h)
    return (total, np.int64(work.parent[node])) if total < best else (best, found)


@njit(cache=True, nogil=True)
def route(ground, work, start, goal, reluctance, limit):
    """Cheapest polyline (K, 3) of u, v, h from start to goal by any-angle A*; K = 0 if there is no way.

    Nodes whose distances to start and goal sum to more than `limit` are left out. `reluctance` multiplies the price of
    unknown floor; inf allows only free floor.
    """
    cells = ground.cells
    u, v, h = cells.col[goal.node] + 0.5, cells.row[goal.node] + 0.5, cells.h[goal.node]
    work.distance[goal.node] = length(goal.u, goal.v, goal.h, u, v, h) * _rate(ground, goal.node, reluctance)
    work.parent[goal.node] = -1
    work.touched[0] = goal.node
    counts = (
        push(
            work.keys, work.values, 0, work.distance[goal.node] + length(start.u, start.v, start.h, u, v, h), goal.node
        ),
        1,
    )
    best, found = math.inf, np.int64(-2)
    while counts[0] and work.keys[0] < best:
        node, size = pop(work.keys, work.values, counts[0])
        counts = (size, counts[1])
        if work.is_closed[node]:
            continue
        work.is_closed[node] = True
        if abs(cells.col[node] + 0.5 - start.u) <= 1.5 and abs(cells.row[node] + 0.5 - start.v) <= 1.5:
            total, anchor = _last_leg(ground, work, node, start, goal, reluctance)
            if total < best:
                best, found = total, anchor
        counts = _relax(ground, work, counts, node, start, goal, reluctance, limit)
    corners = [(start.u, start.v, start.h)]
    while found >= 0:
        corners.append((cells.col[found] + 0.5, cells.row[found] + 0.5, cells.h[found]))
        found = np.int64(work.parent[found])
    corners.append((goal.u, goal.v, goal.h))
    for k in range(counts[1]):
        node = work.touched[k]
        work.distance[node], work.is_closed[node] = math.inf, False
    polyline = np.empty((len(corners) if best < math.inf else 0, 3))
    for k in range(len(polyline)):
        polyline[k, 0], polyline[k, 1], polyline[k, 2] = corners[k]
    return polyline


@njit(cache=True, nogil=True)
def _samples(polyline):
    """Points (u, v, h) on a polyline (K, 3), its corners and others at most _STEP apart."""
    found = [(0.0, 0.0, 0.0) for _ in range(0)]
    for i in range(len(polyline) - 1):
        move = polyline[i + 1] - polyline[i]
        num = max(math.ceil(math.sqrt((move**2).sum()) / _STEP), 1)
        for k in range(num + 1):
            at = polyline[i] + move * (k / num)
            found.append((at[0], at[1], at[2]))
    return found


@njit(cache=True, nogil=True)
def mark_near(cells, polyline, radius, mark):
    """Sets `mark` (N,) at the nodes whose centre is within `radius` of a polyline (K, 3) and at its height."""
    reach = math.ceil(radius)
    for u, v, h in _samples(polyline):
        r0, c0 = math.floor(v), math.floor(u)
        for r in range(max(r0 - reach, 0), min(r0 + reach, cells.rows - 1) + 1):
            for c in range(max(c0 - reach, 0), min(c0 + reach, cells.cols - 1) + 1):
                if (c + 0.5 - u) ** 2 + (r + 0.5 - v) ** 2 > radius**2 and not (r == r0 and c == c0):
                    continue
                for node in range(cells.first[r * cells.cols + c], cells.first[r * cells.cols + c + 1]):
                    if abs(cells.h[node] - h) <= _SAME_HEIGHT:
                        mark[node] = True


@njit(cache=True, nogil=True)
def is_touched(cells, polyline, mark):
    """Whether a polyline (K, 3) runs over a marked node at its height."""
    for u, v, h in _samples(polyline):
        column = math.floor(v) * cells.cols + math.floor(u)
        for node in range(cells.first[column], cells.first[column + 1]):
            if mark[node] and abs(cells.h[node] - h) <= _SAME_HEIGHT:
                return True
    return False


@njit(cache=True, nogil=True)
def polyline_length(polyline):
    """3-D length of a polyline (K, 3)."""
    total = 0.0
    for i in range(len(polyline) - 1):
        total += math.sqrt(((polyline[i + 1] - polyline[i]) ** 2).sum())
    return total
