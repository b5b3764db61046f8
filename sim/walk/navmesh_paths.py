"""Compiled shortest paths on a navigation mesh by Detour's rules: a funnel through the polygons that A* found.

The path is not always the shortest, and may differ in the two directions: the aim is to agree with Habitat.
"""

import numpy as np

from sim.compiled import njit

from .navmesh_kernels import (
    FAR,
    apart,
    apart_sq,
    at,
    corner,
    from_edge,
    nearest_polygon,
    next_corner,
    on_border,
    project,
)
from .navmesh_search import MAX_PATH, corridor_length, find_corridor, new_search

_SAME_SQ = np.float32((1.0 / 16384.0) ** 2)
"""Corners closer than this are the same corner (square metres)."""
_AT_EDGE_SQ = np.float32(1e-6)
"""A start this near to its first edge begins on that edge (square metres)."""
_TRIVIAL = np.float32(1e-10)
"""Ends are the same when their squared distance is below this share of their squared norms (Eigen's isApprox)."""
_ZERO = np.float32(0.0)


@njit(cache=True, nogil=True, error_model="numpy")
def _turn(a, b, c):
    """Twice the signed area of a triangle seen from above; positive where c lies to the right of a-b."""
    return (c[0] - a[0]) * (b[2] - a[2]) - (b[0] - a[0]) * (c[2] - a[2])


@njit(cache=True, nogil=True, error_model="numpy")
def _portal(mesh, polygon, other):
    """(left, right) ends of the edge from one polygon to another."""
    for k in range(mesh.count[polygon]):
        if mesh.neighbour[polygon, k] == other:
            return corner(mesh, polygon, k), next_corner(mesh, polygon, k)
    return corner(mesh, polygon, 0), corner(mesh, polygon, 0)  # never: corridors are made of neighbours


@njit(cache=True, nogil=True, error_model="numpy")
def _append(line, count, point):
    """Adds a point unless it repeats the last one; returns the new number of points."""
    if count and apart_sq(at(line, count - 1), point) < _SAME_SQ:
        return count
    for k in range(3):
        line[count, k] = point[k]
    return count + 1


@njit(cache=True, nogil=True, error_model="numpy")
def _pull(mesh, search, polygons, start, end):
    """Pulls a string through `search.corridor` into `search.line`; number of points, 0 where there are too many."""
    path, line = search.corridor, search.line
    first = on_border(mesh, path[0], start)
    last = on_border(mesh, path[polygons - 1], end)
    count = _append(line, 0, first)
    apex, left, right = first, first, first
    at_left, at_right = 0, 0
    i = 0
    while polygons > 1 and i < polygons:
        new_left, new_right = last, last
        if i + 1 < polygons:
            new_left, new_right = _portal(mesh, path[i], path[i + 1])
            if i == 0 and from_edge(apex, new_left, new_right)[0] < _AT_EDGE_SQ:
                i += 1
                continue
        bend = -1
        if _turn(apex, right, new_right) <= _ZERO:
            if apart_sq(apex, right) < _SAME_SQ or _turn(apex, left, new_right) > _ZERO:
                right, at_right = new_right, i
            else:
                apex, bend = left, at_left
        if bend < 0 and _turn(apex, left, new_left) >= _ZERO:
            if apart_sq(apex, left) < _SAME_SQ or _turn(apex, right, new_left) < _ZERO:
                left, at_left = new_left, i
            else:
                apex, bend = right, at_right
        if bend >= 0:
            count = _append(line, count, apex)
            if count == MAX_PATH:
                return 0
            left, right, at_left, at_right = apex, apex, bend, bend
            i = bend
        i += 1
    count = _append(line, count, last)
    return count if count < MAX_PATH else 0


@njit(cache=True, nogil=True, error_model="numpy")
def _length(line, count):
    """Length of a polyline."""
    total = _ZERO
    for i in range(1, count):
        total += apart(at(line, i), at(line, i - 1))
    return total


@njit(cache=True, nogil=True, error_model="numpy")
def _is_same(a, b):
    """Whether two points on the mesh are so near that their path has length 0, even between islands."""
    zero = (_ZERO, _ZERO, _ZERO)
    return apart_sq(a, b) <= _TRIVIAL * min(apart_sq(zero, a), apart_sq(zero, b))


@njit(cache=True, nogil=True, error_model="numpy")
def _single_path(mesh, search, query, start, start_polygon, from_point, end, end_polygon, to_point):
    """(length, number of points in `search.line`) of one path; (inf, 0) where there is none.

    `start` and `end` are the given points; `from_point` and `to_point` are their places on the mesh.
    """
    if _is_same(from_point, to_point):
        for k in range(3):
            search.line[0, k], search.line[1, k] = from_point[k], to_point[k]
        return _ZERO, 2
    if mesh.island[start_polygon] != mesh.island[end_polygon]:
        return FAR, 0
    if not find_corridor(mesh, search, query, from_point, start_polygon, to_point, end_polygon):
        return FAR, 0
    polygons = corridor_length(search, end_polygon)
    count = _pull(mesh, search, polygons, start, end) if polygons else 0
    return (_length(search.line, count), count) if count else (FAR, 0)


@njit(cache=True, nogil=True, error_model="numpy")
def _straight(mesh, start, polygon, where, goals, polygons, points):
    """(N,) straight distances from a start to goals (N, 3), inf to goals without any path."""
    result = np.full(len(goals), FAR, np.float32)
    for g in range(len(goals)):
        joined = polygons[g] >= 0 and mesh.island[polygons[g]] == mesh.island[polygon]
        if joined or (polygons[g] >= 0 and _is_same(where, at(points, g))):
            result[g] = apart(start, at(goals, g))
    return result


@njit(cache=True, nogil=True, error_model="numpy")
def lengths(mesh, starts, goals):
    """(lengths (M,), nearest goal (M,)) from starts (M, 3) to goals (N, 3); (inf, -1) where none is reachable.

    The result follows Habitat's order: goals are tried by straight distance, until it exceeds the best length.
    """
    search = new_search(mesh)
    polygons, points = project(mesh, goals)
    result = np.full(len(starts), FAR, np.float32)
    nearest = np.full(len(starts), -1, np.int32)
    query = 0
    for i in range(len(starts)):
        start = at(starts, i)
        polygon, where = nearest_polygon(mesh, start)
        if polygon < 0:
            continue
        least = _straight(mesh, start, polygon, where, goals, polygons, points)
        while len(goals):
            g = np.argmin(least)
            if least[g] == FAR or least[g] > result[i]:
                break
            goal, to_point = at(goals, g), at(points, g)
            length, _ = _single_path(mesh, search, query, start, polygon, where, goal, polygons[g], to_point)
            query += 1
            least[g] = FAR
            if length < result[i]:
                result[i], nearest[i] = length, g
    return result, nearest


@njit(cache=True, nogil=True, error_model="numpy")
def polyline(mesh, start, goal):
    """Points (K, 3) of the path from a start (3,) to a goal (3,); K = 0 where there is none."""
    search = new_search(mesh)
    a, b = (start[0], start[1], start[2]), (goal[0], goal[1], goal[2])
    polygon, where = nearest_polygon(mesh, a)
    end_polygon, to_point = nearest_polygon(mesh, b)
    if polygon < 0 or end_polygon < 0:
        return search.line[:0]
    _, count = _single_path(mesh, search, 0, a, polygon, where, b, end_polygon, to_point)
    return search.line[:count]
