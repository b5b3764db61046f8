"""A home sequence in the invented home Small, told by hand: six searches, a gift and a swap."""

from pathlib import Path
from typing import Any

from sim.authoring.content import packed
from sim.episodes.dataset import PersonalDataset
from sim.episodes.sequence_files import HomeSequence, SequenceFile, SequenceSet
from sim.episodes.sequences import SequenceRecord

SCENE = "Small"
MESSAGES: list[dict[str, Any]] = [
    {
        "before": 0,
        "kind": "intro",
        "text": "Cy owns the towel. Ada owns two armchairs and a bed. Bo owns a bed.",
        "adds": [
            ["Cy", "towel_7"], ["Ada", "armchair_35"], ["Ada", "armchair_50"], ["Ada", "bed_11"], ["Bo", "bed_46"],
        ],
    },
    {
        "before": 2,
        "kind": "transfer",
        "text": "Ada gave an armchair to Bo.",
        "adds": [["Bo", "armchair_35"]],
        "removes": [["Ada", "armchair_35"]],
    },
    {
        "before": 3,
        "kind": "swap",
        "text": "Ada and Bo swapped beds.",
        "adds": [["Ada", "bed_46"], ["Bo", "bed_11"]],
        "removes": [["Ada", "bed_11"], ["Bo", "bed_46"]],
    },
]  # fmt: skip


def subtask(owner: str, category: str, names: str | list[str], kind: str, message: int, **more: Any) -> dict[str, Any]:
    """A search in one query and its paraphrase."""
    asked = {"query": [f"Find {owner}'s {category}", f"Bring me to {owner}'s {category}"], "owner": owner}
    info = {"geodesic_distance": 3.0, "previous_geodesic": 3.0}
    return {
        **asked,
        "object_category": category,
        "object_id": names,
        "kind": kind,
        "message": message,
        "info": info,
        **more,
    }


SUBTASKS = [
    subtask("Cy", "towel", "towel_7", "fresh", 0),
    subtask("Ada", "armchair", ["armchair_35", "armchair_50"], "fresh", 0, mode="all"),
    subtask("Ada", "armchair", "armchair_50", "stale", 1, old_object_id="armchair_35"),
    subtask("Ada", "bed", "bed_46", "changed", 2, old_object_id="bed_11"),
    subtask("Cy", "towel", "towel_7", "revisit", 0),
    subtask("Bo", "armchair", "armchair_35", "changed", 1),
]


def told_in(root: Path, out: Path, *, messages: list[dict[str, Any]], subtasks: list[dict[str, Any]]) -> HomeSequence:
    """The story in the home of a dataset, written to a set in `out` and read again; ids are those of seed 3."""
    dataset = PersonalDataset(root)
    record = next(dataset.episodes(scenes=(SCENE,))).record
    goals: dict[str, list[Any]] = {}
    for goal in dataset.goals(SCENE).values():
        goals.setdefault(f"{SCENE}{record.scan_suffix}_{goal.object_category}", []).append(goal)
    told = SequenceRecord.model_validate(
        {
            "sequence_id": "told",
            "split": "hard",
            "scene_id": record.scene_id,
            "scene_dataset_config": "",
            "floor_id": "0",
            "start_position": record.start_position,
            "start_rotation": record.start_rotation,
            "messages": messages,
            "subtasks": subtasks,
        }
    )
    content = SequenceFile(
        goals_by_category={key: tuple(found) for key, found in goals.items()},
        sequences=(told,),
        category_to_task_category_id={},
        category_to_scene_annotation_category_id={},
    )
    (out / "content").mkdir(parents=True, exist_ok=True)
    (out / "content" / f"{SCENE}.json.gz").write_bytes(packed(content))
    return next(SequenceSet(out).sequences())


def marked_story() -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Messages and subtasks of the story whose texts hold words that occur nowhere else, for `leaks`."""
    messages = [{**one, "text": f"{one['text']} MESSAGE-{number}"} for number, one in enumerate(MESSAGES)]
    messages[0]["extracted_summary"] = [f"{owner} owns a SENTENCE-CANARY" for owner, _ in messages[0]["adds"]]
    subtasks = []
    for number, one in enumerate(SUBTASKS):
        slots = ["CAPTION-CANARY", "", ""]
        captions = slots if isinstance(one["object_id"], str) else [slots for _ in one["object_id"]]
        subtasks.append({**one, "query": [f"{text} QUERY-{number}" for text in one["query"]], "description": captions})
    return messages, subtasks


def leaks(text: str, search: int) -> list[str]:
    """Everything in a text that nobody may know at this search of the marked story: later messages and queries, and,
    always, captions, sentences, and the objects that are or were right.
    """
    later = [f"MESSAGE-{number}" for number, one in enumerate(MESSAGES) if one["before"] > search]
    later += [f"QUERY-{number}" for number in range(search + 1, len(SUBTASKS))]
    objects = [name for _, name in MESSAGES[0]["adds"]]
    always = ["CAPTION-CANARY", "SENTENCE-CANARY", "object_id", "owner", "stale", "revisit", *objects]
    return [word for word in (*later, *always) if word in text]
