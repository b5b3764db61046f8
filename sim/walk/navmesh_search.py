"""Compiled searches from polygon to polygon by Detour's rules: A* over edge middles, distance to the nearest wall."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.compiled import njit

from .navmesh_kernels import FAR, apart, at, corner, from_edge, middle, nearest_polygon, next_corner

MAX_NODES = 2048
"""A search that meets more polygons than this fails (habitat-sim's query)."""
MAX_PATH = 256
"""A path over more polygons or with more points fails (habitat-sim)."""
_HEURISTIC = np.float32(0.999)
_ZERO = np.float32(0.0)
_NEW, _OPEN, _CLOSED = 0, 1, 2


class Search(NamedTuple):
    """Memory for one search after another; each call of a public function has its own."""

    query: NDArray[np.int32]
    """(P,) number of the last search that met the polygon."""
    state: NDArray[np.uint8]
    parent: NDArray[np.int32]
    cost: NDArray[np.float32]
    total: NDArray[np.float32]
    """(P,) cost so far plus the least remaining cost."""
    where: NDArray[np.float32]
    """(P, 3) middle of the edge by which the polygon was first met."""
    heap: NDArray[np.int32]
    corridor: NDArray[np.int32]
    """(256,) polygons of the path."""
    line: NDArray[np.float32]
    """(256, 3) points of the path."""


@njit(cache=True, nogil=True)
def new_search(mesh):
    """Empty memory for searches on a mesh."""
    count = len(mesh.count)
    return Search(
        np.full(count, -1, np.int32),
        np.empty(count, np.uint8),
        np.empty(count, np.int32),
        np.empty(count, np.float32),
        np.empty(count, np.float32),
        np.empty((count, 3), np.float32),
        np.empty(min(count, MAX_NODES) + 1, np.int32),
        np.empty(MAX_PATH, np.int32),
        np.empty((MAX_PATH, 3), np.float32),
    )


@njit(cache=True, nogil=True, error_model="numpy")
def _rise(search, hole, polygon):
    """Puts a polygon into the heap at a hole or above it."""
    while hole > 0:
        up = (hole - 1) // 2
        if not search.total[search.heap[up]] > search.total[polygon]:
            break
        search.heap[hole] = search.heap[up]
        hole = up
    search.heap[hole] = polygon


@njit(cache=True, nogil=True, error_model="numpy")
def _pop_least(search, size):
    """Removes the least of a heap of `size` > 0; ties leave in Detour's order (the hole sinks to a leaf first)."""
    least = search.heap[0]
    last = search.heap[size - 1]
    hole, child = 0, 1
    while child < size - 1:
        if child + 1 < size - 1 and search.total[search.heap[child]] > search.total[search.heap[child + 1]]:
            child += 1
        search.heap[hole] = search.heap[child]
        hole, child = child, 2 * child + 1
    _rise(search, hole, last)
    return least


@njit(cache=True, nogil=True, error_model="numpy")
def _push_or_raise(search, size, polygon):
    """Adds a polygon to the heap, or moves it up if it is there already; returns the new size."""
    if search.state[polygon] == _OPEN:
        hole = 0
        while search.heap[hole] != polygon:
            hole += 1
        _rise(search, hole, polygon)
        return size
    search.state[polygon] = _OPEN
    _rise(search, size, polygon)
    return size + 1


@njit(cache=True, nogil=True, error_model="numpy")
def _begin(search, query, polygon, point):
    """Starts a search with one open polygon."""
    search.query[polygon] = query
    search.state[polygon] = _OPEN
    search.parent[polygon] = -1
    search.cost[polygon] = _ZERO
    for k in range(3):
        search.where[polygon, k] = point[k]
    search.heap[0] = polygon


@njit(cache=True, nogil=True, error_model="numpy")
def _meet(mesh, search, query, polygon, other):
    """Stores the middle of the shared edge where a search meets `other` for the first time."""
    search.query[other] = query
    search.state[other] = _NEW
    for k in range(mesh.count[polygon]):
        if mesh.neighbour[polygon, k] == other:
            where = middle(corner(mesh, polygon, k), next_corner(mesh, polygon, k))
            for axis in range(3):
                search.where[other, axis] = where[axis]
            return


@njit(cache=True, nogil=True, error_model="numpy")
def find_corridor(mesh, search, query, start, start_polygon, end, end_polygon):
    """Runs A*; returns whether it reached the end within MAX_NODES polygons; `search.parent` then leads back."""
    _begin(search, query, start_polygon, start)
    search.total[start_polygon] = apart(start, end) * _HEURISTIC
    size, met, lacking = 1, 1, False
    while size:
        polygon = _pop_least(search, size)
        size -= 1
        search.state[polygon] = _CLOSED
        if polygon == end_polygon:
            return not lacking
        here = at(search.where, polygon)
        for k in range(mesh.count[polygon]):
            other = mesh.neighbour[polygon, k]
            if other < 0 or other == search.parent[polygon]:
                continue
            if search.query[other] != query:
                if met == MAX_NODES:
                    lacking = True
                    continue
                met += 1
                _meet(mesh, search, query, polygon, other)
            there = at(search.where, other)
            to_go = apart(there, end)
            cost = search.cost[polygon] + apart(here, there)
            if other == end_polygon:
                cost = cost + to_go
                total = cost
            else:
                total = cost + to_go * _HEURISTIC
            if search.state[other] != _NEW and total >= search.total[other]:
                continue
            search.parent[other] = polygon
            search.cost[other] = cost
            search.total[other] = total
            size = _push_or_raise(search, size, other)
    return False


@njit(cache=True, nogil=True, error_model="numpy")
def corridor_length(search, end_polygon):
    """Writes the polygons from start to end into `search.corridor`; returns their number, 0 if there are too many."""
    count, polygon = 0, end_polygon
    while polygon >= 0:
        count += 1
        polygon = search.parent[polygon]
    if count > MAX_PATH:
        return 0
    polygon = end_polygon
    for i in range(count - 1, -1, -1):
        search.corridor[i] = polygon
        polygon = search.parent[polygon]
    return count


@njit(cache=True, nogil=True, error_model="numpy")
def wall_distance(mesh, point, max_radius):
    """Planar distance from a point's place on the mesh to the nearest wall, at most `max_radius`; inf off the mesh."""
    start, where = nearest_polygon(mesh, (point[0], point[1], point[2]))
    if start < 0:
        return FAR
    search = new_search(mesh)
    _begin(search, 0, start, where)
    search.total[start] = _ZERO
    radius_sq = max_radius * max_radius
    size, met = 1, 1
    while size:
        polygon = _pop_least(search, size)
        size -= 1
        search.state[polygon] = _CLOSED
        for k in range(mesh.count[polygon]):
            if mesh.neighbour[polygon, k] < 0:
                away, _ = from_edge(where, corner(mesh, polygon, k), next_corner(mesh, polygon, k))
                radius_sq = min(radius_sq, away)
        here = at(search.where, polygon)
        for k in range(mesh.count[polygon]):
            other = mesh.neighbour[polygon, k]
            if other < 0 or other == search.parent[polygon]:
                continue
            away, _ = from_edge(where, corner(mesh, polygon, k), next_corner(mesh, polygon, k))
            is_new = search.query[other] != 0
            if away > radius_sq or (is_new and met == MAX_NODES) or (not is_new and search.state[other] == _CLOSED):
                continue
            if is_new:
                met += 1
                _meet(mesh, search, 0, polygon, other)
            total = search.total[polygon] + apart(here, at(search.where, other))
            if search.state[other] == _OPEN and total >= search.total[other]:
                continue
            search.parent[other] = polygon
            search.total[other] = total
            size = _push_or_raise(search, size, other)
    return np.float32(math.sqrt(radius_sq))
