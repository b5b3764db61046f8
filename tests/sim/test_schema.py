"""The models of the released files: unions, how targets are found, and what an agent may see."""

import copy
import json
import math
from typing import Any

import pytest
from pydantic import ValidationError

from sim.episodes.schema import EpisodeRecord, Goal, SceneFile, goals_key, resolve_episode, scene_name_from_id
from sim.types import PAPER4, PAPER6
from tests.sim.synthetic import SCENE, example_content, example_episode, example_goal


def scene_file(content: dict[str, Any]) -> SceneFile:
    return SceneFile.model_validate_json(json.dumps(content), strict=True)


def test_the_example_of_the_format_loads_with_every_field_and_is_equal_when_written() -> None:
    content = scene_file(example_content())
    record = content.episodes[0]
    assert record.episode_id == "3"
    assert record.object_names == ("coffee table_7",)
    assert record.captions_per_object == (("low oak coffee table with a green bowl on it",),)
    assert record.info.geodesic_distance == 3.25
    goal = content.goals_by_category["Zz0ExampleZ.basis.glb_coffee table"][0]
    assert [point.iou for point in goal.view_points] == [0.41, 0.22, None]
    assert len(goal.original_view_points) == 2
    assert SceneFile.model_validate_json(content.model_dump_json(by_alias=True), strict=True) == content


def test_object_id_and_captions_may_be_lists_of_the_same_length() -> None:
    record = EpisodeRecord.model_validate_json(
        json.dumps(
            example_episode(
                object_id=["coffee table_7", "coffee table_8"],
                description=[["oak table", "", ""], ["glass table", "table made of glass", ""]],
            )
        ),
        strict=True,
    )
    assert record.object_names == ("coffee table_7", "coffee table_8")
    assert record.captions_per_object == (("oak table",), ("glass table", "table made of glass"))


@pytest.mark.parametrize(
    "changes",
    [
        {"object_id": ["coffee table_7", "coffee table_8"]},
        {"object_id": []},
        {"description": [["oak table", "", ""], ["glass table", "", ""]]},
    ],
)
def test_one_caption_list_per_object_is_required(changes: dict[str, Any]) -> None:
    with pytest.raises(ValidationError, match="description for"):
        EpisodeRecord.model_validate_json(json.dumps(example_episode(**changes)))


WRONG_IN_EPISODE: dict[str, list[Any]] = {
    "floor_id": [0],
    "episode_id": ["", "3/../4", "3\n", "x" * 65],
    "start_position": ["2 0 3", [2.0, 3.0], [2.0, 0.0, 10_000.5]],
    "start_rotation": [[0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0011]],
    "query": [[], [" "]],
    "scene_id": ["hm3d_v0.2/val/no name.glb"],
}
"""Further wrong values, besides those in test_dataset.py."""


@pytest.mark.parametrize(
    ("path", "value"),
    [
        *((("episodes", 0, field), value) for field, values in WRONG_IN_EPISODE.items() for value in values),
        (("episodes", 0, "info", "geodesic_distance"), "3.25"),
        (("episodes", 0, "info", "geodesic_distance"), 1e308),
        (("goals_by_category", goals_key(SCENE, "coffee table"), 0, "position"), [2.0, -1e5, 1.0]),
        (("category_to_task_category_id", "coffee table"), "0"),
    ],
)
def test_a_wrong_type_or_an_unknown_key_is_refused(path: tuple[Any, ...], value: object) -> None:
    content = example_content()
    place: Any = content
    for part in path[:-1]:
        place = place[part]
    place[path[-1]] = value
    with pytest.raises(ValidationError) as caught:
        scene_file(content)
    assert caught.value.errors()[0]["loc"][: len(path)] == path


@pytest.mark.parametrize(
    ("changes", "found"),
    [({"position": [-1e5, 0.0, 1.0]}, "-100000.0"), ({"rotation": [0.0, 2.0, 0.0, 0.0]}, "its norm is 2, not 1")],
)
def test_a_view_point_too_far_away_or_with_an_invalid_rotation_is_refused(changes: dict[str, Any], found: str) -> None:
    goal = example_goal()
    goal["view_points"][1]["agent_state"] |= changes
    with pytest.raises(ValidationError) as caught:
        Goal.model_validate_json(json.dumps(goal))
    assert found in str(caught.value)


