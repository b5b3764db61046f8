"""Compiled geometry of a navigation mesh in Detour's single precision: heights, nearest polygons, walls.

Points are tuples (x, y, z) of float32. Sums and products keep Detour's order: at walls and ties the last bit decides.
"""

import math

import numpy as np

from sim.compiled import njit

REACH = (np.float32(2.0), np.float32(4.0), np.float32(2.0))
"""Half extents of the box in which a point's polygon is searched, metres (habitat-sim)."""
_FLAT = np.float32(1e-6)
_SLACK = np.float32(1e-6)
"""A polygon that seems too far by less than this (square metres) is still examined: its distance is rounded."""
_ZERO, _HALF, _ONE = np.float32(0.0), np.float32(0.5), np.float32(1.0)
FAR = np.float32(np.inf)


@njit(cache=True, nogil=True, error_model="numpy")
def at(points, i):
    """Row i of (N, 3) as a point."""
    return (points[i, 0], points[i, 1], points[i, 2])


@njit(cache=True, nogil=True, error_model="numpy")
def corner(mesh, polygon, k):
    """Corner k of a polygon."""
    return (mesh.corner[polygon, k, 0], mesh.corner[polygon, k, 1], mesh.corner[polygon, k, 2])


@njit(cache=True, nogil=True, error_model="numpy")
def next_corner(mesh, polygon, k):
    """The corner after corner k, where edge k ends."""
    return corner(mesh, polygon, k + 1 if k + 1 < mesh.count[polygon] else 0)


@njit(cache=True, nogil=True, error_model="numpy")
def between(a, b, share):
    """The point at this share of the way from a to b."""
    return (a[0] + (b[0] - a[0]) * share, a[1] + (b[1] - a[1]) * share, a[2] + (b[2] - a[2]) * share)


@njit(cache=True, nogil=True, error_model="numpy")
def middle(a, b):
    """Half way between two points."""
    return ((a[0] + b[0]) * _HALF, (a[1] + b[1]) * _HALF, (a[2] + b[2]) * _HALF)


@njit(cache=True, nogil=True, error_model="numpy")
def apart_sq(a, b):
    """Squared 3-D distance."""
    dx, dy, dz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    return dx * dx + dy * dy + dz * dz


@njit(cache=True, nogil=True, error_model="numpy")
def apart(a, b):
    """3-D distance."""
    return np.float32(math.sqrt(apart_sq(a, b)))


@njit(cache=True, nogil=True, error_model="numpy")
def from_edge(point, a, b):
    """(squared planar distance, share) of the point of edge a-b nearest to a point seen from above."""
    along_x, along_z = b[0] - a[0], b[2] - a[2]
    dx, dz = point[0] - a[0], point[2] - a[2]
    length_sq = along_x * along_x + along_z * along_z
    share = along_x * dx + along_z * dz
    if length_sq > _ZERO:
        share /= length_sq
    share = min(max(share, _ZERO), _ONE)
    dx, dz = a[0] + share * along_x - point[0], a[2] + share * along_z - point[2]
    return dx * dx + dz * dz, share


@njit(cache=True, nogil=True, error_model="numpy")
def is_over(mesh, polygon, point):
    """Whether a point lies over or under a polygon, by counting crossings of its border towards +x."""
    x, z = point[0], point[2]
    inside = False
    before = mesh.count[polygon] - 1
    for k in range(mesh.count[polygon]):
        x1, z1 = mesh.corner[polygon, k, 0], mesh.corner[polygon, k, 2]
        x0, z0 = mesh.corner[polygon, before, 0], mesh.corner[polygon, before, 2]
        if (z1 > z) != (z0 > z) and x < (x0 - x1) * (z - z1) / (z0 - z1) + x1:
            inside = not inside
        before = k
    return inside


@njit(cache=True, nogil=True, error_model="numpy")
def _height_in_triangle(mesh, t, point):
    """(whether the point is over detail triangle t, height of the triangle there)."""
    a, b, c = at(mesh.triangle[t], 0), at(mesh.triangle[t], 1), at(mesh.triangle[t], 2)
    cx, cz = c[0] - a[0], c[2] - a[2]
    bx, bz = b[0] - a[0], b[2] - a[2]
    px, pz = point[0] - a[0], point[2] - a[2]
    whole = cx * bz - cz * bx
    if abs(whole) < _FLAT:
        return False, _ZERO
    u = bz * px - bx * pz
    v = cx * pz - cz * px
    if whole < _ZERO:
        whole, u, v = -whole, -u, -v
    if u < _ZERO or v < _ZERO or u + v > whole:
        return False, _ZERO
    return True, a[1] + ((c[1] - a[1]) * u + (b[1] - a[1]) * v) / whole


@njit(cache=True, nogil=True, error_model="numpy")
def _nearest_on_edges(mesh, polygon, point, border_only):
    """The nearest point, seen from above, on a polygon's detail edges; `border_only` skips inner edges."""
    least = FAR
    found = point
    for t in range(mesh.first_triangle[polygon], mesh.first_triangle[polygon + 1]):
        before = 2
        for k in range(3):
            edge, before = before, k
            seen_again = mesh.triangle_corner[t, edge] < mesh.triangle_corner[t, k]
            if not mesh.on_border[t, edge] and (border_only or seen_again):
                continue
            a, b = at(mesh.triangle[t], edge), at(mesh.triangle[t], k)
            away, share = from_edge(point, a, b)
            if away < least:
                least, found = away, between(a, b, share)
    return found


