"""Places from which an object can be seen: where generated episodes let a search end."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.frames import yaw_towards
from sim.types import CAMERA_HEIGHT, STOREY_GAP

from .navigation_map import NavigationMap, Points
from .renderer import Renderer

RADIUS = 1.0
"""Planar metres from the object's centre (paper: success within 1.0 m)."""
RELAXED_RADIUS = 1.5
"""... where fewer than MIN_POINTS are visible within RADIUS (DESIGN.md, rule `paper`)."""
MIN_POINTS = 5
SPACING = 0.25
"""Smallest planar distance between two view points, metres (one step)."""
_LEVEL = 0.25
"""Heights within this of the storey's floor are the floor itself (metres)."""
_LEVEL_REACH = 4.0
"""How far from the object that floor is looked for, to tell a platform from a table top (planar metres)."""
_SAMPLES = (-0.4, 0.0, 0.4)
"""Shares of the object's size at which sample points lie on each axis."""


@dataclass(frozen=True, slots=True)
class SeenFrom:
    """A place to stand that sees the object."""

    position: tuple[float, float, float]
    """Feet on the floor, world metres."""
    yaw: float
    """Radians; faces the object's centre."""
    visible_share: float
    """Share of the object's sample points whose line of sight meets the object first, in (0, 1]."""


def view_points_around(
    centre: tuple[float, float, float],
    size: tuple[float, float, float],
    *,
    navigation: NavigationMap,
    renderer: Renderer,
    instance_id: int,
    face_instance: NDArray[np.int32],
) -> list[SeenFrom]:
    """Places near an object that see it from camera height, best first (larger share, then nearer).

    Args:
        centre: Centre of the object's box, world metres.
        size: Extents along world x, y, z in metres.
        navigation: Where a robot can stand.
        renderer: Casts the lines of sight.
        instance_id: The object.
        face_instance: (F,) object of each face of the renderer's mesh.

    Returns:
        Places on the object's storey at least SPACING apart, within RADIUS planar of the centre, or within
        RELAXED_RADIUS when fewer than MIN_POINTS see it; empty when none does.
    """
    found: list[SeenFrom] = []
    for radius in (RADIUS, RELAXED_RADIUS):
        places = _places(np.asarray(centre, float), size, navigation, radius)
        shares = _visible_shares(places, centre, size, renderer, face_instance == instance_id)
        found = _spaced(places, shares, centre)
        if len(found) >= MIN_POINTS:
            break
    return found


def _places(
    centre: NDArray[np.float64], size: tuple[float, float, float], navigation: NavigationMap, radius: float
) -> Points:
    """(K, 3) places on the object's storey: the one whose floor is nearest below the object's middle."""
    storeys = [height for height in navigation.storey_heights if height <= centre[1] + 0.1]
    floor_y = max(storeys) if storeys else centre[1] - size[1] / 2
    around = np.array([[centre[0], floor_y, centre[2]]])
    places = navigation.points_within(around, radius, max_dy=STOREY_GAP - 1e-6)
    is_level = np.abs(places[:, 1] - floor_y) <= _LEVEL
    level = navigation.points_within(around, _LEVEL_REACH, max_dy=_LEVEL) if not is_level.all() else places
    if is_level.all() or not len(level):
        return places
    # Table tops are islands of their own: nobody climbs one to look at what lies on it; steps and platforms stay.
    return places[is_level | np.isfinite(navigation.distances(places, level))]


def _visible_shares(
    places: Points,
    centre: tuple[float, float, float],
    size: tuple[float, float, float],
    renderer: Renderer,
    is_object: NDArray[np.bool_],
) -> NDArray[np.float64]:
    """(K,) share of the object's sample points that are seen from each place."""
    grid = np.stack(np.meshgrid(_SAMPLES, _SAMPLES, _SAMPLES, indexing="ij"), axis=-1).reshape(-1, 3)
    samples = np.asarray(centre) + grid * np.asarray(size)  # (S, 3)
    eyes = places + np.array([0.0, CAMERA_HEIGHT, 0.0])
    origins = np.repeat(eyes, len(samples), axis=0)
    hits = renderer.cast(origins, np.tile(samples, (len(places), 1)) - origins)
    sees = (hits.face_ids >= 0) & is_object[hits.face_ids]
    return sees.reshape(len(places), len(samples)).mean(axis=1)


def _spaced(places: Points, shares: NDArray[np.float64], centre: tuple[float, float, float]) -> list[SeenFrom]:
    """The places that see something, best first, each at least SPACING from all before it."""
    away = np.hypot(places[:, 0] - centre[0], places[:, 2] - centre[2])
    kept: list[SeenFrom] = []
    for index in np.lexsort((away, -shares)):
        x, y, z = (float(value) for value in places[index])
        if shares[index] <= 0:
            break
        if all(math.hypot(x - other.position[0], z - other.position[2]) >= SPACING for other in kept):
            yaw = yaw_towards((x, z), (centre[0], centre[2]))
            kept.append(SeenFrom((x, y, z), yaw, float(shares[index])))
    return kept