def test_the_limits_themselves_and_rounded_quaternions_are_accepted() -> None:
    changes = {
        "start_position": [10_000.0, 0.0, -10_000.0],
        "start_rotation": [0.0, 0.0, 0.0, 1.0009],
        "episode_id": "A_b-" * 16,
    }
    record = scene_file(example_content(episodes=[example_episode(**changes)])).episodes[0]
    assert record.start_position == (10_000.0, 0.0, -10_000.0)
    assert len(record.episode_id) == 64


def test_targets_are_found_by_exact_name_and_keep_the_order_of_the_list() -> None:
    names = ["flower vase_2", "flower vase_20", "flower vase_203"]
    goals = [example_goal(object_name=name, object_category="flower vase", object_id=i) for i, name in enumerate(names)]
    episode = example_episode(object_category="flower vase", object_id="flower vase_20")
    content = example_content(episodes=[episode], goals_by_category={goals_key(SCENE, "flower vase"): goals})
    loaded = scene_file(content)
    targets = resolve_episode("medium", SCENE, loaded.episodes[0], loaded).targets
    assert [goal.object_name for goal in targets] == ["flower vase_20"]
    goals = [example_goal(object_name=f"coffee table_{i}", object_id=i) for i in (7, 8, 9)]
    episode = example_episode(object_id=["coffee table_9", "coffee table_7"], description=[["a"], ["b"]])
    content = example_content(episodes=[episode], goals_by_category={goals_key(SCENE, "coffee table"): goals})
    loaded = scene_file(content)
    targets = resolve_episode("hard", SCENE, loaded.episodes[0], loaded).targets
    assert [goal.object_name for goal in targets] == ["coffee table_9", "coffee table_7"]


def test_an_ambiguous_or_missing_target_is_refused() -> None:
    content = scene_file(example_content(goals_by_category={goals_key(SCENE, "coffee table"): [example_goal()] * 2}))
    with pytest.raises(KeyError, match="expected each once"):
        resolve_episode("easy", SCENE, content.episodes[0], content)
    with pytest.raises(KeyError, match=r"no key 'Other\.basis\.glb_coffee table'"):
        resolve_episode("easy", "Other", content.episodes[0], content)


def test_a_task_holds_the_paragraph_and_one_query_and_no_ground_truth() -> None:
    content = scene_file(example_content())
    episode = resolve_episode("easy", SCENE, content.episodes[0], content)
    task = episode.task("pan", query_index=1, actions=PAPER4)
    assert task.description == episode.record.summary
    assert task.queries == ("Where is Ada's coffee table?",)
    assert (task.max_steps, task.actions) == (500, PAPER4)
    assert episode.task("pog").actions == PAPER6
    seen = repr(task)
    assert "green bowl" not in seen
    assert "coffee table_7" not in seen


def test_a_rotation_by_half_a_turn_makes_the_start_face_plus_z() -> None:
    content = scene_file(example_content())
    start = resolve_episode("easy", SCENE, content.episodes[0], content).start
    assert start.position == (2.0, 0.0, 3.0)
    assert start.yaw == pytest.approx(math.pi)


def test_the_floor_of_a_goal_is_the_median_of_its_original_view_points() -> None:
    goal = example_goal()
    for point, height in zip(goal["view_points"], (0.1, 0.3, 9.0), strict=True):
        point["agent_state"]["position"][1] = height
    assert Goal.model_validate(copy.deepcopy(goal)).floor_y == 0.3
    for point in goal["view_points"]:
        point.pop("iou", None)
    assert Goal.model_validate(goal).floor_y == 0.3
    assert Goal.model_validate(example_goal(view_points=[])).floor_y == 0.45


def test_the_scene_name_is_the_last_part_of_the_scene_id() -> None:
    assert scene_name_from_id("hm3d_v0.2/val/00800-Abc/Abc.basis.glb") == "Abc"
    assert scene_name_from_id("Abc.glb") == "Abc"
