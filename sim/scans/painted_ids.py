"""Copies object ids that are painted on one mesh to another mesh of the same place. Used by hm3d.py."""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ..mesh import FACE_IDS, VERTEX_COLOURS, IdImages, TriangleMesh

TOLERANCE = 1e-3
"""Corners of two files within this count as the same (metres); exporters round differently."""
REACH = 0.2
"""A face that is missing in the painted mesh gets the id of the nearest painted place within this (metres)."""
_ROWS = 256
_PERMUTATION = np.array([1, 2, 4])


class PaintedMesh(NamedTuple):
    """A mesh with ids on it."""

    vertices: NDArray[np.float32]
    """(V, 3) world metres."""
    faces: NDArray[np.int32]
    """(F, 3) vertices."""
    face_id: NDArray[np.int32]
    """(F,) id of faces without image, 0 = none."""
    ids: IdImages

    def sampled(self, index: NDArray[np.integer], uv: NDArray[np.floating]) -> NDArray[np.int32]:
        """The ids (N, K) at texture coordinates (N, K, 2) of the faces `index` (N,)."""
        found = np.repeat(self.face_id[index][:, None], uv.shape[1], axis=1)
        of_face = self.ids.face_image[index]
        order = np.argsort(of_face, kind="stable")
        images, starts = np.unique(of_face[order], return_index=True)
        for image, rows in zip(images.tolist(), np.split(order, starts[1:]), strict=True):
            if image != FACE_IDS:
                texels = self.ids.images[image]
                size = np.array(texels.shape[::-1])
                at = np.floor(uv[rows] * size).astype(np.int64) % size
                found[rows] = texels[at[..., 1], at[..., 0]]
        return found

    def corner_ids(self) -> NDArray[np.int32]:
        """(F, 3) id at each corner of each face."""
        return self.sampled(np.arange(len(self.faces)), self.ids.face_uv)


def painted_mesh(mesh: TriangleMesh, id_of_rgb: NDArray[np.uint16]) -> PaintedMesh:
    """The ids given by a mesh's colours.

    Textures are read texel by texel; vertex colours give each face the id of at least two of its corners, else that of
    its first corner.

    Args:
        mesh: A mesh with one flat colour per object.
        id_of_rgb: (2^24,) ids by 0xRRGGBB; colours of no object are 0 there.
    """
    images = tuple(_ids(texture, id_of_rgb) for texture in mesh.textures)
    face_id = _ids(mesh.face_rgb[:, None], id_of_rgb)[:, 0].astype(np.int32)
    if mesh.vertex_rgb is not None:
        a, b, c = _ids(mesh.vertex_rgb[:, None], id_of_rgb)[:, 0][mesh.faces].T
        by_corners = np.where(b == c, b, a)
        face_id = np.where(mesh.face_texture == VERTEX_COLOURS, by_corners, face_id).astype(np.int32)
    face_image = np.where(mesh.face_texture < 0, FACE_IDS, mesh.face_texture).astype(np.int16)
    return PaintedMesh(mesh.vertices, mesh.faces, face_id, IdImages(images, face_image, mesh.face_uv))


def with_ids(mesh: TriangleMesh, painted: PaintedMesh) -> TriangleMesh:
    """The mesh with the ids of a painted mesh of the same place.

    Faces that are in both meshes, in any order, get the painted images. A face that is missing in the painted mesh gets
    one id: that of the painted place nearest to its centre, or 0 where none is within REACH.
    """
    index, corner = _same_faces(mesh, painted)
    found = index >= 0
    face_image = np.where(found, painted.ids.face_image[index], FACE_IDS).astype(np.int16)
    face_uv = np.zeros((len(mesh.faces), 3, 2), np.float32)
    face_uv[found] = np.take_along_axis(painted.ids.face_uv[index[found]], corner[found][..., None], axis=1)
    face_id = np.where(found, painted.face_id[index], 0).astype(np.int32)
    if not found.all():
        centres = mesh.vertices[mesh.faces[~found]].mean(axis=1)
        face_id[~found] = _nearest_ids(centres, painted)
    ids = None if (face_image == FACE_IDS).all() else IdImages(painted.ids.images, face_image, face_uv)
    return replace(mesh, face_instance=face_id, ids=ids)


def _ids(texels: NDArray[np.uint8], id_of_rgb: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """(h, w) ids of colours (h, w, 3)."""
    found = np.empty(texels.shape[:2], np.uint16)
    for row in range(0, len(texels), _ROWS):
        red, green, blue = np.moveaxis(texels[row : row + _ROWS], -1, 0).astype(np.uint32)
        found[row : row + _ROWS] = id_of_rgb[red << 16 | green << 8 | blue]
    return found


def _same_faces(mesh: TriangleMesh, painted: PaintedMesh) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """For each face of the mesh, the same face of the painted mesh (F,), -1 if none, and matching corners (F, 3)."""
    ours, theirs = mesh.vertices[mesh.faces], painted.vertices[painted.faces]
    corner = np.tile(np.arange(3), (len(ours), 1))
    if ours.shape == theirs.shape and np.abs(ours - theirs).max(initial=0) <= TOLERANCE:
        return np.arange(len(ours)), corner
    tree = KDTree(theirs.mean(axis=1, dtype=np.float64))
    distance, index = tree.query(ours.mean(axis=1, dtype=np.float64), distance_upper_bound=TOLERANCE, workers=-1)
    near = np.isfinite(distance)
    found = theirs[np.where(near, index, 0)]
    for k in range(3):
        apart = np.abs(ours[:, k, None] - found).max(axis=2)
        corner[:, k] = apart.argmin(axis=1)
        near &= apart.min(axis=1) <= TOLERANCE
    near &= _PERMUTATION[corner].sum(axis=1) == _PERMUTATION.sum()
    return np.where(near, index, -1), corner


def _nearest_ids(points: NDArray[np.float32], painted: PaintedMesh) -> NDArray[np.int32]:
    """(N,) ids at the painted places nearest to the points (N, 3)."""
    import open3d  # takes seconds to import, and is not needed when the files of a scan fit each other

    tensor: Any = open3d.core.Tensor
    surface = open3d.t.geometry.RaycastingScene()
    surface.add_triangles(tensor(painted.vertices), tensor(painted.faces.astype(np.uint32)))
    closest = surface.compute_closest_points(tensor(points))
    index = closest["primitive_ids"].numpy().astype(np.int64)
    second, third = closest["primitive_uvs"].numpy().T
    weights = np.stack([1 - second - third, second, third], axis=1)
    uv = (painted.ids.face_uv[index] * weights[..., None]).sum(axis=1)
    ids = painted.sampled(index, uv[:, None])[:, 0]
    return np.where(np.linalg.norm(closest["points"].numpy() - points, axis=1) <= REACH, ids, 0)
