"""How much of the sky the things nearby hide from places on a home's surfaces; read by light.py.

Embree's packets are traced in a compiled loop that adds up what they meet; where they cannot be used, the Raycaster is
asked, which is several times slower.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from sim.compiled import njit
from sim.render.embree import EmbreeScene, new_packet, trace
from sim.render.raycast import Raycaster, chosen_backend, own_cores

from ...mesh import FLAT, TriangleMesh

REACH = 1.5
"""Things farther away hide no light (metres)."""
_NEAR, _CONTACT = 0.3, 0.3
"""Things nearer than this (metres) hide more, by this share, so that furniture stands on its floor."""
NUM_RAYS = 32
_INSIDE = 0.5
"""A place from which more rays meet back sides is inside of something (share)."""
_CHUNK = 1 << 12
Places = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Points (N, 3) just in front of surfaces, and frames (N, 3, 3): rows are two tangents and the normal."""
Sky = tuple[NDArray[np.float64], NDArray[np.bool_]]
"""(N,) share of the sky that is hidden, 0 to 1, and whether the place is inside of something."""


class Surroundings:
    """All quads (Q, 4, 3) of a home as things that hide light."""

    def __init__(self, corners: NDArray[np.float64]) -> None:
        self._mesh = _triangles(corners)
        self._normals = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
        self._caster: Raycaster | None = None
        backend = chosen_backend()
        self._width = backend.packet_width
        self._scene = EmbreeScene(self._mesh.vertices, self._mesh.faces) if backend.name == "embree" else None

    @property
    def caster(self) -> Raycaster:
        """For single rays."""
        if self._caster is None:
            self._caster = Raycaster(self._mesh)
        return self._caster

    def sky(self, places: Places) -> Sky:
        """How much of the sky is hidden from places; what is far counts less."""
        points, frames = places
        hidden, is_inside = np.zeros(len(points)), np.zeros(len(points), bool)
        look: Callable[[Places], Sky] = self._traced if self._scene is not None else self._asked

        def fill(begin: int) -> None:
            here = slice(begin, begin + _CHUNK)
            hidden[here], is_inside[here] = look((points[here], frames[here]))

        with ThreadPoolExecutor(own_cores()) as pool:
            list(pool.map(fill, range(0, len(points), _CHUNK)))
        return hidden, is_inside

    def _traced(self, places: Places) -> Sky:
        assert self._scene is not None
        hidden, is_inside = np.zeros(len(places[0])), np.zeros(len(places[0]), bool)
        packets = new_packet(self._width)
        points, frames = (np.ascontiguousarray(array, np.float32) for array in places)
        directions = hemisphere(NUM_RAYS).astype(np.float32)
        _trace_sky(
            self._scene.incoherent,
            packets,
            points,
            frames,
            directions,
            REACH,
            _NEAR,
            _CONTACT,
            _INSIDE,
            hidden,
            is_inside,
        )
        return hidden, is_inside

    def _asked(self, places: Places) -> Sky:
        rays = (hemisphere(NUM_RAYS) @ places[1]).reshape(-1, 3)
        hits = self.caster.cast(np.repeat(places[0], NUM_RAYS, axis=0), rays)
        far, near = (np.minimum(hits.range_m, reach) / reach for reach in (REACH, _NEAR))
        weight = (1 - _CONTACT) * (1 - far**2) + _CONTACT * (1 - near**2)
        is_back = (np.einsum("ij,ij->i", self._normals[hits.face_ids // 2], rays) > 0) & (hits.range_m < REACH)
        share = is_back.reshape(-1, NUM_RAYS).mean(axis=1)
        return weight.reshape(-1, NUM_RAYS).mean(axis=1), share > _INSIDE


def hemisphere(count: int) -> NDArray[np.float64]:
    """Directions (count, 3) about +z, evenly spread so that each stands for the same share of diffuse light."""
    index = np.arange(count) + 0.5
    radius, angle = np.sqrt(index / count), index * np.pi * (3 - np.sqrt(5))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1 - radius**2)], axis=1)


def _triangles(corners: NDArray[np.float64]) -> TriangleMesh:
    """Two triangles per quad, in order, without looks."""
    num = len(corners)
    faces = (np.array([[0, 1, 2], [0, 2, 3]]) + 4 * np.arange(num)[:, None, None]).reshape(-1, 3).astype(np.int32)
    return TriangleMesh(
        corners.reshape(-1, 3).astype(np.float32),
        faces,
        np.zeros((2 * num, 3), np.uint8),
        np.zeros(2 * num, np.int32),
        np.full(2 * num, FLAT, np.int16),
        np.zeros((2 * num, 3, 2), np.float32),
    )


@njit(cache=True, nogil=True, error_model="numpy")
def _trace_sky(tracer, packets, points, frames, directions, reach, near, contact, inside, hidden, is_inside):
    """Fills `hidden` and `is_inside` (N,) for points (N, 3) with frames (N, 3, 3); the rays' number fills packets."""
    packet = packets[0]
    width = len(packet.tfar)
    for n in range(len(points)):
        total, num_back = 0.0, 0
        for first in range(0, len(directions), width):
            for i in range(width):
                a, b, c = directions[first + i, 0], directions[first + i, 1], directions[first + i, 2]
                packet.org_x[i], packet.org_y[i], packet.org_z[i] = points[n, 0], points[n, 1], points[n, 2]
                packet.dir_x[i] = a * frames[n, 0, 0] + b * frames[n, 1, 0] + c * frames[n, 2, 0]
                packet.dir_y[i] = a * frames[n, 0, 1] + b * frames[n, 1, 1] + c * frames[n, 2, 1]
                packet.dir_z[i] = a * frames[n, 0, 2] + b * frames[n, 1, 2] + c * frames[n, 2, 2]
                packet.tfar[i] = reach
                packet.geom[i] = 0xFFFFFFFF
            trace(tracer[0], tracer[1], tracer[2], packets.ctypes.data, width)
            for i in range(width):
                if packet.geom[i] != 0:
                    continue
                far, close = packet.tfar[i] / reach, packet.tfar[i] / near
                total += (1 - contact) * (1 - far * far) + contact * max(0.0, 1 - close * close)
                along = packet.ng_x[i] * packet.dir_x[i] + packet.ng_y[i] * packet.dir_y[i]
                num_back += along + packet.ng_z[i] * packet.dir_z[i] > 0
        hidden[n] = total / len(directions)
        is_inside[n] = num_back > inside * len(directions)
