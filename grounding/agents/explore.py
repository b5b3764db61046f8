"""Explores one storey of a home, and renders the pictures of an exploration's poses again.

Scene + start -> `FrontierExplorer` in a `PanEnv`, with depth alone -> `Exploration` -> file (exploration.py), or
`Frame`s for maps.
"""

import zlib
from collections.abc import Callable, Iterator, Sequence
from typing import TypedDict

import numpy as np

from sim.errors import SceneError
from sim.frames import T_world_camera
from sim.homes.plan import HomePlan
from sim.mesh import Scene
from sim.tasks.observers import Insight
from sim.tasks.pan import PanEnv
from sim.tasks.run_files import Step
from sim.types import PAPER6, Action, Camera, Frame, Pose, Task

from .coverage import FLOOR_BAND, CoverageTracker, VisibleFloor
from .exploration import Exploration as Exploration
from .frontier import MAX_STEPS, FrontierExplorer
from .rooms_found import RoomMap

EXPLORER_VERSION = "4"
"""Increase it whenever the explorer's starts or ways change, or the coverage, doors and rooms in its files."""

TASK = Task("pan", description="", queries=("explore",), max_steps=MAX_STEPS, actions=PAPER6)
"""The explorer's task, which tells it nothing."""
_STARTS_TRIED = 200
_MAIN_PART = 0.5
"""A start lies on a connected part of the storey with more than this share of its free cells."""
OnStep = Callable[[Step | None, Insight | None], None]


def start_on_storey(scene: Scene, storey_y: float, seed: int) -> Pose:
    """A seeded place and direction on the largest connected part of a storey's floor; beds and stairs are left out.

    Raises:
        SceneError: The storey has no floor, or none of the drawn places is on its largest part.
    """
    rng = np.random.default_rng([seed, zlib.crc32(scene.name.encode()), round(1000 * abs(storey_y))])
    for _ in range(_STARTS_TRIED):
        place = scene.navigation.random_point(rng, storey_y=storey_y)
        yaw = float(rng.uniform(-np.pi, np.pi))
        if abs(place[1] - storey_y) >= FLOOR_BAND:
            continue
        floor = VisibleFloor(scene.navigation, place)
        if abs(floor.storey_y - storey_y) < FLOOR_BAND and floor.reachable.sum() > _MAIN_PART * floor.free.sum():
            return Pose((float(place[0]), float(place[1]), float(place[2])), yaw)
    raise SceneError(
        f"{scene.name}: {_STARTS_TRIED} places drawn on the storey at {storey_y:.2f} m, none on a part with "
        f"{_MAIN_PART:.0%} of its floor; expected one. Give another storey or --seed."
    )


def explore(
    scene: Scene,
    start: Pose,
    *,
    seed: int = 0,
    max_steps: int = MAX_STEPS,
    camera: Camera = Camera(),  # noqa: B008 - frozen value
    plan: HomePlan | None = None,
    on_step: OnStep | None = None,
) -> Exploration:
    """Explores the start's storey; the same arguments give the same exploration.

    Args:
        start: First pose; `start_on_storey` draws one.
        camera: The robot's camera; a smaller picture with the same field of view is faster and shows less far away.
        plan: The home's plan, for rooms and doors; None leaves them out.
        on_step: Gets the first view (step None) and every step; it changes nothing.

    Raises:
        SceneError: The start is on no floor.
    """
    from sim.render.raycast import Raycaster

    floor = VisibleFloor(scene.navigation, np.array(start.position))
    tracker, raycaster = CoverageTracker(floor), Raycaster(scene.mesh)
    env = PanEnv(start, scene.navigation, renderer=raycaster, camera=camera, colours=False, max_steps=max_steps)
    agent = FrontierExplorer(max_steps=max_steps)
    observation = env.reset()
    agent.reset(TASK, camera, seed=seed)
    coverage: list[float] = []
    while True:
        assert observation.depth_m is not None
        tracker.add(observation.depth_m, T_world_camera(env.pose, camera), camera)
        coverage.append(round(tracker.coverage, 4))
        if on_step is not None:
            on_step(env.steps[-1] if env.steps else None, agent.insight() if env.steps else None)
        if env.is_over:
            break
        observation = env.step(agent.act(observation))
    return Exploration(
        scene=scene.name,
        scene_kind=scene.kind,
        scene_digest=scene.digest,
        seed=seed,
        camera=camera,
        start=start,
        storey_y=floor.storey_y,
        steps=env.steps,
        stop_reason=agent.stop_reason or "steps",
        policy=EXPLORER_VERSION,
        coverage=tuple(coverage),
        area_m2=round(float(floor.visible.sum()) * floor.grid.cell**2, 2),
        **_room_figures(plan, floor, tracker, env.poses),
    )


class _RoomFigures(TypedDict, total=False):
    """The figures that a plan adds to an exploration; empty without a plan."""

    doors_passed: int
    num_doors: int
    rooms_missed: tuple[str, ...]


def _room_figures(
    plan: HomePlan | None, floor: VisibleFloor, tracker: CoverageTracker, poses: Sequence[Pose]
) -> _RoomFigures:
    if plan is None:
        return {}
    rooms, path = RoomMap(plan, floor), np.array([pose.position for pose in poses])
    return {
        "doors_passed": rooms.doors_passed(path),
        "num_doors": rooms.num_doors,
        "rooms_missed": rooms.missed(tracker.seen, path),
    }


def frames_of(
    scene: Scene,
    exploration: Exploration,
    *,
    camera: Camera = Camera(),  # noqa: B008 - frozen value
    every: int = 1,
) -> Iterator[Frame]:
    """The views of an exploration in the world frame, rendered again with colours and instance ids.

    Args:
        exploration: Gives the poses. The pose after STOP is left out: it equals the one before.
        camera: Camera of the pictures; it may differ from the agent's.
        every: Every n-th pose is used, beginning with the first.

    Raises:
        SceneError: The exploration was made in another home.
    """
    from sim.homes.renderers import raycaster_of

    if (scene.name, scene.digest) != (exploration.scene, exploration.scene_digest):
        raise SceneError(
            f"exploration: made in {exploration.scene} ({exploration.scene_digest[:12]}), found {scene.name} "
            f"({scene.digest[:12]}); expected the same home. Explore again, or open the home it was made in."
        )
    raycaster = raycaster_of(scene)
    is_stopped = bool(exploration.steps) and exploration.steps[-1].action is Action.STOP
    poses = exploration.poses[:-1] if is_stopped else exploration.poses
    for pose in poses[::every]:
        yield raycaster.render(T_world_camera(pose, camera), camera)
