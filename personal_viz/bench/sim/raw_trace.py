"""The bound of every renderer over Embree: its coherent packets on prefilled rays, and nothing else."""

import itertools
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from sim.compiled import njit
from sim.render.embree import EmbreeScene, new_packet, trace
from sim.render.raycast_kernels import TILES
from sim.types import Camera


class RawTrace:
    """Prefilled rays of some cameras over one search tree; tracing them makes no rays and reads no hits.

    Directions are kept packet by packet (4 MB for a 640 x 480 camera) and copied into one packet before it is traced;
    whole prefilled packets (30 MB) take 1 % longer. Fetching rays takes 3-5 % longer than making them in the kernel
    (measured at 1M triangles), so a renderer of depth alone may come out below this bound by as much.
    """

    def __init__(self, scene: EmbreeScene, Ts_world_camera: NDArray[np.float64], camera: Camera, *, width: int) -> None:
        """Fills the rays.

        Args:
            scene: The tree, made as the renderer's.
            Ts_world_camera: (B, 4, 4), OpenCV axes.
            camera: Intrinsics; its size is a multiple of the renderer's tile.
            width: Rays per packet, as the renderer's.
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
        """`trace` on `num` threads, each with an equal range of packets; returns the last packet of each."""
        bounds = np.linspace(0, len(self._directions[0]), num + 1).astype(int)
        spans = [(int(a), int(b)) for a, b in itertools.pairwise(bounds)]
        return lambda k: list(threads.map(lambda span: self._trace_span(k, span), spans))

    def _trace_span(self, k: int, span: tuple[int, int]) -> NDArray[np.void]:
        packet = new_packet(self._width)
        for axis, name in enumerate(("org_x", "org_y", "org_z")):
            packet[name] = self._origins[k, axis]
        _trace_range(self._scene.coherent, packet, self._directions[k], span)
        return packet


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
        packets: One packet, ours alone, with its origin.
        directions: (P, 3, width) of all packets.
        span: First and last + 1.
    """
    packet = packets[0]
    for k in range(span[0], span[1]):
        for lane in range(len(packet.tfar)):
            packet.dir_x[lane] = directions[k, 0, lane]
        for lane in range(len(packet.tfar)):  # loops of their own: together they are not vectorised
            packet.dir_y[lane] = directions[k, 1, lane]
        for lane in range(len(packet.tfar)):
            packet.dir_z[lane] = directions[k, 2, lane]
        for lane in range(len(packet.tfar)):
            packet.tfar[lane] = np.float32(np.inf)
        trace(tracer[0], tracer[1], tracer[2], packets.ctypes.data, len(packet.tfar))
