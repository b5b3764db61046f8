"""Bakes soft light on a home: sky and sun by direction, darker where something is near, warmer near lamps.

No shadow has an edge: the farther a thing is, the less of the sky it hides, up to a reach. Light is kept in the cache
folder. A compiled loop traces Embree's packets and adds up their hits. Where packets cannot be used, the Raycaster
replaces them, several times slower.
"""

import hashlib
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from sim.cache import cached_bytes
from sim.compiled import njit
from sim.render.embree import EmbreeScene, new_packet, trace
from sim.render.raycast import Raycaster, chosen_backend, own_cores

from ..plan import HOMES_VERSION
from .patches import Patches, bare_mesh

DARKEST = 0.35
"""Least light on a surface, as a share of its colour."""
_LIFT = 0.012
"""Rays start this far in front of the surface (metres)."""
_SUN = np.array([0.55, 0.65, 0.30]) / np.linalg.norm([0.55, 0.65, 0.30])
_SKY, _SUNLIGHT, _BOUNCE = 0.86, 0.15, 0.10
_HIDDEN = 0.85
"""Share of its light that a place loses when it is hidden from all sides."""
_LAMP, _LAMP_RGB = 0.34, np.array([1.0, 0.92, 0.76])
_LAMP_HALF = 0.9
"""Distance at which a lamp is half as bright (metres)."""
_LAMP_REACH = 4.0
_LAMP_SIZE = 0.3
"""Things this near to the bulb are its own shade and cast no shadow (metres)."""
_REACH = 1.5
"""Things farther away hide no light (metres)."""
_NEAR, _CONTACT = 0.3, 0.3
"""Things nearer than _NEAR (metres) hide more, by the share _CONTACT, so that furniture stands on its floor."""
_NUM_RAYS = 32
_INSIDE = 0.5
"""A place is inside something if more than this share of its rays meet back sides."""
_CHUNK = 1 << 12

_Sky = tuple[NDArray[np.float64], NDArray[np.bool_]]
"""Share of the sky that is hidden, 0 to 1, and whether the place is inside something; (N,) each."""


