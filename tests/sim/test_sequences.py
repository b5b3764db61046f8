"""Home sequences: ownership that messages change, stories that contradict themselves, files, episodes as sequences."""

import gzip
import json
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from personal_viz.cli.validate import Validate
from sim.authoring.content import packed
from sim.authoring.sequences.checks import validate_sequences
from sim.episodes.dataset import PersonalDataset
from sim.episodes.sequence_files import (
    SequenceFile,
    SequenceSet,
    episode_from_sequence,
    read_sequence_file,
    resolve_sequence,
    sequence_from_episode,
)
from sim.episodes.sequences import Edge, SequenceRecord, ownership_over_time
from sim.errors import DatasetError

from ..conftest import SHARED

SCENE = "Home"
VIEW_POINT = {"agent_state": {"position": [0.0, 0.0, 0.0], "rotation": [0.0, 0.0, 0.0, 1.0]}}
OBJECTS = {"cup_1": "cup", "cup_2": "cup", "lamp_3": "lamp", "book_4": "book"}


def search(owner: str, name: str, kind: str, message: int, **more: Any) -> dict[str, Any]:
    """A search for one object."""
    category = OBJECTS[name]
    info = {"geodesic_distance": 3.0, "previous_geodesic": 4.0}
    asked = {"query": [f"Find {owner}'s {category}"], "owner": owner, "object_category": category, "object_id": name}
    return {**asked, "kind": kind, "message": message, "info": info, **more}


def message(before: int, kind: str, adds: list[str], removes: list[str], **more: Any) -> dict[str, Any]:
    """A message whose edges are written "Owner object"."""
    pairs = {name: [edge.split() for edge in edges] for name, edges in (("adds", adds), ("removes", removes))}
    return {"before": before, "kind": kind, "text": f"A message of kind {kind}.", **pairs, **more}


def story() -> dict[str, Any]:
    """Six searches; a lamp and a cup change hands, and a book is lent."""
    return {
        "sequence_id": "s0",
        "split": "hard",
        "scene_id": f"{SCENE}.glb",
        "scene_dataset_config": "",
        "floor_id": "1",
        "start_position": [0.0, 0.0, 0.0],
        "start_rotation": [0.0, 0.0, 0.0, 1.0],
        "messages": [
            message(0, "intro", ["Ada cup_1", "Ada cup_2", "Bo lamp_3", "Cy book_4"], []),
            message(1, "transfer", ["Cy lamp_3"], ["Bo lamp_3"]),
            message(2, "transfer", ["Bo cup_1"], ["Ada cup_1"]),
            message(4, "lend", ["Ada book_4"], ["Cy book_4"], until=5),
        ],
        "subtasks": [
            search("Bo", "lamp_3", "fresh", 0),
            search("Cy", "lamp_3", "changed", 1),
            search("Ada", "cup_2", "stale", 2, old_object_id="cup_1"),
            search("Cy", "lamp_3", "revisit", 1),
            search("Ada", "book_4", "changed", 3),
            search("Cy", "book_4", "changed", 3),
        ],
    }


def record(document: dict[str, Any]) -> SequenceRecord:
    """The sequence of a document, read as from a file."""
    return SequenceRecord.model_validate_json(json.dumps(document), strict=True)


def content(*documents: dict[str, Any]) -> dict[str, Any]:
    """A content file with these sequences."""
    goals: dict[str, list[dict[str, Any]]] = {}
    for number, (name, category) in enumerate(OBJECTS.items()):
        goal = {
            "position": [3.0 * number, 0.5, 0.0],
            "object_id": number,
            "object_name": name,
            "view_points": [VIEW_POINT],
        }
        goals.setdefault(f"{SCENE}.glb_{category}", []).append({**goal, "object_category": category, "floor_id": "1"})
    return {
        "goals_by_category": goals,
        "sequences": list(documents),
        "category_to_task_category_id": {},
        "category_to_scene_annotation_category_id": {},
    }


def written(folder: Path, document: dict[str, Any]) -> Path:
    """A set with one content file."""
    (folder / "content").mkdir(parents=True)
    (folder / "content" / f"{SCENE}.json.gz").write_bytes(gzip.compress(json.dumps(document).encode()))
    return folder


