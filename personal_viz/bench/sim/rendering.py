"""The benchmark's rendering figures on one mesh: our renderer, Open3D's rays alone, and Embree alone on our packets.

The last is the lower bound for every renderer on Embree: only its coherent packets on prefilled rays.
"""

from collections.abc import Callable

import numpy as np
import open3d as o3d
from numpy.typing import NDArray

from sim.compiled import njit
from sim.mesh import TriangleMesh
from sim.render.embree import EmbreeScene, new_packet, trace
from sim.render.raycast import Raycaster
from sim.render.raycast_kernels import TILES
from sim.types import Camera

from ..harness import interleaved

SMALL = Camera(width=256, height=256)
"""The second camera size that is measured."""
_Cast = Callable[[int, int], object]


def render_figures(
    mesh: TriangleMesh, Ts_world_camera: NDArray[np.float64], *, threads: int, rounds: int
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
    """
    Ts, camera, num = Ts_world_camera, Camera(), len(Ts_world_camera)
    one, several = (Raycaster(mesh, threads=count) for count in (1, threads))
    cast = _open3d_rays(mesh, Ts, camera)
    work: dict[str, Callable[[int], object]] = {
        "depth": lambda k: one.depth(Ts[k], camera),
        "rgbd": lambda k: one.render(Ts[k], camera),
        "open3d_rays": lambda k: cast(k, 1),
        "rgbd_256": lambda k: one.render(Ts[k], SMALL),
    }
    if one.backend.name == "embree":
        tree, width = EmbreeScene(mesh.vertices, mesh.faces), one.backend.packet_width
        work["raw"] = RawTrace(tree, Ts, camera, width=width).trace
        work["raw_256"] = RawTrace(tree, Ts, SMALL, width=width).trace
    found = interleaved(work, calls=num, rounds=rounds)
    at_once = interleaved(
        {"rgbd": lambda k: several.render(Ts[k], camera), "open3d_rays": lambda k: cast(k, threads)}, calls=num
    )
    names = ("raw", "depth", "rgbd", "open3d_rays", "raw_256", "rgbd_256")
    core = {f"{name}_ms": found[name].core_s * 1e3 if name in found else None for name in names}
    alone = {f"wall_{name}_1_ms": found[name].wall_s * 1e3 for name in at_once}
    return core | alone | {f"wall_{name}_ms": timing.wall_s * 1e3 for name, timing in at_once.items()}


class RawTrace:
    """Prefilled rays of some cameras over one search tree; tracing neither makes rays nor reads hits.

    Directions are kept packet by packet and copied into one packet before it is traced. Fetching rays takes 3-5 %
    longer than making them in the kernel, so a renderer of depth alone may be faster than this bound by that much.
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
        packet = new_packet(self._width)
        for axis, name in enumerate(("org_x", "org_y", "org_z")):
            packet[name] = self._origins[k, axis]
        _trace_all(self._scene.coherent, packet, self._directions[k])
        return packet


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
def _trace_all(tracer, packets, directions):
    """Traces packets one after the other.

    Args:
        tracer: Addresses of scene, arguments and mask for `trace`.
        packets: One packet that no other thread uses, with its origin.
        directions: (P, 3, width) directions of all packets.
    """
    packet = packets[0]
    for k in range(len(directions)):
        for lane in range(len(packet.tfar)):
            packet.dir_x[lane] = directions[k, 0, lane]
        for lane in range(len(packet.tfar)):  # separate loops: a joint one is not vectorised
            packet.dir_y[lane] = directions[k, 1, lane]
        for lane in range(len(packet.tfar)):
            packet.dir_z[lane] = directions[k, 2, lane]
        for lane in range(len(packet.tfar)):
            packet.tfar[lane] = np.float32(np.inf)
        trace(tracer[0], tracer[1], tracer[2], packets.ctypes.data, len(packet.tfar))
