"""Places from which an object can be seen: ends of searches in generated episodes, and for any scan.

seen = view_points_around(scene.objects[0], scene.mesh, navigation=scene.navigation, renderer=Raycaster(scene.mesh))
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.frames import yaw_towards
from sim.mesh import SceneObject, TriangleMesh
from sim.types import RELAXED_RADIUS, SUCCESS_RADIUS, TURN_STEP, Camera

from ..render.renderer import Hits, Renderer
from .navigation_map import NavigationMap, Points
from .object_surface import is_in_box, object_ids_at, object_surface, surface_in_box
from .storeys import nearest_storey, same_storey

SPACING = 0.25
"""Smallest planar distance between two view points, metres (one step)."""
SAMPLES = 48
"""Number of points of an object's surface to which lines of sight are drawn."""
_TRIED_EVERY = 0.1
"""One place is tried per square of this side, metres."""
_HEIGHTS = 4.0
"""Floors are searched this far above and below the object, metres."""
_FLOOR_ABOVE = 0.2
"""A floor this far above an object's middle may still carry it: a rug below a navmesh, which lies up to 0.2 m high."""
_SUNKEN_SHARE = 0.25
"""A storey that lies above the object counts if this share of the floor below the object belongs to it."""
_LEVEL = 0.25
"""Heights within this of the storey's floor are the floor itself (metres)."""
_LEVEL_REACH = 4.0
"""That floor is searched this far from the object, to tell a platform from a table top (planar metres)."""


@dataclass(frozen=True, slots=True)
class SeenFrom:
    """A place to stand that sees the object; `Pose(position, yaw, tilt)` has it in the picture."""

    position: tuple[float, float, float]
    """Feet on the floor, world metres."""
    yaw: float
    """Yaw that turns the camera to `visible_point`, radians."""
    tilt: float
    """Least tilt that brings `visible_point` into the picture: 0 or one look up or down, radians."""
    visible_share: float
    """Share of the lines to the object's surface that meet the object first, in (0, 1]."""
    visible_point: tuple[float, float, float]
    """The seen point that is nearest to the middle of all seen points, world metres."""


def view_points_around(
    item: SceneObject,
    mesh: TriangleMesh,
    *,
    navigation: NavigationMap,
    renderer: Renderer,
    camera: Camera | None = None,
) -> list[SeenFrom]:
    """Places near an object that really see it, best first (larger share, then nearer).

    A line of sight goes from the camera to a point of the object's surface and counts if the first thing that it meets
    is the object. It may rise or fall as far as one look up or down shows.

    Args:
        item: The object; its id is looked up in the mesh. Id 0 = the object is what the mesh has in the item's box.
        mesh: The mesh of `renderer`.
        navigation: Places where a robot can stand.
        renderer: Casts the lines of sight.
        camera: Mounting height and field of view; None = the paper's.

    Returns:
        Places on the object's storey at least SPACING apart, within SUCCESS_RADIUS planar of its centre, or
        within RELAXED_RADIUS when nothing nearer sees it. Empty when nothing does, or the mesh lacks the object.
    """
    camera = camera or Camera()
    centre = np.asarray(item.centre, float)
    targets = _surface(item, mesh)
    around = _thinned(navigation.points_within(centre[None], RELAXED_RADIUS, max_dy=_HEIGHTS))
    if not len(targets) or not len(around):
        return []
    away = np.hypot(around[:, 0] - centre[0], around[:, 2] - centre[2])
    for floor_y in _storeys_below(centre, around, navigation.storey_heights):
        on_storey = _on_storey(around, centre, floor_y, navigation)
        for radius in (SUCCESS_RADIUS, RELAXED_RADIUS):
            places = around[on_storey & (away <= radius)]
            sights = _sights(places, targets, item, mesh, renderer, camera)
            found = _spaced(places, sights, centre, camera)
            if found:
                return found
    return []


def _surface(item: SceneObject, mesh: TriangleMesh) -> Points:
    """(K, 3) points of the object, or of the mesh in its box."""
    if item.instance_id:
        return object_surface(mesh, item.instance_id, centre=item.centre, size=item.size, count=SAMPLES)
    return surface_in_box(mesh, centre=item.centre, size=item.size, count=SAMPLES)


def _are_of(item: SceneObject, mesh: TriangleMesh, hits: Hits) -> NDArray[np.bool_]:
    """(N,) whether each hit is on the object, or in its box."""
    if item.instance_id:
        return object_ids_at(mesh, hits.face_ids, hits.positions) == item.instance_id
    return is_in_box(hits.positions, centre=item.centre, size=item.size)