class _Surroundings:
    """All quads (Q, 4, 3) of a home, as things that hide light."""

    def __init__(self, corners: NDArray[np.float64]) -> None:
        self._mesh = bare_mesh(corners)
        self._normals = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
        backend = chosen_backend()
        self._width = backend.packet_width
        self._scene = EmbreeScene(self._mesh.vertices, self._mesh.faces) if backend.name == "embree" else None

    @cached_property
    def caster(self) -> Raycaster:
        """A raycaster, for where packets cannot be used."""
        return Raycaster(self._mesh)

    def sky(self, points: NDArray[np.float64], frames: NDArray[np.float64]) -> _Sky:
        """The share of the sky that is hidden from each place; things far away hide less.

        Args:
            points: (N, 3) places just in front of surfaces.
            frames: (N, 3, 3) matrices whose rows are two tangents and the normal.
        """
        hidden, is_inside = np.zeros(len(points)), np.zeros(len(points), bool)

        def fill(here: slice) -> None:
            hidden[here], is_inside[here] = self._sky(points[here], frames[here])

        _in_chunks(fill, len(points))
        return hidden, is_inside

    def are_clear(
        self, origins: NDArray[np.float64], rays: NDArray[np.float64], shares: NDArray[np.float64]
    ) -> NDArray[np.bool_]:
        """Whether nothing lies along the first share (N,) of each ray; origins and rays (N, 3)."""
        if self._scene is None:
            return self.caster.cast(origins, rays).range_m >= np.linalg.norm(rays, axis=1) * shares
        tracer, width, found = self._scene.coherent, self._width, np.zeros(len(origins), bool)
        starts, ways, parts = (np.ascontiguousarray(array, np.float32) for array in (origins, rays, shares))

        def fill(here: slice) -> None:
            _trace_lines(tracer, new_packet(width), starts[here], ways[here], parts[here], found[here])

        _in_chunks(fill, len(origins))
        return found

    def _sky(self, points: NDArray[np.float64], frames: NDArray[np.float64]) -> _Sky:
        directions = _hemisphere(_NUM_RAYS)
        if self._scene is not None:
            hidden, is_inside = np.zeros(len(points)), np.zeros(len(points), bool)
            origins, axes, local = (np.ascontiguousarray(array, np.float32) for array in (points, frames, directions))
            _trace_sky(self._scene.coherent, new_packet(self._width), origins, axes, local, hidden, is_inside)
            return hidden, is_inside
        rays = (directions @ frames).reshape(-1, 3)
        hits = self.caster.cast(np.repeat(points, _NUM_RAYS, axis=0), rays)
        far, near = (np.minimum(hits.range_m, reach) / reach for reach in (_REACH, _NEAR))
        weight = (1 - _CONTACT) * (1 - far**2) + _CONTACT * (1 - near**2)
        is_back = (np.einsum("ij,ij->i", self._normals[hits.face_ids // 2], rays) > 0) & (hits.range_m < _REACH)
        share = is_back.reshape(-1, _NUM_RAYS).mean(axis=1)
        return weight.reshape(-1, _NUM_RAYS).mean(axis=1), share > _INSIDE


def _in_chunks(fill: Callable[[slice], None], count: int) -> None:
    """Calls `fill` for parts of `count` things, on this process's own cores."""
    with ThreadPoolExecutor(own_cores()) as pool:
        list(pool.map(fill, [slice(begin, begin + _CHUNK) for begin in range(0, count, _CHUNK)]))


def baked_light(
    corners: NDArray[np.float64], patches: Patches, *, lamps: Sequence[tuple[float, float, float]] = ()
) -> NDArray[np.float64]:
    """Light (S, 3) at the samples of patches: shares of each colour, DARKEST to 1, in steps of 1/255.

    Args:
        corners: (Q, 4, 3) corners of all quads, which hide light from each other.
        patches: The patches that need light.
        lamps: Places of bulbs, metres.
    """
    bulbs = np.array(lamps, float).reshape(-1, 3)
    points, normals = np.float32(patches.points), np.float32(patches.normals)
    key = hashlib.sha256(f"{HOMES_VERSION}".encode())
    for array in (np.float32(corners), points, normals, patches.sample, np.float32(bulbs)):
        key.update(f"{array.shape}".encode())
        key.update(np.ascontiguousarray(array).data)
    stored = cached_bytes("light", key.hexdigest(), lambda: _light(corners, patches, bulbs).tobytes())
    return np.frombuffer(stored, np.uint8).reshape(-1, 3) / 255


def _light(corners: NDArray[np.float64], patches: Patches, bulbs: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Light (S, 3) in steps of 1/255."""
    around = _Surroundings(corners)
    points, normals = patches.points, patches.normals
    hidden = _hidden(around, patches)
    towards_sun = normals @ _SUN
    direct = _SKY + _SUNLIGHT * towards_sun + _BOUNCE * np.maximum(0, -normals[:, 1])
    light = np.repeat((direct * (1 - _HIDDEN * hidden))[:, None], 3, axis=1)
    light += _lamp_light(around, points, normals, bulbs)[:, None] * _LAMP_RGB
    return (np.clip(light, DARKEST, 1) * 255).round().astype(np.uint8)


def _hidden(around: _Surroundings, patches: Patches) -> NDArray[np.float64]:
    """Share (S,) of the sky that is hidden, 0 to 1; samples inside something take that of others in their patches."""
    right, up = _tangents(patches.normals)
    frames, lifted = np.stack([right, up, patches.normals], axis=1), patches.points + _LIFT * patches.normals
    hidden, is_inside = around.sky(lifted, frames)
    return _filled(np.where(is_inside, np.nan, hidden), patches.sample)


def _filled(values: NDArray[np.float64], sample: NDArray[np.int64]) -> NDArray[np.float64]:
    """The values (S,), with every nan replaced by the mean of the samples in the same patches, or else by 0.5."""
    for _ in range(2):
        around = values[sample]  # (P, 4)
        known = ~np.isnan(around)
        mean = np.where(known, around, 0).sum(axis=1) / np.maximum(known.sum(axis=1), 1)
        has = np.repeat(known.any(axis=1), 4)
        total = np.bincount(sample.ravel(), np.repeat(mean, 4) * has, len(values))
        count = np.bincount(sample.ravel(), has, len(values))
        values = np.where(np.isnan(values) & (count > 0), total / np.maximum(count, 1), values)
    return np.where(np.isnan(values), 0.5, values)


def _tangents(normals: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Two sets of unit vectors (N, 3), at right angles to the normals and to each other."""
    helper = np.where(np.abs(normals[:, 1:2]) < 0.9, [[0.0, 1.0, 0.0]], [[1.0, 0.0, 0.0]])
    right = np.asarray(np.cross(helper, normals), np.float64)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    return right, np.asarray(np.cross(normals, right), np.float64)


def _lamp_light(
    around: _Surroundings, points: NDArray[np.float64], normals: NDArray[np.float64], bulbs: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Light (S,) of all bulbs (B, 3): less with distance, none behind things."""
    which, near = np.nonzero(cdist(bulbs, points) < _LAMP_REACH)
    away = bulbs[which] - points[near]
    distance = np.linalg.norm(away, axis=1)
    facing = np.einsum("ij,ij->i", away, normals[near]) / np.maximum(distance, 1e-6)
    lit = facing > 0
    near, bulb, distance, facing = near[lit], bulbs[which[lit]], distance[lit], facing[lit]
    origins, reached = points[near] + _LIFT * normals[near], np.zeros(len(near))
    for offset in _LAMP_SIZE * 0.5 * np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / np.sqrt(3):
        rays = bulb + offset - origins
        reached += around.are_clear(
            origins, rays, 1 - _LAMP_SIZE / np.maximum(np.linalg.norm(rays, axis=1), _LAMP_SIZE)
        )
    fade = (1 - distance / _LAMP_REACH) / (1 + (distance / _LAMP_HALF) ** 2)
    light = np.zeros(len(points))
    np.add.at(light, near, _LAMP * fade * (0.25 + 0.75 * facing) * reached / 4)
    return light


def _hemisphere(count: int) -> NDArray[np.float64]:
    """Directions (count, 3) about +z, evenly spread so that each stands for the same share of diffuse light."""
    index = np.arange(count) + 0.5
    radius, angle = np.sqrt(index / count), index * np.pi * (3 - np.sqrt(5))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1 - radius**2)], axis=1)


@njit(cache=True, nogil=True, error_model="numpy")
def _trace_sky(tracer, packets, points, frames, directions, hidden, is_inside):
    """Fills `hidden` and `is_inside` (N,) for points (N, 3) with frames (N, 3, 3).

    A packet holds one ray from each of several places in a row, which lie near each other and look alike.
    """
    packet = packets[0]
    width = len(packet.tfar)
    num_back = np.zeros(width, np.int64)
    for first in range(0, len(points), width):
        here = min(width, len(points) - first)
        num_back[:] = 0
        for d in range(len(directions)):
            a, b, c = directions[d]
            for i in range(width):
                n = first + min(i, here - 1)
                packet.org_x[i], packet.org_y[i], packet.org_z[i] = points[n, 0], points[n, 1], points[n, 2]
                packet.dir_x[i] = a * frames[n, 0, 0] + b * frames[n, 1, 0] + c * frames[n, 2, 0]
                packet.dir_y[i] = a * frames[n, 0, 1] + b * frames[n, 1, 1] + c * frames[n, 2, 1]
                packet.dir_z[i] = a * frames[n, 0, 2] + b * frames[n, 1, 2] + c * frames[n, 2, 2]
                packet.tfar[i] = _REACH
                packet.geom[i] = 0xFFFFFFFF
            trace(tracer[0], tracer[1], tracer[2], packets.ctypes.data, width)
            for i in range(here):
                if packet.geom[i] != 0:
                    continue
                far, close = packet.tfar[i] / _REACH, packet.tfar[i] / _NEAR
                hidden[first + i] += (1 - _CONTACT) * (1 - far * far) + _CONTACT * max(0.0, 1 - close * close)
                along = packet.ng_x[i] * packet.dir_x[i] + packet.ng_y[i] * packet.dir_y[i]
                num_back[i] += along + packet.ng_z[i] * packet.dir_z[i] > 0
        for i in range(here):
            hidden[first + i] /= len(directions)
            is_inside[first + i] = num_back[i] > _INSIDE * len(directions)


@njit(cache=True, nogil=True, error_model="numpy")
def _trace_lines(tracer, packets, origins, rays, shares, is_clear):
    """Fills `is_clear` (N,): whether nothing lies along the first share (N,) of each ray; origins and rays (N, 3)."""
    packet = packets[0]
    width = len(packet.tfar)
    for first in range(0, len(origins), width):
        here = min(width, len(origins) - first)
        for i in range(width):
            n = first + min(i, here - 1)
            packet.org_x[i], packet.org_y[i], packet.org_z[i] = origins[n, 0], origins[n, 1], origins[n, 2]
            packet.dir_x[i], packet.dir_y[i], packet.dir_z[i] = rays[n, 0], rays[n, 1], rays[n, 2]
            packet.tfar[i] = shares[n]
            packet.geom[i] = 0xFFFFFFFF
        trace(tracer[0], tracer[1], tracer[2], packets.ctypes.data, width)
        for i in range(here):
            is_clear[first + i] = packet.geom[i] != 0
