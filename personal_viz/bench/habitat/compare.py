"""Compares one house of a golden folder with our navigation, depth and measures, row by row; agreement.py counts."""

import itertools
import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sim.errors import SceneError
from sim.frames import T_world_camera, world_from_glb_zup
from sim.mesh import TriangleMesh
from sim.render.raycast import Raycaster
from sim.scans.glb import load_glb
from sim.types import PAPER6, Camera, Pose
from sim.walk.floor_grid import floor_grid_from_mesh
from sim.walk.navigation_map import NavigationMap
from sim.walk.navmesh import NavMesh, load_navmesh

from .golden import EpisodeRow, Episodes, Geodesic, House, NavmeshInfo, Pair, Poses, Snap, StepRow, Steps
from .measures import HabitatMeasures, distances_to_goal, habitat_measures

CLOSE = 1e-4
"""Largest allowed difference of distances, snapped points and radii, metres (issue 3)."""
STEP_CLOSE = 1e-3
"""Largest allowed difference of the end of a forward, or of a pixel's depth, metres (issue 3)."""
ON_MESH = ("on_mesh", "any_islands", "other_island")
"""Kinds of pairs whose ends both lie on Habitat's navmesh. For other ends Detour counts a point's own height above its
polygon, or clamps the point to it. The grid, whose floor lies up to 0.2 m lower, gives similar results there: they are
reported apart."""
DEPTH_BINS = 20_000
"""Depth errors are counted in bins of a micrometre, so that any number of images fits into memory; the last bin holds
everything from 20 mm."""
BOUNDS_TOLERANCE = 0.5
"""Largest distance between the bounds of a scan and of its navmesh, metres; 0 if Habitat built the navmesh itself."""
FLOATS = ("distance_to_goal", "spl", "soft_spl")
"""Measures that are compared as numbers."""

Rows = Iterator[tuple[str, float]]
"""Results one by one: the name of a figure, and whether a row agrees, or its error."""
Samples = dict[str, NDArray]
"""Results of each row, by name of a figure: booleans (agrees or not) or errors; `depth_*` are counts per bin."""


def samples_of(house: House) -> tuple[Samples, list[str]]:
    """The results of every row of a house, and the names of the parts that are not in the folder.

    Raises:
        SceneError: A file is damaged or contradicts another one.
    """
    missing: list[str] = []
    maps: dict[str, NavMesh] = {}
    for name in house.info.navmeshes:
        path = house.navmesh_file(name)
        if path is None:
            missing.append(name)
        else:
            maps[name] = load_navmesh(path)
    path = house.scene_file()
    mesh = _scene(path, house) if path else None
    parts = {
        "glb": mesh,
        "geodesic": (geodesic := house.part("geodesic", Geodesic)),
        "steps": (steps := house.part("steps", Steps)),
        "snap": (snap := house.part("snap", Snap)),
        "poses": (poses := house.part("poses", Poses)),
        "depth": (depth := house.depth(poses) if poses else None),
        "episodes": (episodes := house.part("episodes", Episodes)),
    }
    missing += [f"{house.name}.{name}" for name, part in parts.items() if part is None]
    _require_known_navmeshes(house, geodesic, (steps, snap, episodes))
    rows: list[Rows] = []
    if geodesic:
        rows.append(_geodesic(geodesic, maps))
    if steps and steps.navmesh in maps:
        rows.append(_steps(steps.steps, maps[steps.navmesh]))
    if snap and snap.navmesh in maps:
        rows.append(_snap(snap, maps[snap.navmesh]))
    if episodes and episodes.navmesh in maps:
        rows.append(_episodes(episodes.episodes, maps[episodes.navmesh]))
    if mesh:
        rows.append(_grid(mesh, house.info.navmeshes, geodesic.pairs if geodesic else ()))
    columns = defaultdict[str, list[float]](list)
    for name, value in itertools.chain.from_iterable(rows):
        columns[name].append(value)
    found = {name: np.array(values) for name, values in columns.items()}
    if mesh and poses and depth:
        found |= _depth(mesh, poses, *depth)
    return found, missing


def merged(samples: Sequence[Samples]) -> Samples:
    """The rows of all houses together."""
    names = dict.fromkeys(name for found in samples for name in found)
    every = {name: [found[name] for found in samples if name in found] for name in names}
    return {
        name: np.sum(arrays, axis=0) if name.startswith("depth_") else np.concatenate(arrays)
        for name, arrays in every.items()
    }


