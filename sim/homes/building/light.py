"""Soft light on a home: sky and sun by direction, darker where something is near, warmer near lamps; baked once.

No shadows with edges: what hides the sky counts less the farther it is, up to a reach. Kept in the cache folder.
"""

import hashlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sim.cache import cached_bytes
from sim.render.raycast import Raycaster

from ..plan import HOMES_VERSION
from .patches import Patches
from .sky_rays import Surroundings

DARKEST = 0.35
"""No surface is darker than this share of its colour."""
_LIFT = 0.012
"""Rays start this far in front of the surface (metres)."""
_ASIDE = (0.07, 0.15)
"""Distances at which light is looked for instead (metres)."""
_SUN = np.array([0.55, 0.65, 0.30]) / np.linalg.norm([0.55, 0.65, 0.30])
_SKY, _SUNLIGHT, _BOUNCE = 0.86, 0.15, 0.10
_HIDDEN = 0.85
"""What is hidden from all sides has lost this share of its light."""
_LAMP, _LAMP_RGB = 0.34, np.array([1.0, 0.92, 0.76])
_LAMP_HALF = 0.9
"""Distance at which a lamp is half as bright (metres)."""
_LAMP_REACH = 4.0
_LAMP_SIZE = 0.3
"""What is this near to the bulb is its own shade and casts no shadow (metres)."""


def baked_light(
    corners: NDArray[np.float64], patches: Patches, *, lamps: Sequence[tuple[float, float, float]] = ()
) -> NDArray[np.float64]:
    """Light (S, 3) at the samples of patches: shares of each colour, DARKEST to 1, in steps of 1/255.

    Args:
        corners: (Q, 4, 3) of all quads, which hide light from each other.
        patches: Where it is wanted.
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
    """(S, 3) in steps of 1/255."""
    around = Surroundings(corners)
    points, normals = patches.points, patches.normals
    hidden = _hidden(around, patches)
    towards_sun = normals @ _SUN
    direct = _SKY + _SUNLIGHT * towards_sun + _BOUNCE * np.maximum(0, -normals[:, 1])
    light = np.repeat((direct * (1 - _HIDDEN * hidden))[:, None], 3, axis=1)
    for bulb in bulbs:
        light += _lamp_light(around.caster, points, normals, bulb)[:, None] * _LAMP_RGB
    return (np.clip(light, DARKEST, 1) * 255).round().astype(np.uint8)


def _hidden(around: Surroundings, patches: Patches) -> NDArray[np.float64]:
    """(S,) how much of the sky is hidden, 0 to 1; samples inside of something take it from places beside them."""
    hidden = np.full(len(patches.points), np.nan)
    right, up = _tangents(patches.normals)
    frames, lifted = np.stack([right, up, patches.normals], axis=1), patches.points + _LIFT * patches.normals
    left = np.arange(len(hidden))
    for aside in (0.0, *_ASIDE):
        moves = ((0, 0),) if aside == 0 else ((1, 0), (-1, 0), (0, 1), (0, -1))
        total, count = np.zeros(len(left)), np.zeros(len(left))
        for a, b in moves:
            found, is_inside = around.sky((lifted[left] + aside * (a * right[left] + b * up[left]), frames[left]))
            total += np.where(is_inside, 0, found)
            count += ~is_inside
        done = count > 0
        hidden[left[done]] = total[done] / count[done]
        left = left[~done]
    return _filled(hidden, patches.sample)


def _filled(values: NDArray[np.float64], sample: NDArray[np.int64]) -> NDArray[np.float64]:
    """The values (S,) with every nan replaced by the mean of those that share a patch with it, or else by 0.5."""
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
    """Two unit vectors (N, 3) each that stand on the normals and on each other."""
    helper = np.where(np.abs(normals[:, 1:2]) < 0.9, [[0.0, 1.0, 0.0]], [[1.0, 0.0, 0.0]])
    right = np.asarray(np.cross(helper, normals), np.float64)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    return right, np.asarray(np.cross(normals, right), np.float64)


def _lamp_light(
    caster: Raycaster, points: NDArray[np.float64], normals: NDArray[np.float64], bulb: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(S,) light of one bulb; less with distance, none behind things."""
    away = bulb - points
    distance = np.linalg.norm(away, axis=1)
    facing = np.einsum("ij,ij->i", away, normals) / np.maximum(distance, 1e-6)
    light = np.zeros(len(points))
    near = np.flatnonzero((distance < _LAMP_REACH) & (facing > 0))
    if not len(near):
        return light
    reached = np.zeros(len(near))
    for offset in _LAMP_SIZE * 0.5 * np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / np.sqrt(3):
        origins = points[near] + _LIFT * normals[near]
        rays = bulb + offset - origins
        clear = np.linalg.norm(rays, axis=1) - _LAMP_SIZE
        reached += caster.cast(origins, rays).range_m >= clear
    fade = (1 - distance[near] / _LAMP_REACH) / (1 + (distance[near] / _LAMP_HALF) ** 2)
    light[near] = _LAMP * fade * (0.25 + 0.75 * facing[near]) * reached / 4
    return light
