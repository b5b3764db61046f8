"""Renders views of a mesh on the processor: RGB, planar depth and object ids in one pass over packets of rays.

`Raycaster` is the interface. embree.py finds hits (raycast_open3d.py where it cannot); texels.py and
raycast_kernels.py give their colours and ids.
"""

import itertools
import multiprocessing
import os
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from sim.errors import MissingDependencyError, SceneError
from sim.mesh import TriangleMesh
from sim.types import Camera, Frame

from . import embree
from .raycast_kernels import SKY_RGB as SKY_RGB
from .raycast_kernels import (
    TILES,
    Picture,
    Rows,
    Sampling,
    View,
    cast_rays,
    depth_rows,
    refine_ranges,
    render_rows,
)
from .renderer import Backend, Hits
from .texels import FILTERS, Surfaces, TextureFilter, lanes_dtype, surfaces_of_mesh

_Over = Callable[[list[Rows], Callable[[Rows], None]], None]
_PIXELS_PER_TASK = 16_384
"""Fewer pixels than this are not worth a thread of their own (about 0.5 ms)."""
_RAYS_PER_TASK = 4_096


class _Tracer(Protocol):
    """A library that finds hits; all arguments are the kernels'."""

    tile_rows: int

    def render(self, view: View, surfaces: Surfaces, sampling: Sampling, rows: Rows, picture: Picture) -> None: ...
    def depth(self, view: View, rows: Rows, depth: NDArray[np.float32]) -> None: ...
    def cast(self, rays: NDArray[np.float32]) -> tuple[NDArray[np.float64], NDArray[np.int64]]: ...


