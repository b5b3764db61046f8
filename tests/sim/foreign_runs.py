"""Small datasets and rows as another simulator writes them, for tests of the import."""

import gzip
import json
import math
from pathlib import Path
from typing import Any

from sim.episodes.dataset import PersonalDataset

Rows = list[dict[str, Any]]


def quat(yaw_deg: float) -> list[float]:
    half = math.radians(yaw_deg) / 2
    return [0.0, math.sin(half), 0.0, math.cos(half)]


def write_dataset(root: Path, scene: str, episodes: Rows, *, split: str = "easy") -> PersonalDataset:
    """A dataset of one scene; each row has id, start, rotation, goals (name, position, view_points)."""
    goals = {f"{scene}.basis.glb_thing": [goal for row in episodes for goal in row["goals"]]}
    records = [
        {
            "episode_id": row["id"],
            "scene_id": f"made/{scene}/{scene}.basis.glb",
            "scene_dataset_config": "",
            "object_category": "thing",
            "object_id": [goal["object_name"] for goal in row["goals"]],
            "description": [["a thing"] for _ in row["goals"]],
            "owner": "Nell",
            "floor_id": "0",
            "summary": "Nell owns things.",
            "extracted_summary": [],
            "query": ["Find it."],
            "start_position": row["start"],
            "start_rotation": row["rotation"],
            "info": {"geodesic_distance": 1.0, "euclidean_distance": 1.0, "closest_goal_object_id": 0},
        }
        for row in episodes
    ]
    content = {
        "goals_by_category": goals,
        "episodes": records,
        "category_to_task_category_id": {},
        "category_to_scene_annotation_category_id": {},
    }
    path = root / split / "content" / f"{scene}.json.gz"
    path.parent.mkdir(parents=True)
    path.write_bytes(gzip.compress(json.dumps(content).encode()))
    return PersonalDataset(root)


def goal_row(name: str, position: list[float], view_points: list[list[float]]) -> dict[str, Any]:
    points = [{"agent_state": {"position": point, "rotation": [0, 0, 0, 1]}, "iou": 0.5} for point in view_points]
    return {
        "position": position,
        "object_id": 1,
        "object_name": name,
        "object_category": "thing",
        "floor_id": "0",
        "view_points": points,
    }


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
