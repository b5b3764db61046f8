"""Measures whether the pictures of a home and its navigation map agree, by walking and by casting rays into its mesh.

Scene and the places of its episodes -> `PictureAndWalk` (counts), for `personal-viz homes`. Nothing here reads a plan
or shares code with `floor_grid_from_mesh`, which is judged here.
"""

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from sim.frames import T_world_camera, forward_from_yaw
from sim.mesh import Scene, SceneObject
from sim.render.raycast import Raycaster
from sim.types import AGENT_HEIGHT, AGENT_RADIUS, FORWARD_STEP, Camera, Pose
from sim.walk.object_surface import object_surface

POSES = 2000
"""Number of poses at which a forward is tried."""
_CAMERA = Camera(width=160, height=120)
_TOUCH = AGENT_RADIUS + FORWARD_STEP
"""Nothing that a forward meets is farther than this from the robot's centre (metres)."""
_FREE_AHEAD = AGENT_RADIUS + 0.5
_FLOOR = 0.05
"""Points lower than this above the robot's feet are floor (metres)."""
_CLIMB = 0.2
"""Highest step that the robot takes (metres; Habitat)."""
_CELL = 0.05
"""Side of the squares of places to stand (metres)."""
_BODY = 0.2
"""AGENT_RADIUS in whole cells, as Habitat's navmesh keeps it from walls (metres)."""
_SIDES = (0.25, 0.45, 0.65, 0.85)
"""Heights above the feet at which a body's sides are cast (metres)."""
_AROUND = 16
"""Number of directions around a body."""
_LEVEL = math.cos(math.radians(45))
"""Least upward part of the normal of a face on which one stands (Habitat)."""
_SKIN = 1e-3
_APART = 0.1
"""An object farther than this from everything else floats (metres)."""
_PAIRS = 500_000
"""Number of pairs of a point and a triangle that are measured at once."""
_IN_WALL = 0.2
"""An object with more than this share of its surface inside walls is in a wall."""
_THICKEST = 0.5
"""Opposite back faces of the building this near to each other are two sides of one wall (metres)."""
_SAMPLES = 200
_BEDS = ("bed", "bunk bed", "crib")

Points = NDArray[np.float64]


class Count(NamedTuple):
    """The number of things with some property, and the number of all such things."""

    found: int
    of: int


class PictureAndWalk(NamedTuple):
    """Counts of one home."""

    phantom: Count
    """Forwards that collide although every depth pixel inside the body's width and height is out of reach; of all."""
    free_ahead: Count
    """Collisions with at least 0.5 m of visibly free space ahead; of all collisions."""
    standing: Count
    """Cells where a body fits on the drawn floor that episodes start from; cells of the map's floor there."""
    storey_pairs: Count
    """Pairs of a start and a view point on two storeys that the drawn mesh joins; of all such pairs."""
    floating: Count
    """Objects more than 10 cm from everything else; of all objects."""
    in_walls: Count
    """Objects with more than 20 % of their surface inside a wall; of all objects."""
    on_beds: Count
    """Beds on which the map has places; of all beds."""
    close_starts: Count
    """Starts nearer than the body's radius to something; of all starts."""
    close_views: Count
    """View points nearer than the body's radius to something; of all view points."""


def picture_and_walk(scene: Scene, *, starts: Points, views: Points, caster: Raycaster) -> PictureAndWalk:
    """Measures one home.

    Args:
        scene: The home.
        starts: (N, 3) feet at the starts of its episodes.
        views: (V, 3) feet at the view points of its goals.
        caster: Raycaster of the scene's mesh.
    """
    phantom, free_ahead = forwards(scene, caster)
    places = map_places(scene, starts)
    standing = standing_places(scene, caster)
    return PictureAndWalk(
        phantom=phantom,
        free_ahead=free_ahead,
        standing=Count(_reached(standing, starts), len(places)),
        storey_pairs=_joined(standing, scene.navigation.storey_heights, starts, views),
        floating=floating(scene),
        in_walls=in_walls(scene),
        on_beds=on_beds(scene.objects, places),
        close_starts=Count(_too_close(caster, starts), len(starts)),
        close_views=Count(_too_close(caster, views), len(views)),
    )


def forwards(scene: Scene, caster: Raycaster, *, num: int = POSES) -> tuple[Count, Count]:
    """Tries a forward at `num` seeded poses, each compared with the depth picture before it: phantom, free ahead."""
    rng = np.random.default_rng(0)
    rows, cols = np.indices((_CAMERA.height, _CAMERA.width)) + 0.5
    right = (cols - _CAMERA.width / 2) / _CAMERA.focal
    down = (rows - _CAMERA.height / 2) / _CAMERA.focal
    blocked = phantom = free_ahead = 0
    for _ in range(num):
        feet, yaw = scene.navigation.random_point(rng), float(rng.uniform(-math.pi, math.pi))
        if not scene.navigation.step(feet, feet + FORWARD_STEP * forward_from_yaw(yaw)).collided:
            continue
        x, y, z = feet.tolist()
        depth = caster.depth(T_world_camera(Pose((x, y, z), yaw), _CAMERA), _CAMERA)
        above = _CAMERA.mount_height - down * depth
        meets = (depth > 0) & (np.abs(right * depth) < AGENT_RADIUS) & (above > _FLOOR) & (above < AGENT_HEIGHT)
        nearest = float(depth[meets].min(initial=math.inf))
        blocked += 1
        phantom += nearest >= _TOUCH
        free_ahead += nearest >= _FREE_AHEAD
    return Count(phantom, num), Count(free_ahead, blocked)