def test_ownership_follows_the_messages_and_what_was_lent_goes_back() -> None:
    told = record(story())
    states = ownership_over_time(told.messages, len(told.subtasks))
    assert states[0] == {
        Edge("Ada", "cup_1"): 0,
        Edge("Ada", "cup_2"): 0,
        Edge("Bo", "lamp_3"): 0,
        Edge("Cy", "book_4"): 0,
    }
    assert states[1][Edge("Cy", "lamp_3")] == 1
    assert Edge("Bo", "lamp_3") not in states[1]
    assert states[4][Edge("Ada", "book_4")] == 3
    assert Edge("Ada", "book_4") not in states[5]
    assert states[5][Edge("Cy", "book_4")] == 3
    assert dict(states[2]) == dict(states[3])


def test_each_kind_of_message_can_be_told() -> None:
    document = story()
    document["messages"][3:] = [
        message(2, "share", ["Bo book_4"], []),
        message(3, "unshare", [], ["Bo book_4"]),
        message(3, "swap", ["Ada book_4", "Cy cup_2"], ["Ada cup_2", "Cy book_4"]),
        message(4, "correction", ["Bo cup_2"], ["Cy cup_2"]),
        message(4, "leave", [], ["Ada book_4"]),
    ]
    document["subtasks"][4:] = [search("Bo", "cup_2", "changed", 6, object_id=["cup_1", "cup_2"])]
    told = record(document)
    states = ownership_over_time(told.messages, len(told.subtasks))
    assert set(states[4]) == {Edge("Bo", "cup_1"), Edge("Bo", "cup_2"), Edge("Cy", "lamp_3")}


WRONG_STORIES: dict[str, tuple[tuple[str, int | None, dict[str, Any]], str]] = {
    "no intro": (("messages", 0, {"kind": "share"}), "expected one intro, first of all"),
    "late intro": (("messages", 0, {"before": 1}), "expected one intro, first of all"),
    "disorder": (("messages", 1, {"before": 3}), r"before is \[0, 3, 2, 4\]; expected rising"),
    "after the end": (("messages", 3, {"before": 6, "until": 7}), "rising indices of the 6 subtasks"),
    "no return": (("messages", 3, {"until": None}), r"messages\[3\]\.until is None; expected an index for lend"),
    "return of a gift": (("messages", 1, {"until": 4}), r"messages\[1\]\.until is 4; expected an index for lend"),
    "return before": (("messages", 3, {"until": 4}), "expected a subtask after 4"),
    "no such edge": (("messages", 1, {"removes": [["Ada", "lamp_3"]]}), "Ada does not own 'lamp_3' then"),
    "twice": (("messages", 2, {"adds": [["Ada", "cup_2"]], "removes": [["Bo", "cup_2"]]}), "Bo does not own 'cup_2'"),
    "two objects": (("messages", 1, {"adds": [["Cy", "cup_1"]]}), "expected one object that goes from one person"),
    "nobody to share": (
        ("messages", 1, {"kind": "share", "adds": [["Cy", "plant_9"]], "removes": []}),
        "no other owner",
    ),
    "swap with oneself": (("messages", 1, {"kind": "swap"}), "expected two objects that two people exchange"),
    "leave by half": (("messages", 2, {"kind": "leave", "adds": []}), "Ada still owns something after it"),
    "unshare of the last": (("messages", 1, {"kind": "unshare", "adds": []}), "'lamp_3' has no owner after it"),
    "wrong owner": (("subtasks", 0, {"owner": "Ada"}), r"subtasks\[0\]: Ada does not own \['lamp_3'\] then"),
    "future message": (("subtasks", 0, {"message": 1}), "no message before this subtask"),
    "wrong message": (("subtasks", 1, {"message": 0}), r"message is 0; expected 1, which says that Cy owns it"),
    "fresh though changed": (("subtasks", 1, {"kind": "fresh"}), "expected 'changed': .*, and nobody asked since"),
    "fresh though asked": (("subtasks", 3, {"kind": "fresh"}), "expected 'revisit': .*, and somebody asked since"),
    "revisit of nothing": (("subtasks", 0, {"kind": "revisit"}), "expected 'fresh': .*, and nobody asked since"),
    "stale without trap": (("subtasks", 2, {"old_object_id": None}), "expected the object that the owner gave away"),
    "wrong trap": (("subtasks", 2, {"old_object_id": "book_4"}), r"messages\[2\] does not take 'book_4' from Ada"),
    "empty text": (("messages", 0, {"text": " "}), "pattern"),
}


