"""The benchmark's rendering figures on one mesh: our renderer, Open3D's rays alone, and Embree alone on our packets.

The last is the lower bound for every renderer on Embree: only its coherent packets on prefilled rays.
"""

import itertools
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import open3d as o3d
from numpy.typing import NDArray

from sim.compiled import njit
from sim.mesh import TriangleMesh
from sim.render.embree import EmbreeScene, new_packet, trace
from sim.render.raycast import Raycaster
from sim.render.raycast_kernels import TILES
from sim.types import Camera

from ..harness import Timing, interleaved

SMALL = Camera(width=256, height=256)
"""The second camera size that is measured."""
_Cast = Callable[[int, int], object]


def render_figures(
    mesh: TriangleMesh, Ts_world_camera: NDArray[np.float64], *, threads: int, rounds: int, with_variants: bool = True
) -> dict[str, float | None]:
    """Milliseconds per 640 x 480 frame, medians over the poses (B, 4, 4), interleaved.

    CPU times (`raw_ms`, `rgbd_ms` ...) are measured on one thread, so that no thread waits; `wall_..._1_ms` is the
    elapsed time of the same frames, `wall_..._ms` that of `threads` threads. `raw` is the bound, None without the
    embree backend; `rgbd` has RGB (bilinear), planar depth and instance ids; `_256` is the smaller picture.

    Args:
        mesh: The scene.
        Ts_world_camera: Poses, OpenCV axes.
        threads: Number of threads for the second series of elapsed times.
        rounds: How many times each pose is measured.
        with_variants: Whether to measure the other texture filters and the small picture too.
    """
    Ts, camera, num = Ts_world_camera, Camera(), len(Ts_world_camera)
    before = time.process_time()
    one = Raycaster(mesh, threads=1)
    tree_s = time.process_time() - before
    tree = EmbreeScene(mesh.vertices, mesh.faces) if one.backend.name == "embree" else None
    raw = None if tree is None else RawTrace(tree, Ts, camera, width=one.backend.packet_width)
    cast = _open3d_rays(mesh, Ts, camera)
    work: dict[str, Callable[[int], object]] = {
        "depth": lambda k: one.depth(Ts[k], camera),
        "rgbd": lambda k: one.render(Ts[k], camera),
        "open3d_rays": lambda k: cast(k, 1),
    }
    if raw is not None:
        work["raw"] = raw.trace
    core = interleaved(work, calls=num, rounds=rounds)
    variants: dict[str, Timing] = {}
    if with_variants:
        small = None if tree is None else RawTrace(tree, Ts, SMALL, width=one.backend.packet_width)
        variants = _variants(mesh, small, Ts, bilinear=one)
    several = _several_threads(mesh, raw, Ts, cast, threads=threads)
    found: dict[str, float | None] = {"tree_s": tree_s, "wall_threads": threads}
    for name in ("raw", "depth", "rgbd", "open3d_rays", "nearest", "mipmap", "raw_256", "rgbd_256"):
        timing = (core | variants).get(name)
        found[f"{name}_ms"] = timing and timing.core_s * 1e3
    for name in ("raw", "rgbd", "open3d_rays"):
        found[f"wall_{name}_1_ms"] = core[name].wall_s * 1e3 if name in core else None
        found[f"wall_{name}_ms"] = several[name].wall_s * 1e3 if name in several else None
    return found | {"wall_batch_ms": several["batch"].wall_s * 1e3 / num}