def map_places(scene: Scene, starts: Points) -> Points:
    """(N, 3) places of the map, one per cell of 5 cm, that can be reached from a start."""
    low, high = scene.mesh.vertices.min(axis=0), scene.mesh.vertices.max(axis=0)
    centre, reach = ((low + high) / 2).astype(float), float(np.hypot(*(high - low)[[0, 2]]))
    places = scene.navigation.points_within(centre[None], reach, max_dy=float(high[1] - low[1]) + 1)
    part = _parts(places)
    _, nearest = KDTree(places).query(starts)
    return places[np.isin(part, part[nearest])]


class Standing(NamedTuple):
    """Places of a 5 cm grid where a body fits on drawn floor."""

    feet: Points
    """(N, 3)."""
    part: NDArray[np.int64]
    """(N,) number of the connected part of each place."""


def standing_places(scene: Scene, caster: Raycaster) -> Standing:
    """Every place where a body of the robot's height, and of its radius in whole cells, stands on drawn floor."""
    low, high = scene.mesh.vertices.min(axis=0).astype(float), scene.mesh.vertices.max(axis=0).astype(float)
    axes = [np.arange(low[axis] + _CELL / 2, high[axis], _CELL) for axis in (0, 2)]
    columns = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    feet = _floors(scene, caster, columns, top=float(high[1]) + 1)
    feet = feet[_fits(caster, feet)]
    return Standing(feet, _parts(feet))


def _floors(scene: Scene, caster: Raycaster, columns: NDArray[np.float64], *, top: float) -> Points:
    """(N, 3) places on all upward surfaces with headroom, below the columns (K, 2) of x and z."""
    up = _normals(scene.mesh.vertices, scene.mesh.faces)[:, 1]
    start, ceiling = np.full(len(columns), top), np.full(len(columns), math.inf)
    left = np.arange(len(columns))
    found: list[Points] = []
    while len(left):
        origins = np.column_stack([columns[left, 0], start[left], columns[left, 1]])
        hits = caster.cast(origins, np.tile((0.0, -1.0, 0.0), (len(left), 1)))
        hit = hits.face_ids >= 0
        left, y, faces = left[hit], hits.positions[hit, 1], hits.face_ids[hit]
        is_floor = (up[faces] > _LEVEL) & (ceiling[left] - y >= AGENT_HEIGHT)
        found.append(np.column_stack([columns[left[is_floor], 0], y[is_floor], columns[left[is_floor], 1]]))
        ceiling[left], start[left] = y, y - _SKIN
    return np.concatenate(found)


def _fits(caster: Raycaster, feet: Points) -> NDArray[np.bool_]:
    """(N,) whether a body at each place meets nothing: no side at any height, no top higher than a step."""
    fits = np.ones(len(feet), bool)
    for height, direction in itertools.product(_SIDES, _directions(_AROUND)):
        left = np.flatnonzero(fits)
        hits = caster.cast(feet[left] + (0, height, 0), np.tile(direction, (len(left), 1)))
        fits[left[(hits.face_ids >= 0) & (hits.range_m < _BODY)]] = False
    for share, direction in itertools.product((0.5, 1.0), _directions(_AROUND)):
        left = np.flatnonzero(fits)
        over = feet[left] + direction * _BODY * share + (0, AGENT_HEIGHT - _SKIN, 0)
        hits = caster.cast(over, np.tile((0.0, -1.0, 0.0), (len(left), 1)))
        fits[left[(hits.face_ids >= 0) & (hits.positions[:, 1] > feet[left, 1] + _CLIMB + _SKIN)]] = False
    return fits


def _directions(num: int) -> Points:
    """(num, 3) level unit vectors all around."""
    angles = np.arange(num) * 2 * math.pi / num
    return np.column_stack([np.cos(angles), np.zeros(num), np.sin(angles)])


def _parts(feet: Points) -> NDArray[np.int64]:
    """(N,) connected part of each place; neighbours are one cell and at most one step of height apart."""
    scaled = feet / (_CELL * 1.01, _CLIMB * 1.01, _CELL * 1.01)
    pairs = KDTree(scaled).query_pairs(1.0, p=math.inf, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(feet), len(feet)))
    return np.asarray(connected_components(graph, directed=False)[1], np.int64)


def _reached(standing: Standing, starts: Points) -> int:
    """Number of places to stand that are joined to the nearest one of a start."""
    _, nearest = KDTree(standing.feet).query(starts)
    return int(np.isin(standing.part, standing.part[nearest]).sum())


