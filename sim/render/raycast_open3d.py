"""Finds first hits with Open3D's ray casting, for machines on which Embree's packets cannot be used."""

import numpy as np
import open3d as o3d
from numpy.typing import NDArray

from sim.compiled import njit

from .embree import new_packet
from .raycast_kernels import TILES, Picture, Rows, Sampling, View, colour_rows, direction
from .texels import Surfaces, lanes_dtype

WIDTH = 16
"""Pixels that are coloured together."""


class Open3dTracer:
    """Finds first hits one ray at a time; pictures equal those of Embree's packets except for ties between faces."""

    tile_rows = TILES[WIDTH][1]

    def __init__(self, vertices: NDArray[np.float32], faces: NDArray[np.int32]) -> None:
        """Builds the search tree (about 1 s for a million faces)."""
        self._mesh = vertices, faces
        self._scene = o3d.t.geometry.RaycastingScene()
        self._scene.add_triangles(_tensor(vertices, np.float32), _tensor(faces, np.uint32))
        # The first cast commits the tree, which is not safe from two threads.
        self._scene.cast_rays(_tensor(np.array([[0, 0, 0, 0, 1, 0]]), np.float32))

    def render(self, view: View, surfaces: Surfaces, sampling: Sampling, rows: Rows, picture: Picture) -> None:
        """As `raycast_kernels.render_rows`."""
        found = self._hits(view, rows, picture[1])
        work = new_packet(WIDTH), np.zeros(1, lanes_dtype(WIDTH))
        hits = tuple(found[name].numpy() for name in ("t_hit", "primitive_ids", "primitive_uvs"))
        colour_rows(hits, self._mesh, *work, view, surfaces, sampling, rows, picture)

    def depth(self, view: View, rows: Rows, depth: NDArray[np.float32]) -> None:
        """As `raycast_kernels.depth_rows`."""
        range_m = self._hits(view, rows, depth)["t_hit"].numpy()
        first = rows[0] * self.tile_rows
        depth[first : first + len(range_m)] = np.where(np.isfinite(range_m), range_m, 0)

    def cast(self, rays: NDArray[np.float32]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Range (N,) in lengths of the directions, inf for misses, and face (N,), -1 for misses, of rays (N, 6)."""
        is_ray = np.all(np.isfinite(rays), axis=1) & np.any(rays[:, 3:], axis=1)
        found = self._scene.cast_rays(_tensor(np.where(is_ray[:, None], rays, 0), np.float32), nthreads=1)
        range_m = np.where(is_ray, found["t_hit"].numpy(), np.inf).astype(np.float64)
        return range_m, np.where(np.isfinite(range_m), found["primitive_ids"].numpy().astype(np.int64), -1)

    def _hits(self, view: View, rows: Rows, depth: NDArray[np.float32]) -> dict[str, o3d.core.Tensor]:
        """Open3D's answer for the pixels of these rows of tiles; the calling thread alone works on it."""
        first, last = rows[0] * self.tile_rows, min(rows[1] * self.tile_rows, depth.shape[0])
        return self._scene.cast_rays(_tensor(_pixel_rays(view, first, last, depth.shape[1]), np.float32), nthreads=1)


@njit(cache=True, nogil=True, error_model="numpy")
def _pixel_rays(view, first, last, width):
    """(last - first, width, 6) origins and directions of the rays through these rows of pixels, as `render_rows`'s."""
    rays = np.empty((last - first, width, 6), np.float32)
    for row in range(last - first):
        for col in range(width):
            for k in range(3):
                rays[row, col, k] = view[k][3]
                rays[row, col, 3 + k] = direction(view[k], float(col), float(first + row))
    return rays


def _tensor(array: NDArray, dtype: type) -> o3d.core.Tensor:
    """Open3D's view of an array; its stubs do not know that it takes numpy arrays."""
    return o3d.core.Tensor(np.ascontiguousarray(array, dtype))  # pyright: ignore[reportCallIssue]