class Raycaster:
    """Implements `Renderer` for one mesh: unlit colours, no near or far plane, both sides of faces visible.

    Immutable after construction; all methods may be called from several threads at once. The same pose gives the same
    bytes with any number of threads, on processors with the same instruction set. A forked child process may keep using
    it, but spawning is better, as in sim/tasks/workers.py.
    """

    backend: Backend
    """The library that finds the hits, and why it was chosen."""

    def __init__(
        self,
        mesh: TriangleMesh,
        *,
        texture_filter: TextureFilter = "bilinear",
        threads: int | None = None,
        backend: Literal["auto", "embree", "open3d"] = "auto",
    ) -> None:
        """Builds the search tree (0.2 s for a million faces with Embree, 1 s with Open3D).

        Args:
            mesh: The mesh to render; its textures are not copied and must not be changed.
            texture_filter: `nearest` texel; `bilinear`, as Habitat; `mipmap`, bilinear in the level whose texels are
                nearest to a pixel in size, which does not shimmer but needs a third more memory.
            threads: Number of threads that work on one call; None = the cores that this process may use, or 1 in a
                child made by `multiprocessing`, which shares them with its siblings.
            backend: `auto` is Embree if it passes its self-test, otherwise Open3D and a warning.

        Raises:
            SceneError: The mesh has no faces, or an array is damaged.
            MissingDependencyError: `embree` was asked for and cannot be used, or Open3D cannot be loaded.
        """
        self._surfaces, self._images = surfaces_of_mesh(mesh, texture_filter=texture_filter)
        self._mesh = np.ascontiguousarray(mesh.vertices, np.float32), np.ascontiguousarray(mesh.faces, np.int32)
        self._filter = FILTERS[texture_filter]
        self._workers = _Workers(_default_threads() if threads is None else max(1, threads))
        self.backend = chosen_backend() if backend == "auto" else _asked_backend(backend)
        self._tracer: _Tracer
        if self.backend.name == "embree":
            self._tracer = _EmbreeTracer(*self._mesh, width=self.backend.packet_width)
        else:
            try:
                from .raycast_open3d import Open3dTracer  # takes 2 s to load, and most machines do not need it
            except (ImportError, OSError) as error:
                raise MissingDependencyError(
                    f"open3d: cannot be loaded ({error}); expected its system libraries. "
                    "Install them: apt-get install -y libgl1 libegl1 libx11-6 libusb-1.0-0 libudev1 libgomp1"
                ) from None
            self._tracer = Open3dTracer(*self._mesh)

    def render(self, T_world_camera: NDArray[np.float64], camera: Camera) -> Frame:
        """RGB, planar depth and instance ids seen by a camera at (4, 4); OpenCV axes.

        Pixels that see nothing have depth 0, instance 0 and the colour SKY_RGB.

        Raises:
            SceneError: The pose is not finite.
        """
        return self._rendered(T_world_camera, camera, self._workers.over)

    def render_batch(self, Ts_world_camera: NDArray[np.float64], camera: Camera) -> list[Frame]:
        """`render` of each of the poses (B, 4, 4), in order: one view per thread, or all threads on one view."""
        if len(Ts_world_camera) < 2 * self._workers.threads:
            return [self.render(T_world_camera, camera) for T_world_camera in Ts_world_camera]
        return self._workers.map(lambda T: self._rendered(T, camera, _here), list(Ts_world_camera))

    def depth(self, T_world_camera: NDArray[np.float64], camera: Camera) -> NDArray[np.float32]:
        """Only the depth of `render`, (H, W) planar metres, 0 where nothing was hit; takes half the time.

        Raises:
            SceneError: The pose is not finite.
        """
        view = _view(T_world_camera, camera)
        depth = np.empty((camera.height, camera.width), np.float32)
        self._workers.over(self._ranges(camera), lambda rows: self._tracer.depth(view, rows, depth))
        return depth

    def cast(self, origins: NDArray[np.float64], directions: NDArray[np.float64]) -> Hits:
        """First hits of rays; both (N, 3), directions need not be unit length.

        Rays with a zero direction, or with nan or inf, hit nothing. The face is found in single precision, the range to
        its plane is computed in double precision.
        """
        origins = np.ascontiguousarray(origins, np.float64).reshape(-1, 3)
        directions = np.asarray(directions, float).reshape(-1, 3)
        with np.errstate(invalid="ignore", over="ignore"):
            lengths = np.linalg.norm(directions, axis=1, keepdims=True)
            unit = directions / np.where(lengths > 0, lengths, 1.0)
            rays = np.concatenate([origins, unit], axis=1).astype(np.float32)
        count = max(1, min(self._workers.threads, len(rays) // _RAYS_PER_TASK))
        parts = self._workers.map(self._tracer.cast, np.array_split(rays, count))
        range_m, face_ids = (np.concatenate(column) for column in zip(*parts, strict=True))
        refine_ranges(origins, unit, *self._mesh, range_m, face_ids)
        positions = origins + np.where(face_ids >= 0, range_m, np.nan)[:, None] * unit
        return Hits(range_m, positions, face_ids)

    def _rendered(self, T_world_camera: NDArray[np.float64], camera: Camera, over: _Over) -> Frame:
        T_world_camera = np.array(T_world_camera, np.float64)
        fx, fy, *_ = camera.lens
        view, sampling = _view(T_world_camera, camera), (self._filter, fx * fy)
        shape = (camera.height, camera.width)
        rgb, depth_m, ids = np.empty((*shape, 3), np.uint8), np.empty(shape, np.float32), np.empty(shape, np.int32)
        render, surfaces = self._tracer.render, self._surfaces
        over(self._ranges(camera), lambda rows: render(view, surfaces, sampling, rows, (rgb, depth_m, ids)))
        return Frame(rgb, depth_m, T_world_camera, camera, ids)

    def _ranges(self, camera: Camera) -> list[Rows]:
        """Rows of tiles in small parts, so that threads that finish early can take more."""
        num_rows = -(-camera.height // self._tracer.tile_rows)
        most = min(num_rows, camera.width * camera.height // _PIXELS_PER_TASK)
        count = max(1, min(most, 3 * self._workers.threads)) if self._workers.threads > 1 else 1
        edges = [num_rows * part // count for part in range(count + 1)]
        return list(itertools.pairwise(edges))


def own_cores() -> int:
    """Processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _default_threads() -> int:
    return own_cores() if multiprocessing.parent_process() is None else 1


@lru_cache
def chosen_backend() -> Backend:
    """The library that raycasters of this process use, and why; warns once if it is not the fast one."""
    try:
        return embree.self_test()
    except MissingDependencyError as error:
        warnings.warn(
            f"Views are rendered by Open3D, 3-6 times slower than by Embree's packets: {error}",
            RuntimeWarning,
            stacklevel=3,
        )
        return Backend("open3d", 1, f"Embree's packets cannot be used: {error}")


def _asked_backend(name: Literal["embree", "open3d"]) -> Backend:
    return embree.self_test() if name == "embree" else Backend("open3d", 1, "It was asked for.")


class _EmbreeTracer:
    """Embree's scene with the values that the kernels need."""

    def __init__(self, vertices: NDArray[np.float32], faces: NDArray[np.int32], *, width: int) -> None:
        self.tile_rows = TILES[width][1]
        self._width = width
        self._scene = embree.EmbreeScene(vertices, faces)

    def render(self, view: View, surfaces: Surfaces, sampling: Sampling, rows: Rows, picture: Picture) -> None:
        packet, lanes = embree.new_packet(self._width), np.zeros(1, lanes_dtype(self._width))
        render_rows(self._scene.coherent, packet, lanes, view, surfaces, sampling, rows, picture)

    def depth(self, view: View, rows: Rows, depth: NDArray[np.float32]) -> None:
        depth_rows(self._scene.coherent, embree.new_packet(self._width), view, rows, depth)

    def cast(self, rays: NDArray[np.float32]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        range_m, face_ids = np.empty(len(rays)), np.empty(len(rays), np.int64)
        cast_rays(self._scene.incoherent, embree.new_packet(self._width), rays, range_m, face_ids)
        return range_m, face_ids


class _Workers:
    """Threads that are started when first needed, and anew in a forked child, which inherits none."""

    def __init__(self, threads: int) -> None:
        self.threads = threads
        self._pool: tuple[int, ThreadPoolExecutor] | None = None

    def map(self, function: Callable[[Any], Any], items: Sequence[Any]) -> list[Any]:
        """The function's results; must not be called from within one of these threads."""
        if self.threads == 1 or len(items) < 2:
            return [function(item) for item in items]
        pool = self._pool
        if pool is None or pool[0] != os.getpid():
            pool = self._pool = os.getpid(), ThreadPoolExecutor(self.threads, thread_name_prefix="raycast")
        return list(pool[1].map(function, items))

    def over(self, ranges: list[Rows], function: Callable[[Rows], None]) -> None:
        """Calls the function for each range."""
        self.map(function, ranges)


def _here(ranges: list[Rows], function: Callable[[Rows], None]) -> None:
    function((ranges[0][0], ranges[-1][1]))


def _view(T_world_camera: NDArray[np.float64], camera: Camera) -> View:
    """The kernels' view: for x, y, z one pixel to the right, one down, the ray of pixel (0, 0), and the place."""
    T_world_camera = np.asarray(T_world_camera, float)
    if T_world_camera.shape != (4, 4) or not np.isfinite(T_world_camera).all():
        raise SceneError(
            f"renderer: the camera's pose is {T_world_camera.tolist()}; expected 4 x 4 finite numbers. "
            "Check where the robot stands."
        )
    fx, fy, cx, cy = camera.lens
    right, down = T_world_camera[:3, 0] / fx, T_world_camera[:3, 1] / fy
    corner = T_world_camera[:3, 2] + (0.5 - cx) * right + (0.5 - cy) * down
    return tuple(map(tuple, np.column_stack([right, down, corner, T_world_camera[:3, 3]]).tolist()))
