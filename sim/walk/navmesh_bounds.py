"""Compiled lower bounds of path lengths to many goals at once, so that few of them need Detour's own path.

Exact shortest paths seen from above, by spreading intervals of edges that a root (the start or a wall's corner) sees
(the idea of Polyanya; Cui, Harabor, Grastien, IJCAI 2017). No path of Detour's is shorter: it also counts heights.
"""

import heapq
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.compiled import njit

_SLACK = 0.005
"""Metres by which a path of Detour's may seem to cut a corner: it skips a first edge within 1 mm."""
_MAX_SPREADS = 50_000
"""Intervals to spread before giving up (a mesh folded over itself never ends); homes need a few thousand."""
_SHORT = 1e-9
"""Intervals of edges shorter than this are dropped (metres)."""
_THIN = 1e-12
"""Triangles of a root and an edge smaller than this are flat (square metres)."""
_INSET = 1e-6
"""Share of the way to its polygon's middle by which a start is moved, so that it stands on no edge."""


class Bounds(NamedTuple):
    """Goals sorted by polygon, and room for one search after another."""

    order: NDArray[np.int64]
    """(K,) goals with a polygon, sorted by it."""
    first: NDArray[np.int64]
    """(P + 1,) where each polygon's goals start in `order`."""
    goals: NDArray[np.float64]
    """(N, 3)."""
    centre: NDArray[np.float64]
    """(3,) x and z of the middle of the goals that have a polygon, and how far they reach from it."""
    planar: NDArray[np.float64]
    """(N,) shortest length seen from above."""
    reached: NDArray[np.float64]
    """(V,) shortest length known to each vertex as a root."""


@njit(cache=True, nogil=True, error_model="numpy")
def new_bounds(mesh, goals, polygons):
    """Goals (N, 3) on polygons (N,), -1 = on none, made ready."""
    first = np.zeros(len(mesh.count) + 1, np.int64)
    for g in range(len(goals)):
        if polygons[g] >= 0:
            first[polygons[g] + 1] += 1
    first = np.cumsum(first)
    order = np.argsort(polygons)[len(goals) - first[-1] :]
    centre = np.zeros(3)
    for g in order:
        centre[0] += goals[g, 0] / len(order)
        centre[1] += goals[g, 2] / len(order)
    for g in order:
        centre[2] = max(centre[2], _apart((centre[0], centre[1]), (goals[g, 0], goals[g, 2])))
    return Bounds(order, first, goals.astype(np.float64), centre, np.empty(len(goals)), np.empty(len(mesh.bends)))


@njit(cache=True, nogil=True, error_model="numpy")
def _side(origin, a, b):
    """Positive where b lies to the left of the ray from origin through a; edges begin left, seen from their polygon."""
    return (a[0] - origin[0]) * (b[1] - origin[1]) - (a[1] - origin[1]) * (b[0] - origin[0])


@njit(cache=True, nogil=True, error_model="numpy")
def _apart(a, b):
    return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2)


@njit(cache=True, nogil=True, error_model="numpy")
def _by_way_of(root, left, right, goal):
    """Shortest way from a root to an interval and on to a goal (mirrored to the far side if on the near one)."""
    along = (right[0] - left[0], right[1] - left[1])
    away = ((goal[0] - left[0]) * along[1] - (goal[1] - left[1]) * along[0]) / (along[0] ** 2 + along[1] ** 2)
    if away > 0:
        goal = (goal[0] - 2 * away * along[1], goal[1] + 2 * away * along[0])
    if _side(root, left, goal) > 0:
        return _apart(root, left) + _apart(left, goal)
    if _side(root, right, goal) < 0:
        return _apart(root, right) + _apart(right, goal)
    return _apart(root, goal)


@njit(cache=True, nogil=True, error_model="numpy")
def _crossing(root, through, a, b):
    """Where the ray from a root through a point crosses edge a-b, whose ends lie on both sides of it."""
    left, right = _side(root, through, a), _side(root, through, b)
    share = left / (left - right)
    return (a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]))


@njit(cache=True, nogil=True, error_model="numpy")
def _push(heap, centre, limit, so_far, root, left, right, ids, polygon, entered_from):
    """Remember an interval unless every path through it to the goals is too long."""
    if _apart(left, right) < _SHORT:
        return
    least = so_far + _by_way_of(root, left, right, (centre[0], centre[1])) - centre[2]
    if least <= limit:
        heapq.heappush(heap, (least, so_far, root, left, right, ids, polygon, entered_from))


@njit(cache=True, nogil=True, error_model="numpy")
def _reach_goals(bounds, polygon, so_far, root, left, right):
    """Note the lengths to a polygon's goals from a root that sees it through an interval."""
    for k in range(bounds.first[polygon], bounds.first[polygon + 1]):
        g = bounds.order[k]
        goal = (bounds.goals[g, 0], bounds.goals[g, 2])
        if _side(root, left, goal) > 0:
            length = so_far + _apart(root, left) + _apart(left, goal)
        elif _side(root, right, goal) < 0:
            length = so_far + _apart(root, right) + _apart(right, goal)
        else:
            length = so_far + _apart(root, goal)
        bounds.planar[g] = min(bounds.planar[g], length)


@njit(cache=True, nogil=True, error_model="numpy")
def _corner(mesh, polygon, k):
    """Corner k of a polygon seen from above."""
    return (np.float64(mesh.corner[polygon, k, 0]), np.float64(mesh.corner[polygon, k, 2]))