@pytest.mark.parametrize("name", WRONG_STORIES)
def test_a_story_that_contradicts_itself_is_refused(name: str) -> None:
    (part, index, change), problem = WRONG_STORIES[name]
    document = story()
    document[part][index].update(change)
    with pytest.raises(ValidationError, match=problem):
        record(document)


def test_an_answer_is_asked_anew_once_a_message_has_given_it_back() -> None:
    document = story()
    document["subtasks"][0] = search("Cy", "book_4", "fresh", 0)  # Cy lends the book later, and gets it back
    assert record(document).subtasks[5].kind == "changed"
    document["subtasks"][5]["kind"] = "revisit"
    with pytest.raises(ValidationError, match=r"expected 'changed': messages\[3\] decides it, and nobody asked since"):
        record(document)


def test_a_set_is_read_in_order_with_the_targets_of_each_search(tmp_path: Path) -> None:
    second = {**story(), "sequence_id": "s1"}
    sequences = list(SequenceSet(written(tmp_path, content(story(), second))).sequences())
    assert [str(sequence.key) for sequence in sequences] == ["Home/s0", "Home/s1"]
    names = [[goal.object_name for goal in targets] for targets in sequences[0].targets]
    assert names == [["lamp_3"], ["lamp_3"], ["cup_2"], ["lamp_3"], ["book_4"], ["book_4"]]
    assert sequences[0].start.position == (0.0, 0.0, 0.0)


def test_what_is_wrong_with_a_set_is_said_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r"found no file of sequences; expected .*content/<Scene>\.json\.gz"):
        SequenceSet(tmp_path)
    twice = SequenceSet(written(tmp_path / "twice", content(story(), story())))
    with pytest.raises(DatasetError, match=r"sequences\[1\].sequence_id is 's0', as in sequences\[0\]"):
        list(twice.sequences())
    with pytest.raises(DatasetError, match=r"found no scene 'Hom'; expected one of: Home\. Did you mean 'Home'\?"):
        list(twice.sequences(scenes=("Hom",)))
    document = story()
    document["messages"][1]["adds"] = []
    contradiction = SequenceSet(written(tmp_path / "contradiction", content(document)))
    with pytest.raises(DatasetError, match=r"Home.json.gz: sequences.0 is .*expected: .*messages\[1\] is 'transfer'"):
        list(contradiction.sequences())
    lost = content(story())
    lost["goals_by_category"][f"{SCENE}.glb_lamp"] = []
    with pytest.raises(DatasetError, match=r"sequences\[0\]: subtasks\[0\]: object_id \['lamp_3'\] resolves to \[\]"):
        list(SequenceSet(written(tmp_path / "lost", lost)).sequences())
    unseen = content(story())
    unseen["goals_by_category"][f"{SCENE}.glb_lamp"][0]["view_points"] = []
    with pytest.raises(
        DatasetError, match=r"sequences\[0\]: subtasks\[0\]: \['lamp_3'\] have no view points, expected places"
    ):
        list(SequenceSet(written(tmp_path / "unseen", unseen)).sequences())


def test_an_answer_that_is_not_the_only_one_is_refused() -> None:
    document = story()
    document["messages"][2]["before"] = 3
    document["subtasks"][2] = search("Ada", "cup_2", "fresh", 0)
    with pytest.raises(KeyError, match=r"subtasks\[2\]: Ada owns \['cup_1'\] of the category too"):
        resolve_sequence(SCENE, record(document), SequenceFile.model_validate(content()))
    document["subtasks"][2]["object_id"] = ["cup_1", "cup_2"]
    resolved = resolve_sequence(SCENE, record(document), SequenceFile.model_validate(content()))
    assert len(resolved.targets[2]) == 2


