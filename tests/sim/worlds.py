"""Small worlds and episodes with known answers, for tests of the tasks."""

from typing import Any

import numpy as np

from sim.episodes.schema import AgentState, Episode, EpisodeInfo, EpisodeRecord, Goal, ViewPoint
from sim.frames import quat_xyzw_from_yaw
from sim.tasks.run_files import Measures, RuleMeasures, RunInfo
from sim.types import EpisodeKey
from sim.walk.floor_grid import FloorGrid

from .grids import grid_of


def open_room() -> FloorGrid:
    """Free floor for x and z in [0, 6)."""
    return grid_of(size=6.0)


def room_with(free) -> FloorGrid:
    """The part of the open room where `free` is true: xz (N, 2) -> (N,) bool."""
    return grid_of(lambda x, z: free(np.stack([x, z], axis=1)), size=6.0)


def view_point(position: tuple[float, float, float], *, iou: float | None = 0.5) -> ViewPoint:
    """A view point that faces -z."""
    return ViewPoint(agent_state=AgentState(position=position, rotation=quat_xyzw_from_yaw(0.0)), iou=iou)


def goal(position: tuple[float, float, float], view_points: tuple[ViewPoint, ...], *, name: str = "chair_1") -> Goal:
    """A goal object."""
    return Goal(
        position=position,
        object_id=int(name.rsplit("_", 1)[1]),
        object_name=name,
        object_category=name.rsplit("_", 1)[0],
        floor_id="0",
        view_points=view_points,
    )


def episode(
    *targets: Goal, start: tuple[float, float, float] = (1.0, 0.0, 1.0), yaw: float = 0.0, geodesic: float = 3.0
) -> Episode:
    """An episode of scene Demo with these targets."""
    record = EpisodeRecord(
        episode_id="1",
        scene_id="invented/Demo/Demo.basis.glb",
        scene_dataset_config="none",
        object_category=targets[0].object_category,
        object_id=tuple(target.object_name for target in targets) if len(targets) > 1 else targets[0].object_name,
        captions=tuple(("CAPTION-CANARY", "", "") for _ in targets) if len(targets) > 1 else ("CAPTION-CANARY", "", ""),
        owner="Ada",
        floor_id="0",
        summary="Ada owns the green chair.",
        extracted_summary=("Ada owns EXTRACTED-CANARY in the hall",),
        query=("Find Ada's chair",),
        start_position=start,
        start_rotation=quat_xyzw_from_yaw(yaw),
        info=EpisodeInfo(geodesic_distance=geodesic, euclidean_distance=2.0, closest_goal_object_id=1),
    )
    return Episode(EpisodeKey("easy", "Demo", "1"), record, tuple(targets))


def run_info(run_id: str, /, **changes: object) -> RunInfo:
    """`run.json` of an agent's run in an invented home."""
    values = {
        "run_id": run_id,
        "who": run_id,
        "who_kind": "agent",
        "scene_kind": "invented",
        "dataset_digest": "d",
        "created_utc": "2026-01-01T00:00:00+00:00",
    }
    return RunInfo.model_validate(values | changes)


def measured(rule: RuleMeasures, **changes: Any) -> Measures:
    """Measures of a run of two steps: `rule` under every rule except `habitat`, which is undefined."""
    values = {
        "rules": {"paper": rule, "habitat": None, "authors": rule, "paper-strict": rule},
        "centre_distance": 0.5,
        "path_m": 4.0,
        "num_steps": 2,
        "collisions": 0,
        "stored_geodesic": 2.0,
        "scene_digest": "s",
    }
    return Measures(**values | changes)
