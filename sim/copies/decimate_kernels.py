"""Compiled loops of `decimate`: the possible moves of vertices onto neighbours, their prices, and the moves."""

import math

import numpy as np

from sim.compiled import njit

from .surface import NO_AREA, corner_of, has, is_folded, normal, plane_at, shows_same, squared, value_at

_MAX_RING = 48
"""Vertices with more neighbours than this stay."""
_MIN_COS = 0.3
"""Largest turn of a face that a move may cause (cosine)."""
_SLIVER = 0.02
"""A move may not make faces thinner than this (height over length), unless they were thinner before."""
_BORDER_WEIGHT, _SEAM_WEIGHT = 4.0, 1.0
"""Weights of the lines of open borders and of seams, relative to the shape of surfaces."""
_SHIFT_WEIGHT = 0.05
"""Weight of a shift of the texture, relative to the same shift of the surface (both squared)."""
_LIGHT_METRES = 1.0
"""Light on a texture that changes from none to full counts like a texture that shifts by this (metres): with a
tolerance of 3 mm it moves by 3 of 255 levels."""
_LENGTH_WEIGHT = 1e-7
"""Weight of an edge's length, so that short edges go first on flat surfaces."""


@njit(cache=True, nogil=True)
def quadrics(surface):
    """(V, 11) planes of each vertex's faces, weighted by area, and of its borders and seams; then the area."""
    points, faces = surface.points, surface.faces
    result = np.zeros((len(points), 11))
    for f in range(len(faces)):
        nx, ny, nz = normal(points[faces[f, 0]], points[faces[f, 1]], points[faces[f, 2]])
        length = math.sqrt(nx * nx + ny * ny + nz * nz)
        if length < NO_AREA:
            continue
        nx, ny, nz = nx / length, ny / length, nz / length
        for k in range(3):
            u, v = faces[f, k], faces[f, (k + 1) % 3]
            p, q = points[u], points[v]
            _add_plane(result[u], nx, ny, nz, p, length / 2)
            result[u, 10] += length / 2
            weight = _edge_weight(surface, f, u, v)
            if weight > 0:  # the upright plane through the edge
                ex, ey, ez = q[0] - p[0], q[1] - p[1], q[2] - p[2]
                ox, oy, oz = ey * nz - ez * ny, ez * nx - ex * nz, ex * ny - ey * nx
                size = math.sqrt(ox * ox + oy * oy + oz * oz)
                if size > NO_AREA:
                    _add_plane(result[u], ox / size, oy / size, oz / size, p, weight * size * size)
                    _add_plane(result[v], ox / size, oy / size, oz / size, p, weight * size * size)
    return result


@njit(cache=True, nogil=True)
def _add_plane(quadric, nx, ny, nz, p, weight):
    """Adds the plane with this unit normal through `p`."""
    d = -(nx * p[0] + ny * p[1] + nz * p[2])
    quadric[0] += weight * nx * nx
    quadric[1] += weight * nx * ny
    quadric[2] += weight * nx * nz
    quadric[3] += weight * nx * d
    quadric[4] += weight * ny * ny
    quadric[5] += weight * ny * nz
    quadric[6] += weight * ny * d
    quadric[7] += weight * nz * nz
    quadric[8] += weight * nz * d
    quadric[9] += weight * d * d


@njit(cache=True, nogil=True, inline="always")
def _error(q, p):
    """Mean squared distance (m2) of a point from the planes of a quadric."""
    x, y, z = p[0], p[1], p[2]
    total = q[0] * x * x + q[4] * y * y + q[7] * z * z + q[9]
    total += 2 * (q[1] * x * y + q[2] * x * z + q[5] * y * z + q[3] * x + q[6] * y + q[8] * z)
    return max(total, 0.0) / max(q[10], NO_AREA)


@njit(cache=True, nogil=True)
def price_moves(surface, quadric, is_stale, is_loose, price, target):
    """Finds for every vertex in `is_stale` (V,) the cheapest neighbour to move it onto.

    Writes the mean squared error in m2 to `price` (V,) (inf = it stays) and the neighbour to `target` (V,). Vertices on
    a border (or where more than two faces meet at an edge) move along it only. Unless `is_loose`, vertices on a seam of
    the texture do so too.
    """
    near, count = np.empty(_MAX_RING, np.int32), np.empty(_MAX_RING, np.int32)
    seen = np.empty(_MAX_RING, np.bool_)
    plane, value = np.empty(surface.shown.shape[2]), np.empty(surface.shown.shape[2])
    for u in range(len(is_stale)):
        if not is_stale[u]:
            continue
        price[u] = np.inf
        found = _neighbours(surface, u, near, count)
        borders = 0
        for place in range(found):
            borders += count[place] != 2
        if found <= 0 or not (borders == 0 or borders == 2):
            continue
        for place in range(found):
            if borders and count[place] == 2:
                continue
            v = near[place]
            cost = _error(quadric[u], surface.points[v]) + _LENGTH_WEIGHT * squared(
                surface.points[u], surface.points[v]
            )
            if cost >= price[u] or _num_common(surface, v, near, found, seen) != count[place]:
                continue
            cost += _shift(surface, u, v, is_loose, plane, value)
            if cost < price[u]:
                price[u] = cost
                target[u] = v


