"""Compares one house of a golden folder with our navigation, depth and measures, row by row; agreement.py counts."""

import math
from collections.abc import Sequence
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

from .golden import EpisodeRow, Episodes, Geodesic, House, NavmeshInfo, Pair, Poses, Snap, StepEnd, StepRow, Steps
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
    found: Samples = {}
    if geodesic:
        found |= _geodesic(geodesic, maps)
    if steps and steps.navmesh in maps:
        found |= _steps(steps.steps, maps[steps.navmesh])
    if snap and snap.navmesh in maps:
        found |= _snap(snap, maps[snap.navmesh])
    if episodes and episodes.navmesh in maps:
        found |= _episodes(episodes.episodes, maps[episodes.navmesh])
    if mesh:
        found |= _grid(mesh, house.info.navmeshes, geodesic.pairs if geodesic else ())
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
            f"{BOUNDS_TOLERANCE} m. Put the scan there that the answers were made with."
        )
    return mesh if best == "y" else load_glb(path, up="z")


def _geodesic(part: Geodesic, maps: dict[str, NavMesh]) -> Samples:
    """Whether ours is as long in rows where Habitat finds a way, and, in all rows, whether both find one."""
    ways = [("geodesic_within_1e_4", row.navmesh, row.start, [row.goal], row.distance) for row in part.pairs]
    ways += [
        ("reverse_within_1e_4", row.navmesh, row.goal, [row.start], row.reverse_distance)
        for row in part.pairs
        if row.reverse_distance is not None
    ]
    ways += [
        ("multi_goal_within_1e_4", row.navmesh, row.start, list(row.goals), row.distance) for row in part.multi_goal
    ]
    names = ("geodesic_within_1e_4", "reverse_within_1e_4", "multi_goal_within_1e_4")
    close: dict[str, list[bool]] = {name: [] for name in names}
    reachable = []
    for kind, navmesh, start, goals, theirs in ways:
        if navmesh not in maps:
            continue
        ours = _distance(maps[navmesh], start, goals)
        reachable.append(math.isfinite(ours) == (theirs is not None))
        if theirs is not None:
            close[kind].append(abs(ours - theirs) <= CLOSE)
    return _filled({**close, "reachability": reachable})


def _steps(rows: Sequence[StepRow], navmesh: NavMesh) -> Samples:
    """For rows that are not sensitive, whether the forward ends where Habitat's does, and collides as it does."""
    steps, flags, slides, slide_flags = [], [], [], []
    for row in rows:
        if row.sensitive:
            continue
        for wanted, slide, ends, same in (
            (row.no_slide_le_0_3_3, False, steps, flags),
            (row.slide, True, slides, slide_flags),
        ):
            if wanted is not None:
                agrees = _step_agrees(navmesh, row, wanted, slide=slide)
                ends.append(agrees[0])
                same.append(agrees[1])
    return {
        **_filled(
            {
                "steps_within_1mm": steps,
                "step_flags": flags,
                "slide_steps_within_1mm": slides,
                "slide_flags": slide_flags,
            }
        ),
        "sensitive": np.array([row.sensitive for row in rows], bool),
    }


def _step_agrees(navmesh: NavMesh, row: StepRow, wanted: StepEnd, *, slide: bool) -> tuple[bool, bool]:
    position, collided = navmesh.step(np.array(row.start_used), np.array(row.requested_end), slide=slide)
    return math.dist(position, wanted.position) <= STEP_CLOSE, collided == wanted.collided


def _snap(part: Snap, navmesh: NavMesh) -> Samples:
    found: dict[str, list[bool]] = {
        name: [] for name in ("snap", "navigable", "navigable_dy_0_1", "island_radius", "obstacle_distance")
    }
    for row in part.queries:
        point = np.array(row.point)
        ours = navmesh.snap(point)
        same = (ours is None) == (row.snap is None)
        found["snap"].append(same and (ours is None or row.snap is None or math.dist(ours, row.snap) <= CLOSE))
        found["navigable"].append(navmesh.is_navigable(point) == row.is_navigable)
        if row.is_navigable_dy_0_1 is not None:
            found["navigable_dy_0_1"].append(navmesh.is_navigable(point, max_dy=0.1) == row.is_navigable_dy_0_1)
        if row.island_radius is not None:
            found["island_radius"].append(abs(navmesh.island_radius(point) - row.island_radius) <= CLOSE)
        if row.distance_to_obstacle is not None:
            distance = navmesh.distance_to_obstacle(point, max_radius=part.obstacle_max_radius)
            found["obstacle_distance"].append(abs(distance - row.distance_to_obstacle) <= CLOSE)
    return _filled(found)