def _require_known_navmeshes(
    house: House, geodesic: Geodesic | None, parts: Sequence[Steps | Snap | Episodes | None]
) -> None:
    """Refuses rows on an unknown navmesh; rows on a known one that is not in the folder are only left out.

    Raises:
        SceneError: Rows name a navmesh that the info file does not know.
    """
    names = {part.navmesh for part in parts if part}
    if geodesic:
        names |= {row.navmesh for row in (*geodesic.pairs, *geodesic.multi_goal)}
    unknown = sorted(names - house.info.navmeshes.keys())
    if unknown:
        known = ", ".join(house.info.navmeshes) or "none"
        raise SceneError(
            f"{house.root}: rows of {house.name} name the navmesh {unknown[0]!r}; expected one of those in "
            f"{house.name}.info.json ({known}). Write the folder again with recordings/habitat_golden.py."
        )


def _scene(path: Path, house: House) -> TriangleMesh:
    """The scan in the world frame, turned as it was when Habitat built the navmeshes.

    Raises:
        SceneError: The file is damaged, or the navmeshes were built from another one.
    """
    mesh = load_glb(path, up="y")
    bounds = next((info.bounds for info in house.info.navmeshes.values() if info.bounds), None)
    if bounds is None:
        return mesh if house.info.up != "z" else load_glb(path, up="z")
    turned = {"y": mesh.vertices, "z": world_from_glb_zup(mesh.vertices)}
    apart = {up: float(np.abs([v.min(axis=0), v.max(axis=0)] - np.array(bounds)).max()) for up, v in turned.items()}
    best = house.info.up or min(apart, key=lambda up: apart[up])
    if apart[best] > BOUNDS_TOLERANCE:
        raise SceneError(
            f"{path}: its bounds are {apart[best]:.2f} m away from those in {house.name}.info.json; expected at most "
            f"{BOUNDS_TOLERANCE} m. Replace it with the scan from which the answers were made."
        )
    return mesh if best == "y" else load_glb(path, up="z")


def _geodesic(part: Geodesic, maps: dict[str, NavMesh]) -> Rows:
    """Whether our path is as long, in rows where Habitat finds one, and, in all rows, whether both find one."""
    ways = [("geodesic_within_1e_4", row.navmesh, row.start, [row.goal], row.distance) for row in part.pairs]
    ways += [
        ("reverse_within_1e_4", row.navmesh, row.goal, [row.start], row.reverse_distance)
        for row in part.pairs
        if row.reverse_distance is not None
    ]
    ways += [
        ("multi_goal_within_1e_4", row.navmesh, row.start, list(row.goals), row.distance) for row in part.multi_goal
    ]
    for name, navmesh, start, goals, theirs in ways:
        if navmesh not in maps:
            continue
        ours = _distance(maps[navmesh], start, goals)
        yield "reachability", math.isfinite(ours) == (theirs is not None)
        if theirs is not None:
            yield name, abs(ours - theirs) <= CLOSE


def _steps(rows: Sequence[StepRow], navmesh: NavMesh) -> Rows:
    """For rows that are not sensitive, whether the forward ends where Habitat's does, and collides as it does."""
    for row in rows:
        yield "sensitive", row.sensitive
        for prefix, theirs in (("", row.no_slide_le_0_3_3), ("slide_", row.slide)):
            if row.sensitive or theirs is None:
                continue
            start, end = np.array(row.start_used), np.array(row.requested_end)
            position, collided = navmesh.step(start, end, slide=prefix != "")
            yield f"{prefix}steps_within_1mm", math.dist(position, theirs.position) <= STEP_CLOSE
            yield f"{prefix or 'step_'}flags", collided == theirs.collided


def _snap(part: Snap, navmesh: NavMesh) -> Rows:
    """Whether points are moved and judged as Habitat does."""
    for row in part.queries:
        point = np.array(row.point)
        ours = navmesh.snap(point)
        is_close = ours is not None and row.snap is not None and math.dist(ours, row.snap) <= CLOSE
        yield "snap", is_close or (ours is None and row.snap is None)
        yield "navigable", navmesh.is_navigable(point) == row.is_navigable
        if row.is_navigable_dy_0_1 is not None:
            yield "navigable_dy_0_1", navmesh.is_navigable(point, max_dy=0.1) == row.is_navigable_dy_0_1
        if row.island_radius is not None:
            yield "island_radius", abs(navmesh.island_radius(point) - row.island_radius) <= CLOSE
        if row.distance_to_obstacle is not None:
            distance = navmesh.distance_to_obstacle(point, max_radius=part.obstacle_max_radius)
            yield "obstacle_distance", abs(distance - row.distance_to_obstacle) <= CLOSE


