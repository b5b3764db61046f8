"""Renders views of a mesh on the processor: Open3D finds the first hits, a compiled loop colours them."""

from functools import lru_cache

import numpy as np
import open3d as o3d
from numba import njit
from numpy.typing import NDArray

from sim.errors import SceneError
from sim.scenes.scene import TriangleMesh
from sim.types import Camera

from .renderer import Frame, Hits

SKY_RGB = (214, 226, 238)
"""Colour of pixels that see nothing (windows, gaps of a scan)."""
_MISS = o3d.t.geometry.RaycastingScene.INVALID_ID


class Raycaster:
    """Implements `Renderer` for one mesh: unlit colours, no near or far plane, both sides of faces visible.

    Immutable after construction; `render` and `cast` may be called from several threads at once.
    """

    def __init__(self, mesh: TriangleMesh) -> None:
        """Builds the search tree (about 1 s for a million faces).

        Raises:
            SceneError: The mesh has no faces.
        """
        if not len(mesh.faces):
            raise SceneError("renderer: found a mesh without faces; expected at least one. Check the scene's file.")
        self._scene = o3d.t.geometry.RaycastingScene()
        self._scene.add_triangles(_tensor(mesh.vertices, np.float32), _tensor(mesh.faces, np.uint32))
        self._faces = (
            np.ascontiguousarray(mesh.face_rgb),
            np.ascontiguousarray(mesh.face_instance),
            np.ascontiguousarray(mesh.face_texture),
            np.ascontiguousarray(mesh.face_uv),
        )
        sizes = np.array([texture.shape[:2] for texture in mesh.textures], np.int64).reshape(-1, 2)
        starts = np.concatenate([[0], np.cumsum(sizes[:, 0] * sizes[:, 1])])[:-1]
        self._layout = np.column_stack([starts, sizes]).astype(np.int64)  # (textures, 3): first texel, height, width
        self._texels = np.concatenate([np.empty((0, 3), np.uint8), *(t.reshape(-1, 3) for t in mesh.textures)])
        # The first cast commits the tree, which is not safe from two threads.
        self._scene.cast_rays(_tensor(np.array([[0, 0, 0, 0, 1, 0]]), np.float32))

    def render(self, T_world_camera: NDArray[np.float64], camera: Camera) -> Frame:
        """RGB, planar depth and instance ids seen by a camera at (4, 4); OpenCV axes.

        Pixels that see nothing have depth 0, instance 0 and the colour SKY_RGB.
        """
        rays = np.empty((camera.height, camera.width, 6), np.float32)
        rays[..., :3] = T_world_camera[:3, 3]
        np.matmul(_pixel_directions(camera), T_world_camera[:3, :3].T.astype(np.float32), out=rays[..., 3:])
        found = self._scene.cast_rays(_tensor(rays, np.float32))
        depth_m = np.ascontiguousarray(found["t_hit"].numpy())
        rgb, instance_ids = _shade(
            found["primitive_ids"].numpy().reshape(-1),
            found["primitive_uvs"].numpy().reshape(-1, 2),
            *self._faces,
            self._texels,
            self._layout,
        )
        shape = (camera.height, camera.width)
        depth_m[~np.isfinite(depth_m)] = 0.0
        return Frame(rgb.reshape(*shape, 3), depth_m, instance_ids.reshape(shape))

    def cast(self, origins: NDArray[np.float64], directions: NDArray[np.float64]) -> Hits:
        """First hits of rays; both (N, 3), directions need not be unit length (a zero direction hits nothing)."""
        origins = np.asarray(origins, float).reshape(-1, 3)
        directions = np.asarray(directions, float).reshape(-1, 3)
        lengths = np.linalg.norm(directions, axis=1, keepdims=True)
        unit = directions / np.where(lengths > 0, lengths, 1.0)
        found = self._scene.cast_rays(_tensor(np.concatenate([origins, unit], axis=1), np.float32))
        range_m = found["t_hit"].numpy().astype(np.float64)
        face_ids = found["primitive_ids"].numpy().astype(np.int64)
        hit = np.isfinite(range_m) & (lengths[:, 0] > 0)
        positions = origins + np.where(hit, range_m, np.nan)[:, None] * unit
        return Hits(np.where(hit, range_m, np.inf), positions, np.where(hit, face_ids, -1))


def _tensor(array: NDArray, dtype: type) -> o3d.core.Tensor:
    """Open3D's view of an array; its stubs do not know that it takes numpy arrays."""
    return o3d.core.Tensor(np.ascontiguousarray(array, dtype))  # pyright: ignore[reportCallIssue]


@lru_cache(maxsize=8)
def _pixel_directions(camera: Camera) -> NDArray[np.float32]:
    """(H, W, 3) directions through the pixel centres in camera axes; forward component 1 makes hits planar depths."""
    directions = np.ones((camera.height, camera.width, 3), np.float32)
    directions[..., 0] = (np.arange(camera.width) + 0.5 - camera.width / 2) / camera.focal
    directions[..., 1] = ((np.arange(camera.height) + 0.5 - camera.height / 2) / camera.focal)[:, None]
    directions.flags.writeable = False
    return directions


@njit(cache=True, nogil=True, error_model="numpy")
def _shade(face_ids, weights, face_rgb, face_instance, face_texture, face_uv, texels, layout):
    """Colour (N, 3) and instance (N,) of hits: bilinear texture that repeats, or the face's flat colour."""
    rgb = np.empty((len(face_ids), 3), np.uint8)
    instances = np.zeros(len(face_ids), np.int32)
    for i in range(len(face_ids)):
        face = face_ids[i]
        if face == _MISS:
            for k in range(3):
                rgb[i, k] = SKY_RGB[k]
            continue
        instances[i] = face_instance[face]
        texture = face_texture[face]
        if texture < 0:
            for k in range(3):
                rgb[i, k] = face_rgb[face, k]
            continue
        start, height, width = layout[texture, 0], layout[texture, 1], layout[texture, 2]
        b, c = weights[i, 0], weights[i, 1]
        a = 1 - b - c
        u = a * face_uv[face, 0, 0] + b * face_uv[face, 1, 0] + c * face_uv[face, 2, 0]
        v = a * face_uv[face, 0, 1] + b * face_uv[face, 1, 1] + c * face_uv[face, 2, 1]
        x, y = (u - np.floor(u)) * width - 0.5, (v - np.floor(v)) * height - 0.5
        x0, y0 = int(np.floor(x)), int(np.floor(y))
        x_share, y_share = x - x0, y - y0
        left, right = x0 % width, (x0 + 1) % width
        top, bottom = start + (y0 % height) * width, start + ((y0 + 1) % height) * width
        for k in range(3):
            upper = texels[top + left, k] * (1 - x_share) + texels[top + right, k] * x_share
            lower = texels[bottom + left, k] * (1 - x_share) + texels[bottom + right, k] * x_share
            rgb[i, k] = int(upper * (1 - y_share) + lower * y_share + 0.5)
    return rgb, instances