def _episodes(rows: Sequence[EpisodeRow], navmesh: NavMesh) -> Samples:
    """Agreement of the final measures of given trajectories, and of distance_to_goal at each of their rows.

    A float that is finite on one side only, or inf on one and nan on the other, is an error of inf. The same non-finite
    value on both sides is no error, and counts under `nonfinite_exact` alone.
    """
    errors: list[float] = []
    exact: dict[str, list[bool]] = {
        name: []
        for name in (
            "success_exact",
            "num_steps_exact",
            "collisions_exact",
            "nonfinite_exact",
            "distance_after_step_within_1e_4",
        )
    }
    for row in rows:
        positions = np.array([pose[:3] for pose in row.trajectory])
        distances = distances_to_goal(positions, row.goal_points, navigation=navmesh)
        ours = _measures(row, positions, distances)
        exact["success_exact"].append(ours.success == row.measures.success)
        exact["num_steps_exact"].append(ours.num_steps == row.measures.num_steps)
        exact["collisions_exact"].append(ours.collisions == row.measures.collisions)
        for name in FLOATS:
            theirs, value = getattr(row.measures, name), getattr(ours, name)
            is_same_kind = _kind(value) == ("finite" if theirs is not None else row.nonfinite.get(name))
            exact["nonfinite_exact"].append(is_same_kind)
            if not is_same_kind:
                errors.append(math.inf)
            elif theirs is not None:
                errors.append(abs(value - theirs))
        for distance, wanted in zip(distances, row.distance_after_step or (), strict=bool(row.distance_after_step)):
            exact["distance_after_step_within_1e_4"].append(
                math.isinf(distance) if wanted is None else bool(abs(distance - wanted) <= CLOSE)
            )
    return {**_filled(exact), "measures": np.array(errors)}


def _measures(row: EpisodeRow, positions: NDArray[np.float64], distances: NDArray[np.float64]) -> HabitatMeasures:
    actions = [PAPER6[number] for number in row.actions]
    try:
        return habitat_measures(
            positions, actions, row.collided, distances=distances, success_distance=row.settings.success_distance
        )
    except ZeroDivisionError:  # habitat-lab has measures, so it saw a distance where we see none: nothing agrees
        return HabitatMeasures(math.nan, math.nan, math.nan, math.nan, len(actions), sum(row.collided))


def _grid(mesh: TriangleMesh, navmeshes: dict[str, NavmeshInfo], pairs: Sequence[Pair]) -> Samples:
    """Errors of our own grid, made from the mesh alone for each navmesh's robot, in Habitat's distances and areas."""
    areas, errors, apart, reachable, reachable_apart = [], [], [], [], []
    for name, info in navmeshes.items():
        radius, height = round(info.settings.agent_radius, 4), round(info.settings.agent_height, 4)
        grid = floor_grid_from_mesh(mesh, radius=radius, height=height)
        areas.append(abs(grid.surface_area / info.navigable_area - 1))
        for row in pairs:
            if row.navmesh != name:
                continue
            ours, theirs = _distance(grid, row.start, [row.goal]), row.distance
            is_on_mesh = row.kind in ON_MESH
            (reachable if is_on_mesh else reachable_apart).append(math.isfinite(ours) == (theirs is not None))
            if math.isfinite(ours) and theirs:
                (errors if is_on_mesh else apart).append(ours / theirs - 1)
    return {
        **_filled({"grid_reachability": reachable, "grid_off_mesh_reachability": reachable_apart}),
        **{
            name: np.array(values, float)
            for name, values in (("grid_area", areas), ("grid", errors), ("grid_off_mesh", apart))
            if values
        },
    }


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


def _filled(rows: dict[str, list[bool]]) -> Samples:
    """Arrays of the figures that have at least one row."""
    return {name: np.array(values, bool) for name, values in rows.items() if values}
