"""The JSON that habitat-lab's stock `ObjectNav-v1` dataset class reads, as facts: field names, types, and its joins.

Read in habitat-lab at commits 0565fdbf, 009998e1 and 01ce2951 (`ObjectNavDatasetV1`, `ObjectGoalNavEpisode`,
`ObjectGoal`, `ObjectViewLocation`), and in HABITAT_SEMANTICS.md, section 4. Its constructors take these fields and no
others; `required` ones have no default or may not be None.
"""

import gzip
import json
import posixpath
from pathlib import Path
from typing import Any

EPISODE = {
    "required": {
        "episode_id": str, "scene_id": str, "scene_dataset_config": str, "additional_obj_config_paths": list,
        "start_position": list, "start_rotation": list,
    },
    "optional": {
        "info": dict, "goals": list, "start_room": str, "shortest_paths": list, "object_category": str,
    },
}  # fmt: skip
GOAL = {
    "required": {"position": list, "object_id": (int, str)},
    "optional": {
        "radius": float, "object_name": str, "object_name_id": int, "object_category": str, "room_id": str,
        "room_name": str, "view_points": list,
    },
}  # fmt: skip
VIEW_POINT = {"required": {"agent_state": dict, "iou": (float, type(None))}, "optional": {}}
AGENT_STATE = {"required": {"position": list, "rotation": list}, "optional": {}}


def read_as_habitat(data_path: Path, *, scenes_dir: Path) -> list[dict[str, Any]]:
    """The episodes of all content files beside an index, with their goals, joined as the class joins them.

    Asserts what its constructors and its own assertions demand.
    """
    episodes: list[dict[str, Any]] = []
    files = [data_path, *sorted((data_path.parent / "content").glob("*.json.gz"))]
    for path in files:
        whole = json.loads(gzip.decompress(path.read_bytes()))
        ids, others = whole["category_to_task_category_id"], whole["category_to_scene_annotation_category_id"]
        assert set(ids) == set(others)
        assert all(type(number) is int for number in ids.values())
        for goals in whole["goals_by_category"].values():
            for goal in goals:
                _takes(GOAL, goal)
                for point in goal["view_points"]:
                    _takes(VIEW_POINT, point)
                    _takes(AGENT_STATE, point["agent_state"])
        for index, episode in enumerate(whole["episodes"]):
            _takes(EPISODE, episode)
            assert episode["object_category"] in ids
            scene = episode["scene_id"].removeprefix("data/scene_datasets/")
            goals = whole["goals_by_category"][f"{posixpath.basename(scene)}_{episode['object_category']}"]
            episodes.append({**episode, "episode_id": str(index), "scene_id": str(scenes_dir / scene), "goals": goals})
    return episodes


def _takes(fields: dict[str, dict[str, Any]], value: dict[str, Any]) -> None:
    """Asserts that a constructor with these fields takes the value."""
    assert set(fields["required"]) <= set(value), set(fields["required"]) - set(value)
    assert set(value) <= {*fields["required"], *fields["optional"]}, set(value)
    for name, kind in fields["required"].items():
        assert isinstance(value[name], kind), (name, value[name])
    for name, kind in fields["optional"].items():
        assert value.get(name) is None or isinstance(value[name], kind), (name, value[name])
