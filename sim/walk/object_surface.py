"""Finds the object at a point of a mesh, and spreads points over the surface of one object or inside a box."""

import numpy as np
from numpy.typing import NDArray

from sim.compiled import njit
from sim.mesh import FACE_IDS, TriangleMesh

from .navigation_map import Points

_PADDING = 0.05
"""An object's faces may begin this far outside its box, metres."""
_ON_BOX = 0.01
"""A place this far outside a box still belongs to it, metres: hits are not exact."""
_ROUNDS = (16, 1024)
"""Samples per wanted point where images hold the ids: the first round suits small faces, the second large ones."""
_GOLDEN = (0.7548776662466927, 0.5698402909980532)
"""Steps of the two-dimensional golden sequence: successive shares spread evenly over a triangle."""


def object_ids_at(mesh: TriangleMesh, face_ids: NDArray[np.integer], positions: Points) -> NDArray[np.int32]:
    """(N,) object of each place on a mesh, 0 = none.

    Args:
        mesh: The mesh; its `ids` are used where it has them, else `face_instance`.
        face_ids: (N,) face of each place, -1 = none.
        positions: (N, 3) world metres; unused where faces have one id each.
    """
    found = np.where(face_ids >= 0, mesh.face_instance[face_ids], 0).astype(np.int32)
    if mesh.ids is None:
        return found
    image_of = np.where(face_ids >= 0, mesh.ids.face_image[face_ids], FACE_IDS)
    for index, image in enumerate(mesh.ids.images):
        here = np.flatnonzero(image_of == index)
        weights = _weights(mesh.vertices[mesh.faces[face_ids[here]]].astype(np.float64), positions[here])
        uv = (weights[:, :, None] * mesh.ids.face_uv[face_ids[here]]).sum(axis=1)
        height, width = image.shape
        col, row = (((uv - np.floor(uv)) * (width, height)).astype(np.int64) % (width, height)).T
        found[here] = image[row, col]
    return found


def object_surface(
    mesh: TriangleMesh,
    instance_id: int,
    *,
    centre: tuple[float, float, float],
    size: tuple[float, float, float],
    count: int,
) -> Points:
    """Points (K, 3) spread over an object's faces by area, the same ones at every call.

    Args:
        mesh: World frame.
        instance_id: The object.
        centre: Centre of its box, metres; the box is used only where images hold the ids.
        size: Extents of its box along x, y, z.
        count: Wanted number of points. Fewer come back only where images give the object very little area.

    Returns:
        (0, 3) when the mesh has no face of this object.
    """
    if mesh.ids is None:
        return _spread(mesh, np.flatnonzero(mesh.face_instance == instance_id), count)[1]
    half = np.asarray(size) / 2 + _PADDING
    low, high = np.asarray(centre) - half, np.asarray(centre) + half
    by_face = mesh.ids.face_image == FACE_IDS
    may_hold = np.where(by_face, mesh.face_instance == instance_id, _overlap(mesh.vertices, mesh.faces, low, high))
    faces = np.flatnonzero(may_hold)
    points = np.empty((0, 3))
    for per_point in _ROUNDS:
        face_ids, places = _spread(mesh, faces, count * per_point)
        points = places[object_ids_at(mesh, face_ids, places) == instance_id]
        if len(points) >= count:
            return points[np.linspace(0, len(points) - 1, count).round().astype(np.int64)]
    return points


def surface_in_box(
    mesh: TriangleMesh, *, centre: tuple[float, float, float], size: tuple[float, float, float], count: int
) -> Points:
    """Points (K, 3) spread by area over the part of a mesh that lies in a box along the axes, the same at every call.

    Args:
        mesh: World frame.
        centre: Of the box, metres.
        size: Extents of the box along x, y, z.
        count: Wanted number of points; fewer come back only where the box holds very little area.

    Returns:
        (0, 3) when the box holds nothing of the mesh.
    """
    half = np.asarray(size) / 2
    faces = np.flatnonzero(_overlap(mesh.vertices, mesh.faces, np.asarray(centre) - half, np.asarray(centre) + half))
    points = np.empty((0, 3))
    for per_point in _ROUNDS:
        places = _spread(mesh, faces, count * per_point)[1]
        points = places[is_in_box(places, centre=centre, size=size)]
        if len(points) >= count:
            return points[np.linspace(0, len(points) - 1, count).round().astype(np.int64)]
    return points


def is_in_box(
    positions: Points, *, centre: tuple[float, float, float], size: tuple[float, float, float]
) -> NDArray[np.bool_]:
    """(N,) whether each place (N, 3) is in a box along the axes or on its sides; nan is not."""
    off = np.abs(positions - centre) - np.asarray(size) / 2
    return off.max(axis=1) <= _ON_BOX  # (N,)


def _spread(mesh: TriangleMesh, faces: NDArray[np.int64], count: int) -> tuple[NDArray[np.int64], Points]:
    """(count,) faces and (count, 3) places on them, evenly by area; none where the faces have no area."""
    corners = mesh.vertices[mesh.faces[faces]].astype(np.float64)
    sides = corners[:, 1:] - corners[:, :1]
    ends = np.cumsum(np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1))
    if not len(ends) or ends[-1] <= 0:
        return np.empty(0, np.int64), np.empty((0, 3))
    at = np.searchsorted(ends, (np.arange(count) + 0.5) / count * ends[-1], side="right").clip(max=len(ends) - 1)
    shares = (0.5 + np.arange(count)[:, None] * _GOLDEN) % 1.0
    shares = np.where(shares.sum(axis=1, keepdims=True) > 1, 1 - shares, shares)
    return faces[at], corners[at, 0] + (shares[:, :, None] * sides[at]).sum(axis=1)


def _weights(corners: NDArray[np.float64], positions: Points) -> NDArray[np.float64]:
    """(N, 3) weights of the corners (N, 3, 3) that give places (N, 3) in their planes, not outside the triangle."""
    one, two, to = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], positions - corners[:, 0]
    a, b, c = (one * one).sum(axis=1), (one * two).sum(axis=1), (two * two).sum(axis=1)
    d, e = (to * one).sum(axis=1), (to * two).sum(axis=1)
    area = np.maximum(a * c - b * b, 1e-30)
    weights = np.stack([np.ones(len(a)), (c * d - b * e) / area, (a * e - b * d) / area], axis=1)
    weights[:, 0] -= weights[:, 1] + weights[:, 2]
    weights = np.maximum(weights, 0)
    return weights / weights.sum(axis=1, keepdims=True)


@njit(cache=True, nogil=True)
def _overlap(vertices, faces, low, high):
    """(F,) whether the bounds of each face touch a box."""
    found = np.empty(len(faces), np.bool_)
    for face in range(len(faces)):
        touches = True
        for axis in range(3):
            a, b, c = vertices[faces[face, 0], axis], vertices[faces[face, 1], axis], vertices[faces[face, 2], axis]
            touches &= min(a, b, c) <= high[axis] and max(a, b, c) >= low[axis]
        found[face] = touches
    return found
