"""The benchmark's rendering figures on one mesh: ours, Embree alone on the same packets, and Open3D's rays alone."""

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import open3d as o3d
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from sim.mesh import TriangleMesh
from sim.render.embree import EmbreeScene
from sim.render.raycast import Raycaster
from sim.types import Camera

from .measure import Timing, interleaved
from .raw_trace import RawTrace

_Cast = Callable[[int, int], object]
SMALL = Camera(width=256, height=256)
"""The second size that is measured."""


class WallFigures(BaseModel):
    """Elapsed milliseconds per 640 x 480 frame with one thread and with `threads`."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    threads: int
    raw_1_ms: float | None
    rgbd_1_ms: float
    open3d_rays_1_ms: float
    raw_ms: float | None
    rgbd_ms: float
    open3d_rays_ms: float
    batch_ms: float
    """Per frame of one `render_batch` call."""


class RenderFigures(BaseModel):
    """CPU milliseconds of all threads per frame, 640 x 480 unless said otherwise."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    raw_ms: float | None
    """Embree alone on prefilled rays, same packets: the bound. None without the embree backend."""
    depth_ms: float
    rgbd_ms: float
    """RGB (bilinear), planar depth and instance ids."""
    open3d_rays_ms: float
    """Open3D's `cast_rays` alone on prefilled rays."""
    nearest_ms: float | None
    mipmap_ms: float | None
    raw_256_ms: float | None
    rgbd_256_ms: float | None
    """At 256 x 256."""
    tree_s: float
    """CPU seconds to make a `Raycaster`."""
    wall: WallFigures


def render_figures(
    mesh: TriangleMesh, Ts_world_camera: NDArray[np.float64], *, threads: int, rounds: int, with_variants: bool = True
) -> RenderFigures:
    """Medians over the poses (B, 4, 4), interleaved. CPU times are those of one thread each, so that none waits.

    Args:
        mesh: The scene.
        Ts_world_camera: Poses, OpenCV axes.
        threads: Of the second row of elapsed times.
        rounds: How often each pose is measured.
        with_variants: Measure the other texture filters and the small picture too.
    """
    Ts, camera, num = Ts_world_camera, Camera(), len(Ts_world_camera)
    before = time.process_time()
    one = Raycaster(mesh, threads=1)
    tree_s = time.process_time() - before
    tree = EmbreeScene(mesh.vertices, mesh.faces) if one.backend.name == "embree" else None
    width = one.backend.packet_width
    raw = None if tree is None else RawTrace(tree, Ts, camera, width=width)
    cast = _open3d_rays(mesh, Ts, camera)
    work: dict[str, Callable[[int], object]] = {
        "depth": lambda k: one.depth(Ts[k], camera),
        "rgbd": lambda k: one.render(Ts[k], camera),
        "open3d": lambda k: cast(k, 1),
    }
    if raw is not None:
        work["raw"] = raw.trace
    core = interleaved(work, calls=num, rounds=rounds)
    variants: dict[str, Timing] = {}
    if with_variants:
        small = None if tree is None else RawTrace(tree, Ts, SMALL, width=width)
        variants = _variants(mesh, small, Ts, bilinear=one)
    return RenderFigures(
        raw_ms=_core_ms(core.get("raw")),
        depth_ms=core["depth"].core_s * 1e3,
        rgbd_ms=core["rgbd"].core_s * 1e3,
        open3d_rays_ms=core["open3d"].core_s * 1e3,
        nearest_ms=_core_ms(variants.get("nearest")),
        mipmap_ms=_core_ms(variants.get("mipmap")),
        raw_256_ms=_core_ms(variants.get("raw_256")),
        rgbd_256_ms=_core_ms(variants.get("rgbd_256")),
        tree_s=tree_s,
        wall=_wall_figures(core, _several_threads(mesh, raw, Ts, cast, threads=threads), threads=threads, num=num),
    )


def _several_threads(
    mesh: TriangleMesh, raw: RawTrace | None, Ts: NDArray[np.float64], cast: _Cast, *, threads: int
) -> dict[str, Timing]:
    camera, raycaster = Camera(), Raycaster(mesh, threads=threads)
    work: dict[str, Callable[[int], object]] = {
        "rgbd": lambda k: raycaster.render(Ts[k], camera),
        "open3d": lambda k: cast(k, threads),
    }
    with ThreadPoolExecutor(threads) as pool:
        if raw is not None:
            work["raw"] = raw.traced_by(pool, threads)
        found = interleaved(work, calls=len(Ts))
    return found | interleaved({"batch": lambda _: raycaster.render_batch(Ts, camera)}, calls=2, warm_ups=1)


def _variants(
    mesh: TriangleMesh, small: RawTrace | None, Ts: NDArray[np.float64], *, bilinear: Raycaster
) -> dict[str, Timing]:
    """Other texture filters, and a smaller picture."""
    camera = Camera()
    nearest = Raycaster(mesh, texture_filter="nearest", threads=1)
    mipmap = Raycaster(mesh, texture_filter="mipmap", threads=1)
    work: dict[str, Callable[[int], object]] = {
        "nearest": lambda k: nearest.render(Ts[k], camera),
        "mipmap": lambda k: mipmap.render(Ts[k], camera),
        "rgbd_256": lambda k: bilinear.render(Ts[k], SMALL),
    }
    if small is not None:
        work["raw_256"] = small.trace
    return interleaved(work, calls=len(Ts))


def _wall_figures(one: dict[str, Timing], several: dict[str, Timing], *, threads: int, num: int) -> WallFigures:
    return WallFigures(
        threads=threads,
        raw_1_ms=_wall_ms(one.get("raw")),
        rgbd_1_ms=one["rgbd"].wall_s * 1e3,
        open3d_rays_1_ms=one["open3d"].wall_s * 1e3,
        raw_ms=_wall_ms(several.get("raw")),
        rgbd_ms=several["rgbd"].wall_s * 1e3,
        open3d_rays_ms=several["open3d"].wall_s * 1e3,
        batch_ms=several["batch"].wall_s * 1e3 / num,
    )


def _open3d_rays(mesh: TriangleMesh, Ts: NDArray[np.float64], camera: Camera) -> _Cast:
    """Open3D's `cast_rays` of the k-th camera on so many threads; its scene and rays are ready in its own arrays."""
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(_tensor(mesh.vertices), _tensor(mesh.faces.astype(np.uint32)))
    x = (np.arange(camera.width) + 0.5 - camera.width / 2) / camera.focal
    y = (np.arange(camera.height) + 0.5 - camera.height / 2) / camera.focal
    directions = np.stack([*np.meshgrid(x, y), np.ones((camera.height, camera.width))], axis=-1)
    tensors = []
    for T in Ts:
        rays = np.empty((camera.height, camera.width, 6), np.float32)
        rays[..., :3], rays[..., 3:] = T[:3, 3], directions @ T[:3, :3].T
        tensors.append(_tensor(rays))
    return lambda k, threads: scene.cast_rays(tensors[k], nthreads=threads)


def _tensor(array: NDArray) -> o3d.core.Tensor:
    """Open3D's view of an array; its stubs do not know that it takes numpy arrays."""
    return o3d.core.Tensor(array)  # pyright: ignore[reportCallIssue]


def _core_ms(timing: Timing | None) -> float | None:
    return None if timing is None else timing.core_s * 1e3


def _wall_ms(timing: Timing | None) -> float | None:
    return None if timing is None else timing.wall_s * 1e3
