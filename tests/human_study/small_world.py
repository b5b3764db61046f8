"""A square room with one wall whose distances are known exactly, an episode in it, and a study about it."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from human_study.design.plan import StudyPlan, StudyScene
from human_study.design.planning import make_plan
from human_study.design.study import StudyConfig
from sim.episodes.schema import AgentState, Episode, EpisodeInfo, EpisodeRecord, Goal, ViewPoint
from sim.render.renderer import Hits
from sim.tasks.pan import PanEnv
from sim.types import Camera, EpisodeKey, Frame, GridSpec
from sim.walk.navigation_map import StepResult, TopDown

HALF = 3.0
"""The room is [-HALF, HALF] in x and z, metres."""
WALL_Z = -0.9
WALL_END = 1.0
"""A thin wall at z = WALL_Z from x = -WALL_END to WALL_END."""
GAP = 0.001
"""Distance from a wall at which a walk ends, metres."""
CANARY = "CANARY"
"""Part of every ground-truth text of the episode."""
SCENE_DIGEST = "d" * 64
CAMERA = Camera(width=16, height=12)


class SquareRoom:
    """NavigationMap of the room."""

    storey_heights = (0.0,)

    def snap(self, point: NDArray[np.float64]) -> NDArray[np.float64] | None:
        inside = np.clip(np.asarray(point, float), -HALF, HALF)
        inside[1] = 0.0
        return inside

    def is_navigable(self, point: NDArray[np.float64], *, max_dy: float = 0.5) -> bool:
        return bool(max(abs(point[0]), abs(point[2])) <= HALF and abs(point[1]) <= max_dy)

    def step(self, start: NDArray[np.float64], end: NDArray[np.float64], *, slide: bool = False) -> StepResult:
        assert not slide
        wanted = math.dist(start, end)
        reach = 1.0
        for axis in (0, 2):
            if abs(end[axis]) > HALF:
                bound = math.copysign(HALF, end[axis])
                reach = min(reach, (bound - start[axis]) / (end[axis] - start[axis]))
        if crosses_wall(start, end):
            reach = min(reach, max(0.0, (abs(WALL_Z - start[2]) - GAP) / abs(end[2] - start[2])))
        position = np.asarray(start) + reach * (np.asarray(end) - np.asarray(start))
        moved = math.dist(start, position)
        x, y, z = position
        return StepResult((float(x), float(y), float(z)), moved**2 + 1e-5 < wanted**2)

    def distances(self, starts: NDArray[np.float64], goals: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.array([min(_distance(start, goal) for goal in goals) for start in starts])

    def shortest_path(self, start: NDArray[np.float64], goals: NDArray[np.float64]) -> NDArray[np.float64] | None:
        goal = min(goals, key=lambda point: _distance(start, point))
        if not crosses_wall(start, goal):
            return np.array([start, goal])
        corner = min(_corners(), key=lambda point: math.dist(start, point) + math.dist(point, goal))
        return np.array([start, corner, goal])

    def points_within(self, centres: NDArray[np.float64], radius: float, *, max_dy: float) -> NDArray[np.float64]:
        axis = np.arange(-60, 61) / 20.0
        x, z = np.meshgrid(axis, axis)
        points = np.stack([x.ravel(), np.zeros(x.size), z.ravel()], axis=1)
        near = [
            np.hypot(points[:, 0] - centre[0], points[:, 2] - centre[2]) <= radius + 1e-9
            for centre in centres
            if abs(centre[1]) <= max_dy
        ]
        return points[np.any(near, axis=0)] if near else np.empty((0, 3))

    def random_point(self, rng: np.random.Generator, *, storey_y: float | None = None) -> NDArray[np.float64]:
        return np.array([rng.uniform(-HALF, HALF), 0.0, rng.uniform(-HALF, HALF)])

    def top_down(self, storey_y: float) -> TopDown:
        return TopDown(np.ones((60, 60), bool), GridSpec((-HALF, -HALF), 0.1, (60, 60)), 0.0)


class PoseColours:
    """Renderer whose pictures tell poses apart."""

    def render(self, T_world_camera: NDArray[np.float64], camera: Camera) -> Frame:
        shape = (camera.height, camera.width)
        colour = np.round(np.abs(T_world_camera[[0, 2, 0], [3, 3, 2]]) * 50).astype(np.uint8)
        rgb = np.broadcast_to(colour, (*shape, 3)).copy()
        return Frame(rgb, np.ones(shape, np.float32), T_world_camera, camera, np.zeros(shape, np.int32))

    def depth(self, T_world_camera: NDArray[np.float64], camera: Camera) -> NDArray[np.float32]:
        return self.render(T_world_camera, camera).depth_m

    def cast(self, origins: NDArray[np.float64], directions: NDArray[np.float64]) -> Hits:
        count = len(origins)
        return Hits(np.full(count, np.inf), np.full((count, 3), np.nan), np.full(count, -1, np.int64))


def episode(episode_id: str = "0") -> Episode:
    """Start at the origin facing -z; target at (-2, 0.5, 0), its one view point at (-1.25, 0, 0)."""
    seen_from = AgentState(position=(-1.25, 0.0, 0.0), rotation=(0.0, 0.0, 0.0, 1.0))
    goal = Goal(
        position=(-2.0, 0.5, 0.0),
        object_id=7,
        object_name=f"{CANARY} lamp_7",
        object_category=f"{CANARY} category",
        floor_id=f"{CANARY} floor",
        view_points=(ViewPoint(agent_state=seen_from, iou=1.0),),
    )
    record = EpisodeRecord(
        episode_id=episode_id,
        scene_id="x/room.basis.glb",
        scene_dataset_config="",
        object_category=goal.object_category,
        object_id=goal.object_name,
        description=(f"{CANARY} caption",),
        owner=f"{CANARY} owner",
        floor_id=goal.floor_id,
        summary="Somebody owns something.",
        extracted_summary=(f"{CANARY} edge",),
        query=("Find somebody's thing.", "Where is it?"),
        start_position=(0.0, 0.0, 0.0),
        start_rotation=(0.0, 0.0, 0.0, 1.0),
        info=EpisodeInfo(geodesic_distance=1.25, euclidean_distance=2.0, closest_goal_object_id=7),
    )
    return Episode(EpisodeKey("easy", "room", episode_id), record, (goal,))


ROOM = StudyScene(name="room", kind="invented")
"""The room as a home of the study."""


FILLED = {
    "ethics": {
        "irb": "2026-17",
        "institution": "The University of Anywhere",
        "contact": "study@anywhere.example",
        "pay": "You get 12 EUR.",
        "pay_if_leaving": "If you stop early, you get 4 EUR for each quarter of an hour.",
        "insurance": "You are insured against accidents by the university.",
        "data_protection_officer": "dpo@anywhere.example",
        "legal_basis": "your consent, Art. 6 (1) (a) GDPR",
        "complaint_body": "the Data Protection Authority of Anywhere",
        "duration_min": 45,
    },
    "privacy": {"retention": "2027-12-31"},
    "smallest_effect": 10.0,
    "sample_size_reason": "Power of 0.9 for 15 points.",
}
"""Fields of a study file that fill every place in the texts."""


def paged_study(**changes: object) -> StudyConfig:
    """A small study with all pages."""
    return study(**({"flow": ("device", "consent", "instructions", "quiz")} | changes))


def study(**changes: object) -> StudyConfig:
    """A small study in the room: everybody does everything, no pages before the trials."""
    values = {
        "study": "pilot",
        "dataset": {"sha256": "0" * 64},
        "task": ("pog", "pan"),
        "design": {"kind": "crossed", "raters_per_episode": 1},
        "pog": {"conditions": ("map_open",)},
        "flow": ("instructions",),
        "practice": {"pan": 0, "pog": 0},
        "checks": {"every": None},
    }
    return StudyConfig.model_validate(values | changes)


def plan(config: StudyConfig, episode_ids: Sequence[str] = ("0", "1", "2")) -> StudyPlan:
    """p01 points, p02 walks."""
    return make_plan(config, [ROOM], [episode(name).key for name in episode_ids])


def env(*, max_steps: int = 500, with_pictures: bool = False) -> PanEnv:
    """The episode's environment."""
    renderer = PoseColours() if with_pictures else None
    return PanEnv(episode().start, SquareRoom(), renderer=renderer, camera=CAMERA, max_steps=max_steps)


def crosses_wall(a: NDArray[np.float64], b: NDArray[np.float64]) -> bool:
    """Whether the straight line from a to b meets the wall."""
    if (a[2] - WALL_Z) * (b[2] - WALL_Z) > 0 or a[2] == b[2]:
        return False
    x = a[0] + (WALL_Z - a[2]) / (b[2] - a[2]) * (b[0] - a[0])
    return bool(abs(x) < WALL_END)


def _distance(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    if not crosses_wall(a, b):
        return math.dist(a, b)
    return min(math.dist(a, corner) + math.dist(corner, b) for corner in _corners())


def _corners() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    return np.array([-WALL_END, 0.0, WALL_Z]), np.array([WALL_END, 0.0, WALL_Z])
