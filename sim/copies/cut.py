"""One storey of a scene without its ceiling: browsers and recordings show it, and clicks are intersected with it.

Triangles are clipped exactly at two level planes. `storey_cut` finds the planes' heights from the storey's floor and
ceiling, so that no walkable part stays covered.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from sim.errors import SceneError
from sim.types import CUT_HEIGHT, STOREY_GAP
from sim.walk.height_field import ceilings
from sim.walk.navigation_map import NavigationMap

from ..mesh import Scene, TriangleMesh

CUT_BELOW = 0.4
"""Storeys begin this far below their lowest floor (metres), to keep it and the first steps of a stair down."""
CUT_RANGE = (1.6, 2.2)
"""Lowest and highest cut above the floor (metres): above eye height and furniture, near the tops of doors."""
UNDER_CEILING = 0.15
"""Distance of the cut below the ceiling (metres); ceilings of scans are not level."""
_MIN_CLEARANCE = 1.5
"""Faces less than this above the floor are not a ceiling: table tops, the underside of a stair (metres)."""
_MIN_AREA = 1.0
"""Smaller floors are steps of a stair, smaller ceilings are lamps and door heads (m2)."""
_MIN_COVERED = 0.1
"""A storey with ceilings over less than this share of its floor counts as one without ceiling."""
_OVER_FLOOR = 0.3
"""At least this much stays visible above every floor of the storey (metres)."""
_CELL = 0.1
"""Side of the cells in which floors and ceilings are counted (metres)."""
_LEVEL = 0.1
"""Height of the bins in which floors and ceilings are counted (metres)."""
_LEVEL_SHARE = 0.05
"""This share of a level may be lower than the level's height: a step, a beam."""


class StoreyCut(NamedTuple):
    """The heights between which a storey is shown, world metres."""

    bottom_y: float
    top_y: float


def storey_mesh(scene: Scene, floor_y: float) -> TriangleMesh:
    """The storey of a scene with this storey height (metres), cut, at full resolution.

    Raises:
        SceneError: No face of the scene is on that storey.
    """
    heights = storey_cut(scene, floor_y)
    mesh = cut_storey(scene.mesh, bottom_y=heights.bottom_y, top_y=heights.top_y)
    if not len(mesh.faces):
        known = ", ".join(f"{height:.2f}" for height in scene.navigation.storey_heights)
        raise SceneError(
            f"{scene.label}: found no face on a storey at {floor_y!r} m; expected a height near one of [{known}]. "
            "Take one of the scene's storey heights."
        )
    return mesh


def storey_cut(scene: Scene, floor_y: float) -> StoreyCut:
    """The heights at which the storey of this height (metres) is cut: under its lowest ceiling, over all of its floors.

    Ceilings are searched over the walkable places of the storey. A ceiling or floor needs 1 m2 at one height to count:
    a split level, a platform and a slope do, while a stair's steps, lamps and door heads do not. Without any walkable
    place or ceiling the cuts are CUT_HEIGHT above and CUT_BELOW below the floor.
    """
    x, y, z = _floor_cells(scene.navigation, floor_y)
    if not len(y):
        return StoreyCut(floor_y - CUT_BELOW, floor_y + CUT_HEIGHT)
    floors = _levels(x, y, z)
    lowest, highest = min([floor_y, *floors]), max([floor_y, *floors])
    ceiling = ceilings(scene.mesh.vertices, scene.mesh.faces, x, y, z, _CELL, _MIN_CLEARANCE)
    covered = np.isfinite(ceiling)
    top = floor_y + CUT_HEIGHT
    highest_top = floor_y + (CUT_RANGE[1] if scene.kind == "scan" else CUT_HEIGHT)
    if covered.mean() >= _MIN_COVERED:
        # the cut is at least at eye height over every floor, even under hanging things
        under = np.maximum(ceiling - UNDER_CEILING, y + CUT_RANGE[0])[covered]
        top = min([*_levels(x[covered], under, z[covered]), highest_top])
    return StoreyCut(lowest - CUT_BELOW, max(top, highest + _OVER_FLOOR))