@njit(cache=True, nogil=True, error_model="numpy")
def _spread_root(mesh, bounds, heap, limit, so_far, root, vertex, polygon):
    """Spread a root over one polygon in which it stands: to its goals, and to the edges by which it can be left."""
    _reach_goals(bounds, polygon, so_far, root, root, root)
    for k in range(mesh.count[polygon]):
        end = k + 1 if k + 1 < mesh.count[polygon] else 0
        ids = (vertex, np.int64(mesh.vertex[polygon, k]), np.int64(mesh.vertex[polygon, end]))
        other = mesh.neighbour[polygon, k]
        if other >= 0 and (vertex < 0 or (ids[1] != vertex and ids[2] != vertex)):
            left, right = _corner(mesh, polygon, k), _corner(mesh, polygon, end)
            _push(heap, bounds.centre, limit, so_far, root, left, right, ids, other, polygon)


@njit(cache=True, nogil=True, error_model="numpy")
def _turn_at(mesh, bounds, heap, limit, length, vertex, point, polygon):
    """Remember a vertex as a new root if a path can bend there and none so short has come to it."""
    if vertex >= 0 and mesh.bends[vertex] and length < bounds.reached[vertex] - _SHORT:
        bounds.reached[vertex] = length
        to_goals = _apart(point, (bounds.centre[0], bounds.centre[1])) - bounds.centre[2]
        if length + to_goals <= limit:
            ids = (vertex, np.int64(-1), np.int64(-1))
            heapq.heappush(heap, (length + to_goals, length, point, point, point, ids, polygon, np.int32(-1)))


@njit(cache=True, nogil=True, error_model="numpy")
def _leave(mesh, bounds, heap, limit, so_far, root, left, right, ids, polygon, entered_from):
    """Spread what a root sees through an interval to the edges by which the polygon behind it can be left."""
    for k in range(mesh.count[polygon]):
        other = mesh.neighbour[polygon, k]
        if other < 0 or other == entered_from:
            continue
        end = k + 1 if k + 1 < mesh.count[polygon] else 0
        a, b = _corner(mesh, polygon, k), _corner(mesh, polygon, end)
        a_id, b_id = np.int64(mesh.vertex[polygon, k]), np.int64(mesh.vertex[polygon, end])
        begins_left, ends_right = _side(root, left, a) > 0, _side(root, right, b) < 0
        if (begins_left and _side(root, left, b) >= 0) or (ends_right and _side(root, right, a) <= 0):
            continue
        if _side(root, a, b) > -_THIN:
            continue  # seen edge on
        seen_a, seen_b = a, b
        if begins_left:
            seen_a, a_id = _crossing(root, left, a, b), np.int64(-1)
        if ends_right:
            seen_b, b_id = _crossing(root, right, a, b), np.int64(-1)
        _push(heap, bounds.centre, limit, so_far, root, seen_a, seen_b, (ids[0], a_id, b_id), other, polygon)
    _turn_at(mesh, bounds, heap, limit, so_far + _apart(root, left), ids[1], left, polygon)
    _turn_at(mesh, bounds, heap, limit, so_far + _apart(root, right), ids[2], right, polygon)


@njit(cache=True, nogil=True, error_model="numpy")
def lower_bounds(mesh, bounds, start, start_polygon, limit):
    """(N,) no more than Detour's length from a start (x, y, z) over its polygon to each goal; inf above `limit`."""
    bounds.planar[:] = math.inf
    bounds.reached[:] = math.inf
    limit = limit + _SLACK
    root = (np.float64(start[0]), np.float64(start[2]))
    for k in range(mesh.count[start_polygon]):
        x, z = _corner(mesh, start_polygon, k)
        share = _INSET / mesh.count[start_polygon]
        root = (root[0] + (x - start[0]) * share, root[1] + (z - start[2]) * share)
    nobody = (np.int64(-1), np.int64(-1), np.int64(-1))
    heap = [(0.0, 0.0, root, root, root, nobody, np.int32(start_polygon), np.int32(-1))]
    spreads = 0
    while len(heap):
        least, so_far, root, left, right, ids, polygon, entered_from = heapq.heappop(heap)
        if least > limit:
            break
        spreads += 1
        if spreads > _MAX_SPREADS:
            bounds.planar[:] = 0.0  # nothing is known
            break
        vertex = ids[0]
        if vertex >= 0 and so_far > bounds.reached[vertex]:
            continue
        if entered_from >= 0:
            _reach_goals(bounds, polygon, so_far, root, left, right)
            _leave(mesh, bounds, heap, limit, so_far, root, left, right, ids, polygon, entered_from)
        elif vertex < 0:
            _spread_root(mesh, bounds, heap, limit, so_far, root, vertex, polygon)
        else:
            for k in range(mesh.first_around[vertex], mesh.first_around[vertex + 1]):
                _spread_root(mesh, bounds, heap, limit, so_far, root, vertex, mesh.around[k])
    result = np.empty(len(bounds.planar), np.float32)
    for g in range(len(result)):
        rise = bounds.goals[g, 1] - start[1]
        length = math.sqrt(bounds.planar[g] ** 2 + rise * rise) - _SLACK
        result[g] = length if bounds.planar[g] <= limit else math.inf
    return result