def _joined(standing: Standing, storeys: Sequence[float], starts: Points, views: Points) -> Count:
    """Pairs of a start and a view point on two storeys that one part of the drawn floor joins."""
    tree = KDTree(standing.feet)

    def of(points: Points) -> NDArray[np.int64]:  # (N, 2) storey and part; part -1 = no floor near
        distance, nearest = tree.query(points)
        part = np.where(distance < FORWARD_STEP, standing.part[nearest], -1)
        return np.column_stack([np.abs(points[:, 1:2] - np.asarray(storeys)).argmin(axis=1), part])

    from_, to = of(starts)[:, None], of(views)[None]
    apart = from_[..., 0] != to[..., 0]
    return Count(int((apart & (from_[..., 1] == to[..., 1]) & (from_[..., 1] >= 0)).sum()), int(apart.sum()))


def floating(scene: Scene) -> Count:
    """Objects more than 10 cm from everything else, of all objects that are drawn."""
    corners = scene.mesh.vertices[scene.mesh.faces].astype(float)
    low, high = corners.min(axis=1), corners.max(axis=1)
    found = drawn = 0
    for item in scene.objects:
        own = scene.mesh.face_instance == item.instance_id
        if not own.any():
            continue
        drawn += 1
        reach = low[own].min(axis=0) - _APART, high[own].max(axis=0) + _APART
        near = ~own & (low <= reach[1]).all(axis=1) & (high >= reach[0]).all(axis=1)
        found += not near.any() or _distance(corners[own], corners[near]) > _APART
    return Count(found, drawn)


def _distance(own: Points, near: Points) -> float:
    """Distance in metres of an object's triangles (F, 3, 3) from others (G, 3, 3): corners of each to faces of both."""
    return min(_from_points(own.reshape(-1, 3), near), _from_points(near.reshape(-1, 3), own))


def _from_points(points: Points, corners: Points) -> float:
    """Least distance of points (N, 3) from triangles (F, 3, 3), metres."""
    points = np.unique(points.round(4), axis=0)
    least = math.inf
    for part in np.array_split(points, math.ceil(len(points) * len(corners) / _PAIRS)):
        pairs = np.repeat(part, len(corners), axis=0)
        closest = trimesh.triangles.closest_point(np.tile(corners, (len(part), 1, 1)), pairs)
        least = min(least, float(np.linalg.norm(closest - pairs, axis=1).min()))
        if least <= _APART:
            break
    return least


def in_walls(scene: Scene) -> Count:
    """Objects with more than 20 % of their surface inside a wall, of all objects that are drawn.

    A point is inside when two opposite level rays from it meet back faces of the building within a wall's thickness.
    """
    building = scene.mesh.select(scene.mesh.face_instance == 0)
    normals, caster = _normals(building.vertices, building.faces), Raycaster(building)
    found = drawn = 0
    for item in scene.objects:
        points = object_surface(scene.mesh, item.instance_id, centre=item.centre, size=item.size, count=_SAMPLES)
        if not len(points):
            continue
        inside = np.zeros(len(points), bool)
        for direction in _directions(8)[:4]:
            thickness = np.zeros(len(points))
            for way in (direction, -direction):
                hits = caster.cast(points, np.tile(way, (len(points), 1)))
                is_back = (hits.face_ids >= 0) & (normals[hits.face_ids] @ way > 0)
                thickness += np.where(is_back, hits.range_m, math.inf)
            inside |= thickness <= _THICKEST
        drawn += 1
        found += float(inside.mean()) > _IN_WALL
    return Count(found, drawn)


def _normals(vertices: NDArray[np.float32], faces: NDArray[np.int32]) -> Points:
    """(F, 3) unit normals; zero where a face has no area."""
    a, b, c = np.moveaxis(vertices[faces].astype(float), 1, 0)
    normal = np.cross(b - a, c - a)
    return normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)


def on_beds(objects: Sequence[SceneObject], places: Points) -> Count:
    """Beds with places (N, 3) of the map above them, more than a step over their foot; of all beds."""
    beds = [item for item in objects if item.category in _BEDS]
    found = 0
    for bed in beds:
        half = np.asarray(bed.size) / 2
        away = places - bed.centre
        is_over = (np.abs(away[:, [0, 2]]) < half[[0, 2]]).all(axis=1) & (away[:, 1] + half[1] > _CLIMB)
        found += bool((is_over & (away[:, 1] < half[1] + _CLIMB)).any())
    return Count(found, len(beds))


def _too_close(caster: Raycaster, feet: Points) -> int:
    """Number of places (N, 3) at which something is nearer than AGENT_RADIUS."""
    nearest = np.full(len(feet), math.inf)
    for height, direction in itertools.product(_SIDES, _directions(2 * _AROUND)):
        hits = caster.cast(feet + np.array([0, height, 0]), np.tile(direction, (len(feet), 1)))
        nearest = np.minimum(nearest, np.where(hits.face_ids >= 0, hits.range_m, math.inf))
    return int((nearest < AGENT_RADIUS).sum())
