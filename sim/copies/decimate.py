"""Reduces triangles without changing the look: vertices move onto neighbours while the surface stays in place.

Half-edge collapses ordered by quadric error (Garland and Heckbert 1997). No new vertex is made, so texture coordinates,
colours and baked light stay exact at the vertices, and texture seams only move along themselves.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..mesh import VERTEX_COLOURS, TriangleMesh
from ..scans.equal_rows import numbered
from .decimate_kernels import move, price_moves, quadrics
from .surface import Surface, rings

TOLERANCE = 0.003
"""Root mean squared distance from the old surface that a move may cause with any number of faces (metres)."""
_COLOUR_METRES = 0.1
"""A vertex colour that changes from black to white counts like a texture that shifts by this (metres)."""
_MIN_PROGRESS = 0.002
"""A round that removes a smaller share of the faces is the last one of its kind."""


def decimated(mesh: TriangleMesh, *, max_faces: int, tolerance: float = TOLERANCE) -> TriangleMesh:
    """A mesh with at most `max_faces` faces, and fewer where that changes nothing.

    Vertices at the same place are joined first, and of equal faces only the first is kept. Faces keep their texture,
    colour and instance id; ids finer than faces are dropped.

    Args:
        mesh: Any mesh; the same mesh gives the same result.
        max_faces: Largest number of faces. Where seams or loose pieces leave no other way, vertices first move across
            seams, then the smallest faces are dropped.
        tolerance: Largest error in metres, as TOLERANCE.
    """
    surface, origin = _surface_of(mesh)
    quadric = quadrics(surface)
    num_points = len(surface.points)
    price, target = np.full(num_points, np.inf), np.zeros(num_points, np.int32)
    is_stale, is_loose = np.ones(num_points, bool), False
    while True:
        price_moves(surface, quadric, is_stale, is_loose, price, target)
        excess = len(origin) - max_faces
        limit = _limit(price, excess, tolerance)
        order = np.flatnonzero(price <= limit)
        order = order[np.argsort(price[order], kind="stable")]
        is_touched, is_gone = np.zeros(num_points, bool), np.zeros(len(origin), bool)
        wanted = len(origin) if limit <= tolerance**2 else excess
        removed = move(surface, quadric, order, target, wanted, is_loose, is_touched, is_gone)
        surface, origin = _kept(surface, origin, ~is_gone)
        is_stale = is_touched | is_touched[target]
        if removed <= _MIN_PROGRESS * len(origin):
            if is_loose or excess <= removed:
                break
            is_loose, is_stale[:] = True, True
    if len(origin) > max_faces:
        keep = np.zeros(len(origin), bool)
        keep[np.argsort(-_areas(surface.points[surface.faces]), kind="stable")[:max_faces]] = True
        surface, origin = _kept(surface, origin, keep)
    return _mesh_of(surface, origin, mesh)


def _limit(price: NDArray[np.float64], excess: int, tolerance: float) -> float:
    """Highest price (m2) of this round: the tolerance, or the price of losing `excess` faces at two per move."""
    possible = price[np.isfinite(price)]
    if excess <= 0 or not len(possible):
        return tolerance**2
    wanted = min(excess // 2 + 1, len(possible)) - 1
    return max(tolerance**2, float(np.partition(possible, wanted)[wanted]))


def _surface_of(mesh: TriangleMesh) -> tuple[Surface, NDArray[np.int64]]:
    """The mesh with equal vertices joined, and the index of each of its faces in the original mesh."""
    vertices = mesh.vertices + np.float32(0)  # -0.0 becomes 0.0
    _, number = numbered(vertices.view(np.int32))
    faces = number[mesh.faces]
    once, _ = numbered(np.sort(faces, axis=1))
    a, b, c = faces[once].T
    origin = once[(a != b) & (b != c) & (c != a)]
    points = np.empty((number.max(initial=-1) + 1, 3))
    points[number] = vertices
    texture, faces = mesh.face_texture[origin], np.ascontiguousarray(faces[origin])
    packed = (mesh.face_rgb[origin].astype(np.int32) << np.array([16, 8, 0], np.int32)).sum(axis=1, dtype=np.int32)
    look = np.where(texture >= 0, texture, np.where(texture == VERTEX_COLOURS, -1, -2 - packed)).astype(np.int32)
    rgb = None if mesh.vertex_rgb is None else mesh.vertex_rgb[mesh.faces[origin]]
    is_lit = rgb is not None and bool((rgb[look >= 0] != 255).any())
    shown = np.zeros((len(origin), 3, 6 if is_lit else 3), np.float32)
    shown[..., :2] = np.where((texture >= 0)[:, None, None], mesh.face_uv[origin], 0)
    scale = np.zeros(len(origin), np.float32)
    if rgb is not None:
        shown[look == -1, :, :3] = rgb[look == -1]
        scale[look == -1] = _COLOUR_METRES / 255
        if is_lit:
            shown[look >= 0, :, 3:] = rgb[look >= 0]
    area_uv = _areas(shown[..., :3])
    scaled = (look >= 0) & (area_uv > 0)
    scale[scaled] = np.sqrt(_areas(points[faces[scaled]]) / area_uv[scaled])
    return Surface(points, faces, look, shown, scale, *rings(faces, len(points))), origin


def _kept(surface: Surface, origin: NDArray[np.int64], keep: NDArray[np.bool_]) -> tuple[Surface, NDArray[np.int64]]:
    """The faces where `keep` (F,) is True."""
    faces = surface.faces[keep]
    rest = Surface(
        surface.points,
        faces,
        surface.look[keep],
        surface.shown[keep],
        surface.scale[keep],
        *rings(faces, len(surface.points)),
    )
    return rest, origin[keep]


def _mesh_of(surface: Surface, origin: NDArray[np.int64], mesh: TriangleMesh) -> TriangleMesh:
    """The surface as a mesh; faces share vertices of equal place and vertex colour; white leaves textures unchanged."""
    is_lit = surface.shown.shape[2] > 3
    rgb = np.full((len(origin), 3, 3), 255, np.int32)
    rgb[surface.look == -1] = np.rint(surface.shown[surface.look == -1, :, :3])
    if is_lit:
        rgb[surface.look >= 0] = np.rint(surface.shown[surface.look >= 0, :, 3:])
    packed = (rgb << np.array([16, 8, 0], np.int32)).sum(axis=2, dtype=np.int32)
    first, number = numbered(np.stack([surface.faces.reshape(-1), packed.reshape(-1)], axis=1))
    return replace(
        mesh,
        vertices=surface.points[surface.faces.reshape(-1)[first]].astype(np.float32),
        faces=number.reshape(-1, 3),
        face_rgb=mesh.face_rgb[origin],
        face_instance=mesh.face_instance[origin],
        face_texture=mesh.face_texture[origin],
        face_uv=np.where((surface.look >= 0)[:, None, None], surface.shown[..., :2], 0).astype(np.float32),
        vertex_rgb=None if mesh.vertex_rgb is None else rgb.reshape(-1, 3)[first].astype(np.uint8),
        ids=None,
    )


def _areas(corners: NDArray[np.floating]) -> NDArray[np.float64]:
    """(N,) areas of triangles (N, 3, 3)."""
    a, b, c = np.moveaxis(corners.astype(float), 1, 0)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