def test_messages_about_unknown_objects_are_refused(tmp_path: Path) -> None:
    document = story()
    document["messages"][0]["adds"].append(["Cy", "cup_99"])
    with pytest.raises(
        DatasetError, match=r"sequences\[0\]: messages name \['cup_99'\], which goals_by_category does not"
    ):
        list(SequenceSet(written(tmp_path, content(document))).sequences())


def test_a_written_set_is_read_back_as_it_was(tmp_path: Path) -> None:
    file = SequenceFile.model_validate_json(json.dumps(content(story())), strict=True)
    (tmp_path / "content").mkdir()
    (tmp_path / "content" / f"{SCENE}.json.gz").write_bytes(packed(file))
    assert read_sequence_file(tmp_path / "content" / f"{SCENE}.json.gz") == file
    assert packed(file) == packed(file.model_copy())


def whole_story() -> dict[str, Any]:
    """A story that keeps every guarantee of generation: of `hard`, in which somebody shares something to the end."""
    document = story()
    document["messages"][0]["adds"] += [["Dee", "cup_1"], ["Eve", "cup_1"]]
    del document["messages"][3]
    document["subtasks"][1:] = [
        search("Bo", "cup_1", "changed", 2),
        search("Ada", "cup_2", "stale", 2, old_object_id="cup_1"),
    ]
    document["messages"][2]["before"] = 1
    return document


def test_a_set_that_keeps_its_guarantees_has_no_finding(tmp_path: Path) -> None:
    report = validate_sequences(written(tmp_path, content(whole_story())))
    assert (report.num_sequences, report.num_subtasks, report.problems, report.broken) == (1, 3, (), ())
    assert report.subtasks == {"fresh": 1, "changed": 1, "stale": 1}
    assert report.messages == {"intro": 1, "transfer": 2}


def test_each_broken_guarantee_is_one_line(tmp_path: Path) -> None:
    document = whole_story()
    document["subtasks"][0]["info"]["geodesic_distance"] = 20.0
    document["messages"][0]["adds"] = document["messages"][0]["adds"][:-2]  # nothing is shared
    file = content(document)
    file["goals_by_category"][f"{SCENE}.glb_cup"][1]["position"] = [0.5, 0.5, 0.0]
    file["goals_by_category"][f"{SCENE}.glb_cup"][0]["floor_id"] = "2"
    report = validate_sequences(written(tmp_path, file))
    assert report.broken == (
        "Home/s0: subtasks[0] begins 20.00 m from its object; expected 3 to 11 m in hard",
        "Home/s0: subtasks[0]: no object has several owners; expected the rule of hard after each message",
        "Home/s0: subtasks[2] is 0.50 m from the object before; expected at least 2 m",
        "Home/s0: subtasks[2] is 'stale' without another 'cup' on its storey",
    )


def test_the_old_object_is_another_one_of_the_category_on_the_storey(tmp_path: Path) -> None:
    document = whole_story()
    document["messages"][0]["adds"][2] = ["Ada", "lamp_3"]
    document["messages"][1]["removes"] = [["Ada", "lamp_3"]]
    document["subtasks"][0] = search("Ada", "lamp_3", "fresh", 0)
    document["subtasks"][2] |= {"message": 1, "old_object_id": "lamp_3"}
    report = validate_sequences(written(tmp_path / "category", content(document)))
    assert report.broken == ("Home/s0: subtasks[2].old_object_id is 'lamp_3'; expected another 'cup' on its storey",)
    file = content(whole_story())
    cups = file["goals_by_category"][f"{SCENE}.glb_cup"]
    cups.append({**cups[1], "object_name": "cup_5"})
    cups[0]["floor_id"] = "2"
    report = validate_sequences(written(tmp_path / "storey", file))
    assert report.broken == ("Home/s0: subtasks[2].old_object_id is 'cup_1'; expected another 'cup' on its storey",)


def test_a_right_object_lies_apart_from_the_one_that_was_right_before(tmp_path: Path) -> None:
    file = content(whole_story())
    file["goals_by_category"][f"{SCENE}.glb_cup"][1]["position"] = [1.5, 0.5, 0.0]
    report = validate_sequences(written(tmp_path, file))
    assert "Home/s0: subtasks[2] is 1.50 m from 'cup_1'; expected at least 2 m" in report.broken