def cut_storey(mesh: TriangleMesh, *, bottom_y: float, top_y: float) -> TriangleMesh:
    """The part of a mesh between two heights; triangles are clipped there, with their textures, colours and ids.

    It has no unused vertices, and may have no faces. Neighbours that shared an edge share its new vertex.
    """
    top, bottom = np.float32(top_y), np.float32(bottom_y)
    y = mesh.vertices[mesh.faces, 1]
    near = mesh.select((y.min(axis=1) <= top) & (y.max(axis=1) >= bottom))
    return _compact(_clipped(_clipped(near, top, side=1), bottom, side=-1))


def _floor_cells(navigation: NavigationMap, floor_y: float) -> tuple[NDArray, NDArray, NDArray]:
    """x, y, z of the storey's walkable places, at most one per cell of _CELL and level of _LEVEL; each (N,)."""
    grid = navigation.top_down(floor_y).grid
    rows, cols = grid.shape
    half = np.array([cols, rows]) * grid.cell / 2
    middle = np.array([grid.origin_xz[0] + half[0], floor_y, grid.origin_xz[1] + half[1]])
    points = navigation.points_within(middle[None], float(np.hypot(*half)) + grid.cell, max_dy=STOREY_GAP)
    if not len(points):
        return np.empty(0), np.empty(0), np.empty(0)
    cells = np.floor(points / [_CELL, _LEVEL, _CELL] + 1e-6).astype(np.int64)
    _, first = np.unique(cells, axis=0, return_index=True)
    return points[first, 0], points[first, 1], points[first, 2]


def _levels(x: NDArray[np.float64], y: NDArray[np.float64], z: NDArray[np.float64]) -> list[float]:
    """Height of each group of at least _MIN_AREA: adjoining places within one bin of _LEVEL and the next."""
    bins, col, row = (
        np.floor(value / size + 1e-6).astype(np.int64) for value, size in ((y, _LEVEL), (x, _CELL), (z, _CELL))
    )
    col, row = col - col.min(), row - row.min()
    found = []
    for level in np.unique(bins):
        here = np.flatnonzero((bins == level) | (bins == level + 1))
        if len(here) * _CELL**2 < _MIN_AREA:
            continue
        image = np.zeros((row.max() + 1, col.max() + 1), bool)
        image[row[here], col[here]] = True
        groups: NDArray[np.int32] = ndimage.label(image)[0]  # type: ignore
        areas = np.bincount(groups.ravel())[1:] * _CELL**2
        if areas.max() >= _MIN_AREA:
            large = areas[groups[row[here], col[here]] - 1] >= _MIN_AREA
            found.append(float(np.quantile(y[here][large], _LEVEL_SHARE)))
    return found


