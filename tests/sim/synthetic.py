"""A small invented dataset (DATA_FORMAT.md, section 7) and a writer, for tests that need episode files on disk."""

import copy
import gzip
import json
from pathlib import Path
from typing import Any

from sim.types import Split

SCENE = "Zz0ExampleZ"
Content = dict[str, Any]
Contents = dict[tuple[Split, str], Content]


def example_view_point(x: float, z: float, *, y: float = 0.0, quat_xyzw: list[float], iou: float | None) -> Content:
    """A view point as in the files; without `iou` it is one that the generator added."""
    point: Content = {"agent_state": {"position": [x, y, z], "rotation": quat_xyzw}}
    return point if iou is None else {**point, "iou": iou}


def example_goal(**changes: Any) -> Content:
    """A coffee table at (2, 0.45, -1) with two original view points and an added one that looks away."""
    goal: Content = {
        "position": [2.0, 0.45, -1.0],
        "radius": None,
        "object_id": 7,
        "object_name": "coffee table_7",
        "object_name_id": None,
        "object_category": "coffee table",
        "floor_id": "0",
        "room_id": None,
        "room_name": None,
        "view_points": [
            example_view_point(2.0, -0.25, quat_xyzw=[0.0, 0.0, 0.0, 1.0], iou=0.41),
            example_view_point(1.25, -1.0, quat_xyzw=[0.0, -0.70711, 0.0, 0.70711], iou=0.22),
            example_view_point(2.6, 0.1, quat_xyzw=[0.0, 0.99, 0.0, 0.14107], iou=None),
        ],
    }
    return {**goal, **changes}


def example_episode(*, scene: str = SCENE, owner: Any = "Ada", **changes: Any) -> Content:
    """Somebody asks for Ada's coffee table from 4 m away, looking the other way."""
    asked = f"{owner}'s coffee table"
    episode: Content = {
        "episode_id": "3",
        "scene_id": f"hm3d_v0.2/val/00000-{scene}/{scene}.basis.glb",
        "scene_dataset_config": "./data/scene_datasets/hm3d_v0.2/hm3d_annotated_basis.scene_dataset_config.json",
        "object_category": "coffee table",
        "object_id": "coffee table_7",
        "description": ["low oak coffee table with a green bowl on it", "", ""],
        "owner": owner,
        "floor_id": "0",
        "summary": f"In the ground-floor lounge {owner} owns the low oak table, and Bo owns the desk in the study.",
        "extracted_summary": [f"{owner} owns a low oak coffee table in the lounge", "Bo owns a desk in the study"],
        "query": [
            f"Find {asked}",
            f"Where is {asked}?",
            f"Locate {asked}",
            f"Retrieve {asked} position",
            f"Identify the position of {asked}",
            f"Give me the coordinates of {asked}",
        ],
        "start_position": [2.0, 0.0, 3.0],
        "start_rotation": [0.0, 1.0, 0.0, 0.0],
        "additional_obj_config_paths": [],
        "goals": [],
        "start_room": None,
        "shortest_paths": None,
        "info": {"geodesic_distance": 3.25, "euclidean_distance": 4.0, "closest_goal_object_id": 7},
    }
    return {**episode, **changes}


def example_content(*, scene: str = SCENE, episodes: list[Content] | None = None, **changes: Any) -> Content:
    """A content file with one goal and, by default, one episode."""
    content: Content = {
        "goals_by_category": {f"{scene}.basis.glb_coffee table": [example_goal()]},
        "episodes": [example_episode(scene=scene)] if episodes is None else episodes,
        "category_to_task_category_id": {"coffee table": 0},
        "category_to_scene_annotation_category_id": {"coffee table": 0},
    }
    return copy.deepcopy({**content, **changes})


def lattice(x0: float, *, y: float = 0.0) -> list[Content]:
    """View points from x0 to x0 + 2 m and z 0 to 3 m, every 0.25 m, on a floor at y; they look along -z."""
    ahead = [0.0, 0.0, 0.0, 1.0]
    xz = [(x0 + 0.25 * i, 0.25 * j) for i in range(9) for j in range(13)]
    return [example_view_point(*place, y=y, quat_xyzw=ahead, iou=0.4) for place in xz]


def write_home(root: Path) -> Path:
    """Writes a dataset whose `SCENE` can be opened: a table seen from x 1 to 3, and one easy episode that asks for it.

    A home needs 1 m2 of floor, and the places of `example_content` make less.
    """
    goals = {f"{SCENE}.basis.glb_coffee table": [example_goal(view_points=lattice(1.0))]}
    return write_dataset(root, {("easy", SCENE): example_content(goals_by_category=goals)})


def write_content(root: Path, split: Split, content: Content | str, *, scene: str = SCENE, plain: bool = False) -> Path:
    """Writes one content file (text is written as it is) and returns its path; `plain` leaves the gzip away."""
    path = root / split / "content" / f"{scene}.json{'' if plain else '.gz'}"
    path.parent.mkdir(parents=True, exist_ok=True)
    data = (content if isinstance(content, str) else json.dumps(content)).encode()
    path.write_bytes(data if plain else gzip.compress(data))
    return path


def write_dataset(root: Path, contents: Contents | None = None) -> Path:
    """Writes content and index files below `root` and returns it; by default one easy episode of `SCENE`."""
    contents = {("easy", SCENE): example_content()} if contents is None else contents
    for (split, scene), content in contents.items():
        write_content(root, split, content, scene=scene)
        index = {"episodes": [], **{key: content[key] for key in content if key.startswith("category_to_")}}
        (root / split / f"{split}.json.gz").write_bytes(gzip.compress(json.dumps(index).encode()))
    return root