def _episodes(rows: Sequence[EpisodeRow], navmesh: NavMesh) -> Rows:
    """Agreement of the final measures of given trajectories, and of distance_to_goal at each of their rows.

    A float that is finite on one side only, or inf on one and nan on the other, is an error of inf. The same non-finite
    value on both sides is no error, and counts under `nonfinite_exact` alone.
    """
    for row in rows:
        positions = np.array([pose[:3] for pose in row.trajectory])
        distances = distances_to_goal(positions, row.goal_points, navigation=navmesh)
        ours = _measures(row, positions, distances)
        for name in ("success", "num_steps", "collisions"):
            yield f"{name}_exact", getattr(ours, name) == getattr(row.measures, name)
        for name in FLOATS:
            theirs, value = getattr(row.measures, name), getattr(ours, name)
            is_same_kind = _kind(value) == ("finite" if theirs is not None else row.nonfinite.get(name))
            yield "nonfinite_exact", is_same_kind
            if not is_same_kind or theirs is not None:
                yield "measures", abs(value - theirs) if is_same_kind else math.inf
        for distance, wanted in zip(distances, row.distance_after_step or (), strict=bool(row.distance_after_step)):
            is_close = math.isinf(distance) if wanted is None else abs(distance - wanted) <= CLOSE
            yield "distance_after_step_within_1e_4", bool(is_close)


def _measures(row: EpisodeRow, positions: NDArray[np.float64], distances: NDArray[np.float64]) -> HabitatMeasures:
    actions = [PAPER6[number] for number in row.actions]
    try:
        return habitat_measures(
            positions, actions, row.collided, distances=distances, success_distance=row.settings.success_distance
        )
    except ZeroDivisionError:  # habitat-lab has measures, so it saw a distance where we see none: nothing agrees
        return HabitatMeasures(math.nan, math.nan, math.nan, math.nan, len(actions), sum(row.collided))


def _grid(mesh: TriangleMesh, navmeshes: dict[str, NavmeshInfo], pairs: Sequence[Pair]) -> Rows:
    """Errors of our own grid, made from the mesh alone for each navmesh's robot, in Habitat's distances and areas."""
    for name, info in navmeshes.items():
        radius, height = round(info.settings.agent_radius, 4), round(info.settings.agent_height, 4)
        grid = floor_grid_from_mesh(mesh, radius=radius, height=height)
        yield "grid_area", abs(grid.surface_area / info.navigable_area - 1)
        for row in pairs:
            if row.navmesh != name:
                continue
            ours, theirs = _distance(grid, row.start, [row.goal]), row.distance
            kind = "grid" if row.kind in ON_MESH else "grid_off_mesh"
            yield f"{kind}_reachability", math.isfinite(ours) == (theirs is not None)
            if math.isfinite(ours) and theirs:
                yield kind, ours / theirs - 1


def _depth(mesh: TriangleMesh, poses: Poses, images: NDArray[np.uint16], scale_m: float) -> Samples:
    """Counts of errors per micrometre where both see something, and of pixels where only one does."""
    camera = Camera(poses.width, poses.height, poses.hfov_deg, mount_height=poses.sensor_offset[1])
    raycaster = Raycaster(mesh)
    bins, single = np.zeros(DEPTH_BINS, np.int64), 0
    for row, image in zip(poses.poses, images, strict=True):
        pose = Pose(row.body_position, row.yaw, math.radians(row.tilt_deg))
        ours = raycaster.render(T_world_camera(pose, camera), camera).depth_m.astype(np.float64)
        theirs = image * scale_m
        ours[ours > np.iinfo(np.uint16).max * scale_m] = 0.0  # too far to be stored
        both = (ours > 0) & (theirs > 0)
        micrometres = np.minimum(np.abs(ours - theirs)[both] * 1e6, DEPTH_BINS - 1).astype(np.int64)
        bins += np.bincount(micrometres, minlength=DEPTH_BINS)
        single += int(np.count_nonzero((ours > 0) != (theirs > 0)))
    return {"depth_bins": bins, "depth_single": np.array([single])}


def _distance(navigation: NavigationMap, start: Sequence[float], goals: Sequence[Sequence[float]]) -> float:
    return float(navigation.distances(np.array([start]), np.array(goals))[0])


def _kind(value: float) -> str:
    return "finite" if math.isfinite(value) else "nan" if math.isnan(value) else "inf"