def _thinned(places: Points) -> Points:
    """The place nearest to the middle of each square of _TRIED_EVERY (and of each half metre of height)."""
    squares = np.floor(places / (_TRIED_EVERY, 0.5, _TRIED_EVERY))
    off = np.hypot(*(places / _TRIED_EVERY - squares - 0.5)[:, [0, 2]].T)
    order = np.lexsort((off, *squares.T))
    _, first = np.unique(squares[order], axis=0, return_index=True)
    return places[order[first]]


def _storeys_below(centre: NDArray[np.float64], around: Points, heights: tuple[float, ...]) -> list[float]:
    """Floor heights of the storeys on which the object can be, likeliest first.

    It is on the highest storey that has floor around it, not above it. A storey whose level lies above the object
    counts where much of the floor below the object belongs to it: a sunken room. If the likeliest floor lies a little
    above the object, the object may also hang from the ceiling below.
    """
    highest_floor = centre[1] + _FLOOR_ABOVE
    below = around[around[:, 1] <= highest_floor, 1]
    nearest = nearest_storey(below, heights)
    found: list[float] = []
    for index in reversed(range(len(heights))):
        share = np.mean(nearest == index) if len(below) else 0.0
        if share >= _SUNKEN_SHARE or (share > 0 and heights[index] <= highest_floor):
            found.append(heights[index])
    return found[:2] if found and found[0] > centre[1] else found[:1]


def _on_storey(
    around: Points, centre: NDArray[np.float64], floor_y: float, navigation: NavigationMap
) -> NDArray[np.bool_]:
    """(K,) whether each place belongs to the storey's floor: steps and platforms do, table tops do not."""
    off = np.abs(around[:, 1] - floor_y)
    is_level = off <= _LEVEL
    on_storey = same_storey(around[:, 1], floor_y)
    others = np.flatnonzero(on_storey & ~is_level)
    level = navigation.points_within(np.array([[centre[0], floor_y, centre[2]]]), _LEVEL_REACH, max_dy=_LEVEL)
    if len(others) and len(level):
        # Table tops are islands of their own: no robot climbs one to look at the things on it.
        on_storey[others] = np.isfinite(navigation.distances(around[others], _thinned(level)))
    return on_storey


def _sights(
    places: Points,
    targets: Points,
    item: SceneObject,
    mesh: TriangleMesh,
    renderer: Renderer,
    camera: Camera,
) -> Points:
    """(K, S, 3) points where each place's line to each target meets the object; NaN where another thing comes first."""
    eyes = np.repeat(places + np.array([0.0, camera.mount_height, 0.0]), len(targets), axis=0)
    hits = renderer.cast(eyes, np.tile(targets, (len(places), 1)) - eyes)
    to = hits.positions - eyes
    steep = np.abs(np.arctan2(to[:, 1], np.hypot(to[:, 0], to[:, 2])))
    seen = _are_of(item, mesh, hits) & (steep <= TURN_STEP + _half_height(camera))
    return np.where(seen[:, None], hits.positions, np.nan).reshape(len(places), len(targets), 3)


def _half_height(camera: Camera) -> float:
    """Angle in radians from the middle of the picture to just inside its upper edge."""
    return 0.999 * math.atan(camera.height / 2 / camera.focal)


def _spaced(places: Points, sights: Points, centre: NDArray[np.float64], camera: Camera) -> list[SeenFrom]:
    """The places that see something, best first, each at least SPACING from all before it."""
    seen = np.isfinite(sights[..., 0])
    shares = seen.mean(axis=1) if seen.size else np.zeros(len(places))
    away = np.hypot(places[:, 0] - centre[0], places[:, 2] - centre[2])
    kept: list[SeenFrom] = []
    for index in np.lexsort((away, -shares)):
        x, y, z = (float(value) for value in places[index])
        if shares[index] <= 0:
            break
        if all(math.hypot(x - other.position[0], z - other.position[2]) >= SPACING for other in kept):
            kept.append(_seen_from((x, y, z), sights[index, seen[index]], float(shares[index]), camera))
    return kept


def _seen_from(position: tuple[float, float, float], seen: Points, share: float, camera: Camera) -> SeenFrom:
    """A view point with the camera turned to the middle of the seen points, (S, 3)."""
    x, y, z = (float(value) for value in seen[np.linalg.norm(seen - seen.mean(axis=0), axis=1).argmin()])
    away = math.hypot(x - position[0], z - position[2])
    rise = math.atan2(y - position[1] - camera.mount_height, away)
    tilt = 0.0 if abs(rise) <= _half_height(camera) else math.copysign(TURN_STEP, rise)
    return SeenFrom(position, yaw_towards((position[0], position[2]), (x, z)), tilt, share, (x, y, z))
