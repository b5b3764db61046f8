"""A small data set in the release's format, made here: two homes, the first with two storeys; medium has no file."""

import gzip
import json
from dataclasses import dataclass
from pathlib import Path

QUERIES = (
    "Find {}",
    "Where is {}?",
    "Locate {}",
    "Retrieve {} position",
    "Identify the position of {}",
    "Give me the coordinates of {}",
)


@dataclass(frozen=True)
class Thing:
    """One goal object of the data set."""

    name: str
    position: tuple[float, float, float]
    floor_id: str
    floor_y: float
    caption: str = ""
    """Empty = no episode targets it."""
    owner: str = ""

    @property
    def category(self) -> str:
        return self.name.rsplit("_", 1)[0]


HOMES = {
    "HomeOne": (
        Thing("table_1", (2.25, 0.5, 7.75), "0", 0.0, "low oak table with a green bowl", "Ada"),
        Thing("sofa_2", (5.5, 0.4, 7.5), "0", 0.0, "long grey sofa with striped cushions", "Bo"),
        Thing("sofa_3", (9.5, 0.4, 2.5), "0", 0.0, "small yellow leather sofa", "Ada"),
        Thing("lamp_4", (9.25, 1.2, 2.75), "0", 0.0),
        Thing("bed_5", (2.5, 3.4, 7.5), "1", 3.0, "wide bed with a purple blanket", "Bo"),
        Thing("lamp_6", (6.5, 4.2, 2.5), "1", 3.0, "tall copper lamp", "Ada"),
    ),
    "HomeTwo": (
        Thing("chair_1", (-3.5, 0.4, -1.5), "0", 0.0, "white plastic chair", "Carl"),
        Thing("chair_2", (1.5, 0.4, -1.5), "0", 0.0, "carved wooden chair with armrests", "Dee"),
        Thing("mirror_3", (0.5, 1.5, 4.5), "0", 0.0, "oval mirror with a golden frame", "Carl"),
    ),
}


def goal_json(thing: Thing) -> dict:
    x, _, z = thing.position
    stands = [(x + 0.5, thing.floor_y, z), (x, thing.floor_y, z - 0.75)]
    view_points = [{"agent_state": {"position": p, "rotation": [0.0, 0.0, 0.0, 1.0]}, "iou": 0.3} for p in stands]
    empty = dict.fromkeys(("radius", "object_name_id", "room_id", "room_name"))
    return {
        "position": thing.position,
        "object_id": int(thing.name.rsplit("_", 1)[1]),
        "object_name": thing.name,
        "object_category": thing.category,
        "floor_id": thing.floor_id,
        "view_points": view_points,
        **empty,
    }


def episode_json(scene: str, episode_id: int, thing: Thing, things: tuple[Thing, ...]) -> dict:
    owned = [other for other in things if other.owner]
    phrases = [f"{other.owner} owns a {other.caption} in the room" for other in owned]
    return {
        "episode_id": str(episode_id),
        "scene_id": f"hm3d_v0.2/val/00000-{scene}/{scene}.basis.glb",
        "scene_dataset_config": "./hm3d_annotated_basis.scene_dataset_config.json",
        "object_category": thing.category,
        "object_id": thing.name,
        "description": [thing.caption, "", ""],
        "owner": thing.owner,
        "floor_id": thing.floor_id,
        "summary": " ".join(f"{phrase}." for phrase in phrases),
        "extracted_summary": phrases,
        "query": [query.format(f"{thing.owner}'s {thing.category}") for query in QUERIES],
        "start_position": [0.0, thing.floor_y, 0.0],
        "start_rotation": [0.0, 0.0, 0.0, 1.0],
        "additional_obj_config_paths": [],
        "goals": [],
        "start_room": None,
        "shortest_paths": None,
        "info": {"geodesic_distance": 4.0, "euclidean_distance": 3.5, "closest_goal_object_id": 1},
    }


def write_scene(root: Path, split: str, scene: str, things: tuple[Thing, ...]) -> None:
    goals: dict[str, list[dict]] = {}
    for thing in things:
        goals.setdefault(f"{scene}.basis.glb_{thing.category}", []).append(goal_json(thing))
    targets = [thing for thing in things if thing.owner]
    content = {
        "goals_by_category": goals,
        "episodes": [episode_json(scene, number, thing, things) for number, thing in enumerate(targets)],
        "category_to_task_category_id": {},
        "category_to_scene_annotation_category_id": {},
    }
    folder = root / split / "content"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{scene}.json.gz").write_bytes(gzip.compress(json.dumps(content).encode(), mtime=0))


def write_small_dataset(root: Path) -> None:
    """Easy holds both homes (8 episodes), hard only HomeTwo (3), medium none."""
    for scene, things in HOMES.items():
        write_scene(root, "easy", scene, things)
    write_scene(root, "hard", "HomeTwo", HOMES["HomeTwo"])
