"""Compiled single steps on a navigation mesh: habitat-sim's old rule without sliding, and Detour's sliding walk."""

import numpy as np

from sim.compiled import njit

from .navmesh_kernels import FAR, apart, between, corner, from_edge, height, is_over, nearest_polygon

_MAX_MET = 64
"""A step ignores polygons beyond this number (Detour's small node pool)."""
_MAX_WAITING = 48
_MARGIN = np.float32(0.001)
"""The circle over a sliding step is this much larger than the step, metres."""
_PARALLEL = np.float32(1e-6)
_NUDGE = np.float32(1e-4)
"""An end that counts as on another island is moved this far towards its polygon's middle, metres (habitat-sim)."""
_COLLISION = np.float32(1e-5)
_ZERO, _HALF, _ONE = np.float32(0.0), np.float32(0.5), np.float32(1.0)


@njit(cache=True, nogil=True, error_model="numpy")
def _crossing(start, end, a, b):
    """(whether segment start-end crosses edge a-b seen from above, share of the edge at which it does)."""
    edge_x, edge_z = b[0] - a[0], b[2] - a[2]
    walk_x, walk_z = end[0] - start[0], end[2] - start[2]
    from_x, from_z = start[0] - a[0], start[2] - a[2]
    whole = edge_x * walk_z - edge_z * walk_x
    if abs(whole) < _PARALLEL:
        return False, _ZERO
    on_walk = (edge_z * from_x - edge_x * from_z) / whole
    on_edge = (walk_z * from_x - walk_x * from_z) / whole
    crosses = _ZERO <= on_walk <= _ONE and _ZERO <= on_edge <= _ONE
    return crosses, on_edge


@njit(cache=True, nogil=True, error_model="numpy")
def _at_wall(start, end, a, b, slide):
    """(whether wall a-b can end a walk, the point on it, that point's squared planar distance to the wanted end)."""
    if slide:
        away, share = from_edge(end, a, b)
        return True, between(a, b, share), away
    crosses, share = _crossing(start, end, a, b)
    hit = between(a, b, share)
    dx, dz = hit[0] - end[0], hit[2] - end[2]
    return crosses, hit, dx * dx + dz * dz


@njit(cache=True, nogil=True, error_model="numpy")
def _walk(mesh, polygon, start, end, slide):
    """(last polygon, point) of a walk along the surface from a start on `polygon`; polygon -1 where there is no way.

    Searches polygons breadth first. Sliding: polygons whose shared edge touches the circle over the segment; the walk
    ends at the point of their walls nearest to the end. Otherwise: polygons entered through an edge that the segment
    crosses; the walk ends where the segment crosses a wall (the crossing nearest to the end).
    """
    waiting = np.empty(_MAX_MET, np.int32)
    met = np.empty(_MAX_MET, np.int32)
    closed = np.zeros(_MAX_MET, np.bool_)
    met[0], closed[0], waiting[0] = polygon, True, polygon
    num_met, head, tail = 1, 0, 1
    centre = between(start, end, _HALF)
    radius = apart(start, end) / np.float32(2.0) + _MARGIN
    least, best, found = FAR, -1, start
    while head < tail:
        here = waiting[head]
        head += 1
        if is_over(mesh, here, end):
            return here, end
        k = mesh.count[here] - 1
        for following in range(mesh.count[here]):
            a, b = corner(mesh, here, k), corner(mesh, here, following)
            other = mesh.neighbour[here, k]
            k = following
            if other < 0:
                stops, hit, away = _at_wall(start, end, a, b, slide)
                if stops and away < least:
                    least, best, found = away, here, hit
                continue
            slot = 0
            while slot < num_met and met[slot] != other:
                slot += 1
            if slot == _MAX_MET:
                continue
            if slot == num_met:
                met[slot] = other
                num_met += 1
            if slide:
                enters = from_edge(centre, a, b)[0] <= radius * radius
            else:
                enters, _ = _crossing(start, end, a, b)
            if enters and not closed[slot] and tail - head < _MAX_WAITING:
                closed[slot] = True
                waiting[tail] = other
                tail += 1
    return best, found


@njit(cache=True, nogil=True, error_model="numpy")
def _nudged(mesh, polygon, point):
    """A point moved a little towards the middle of a polygon."""
    x, y, z = _ZERO, _ZERO, _ZERO
    for k in range(mesh.count[polygon]):
        x, y, z = x + mesh.corner[polygon, k, 0], y + mesh.corner[polygon, k, 1], z + mesh.corner[polygon, k, 2]
    count = np.float32(mesh.count[polygon])
    to_middle = (x / count - point[0], y / count - point[1], z / count - point[2])
    length = apart(to_middle, (_ZERO, _ZERO, _ZERO))
    if length == _ZERO:
        return point
    share = _NUDGE / length
    return (point[0] + to_middle[0] * share, point[1] + to_middle[1] * share, point[2] + to_middle[2] * share)


@njit(cache=True, nogil=True, error_model="numpy")
def _end_of_step(mesh, start, end, slide):
    """The end of a step from `start` towards `end`; it is `start` unless both are on the same island."""
    polygon, where = nearest_polygon(mesh, start)
    end_polygon, _ = nearest_polygon(mesh, end)
    if polygon < 0 or end_polygon < 0 or mesh.island[polygon] != mesh.island[end_polygon]:
        return start
    last, found = _walk(mesh, polygon, where, end, slide)
    if last < 0:
        return start
    _, y = height(mesh, last, found)  # keeps its own y where rounding puts it outside
    found = (found[0], y, found[2])
    on, _ = nearest_polygon(mesh, found)
    if on < 0 or mesh.island[on] != mesh.island[polygon]:
        found = _nudged(mesh, last, found)
    return found


@njit(cache=True, nogil=True, error_model="numpy")
def step(mesh, start, end, slide):
    """(end point (x, y, z), collided) of one step from `start` (3,) towards `end` (3,), both as given.

    Collided: |moved|^2 + 1e-5 < |wanted|^2 from the start as given (habitat-sim).
    """
    a, b = (start[0], start[1], start[2]), (end[0], end[1], end[2])
    found = _end_of_step(mesh, a, b, slide)
    moved = (found[0] - a[0], found[1] - a[1], found[2] - a[2])
    wanted = (b[0] - a[0], b[1] - a[1], b[2] - a[2])
    moved_sq = moved[0] * moved[0] + moved[1] * moved[1] + moved[2] * moved[2]
    wanted_sq = wanted[0] * wanted[0] + wanted[1] * wanted[1] + wanted[2] * wanted[2]
    return found, moved_sq + _COLLISION < wanted_sq
