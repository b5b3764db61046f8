"""A navigation mesh in a layout for compiled loops: corners stored with their polygon, walls and islands marked."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from .navmesh_file import MAX_CORNERS, NavMeshData

_WALKABLE = 1
"""The flag of polygons that Habitat uses."""
_MIN_AREA = 1e-5
"""Polygons with less 3-D area are disabled, as Habitat does (square metres)."""


class Polygons(NamedTuple):
    """The polygons of one tile; arrays are indexed by polygon. Positions are float32 world metres, as in Detour."""

    corner: NDArray[np.float32]
    """(P, 6, 3) corners in order; only the first `count` are used."""
    count: NDArray[np.int32]
    """(P,) corners, 3-6."""
    neighbour: NDArray[np.int32]
    """(P, 6) polygon across the edge from corner k to corner k + 1; -1 = wall (no polygon or a disabled one)."""
    island: NDArray[np.int32]
    """(P,) connected part, numbered in the order of the polygons; -1 = disabled."""
    low: NDArray[np.float32]
    """(P, 3) lowest corner of the polygon's box, detail vertices included."""
    high: NDArray[np.float32]
    """(P, 3) highest corner of the box."""
    first_triangle: NDArray[np.int32]
    """(P + 1,) index of each polygon's first detail triangle."""
    triangle: NDArray[np.float32]
    """(T, 3, 3) corners of detail triangles."""
    triangle_corner: NDArray[np.uint8]
    """(T, 3) index of each corner among the polygon's own corners and detail vertices."""
    on_border: NDArray[np.bool_]
    """(T, 3) whether the edge from corner k to corner k + 1 lies on the polygon's border."""
    tree_bounds: NDArray[np.uint16]
    """(B, 2, 3) boxes in tree units."""
    tree_index: NDArray[np.int32]
    """(B,) leaf: its polygon; otherwise minus the number of nodes to skip."""
    bounds: NDArray[np.float32]
    """(2, 3) lowest and highest corner of the tile."""
    origin: NDArray[np.float32]
    """(3,) origin of the tile grid."""
    tile_size: NDArray[np.float32]
    """(2,) extent along x and z."""
    climb: np.float32
    scale: np.float32


def polygons_from_data(data: NavMeshData) -> Polygons:
    """The mesh of a file, with disabled polygons turned into walls and islands numbered."""
    count = data.counts
    is_meant = np.arange(MAX_CORNERS) < count[:, None]
    corner = data.vertices[np.where(is_meant, data.corners, data.corners[:, :1])]
    first, triangle, index, flags = _detail_triangles(data, corner)
    owner = np.repeat(np.arange(len(count)), np.diff(first))
    areas = np.bincount(owner, _areas(triangle), minlength=len(count))
    usable = ((data.flags & _WALKABLE) != 0) & (areas >= _MIN_AREA)
    neighbour = np.where(is_meant & usable[:, None], data.neighbours, -1)
    neighbour = np.where((neighbour >= 0) & usable[neighbour], neighbour, -1).astype(np.int32)
    low = np.minimum(corner.min(axis=1), np.minimum.reduceat(triangle.min(axis=1), first[:-1]))
    high = np.maximum(corner.max(axis=1), np.maximum.reduceat(triangle.max(axis=1), first[:-1]))
    return Polygons(
        corner=corner,
        count=count,
        neighbour=neighbour,
        island=_islands(neighbour, usable),
        low=low,
        high=high,
        first_triangle=first,
        triangle=triangle,
        triangle_corner=index,
        on_border=(flags[:, None] >> np.array([0, 2, 4], np.uint8)) & 1 != 0,
        tree_bounds=data.tree_bounds,
        tree_index=data.tree_index,
        bounds=data.bounds,
        origin=data.origin.astype(np.float32),
        tile_size=data.tile_size.astype(np.float32),
        climb=np.float32(data.climb),
        scale=np.float32(data.scale),
    )


def triangle_areas(polygons: Polygons) -> NDArray[np.float64]:
    """(T,) 3-D area of each detail triangle in square metres, 0 where its polygon is disabled."""
    return np.where(polygons.island[owners(polygons)] >= 0, _areas(polygons.triangle), 0.0)


def owners(polygons: Polygons) -> NDArray[np.int64]:
    """(T,) polygon of each detail triangle."""
    return np.repeat(np.arange(len(polygons.count)), np.diff(polygons.first_triangle))


def island_radii(polygons: Polygons) -> NDArray[np.float64]:
    """(I,) radius of each island, metres: largest distance of its polygons' corners from their mean (as in Habitat).

    A corner counts once for each polygon that has it.
    """
    is_meant = (np.arange(MAX_CORNERS) < polygons.count[:, None]) & (polygons.island[:, None] >= 0)
    points = polygons.corner[is_meant].astype(np.float64)
    island = np.broadcast_to(polygons.island[:, None], is_meant.shape)[is_meant]
    sizes = np.bincount(island)
    middles = np.stack([np.bincount(island, points[:, k]) / sizes for k in range(3)], axis=1)
    radii = np.zeros(len(sizes))
    np.maximum.at(radii, island, np.linalg.norm(points - middles[island], axis=1))
    return radii


def _areas(triangle: NDArray[np.float32]) -> NDArray[np.float64]:
    """(T,) 3-D areas of triangles (T, 3, 3) in square metres."""
    corners = triangle.astype(np.float64)
    return np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2


def _detail_triangles(
    data: NavMeshData, corner: NDArray[np.float32]
) -> tuple[NDArray[np.int32], NDArray[np.float32], NDArray[np.uint8], NDArray[np.uint8]]:
    """(first (P + 1,), corners (T, 3, 3), their indices (T, 3), edge flags (T,)) in the order of the polygons."""
    first_vertex, start, _, amount = data.details.T
    first = np.concatenate([[0], np.cumsum(amount)])
    owner = np.repeat(np.arange(len(amount)), amount)
    rows = data.detail_triangles[np.arange(first[-1]) - first[owner] + start[owner]]
    index = rows[:, :3].astype(np.int64)
    own = data.counts[owner, None]
    is_own = index < own
    triangle = corner[owner[:, None], np.where(is_own, index, 0)]
    triangle[~is_own] = data.detail_vertices[(first_vertex[owner, None] + index - own)[~is_own]]
    return first.astype(np.int32), triangle, rows[:, :3].copy(), rows[:, 3].copy()


def _islands(neighbour: NDArray[np.int32], usable: NDArray[np.bool_]) -> NDArray[np.int32]:
    """(P,) connected part of each usable polygon, -1 elsewhere."""
    total = len(neighbour)
    polygon, side = np.nonzero(neighbour >= 0)
    pairs = coo_matrix((np.ones(len(polygon), bool), (polygon, neighbour[polygon, side])), shape=(total, total))
    part = connected_components(pairs, directed=False)[1]
    _, number = np.unique(part[usable], return_inverse=True)
    island = np.full(total, -1, np.int32)
    island[usable] = number
    return island
