"""The benchmark's navigation and environment figures on one mesh."""

import time

import numpy as np
from numpy.typing import NDArray

from sim.mesh import TriangleMesh
from sim.render.renderer import Renderer
from sim.tasks.pan import PanEnv
from sim.types import Action, Camera, Pose
from sim.walk.floor_grid import floor_grid_from_mesh
from sim.walk.navigation_map import NavigationMap

from ..harness import interleaved

_WALK = 20
"""Number of steps from one start point before the next."""
_MOVES = (Action.FORWARD, Action.LEFT, Action.RIGHT, Action.LOOK_UP, Action.LOOK_DOWN)


def navigation_figures(
    mesh: TriangleMesh, navigation: NavigationMap, *, seed: int, builds: int = 3, goals: int = 8
) -> dict[str, float]:
    """Speed of making and querying a robot's map of one mesh: `query_figures`, and `build_s` in CPU seconds.

    Args:
        mesh: The mesh, world frame.
        navigation: Its `floor_grid_from_mesh`, made before, so that compiled code is ready.
        seed: Seed of the places.
        builds: How many times the map is made again.
        goals: Number of different goals; each is queried from twenty starts.
    """
    build = interleaved({"build": lambda _: floor_grid_from_mesh(mesh)}, calls=builds, warm_ups=0)["build"]
    return {"build_s": build.core_s, **query_figures(navigation, seed=seed, goals=goals)}


def query_figures(navigation: NavigationMap, *, seed: int, goals: int) -> dict[str, float]:
    """Median CPU times of queries for `goals` different random goals, each queried from twenty starts.

    Returns:
        `field_ms` of one `distances` to a new goal; `path_us` of one `shortest_path` with the goal's field ready, for
        goals that can be reached.
    """
    rng = np.random.default_rng(seed)
    points = [navigation.random_point(rng)[None] for _ in range(goals + 1)]
    starts = np.stack([navigation.random_point(rng) for _ in range(20)])
    navigation.distances(starts, points[-1])  # compiled code is ready after this
    navigation.shortest_path(starts[0], points[-1])
    field_s, path_s = [], []
    for goal in points[:-1]:
        before = time.process_time()
        navigation.distances(starts[:1], goal)
        field_s.append(time.process_time() - before)
        for k in np.flatnonzero(np.isfinite(navigation.distances(starts, goal))):
            before = time.process_time()
            navigation.shortest_path(starts[k], goal)
            path_s.append(time.process_time() - before)
    return {"path_us": float(np.median(path_s)) * 1e6, "field_ms": float(np.median(field_s)) * 1e3}


def camera_starts(navigation: NavigationMap, num: int, *, seed: int) -> list[Pose]:
    """Robot poses at random places of all storeys in turn, looking anywhere along the floor."""
    rng = np.random.default_rng(seed)
    heights = navigation.storey_heights
    poses = []
    for k in range(num):
        x, y, z = (float(value) for value in navigation.random_point(rng, storey_y=heights[k % len(heights)]))
        poses.append(Pose((x, y, z), float(rng.uniform(-np.pi, np.pi))))
    return poses


def env_steps_per_s(
    navigation: NavigationMap, renderer: Renderer | None, *, camera: Camera, num_steps: int, seed: int
) -> float:
    """Steps per elapsed second of one `PanEnv` under random moves, median over walks of twenty steps.

    Args:
        navigation: The map on which the robot walks.
        renderer: Renders the observations; None = without pictures.
        camera: Camera of the observations.
        num_steps: Total number of steps, rounded up to whole walks; one more walk comes first and is not counted.
        seed: Seed of starts and moves.
    """
    rng = np.random.default_rng(seed)
    walks = camera_starts(navigation, -(-num_steps // _WALK) + 1, seed=seed)
    elapsed: list[float] = []
    for start in walks:
        env = PanEnv(start, navigation, renderer=renderer, camera=camera)
        env.reset()
        moves: NDArray[np.int64] = rng.integers(len(_MOVES), size=_WALK)
        before = time.perf_counter()
        for move in moves:
            env.step(_MOVES[move])
        elapsed.append(time.perf_counter() - before)
    return _WALK / float(np.median(elapsed[1:]))