class _Pieces(NamedTuple):
    """The parts of faces that a cutting plane leaves; each corner lies between two corners of its old face."""

    rows: NDArray[np.int64]
    """(P,) the old faces."""
    kept: NDArray[np.int64]
    """(P, 3) the old corner (0-2) that is not cut off."""
    lost: NDArray[np.int64]
    """(P, 3) the old corner at the other end of the edge; equal to `kept` where the corner is an old one."""
    share: NDArray[np.float64]
    """(P, 3) share of the way from `kept` to `lost` at which the corner lies, 0-1."""

    def behind(self, whole: NDArray[np.bool_], values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Values (F, 3, K) of corners of the old faces: of the `whole` (F,) ones, and at the pieces' corners."""
        at_kept, at_lost = (
            np.take_along_axis(values[self.rows], corner[..., None], axis=1) for corner in (self.kept, self.lost)
        )
        between = (at_kept + self.share[..., None] * (at_lost - at_kept)).astype(np.float32)
        return np.concatenate([values[whole], between])


def _clipped(mesh: TriangleMesh, height: np.float32, *, side: int) -> TriangleMesh:
    """The part of a mesh below (`side` 1) or above (-1) a height."""
    over = (mesh.vertices[:, 1] - height) * np.float32(side)
    whole = np.asarray((over[mesh.faces] <= 0).all(axis=1))
    pieces = _pieces(over[mesh.faces])
    faces = mesh.faces[pieces.rows]
    a = np.take_along_axis(faces, pieces.kept, axis=1)
    b = np.take_along_axis(faces, pieces.lost, axis=1)
    is_new = pieces.share > 0
    edges, first, number = np.unique(
        a[is_new].astype(np.int64) << 32 | b[is_new], return_index=True, return_inverse=True
    )
    a[is_new] = number.reshape(-1) + len(mesh.vertices)
    ends, share = (edges >> 32, edges & 0xFFFFFFFF), pieces.share[is_new][first]
    points = _mixed(mesh.vertices, *ends, share).astype(np.float32)
    points[:, 1] = height
    rgb = mesh.vertex_rgb
    if rgb is not None:
        rgb = np.concatenate([rgb, np.rint(_mixed(rgb, *ends, share)).astype(np.uint8)])
    cut = mesh.select(np.concatenate([np.flatnonzero(whole), pieces.rows]))
    if mesh.ids and cut.ids:
        cut = replace(cut, ids=replace(cut.ids, face_uv=pieces.behind(whole, mesh.ids.face_uv)))
    cut = replace(
        cut,
        vertices=np.concatenate([mesh.vertices, points]),
        faces=np.concatenate([mesh.faces[whole], a]),
        face_uv=pieces.behind(whole, mesh.face_uv),
        vertex_rgb=rgb,
    )
    a, b, c = cut.faces.T
    return cut.select((a != b) & (b != c) & (c != a))


def _pieces(over: NDArray[np.float32]) -> _Pieces:
    """The pieces of faces whose corners are `over` (F, 3) metres beyond the plane; one or two for each face cut."""
    inside = over <= 0
    count = inside.sum(axis=1)
    tips, stumps = np.flatnonzero(count == 1), np.flatnonzero(count == 2)
    # corners rotated so that the single corner on its side comes first
    tip = (inside[tips].argmax(axis=1)[:, None] + np.arange(3)) % 3
    stump = (inside[stumps].argmin(axis=1)[:, None] + np.arange(3)) % 3
    rows = np.concatenate([tips, stumps, stumps])
    kept = np.concatenate([tip[:, [0, 0, 0]], stump[:, [1, 1, 2]], stump[:, [1, 2, 2]]])
    lost = np.concatenate([tip, stump[:, [0, 1, 2]], stump[:, [0, 2, 0]]])
    at_kept = np.take_along_axis(over[rows], kept, axis=1).astype(float)
    at_lost = np.take_along_axis(over[rows], lost, axis=1).astype(float)
    # from inside to outside on every edge, so that all faces at an edge find the same point
    share = np.where(kept == lost, 0.0, at_kept / np.where(kept == lost, 1.0, at_kept - at_lost))
    return _Pieces(rows, kept, lost, share)


def _mixed(values: NDArray, a: NDArray[np.int64], b: NDArray[np.int64], share: NDArray[np.float64]) -> NDArray:
    """Values (N, K) of vertices `a` moved by `share` towards those of `b`."""
    start, end = values[a].astype(float), values[b].astype(float)
    return start + share[:, None] * (end - start)


def _compact(mesh: TriangleMesh) -> TriangleMesh:
    """The mesh without the vertices that no face uses."""
    used = np.zeros(len(mesh.vertices), bool)
    used[mesh.faces] = True
    number = np.cumsum(used, dtype=np.int32) - 1
    rgb = None if mesh.vertex_rgb is None else mesh.vertex_rgb[used]
    return replace(mesh, vertices=mesh.vertices[used], faces=number[mesh.faces].astype(np.int32), vertex_rgb=rgb)