def test_the_rule_holds_after_each_message_of_several_before_one_search(tmp_path: Path) -> None:
    document = whole_story()
    document["messages"][1:] = [
        message(1, "unshare", [], ["Dee cup_1"]),
        message(1, "unshare", [], ["Eve cup_1"]),
        message(1, "share", ["Cy cup_1"], []),
    ]
    document["subtasks"][1:] = [search("Cy", "cup_1", "changed", 3)]
    report = validate_sequences(written(tmp_path, content(document)))
    assert report.broken == (
        "Home/s0: messages[2]: no object has several owners; expected the rule of hard after each message",
    )


def test_a_query_has_one_meaning_and_the_walk_from_the_object_before_is_known(tmp_path: Path) -> None:
    document = whole_story()
    document["messages"] = document["messages"][:1]
    document["messages"][0]["adds"] += [["Bo", "lamp_5"]]
    document["subtasks"][1:] = [search("Cy", "book_4", "fresh", 0)]
    del document["subtasks"][1]["info"]["previous_geodesic"]
    file = content(document)
    other = file["goals_by_category"][f"{SCENE}.glb_lamp"][0] | {
        "object_name": "lamp_5",
        "object_category": "desk lamp",
    }
    file["goals_by_category"][f"{SCENE}.glb_desk lamp"] = [other]
    report = validate_sequences(written(tmp_path, file))
    assert report.broken == (
        "Home/s0: subtasks[1].info.previous_geodesic is null; expected the walk from the object before",
        "Home/s0: subtasks[0] could mean Bo's 'desk lamp' too; expected a query with one meaning",
    )


def test_a_changed_answer_differs_from_the_one_of_the_intro(tmp_path: Path) -> None:
    document = whole_story()
    document["messages"][1:] = [message(1, "lend", ["Ada lamp_3"], ["Bo lamp_3"], until=2)]
    document["subtasks"][1:] = [search("Cy", "book_4", "fresh", 0), search("Bo", "lamp_3", "changed", 1)]
    file = content(document)
    file["goals_by_category"][f"{SCENE}.glb_lamp"] += [
        file["goals_by_category"][f"{SCENE}.glb_lamp"][0] | {"object_name": "lamp_5"}
    ]
    document["subtasks"][0] = search("Dee", "cup_1", "fresh", 0)
    report = validate_sequences(written(tmp_path, file))
    assert report.broken == (
        "Home/s0: subtasks[2] is 'changed', but the intro gives 'lamp_3'; expected another answer",
    )


def test_validate_tells_of_a_set_and_refuses_only_what_cannot_be_used(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = written(tmp_path, content(whole_story()))
    assert Validate(folder).run() == 0
    assert "1 sequences with 3 searches (fresh 1, changed 1, stale 1)" in capsys.readouterr().out
    (folder / "content" / "Other.json").write_text("{")
    assert Validate(folder, json=True).run() == 1
    found = json.loads(capsys.readouterr().out)
    assert (found["sequences"], found["errors"]) == (1, 1)
    assert "Other.json: (top level) is text that is not JSON" in found["problems"][0]


def test_only_a_sequence_of_one_search_is_an_episode() -> None:
    resolved = resolve_sequence(SCENE, record(story()), SequenceFile.model_validate(content()))
    with pytest.raises(DatasetError, match="found 4 messages, 6 searches in mode 'any'"):
        episode_from_sequence(resolved)


@pytest.mark.slow
def test_each_released_episode_is_a_sequence_and_back_without_loss() -> None:
    folder = SHARED / "personal-dataset" / "split"
    if not folder.is_dir():
        pytest.skip(f"the episodes are not at {folder}")
    dataset, num_same = PersonalDataset(folder), 0
    for episode in dataset.episodes():
        split, scene, _ = episode.key
        text = sequence_from_episode(episode).model_dump_json(by_alias=True)
        held = dataset.content(split, scene)
        goals = SequenceFile.model_construct(goals_by_category=held.goals_by_category)
        back = episode_from_sequence(resolve_sequence(scene, record(json.loads(text)), goals))
        assert back == episode
        num_same += 1
    assert num_same == 2000