class RawTrace:
    """Prefilled rays of some cameras over one search tree; tracing neither makes rays nor reads hits.

    Directions are kept packet by packet (4 MB for a 640 x 480 camera) and copied into one packet before it is traced;
    whole prefilled packets (30 MB) take 1 % longer. Fetching rays takes 3-5 % longer than making them in the kernel
    (measured at 1M triangles), so a renderer of depth alone may be faster than this bound by that much.
    """

    def __init__(self, scene: EmbreeScene, Ts_world_camera: NDArray[np.float64], camera: Camera, *, width: int) -> None:
        """Fills the rays.

        Args:
            scene: The search tree, made like the renderer's.
            Ts_world_camera: (B, 4, 4), OpenCV axes.
            camera: Intrinsics; its size is a multiple of the renderer's tile.
            width: Rays per packet, as in the renderer.
        """
        self._scene, self._width = scene, width
        self._origins = np.asarray(Ts_world_camera[:, :3, 3], np.float32)
        in_camera = _tiled_directions(camera, width)
        self._directions = [
            np.ascontiguousarray(np.einsum("ij,pjw->piw", T[:3, :3], in_camera), np.float32) for T in Ts_world_camera
        ]

    def trace(self, k: int) -> NDArray[np.void]:
        """Traces all rays of the k-th camera on this thread; returns the last packet with its hits."""
        return self._trace_span(k, (0, len(self._directions[k])))

    def traced_by(self, threads: ThreadPoolExecutor, num: int) -> Callable[[int], list[NDArray[np.void]]]:
        """A function like `trace` that uses `num` threads, each on an equal range of packets.

        It returns the last packet of each thread.
        """
        bounds = np.linspace(0, len(self._directions[0]), num + 1).astype(int)
        spans = [(int(a), int(b)) for a, b in itertools.pairwise(bounds)]
        return lambda k: list(threads.map(lambda span: self._trace_span(k, span), spans))

    def _trace_span(self, k: int, span: tuple[int, int]) -> NDArray[np.void]:
        packet = new_packet(self._width)
        for axis, name in enumerate(("org_x", "org_y", "org_z")):
            packet[name] = self._origins[k, axis]
        _trace_range(self._scene.coherent, packet, self._directions[k], span)
        return packet


def _several_threads(
    mesh: TriangleMesh, raw: RawTrace | None, Ts: NDArray[np.float64], cast: _Cast, *, threads: int
) -> dict[str, Timing]:
    camera, raycaster = Camera(), Raycaster(mesh, threads=threads)
    work: dict[str, Callable[[int], object]] = {
        "rgbd": lambda k: raycaster.render(Ts[k], camera),
        "open3d_rays": lambda k: cast(k, threads),
    }
    with ThreadPoolExecutor(threads) as pool:
        if raw is not None:
            work["raw"] = raw.traced_by(pool, threads)
        found = interleaved(work, calls=len(Ts))
    return found | interleaved({"batch": lambda _: raycaster.render_batch(Ts, camera)}, calls=2, warm_ups=1)


def _variants(
    mesh: TriangleMesh, small: RawTrace | None, Ts: NDArray[np.float64], *, bilinear: Raycaster
) -> dict[str, Timing]:
    """Times of other texture filters, and of a smaller picture."""
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


def _open3d_rays(mesh: TriangleMesh, Ts: NDArray[np.float64], camera: Camera) -> _Cast:
    """A function that runs Open3D's `cast_rays` for the k-th camera on some threads.

    Its scene and rays are already in Open3D's own arrays.
    """
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


def _tiled_directions(camera: Camera, width: int) -> NDArray[np.floating]:
    """(packets, 3, width) rays through pixel centres in camera axes, tile by tile in rows; forward component 1."""
    cols, rows = TILES[width]
    assert camera.height % rows == 0 == camera.width % cols, camera
    x = (np.arange(camera.width) + 0.5 - camera.width / 2) / camera.focal
    y = (np.arange(camera.height) + 0.5 - camera.height / 2) / camera.focal
    image = np.stack([*np.meshgrid(x, y), np.ones((camera.height, camera.width))])
    blocks = image.reshape(3, camera.height // rows, rows, camera.width // cols, cols)
    return blocks.transpose(1, 3, 0, 2, 4).reshape(-1, 3, width)


@njit(cache=True, nogil=True, error_model="numpy")
def _trace_range(tracer, packets, directions, span):
    """Traces packets span[0] to span[1].

    Args:
        tracer: Addresses of scene, arguments and mask for `trace`.
        packets: One packet that no other thread uses, with its origin.
        directions: (P, 3, width) directions of all packets.
        span: First packet, and last packet + 1.
    """
    packet = packets[0]
    for k in range(span[0], span[1]):
        for lane in range(len(packet.tfar)):
            packet.dir_x[lane] = directions[k, 0, lane]
        for lane in range(len(packet.tfar)):  # separate loops: a joint one is not vectorised
            packet.dir_y[lane] = directions[k, 1, lane]
        for lane in range(len(packet.tfar)):
            packet.dir_z[lane] = directions[k, 2, lane]
        for lane in range(len(packet.tfar)):
            packet.tfar[lane] = np.float32(np.inf)
        trace(tracer[0], tracer[1], tracer[2], packets.ctypes.data, len(packet.tfar))
