"""Small datasets whose episodes other simulators ran, for tests of the import."""

import math
from pathlib import Path
from typing import Any

from sim.episodes.dataset import PersonalDataset

from . import synthetic
from .synthetic import example_content, example_episode, example_goal, example_view_point

Rows = list[dict[str, Any]]


def quat(yaw_deg: float) -> list[float]:
    half = math.radians(yaw_deg) / 2
    return [0.0, math.sin(half), 0.0, math.cos(half)]


def write_dataset(root: Path, scene: str, episodes: Rows) -> PersonalDataset:
    """A dataset of one scene; each row has id, start, rotation, goals (see `goal_row`)."""
    records = [
        example_episode(
            scene=scene,
            episode_id=row["id"],
            object_category="thing",
            object_id=[goal["object_name"] for goal in row["goals"]],
            description=[["a thing"] for _ in row["goals"]],
            start_position=row["start"],
            start_rotation=row["rotation"],
        )
        for row in episodes
    ]
    goals = {f"{scene}.basis.glb_thing": [goal for row in episodes for goal in row["goals"]]}
    content = example_content(scene=scene, episodes=records, goals_by_category=goals)
    return PersonalDataset(synthetic.write_dataset(root, {("easy", scene): content}))


def goal_row(name: str, position: list[float], view_points: list[list[float]]) -> dict[str, Any]:
    points = [example_view_point(x, z, y=y, quat_xyzw=[0, 0, 0, 1], iou=0.5) for x, y, z in view_points]
    return example_goal(position=position, object_id=1, object_name=name, object_category="thing", view_points=points)


def two_starts(root: Path, start: tuple[float, float, float], *, yaws_deg: tuple[float, float]) -> PersonalDataset:
    """Two episodes of scene Flat, 40 and 41, that start at one place with these yaws."""
    rows = [
        {
            "id": str(number),
            "start": start,
            "rotation": quat(yaw_deg),
            "goals": [goal_row(f"thing_{number}", [1.0, 0.5, -6.0], [[1.0, 0.2, -5.0]])],
        }
        for number, yaw_deg in enumerate(yaws_deg, start=40)
    ]
    return write_dataset(root, "Flat", rows)