@njit(cache=True, nogil=True, error_model="numpy")
def height(mesh, polygon, point):
    """(whether the point is over or under the polygon, height of the detailed surface there)."""
    if not is_over(mesh, polygon, point):
        return False, point[1]
    for t in range(mesh.first_triangle[polygon], mesh.first_triangle[polygon + 1]):
        is_there, y = _height_in_triangle(mesh, t, point)
        if is_there:
            return True, y
    return True, _nearest_on_edges(mesh, polygon, point, False)[1]  # on an edge, missed by rounding


@njit(cache=True, nogil=True, error_model="numpy")
def closest_on_polygon(mesh, polygon, point):
    """(whether the point is over or under the polygon, point of the polygon nearest to it)."""
    over, y = height(mesh, polygon, point)
    if over:
        return True, (point[0], y, point[2])
    return False, _nearest_on_edges(mesh, polygon, point, True)


@njit(cache=True, nogil=True, error_model="numpy")
def on_border(mesh, polygon, point):
    """The end of a path for a point: the point itself if over the polygon, else the nearest edge point from above."""
    if is_over(mesh, polygon, point):
        return point
    least, edge, best = FAR, 0, _ZERO
    for k in range(mesh.count[polygon]):
        away, share = from_edge(point, corner(mesh, polygon, k), next_corner(mesh, polygon, k))
        if away < least:
            least, edge, best = away, k, share
    return between(corner(mesh, polygon, edge), next_corner(mesh, polygon, edge), best)


@njit(cache=True, nogil=True, error_model="numpy")
def _box_in_tree(mesh, point):
    """(whether the search box of a point meets the tile, lowest corner, highest corner) in tree units."""
    low = np.empty(3, np.int64)
    high = np.empty(3, np.int64)
    meets = True
    for k in range(3):
        least, most = point[k] - REACH[k], point[k] + REACH[k]
        if k != 1:
            side = mesh.tile_size[k // 2]
            meets = meets and least < mesh.origin[k] + side and most >= mesh.origin[k]
        bottom, top = mesh.bounds[0, k], mesh.bounds[1, k]
        low[k] = int(mesh.scale * (min(max(least, bottom), top) - bottom)) & 0xFFFE
        high[k] = int(mesh.scale * (min(max(most, bottom), top) - bottom) + _ONE) & 0xFFFF | 1
    return meets, low, high


@njit(cache=True, nogil=True, error_model="numpy")
def _least_possible(mesh, polygon, point):
    """A lower bound, from the polygon's box, of the squared distance that `_distance_sq` gives."""
    away_x = max(mesh.low[polygon, 0] - point[0], _ZERO, point[0] - mesh.high[polygon, 0])
    away_y = max(mesh.low[polygon, 1] - point[1], _ZERO, point[1] - mesh.high[polygon, 1])
    away_z = max(mesh.low[polygon, 2] - point[2], _ZERO, point[2] - mesh.high[polygon, 2])
    if away_x > _ZERO or away_z > _ZERO:
        return away_x * away_x + away_y * away_y + away_z * away_z
    away_y = max(away_y - mesh.climb, _ZERO)
    return away_y * away_y


@njit(cache=True, nogil=True, error_model="numpy")
def _distance_sq(mesh, over, found, point):
    """Detour's squared distance of a point to its closest point on a polygon; over it, one step of height is free."""
    if not over:
        return apart_sq(found, point)
    away = abs(point[1] - found[1]) - mesh.climb
    return away * away if away > _ZERO else _ZERO


@njit(cache=True, nogil=True, error_model="numpy")
def nearest_polygon(mesh, point):
    """(polygon, point on it) nearest to a point; polygon -1 where none is in reach. The tree's first wins ties."""
    best, where = -1, point
    if not (math.isfinite(point[0]) and math.isfinite(point[1]) and math.isfinite(point[2])):
        return best, where
    meets, low, high = _box_in_tree(mesh, point)
    if not meets:
        return best, where
    bound, least = FAR, FAR
    for only_over in (True, False):  # first polygons over or under the point: they bound the others' distance
        node = 0
        while node < len(mesh.tree_index):
            box = mesh.tree_bounds[node]
            overlaps = True
            for k in range(3):
                overlaps = overlaps and low[k] <= box[1, k] and high[k] >= box[0, k]
            polygon = mesh.tree_index[node]
            if polygon < 0 and not overlaps:
                node -= polygon
                continue
            node += 1
            if polygon < 0 or not overlaps or mesh.island[polygon] < 0:
                continue
            possible = _least_possible(mesh, polygon, point)
            if possible > bound + _SLACK or (only_over and not is_over(mesh, polygon, point)):
                continue
            over, found = closest_on_polygon(mesh, polygon, point)
            away = _distance_sq(mesh, over, found, point)
            bound = min(bound, away)
            if not only_over and away < least:
                least, best, where = away, polygon, found
    return best, where


@njit(cache=True, nogil=True, error_model="numpy")
def project(mesh, points):
    """(polygon (N,), points on the mesh (N, 3)) nearest to points (N, 3); polygon -1 where none is in reach."""
    polygons = np.empty(len(points), np.int32)
    found = np.empty((len(points), 3), np.float32)
    for i in range(len(points)):
        polygons[i], where = nearest_polygon(mesh, at(points, i))
        for k in range(3):
            found[i, k] = where[k]
    return polygons, found