@njit(cache=True, nogil=True)
def move(surface, quadric, order, target, num_wanted, is_loose, is_touched, is_gone):
    """Moves vertices in this order, never two neighbours; returns the number of removed faces.

    Writes faces, `shown` and `quadric`; sets `is_touched` (V,) around each move and `is_gone` (F,). Ends after
    `num_wanted` faces.
    """
    faces, start, ring = surface.faces, surface.start, surface.ring
    plane, value = np.empty(surface.shown.shape[2]), np.empty(surface.shown.shape[2])
    removed = 0
    for u in order:
        v = target[u]
        is_free = not is_touched[v]
        for k in range(start[u], start[u + 1]):
            for corner in range(3):
                is_free = is_free and not is_touched[faces[ring[k], corner]]
        if not is_free:
            continue
        for k in range(start[u], start[u + 1]):  # all values first: they are read from the old faces
            f = ring[k]
            if not has(faces, f, v):
                i = corner_of(faces, f, u)
                plane_at(surface, f, i, surface.points[v], plane)
                if not value_at(surface, f, u, v, value):
                    value[:] = plane
                for channel in range(len(value)):
                    surface.shown[f, i, channel] = value[channel]
        for k in range(start[u], start[u + 1]):
            f = ring[k]
            for corner in range(3):
                is_touched[faces[f, corner]] = True
            if has(faces, f, v):
                is_gone[f] = True
                removed += 1
            else:
                faces[f, corner_of(faces, f, u)] = v
        quadric[v] += quadric[u]
        if removed >= num_wanted:
            break
    return removed


@njit(cache=True, nogil=True)
def _edge_weight(surface, f, u, v):
    """Weight of the line of an edge of face `f`: a border, fold or seam has one, other edges have 0."""
    others, joins, folds = 0, True, False
    for k in range(surface.start[u], surface.start[u + 1]):
        g = surface.ring[k]
        if g != f and has(surface.faces, g, v):
            others += 1
            joins = joins and shows_same(surface, f, g, u) and shows_same(surface, f, g, v)
            folds = folds or is_folded(surface, f, g, u, v)
    if others != 1 or folds:
        return _BORDER_WEIGHT
    return 0.0 if joins else _SEAM_WEIGHT


@njit(cache=True, nogil=True, inline="always")
def _neighbours(surface, u, near, count):
    """Number of neighbours of `u`; writes them and the number of their common faces with `u`. -1 = too many."""
    found = 0
    for k in range(surface.start[u], surface.start[u + 1]):
        for corner in range(3):
            v = surface.faces[surface.ring[k], corner]
            if v == u:
                continue
            place = 0
            while place < found and near[place] != v:
                place += 1
            if place == found:
                if found == _MAX_RING:
                    return -1
                near[place] = v
                count[place] = 0
                found += 1
            count[place] += 1
    return found


@njit(cache=True, nogil=True, inline="always")
def _num_common(surface, v, near, found, seen):
    """Number of neighbours of `v` among the first `found` of `near`."""
    seen[:found] = False
    common = 0
    for k in range(surface.start[v], surface.start[v + 1]):
        for corner in range(3):
            w = surface.faces[surface.ring[k], corner]
            if w != v:
                for place in range(found):
                    if near[place] == w:
                        common += not seen[place]
                        seen[place] = True
                        break
    return common


@njit(cache=True, nogil=True, inline="always")
def _shift(surface, u, v, is_loose, plane, value):
    """Weighted mean squared shift (m2) of the look of the faces around `u` after its move to `v`; inf = not allowed."""
    points, faces = surface.points, surface.faces
    total, total_area = 0.0, 0.0
    p = points[v]
    for k in range(surface.start[u], surface.start[u + 1]):
        f = surface.ring[k]
        if has(faces, f, v):
            continue
        i = corner_of(faces, f, u)
        b, c = points[faces[f, (i + 1) % 3]], points[faces[f, (i + 2) % 3]]
        if not _keeps_shape(points[u], p, b, c):
            return np.inf
        if value_at(surface, f, u, v, value):
            area = plane_at(surface, f, i, p, plane)
            for channel in range(len(value)):
                scale = surface.scale[f] if channel < 3 else _LIGHT_METRES / 255
                total += ((plane[channel] - value[channel]) * scale) ** 2 * area
            total_area += area
        elif not is_loose:
            return np.inf
    return _SHIFT_WEIGHT * total / max(total_area, NO_AREA)


@njit(cache=True, nogil=True, inline="always")
def _keeps_shape(a, p, b, c):
    """Whether a face may have its corner `p` instead of `a`: it must not turn over nor become a sliver."""
    ox, oy, oz = normal(a, b, c)
    nx, ny, nz = normal(p, b, c)
    old, new = math.sqrt(ox * ox + oy * oy + oz * oz), math.sqrt(nx * nx + ny * ny + nz * nz)
    if new < NO_AREA:
        return False
    if old > NO_AREA and ox * nx + oy * ny + oz * nz < _MIN_COS * old * new:
        return False
    new_thinness = new / max(squared(p, b), squared(b, c), squared(c, p))
    return new_thinness > _SLIVER or new_thinness >= old / max(squared(a, b), squared(b, c), squared(c, a))
