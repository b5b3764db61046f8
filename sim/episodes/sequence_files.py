"""Files of home sequences, `<set>/content/<SceneName>.json.gz`, read with their targets; and episodes as sequences.

A sequence with one `intro` and one search is a PersONAL episode: `sequence_from_episode` and `episode_from_sequence`
turn one into the other without loss.
"""

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import BaseModel, ValidationError

from sim.errors import DatasetError, did_you_mean, line_from_validation_error, short
from sim.frames import yaw_from_quat_xyzw
from sim.types import EpisodeKey, Pose

from .dataset import content_text, read_bytes
from .schema import (
    STRICT_SHAPE,
    Episode,
    EpisodeInfo,
    EpisodeRecord,
    Goal,
    goals_of,
    resolve_goals,
    scan_suffix_from_id,
)
from .sequences import Edge, Message, SequenceRecord, Subtask, SubtaskInfo, ownership_over_time

_ADVICE = '"personal-viz validate" lists every problem.'


class SequenceFile(BaseModel):
    """One content file `<set>/content/<SceneName>.json.gz`; goals and categories are those of `SceneFile`."""

    model_config = STRICT_SHAPE
    goals_by_category: dict[str, tuple[Goal, ...]]
    sequences: tuple[SequenceRecord, ...]
    category_to_task_category_id: dict[str, int]
    category_to_scene_annotation_category_id: dict[str, int]


class SequenceKey(NamedTuple):
    """The name of a sequence within its set."""

    scene: str
    sequence_id: str

    def __str__(self) -> str:
        return f"{self.scene}/{self.sequence_id}"


@dataclass(frozen=True, slots=True)
class HomeSequence:
    """A sequence with its targets; holds ground truth, so it never reaches an agent, a browser or a prompt."""

    key: SequenceKey
    record: SequenceRecord
    targets: tuple[tuple[Goal, ...], ...]
    """The right objects of each subtask."""
    ownership: tuple[Mapping[Edge, int], ...]
    """At each subtask, who owns what and the message that said so."""
    goals: tuple[Goal, ...]
    """All objects of the sequence's storey, by the annotator's label."""

    def of_category(self, category: str) -> tuple[Goal, ...]:
        """The objects of a category on the sequence's storey."""
        return tuple(goal for goal in self.goals if goal.object_category == category)

    @property
    def start(self) -> Pose:
        """Start pose, world frame."""
        return Pose(self.record.start_position, yaw_from_quat_xyzw(self.record.start_rotation))


def holds_sequences(root: Path) -> bool:
    """Whether a folder is a set of sequences, not of episodes, which lie in folders of their splits."""
    return (root / "content").is_dir()


class SequenceSet:
    """The sequences below one folder, `<root>/content/<SceneName>.json.gz` (or plain `.json`)."""

    def __init__(self, root: Path | str) -> None:
        """Lists the files without reading them.

        Raises:
            DatasetError: The folder does not exist or holds no content file.
        """
        self.root = Path(root)
        found = [*(self.root / "content").glob("*.json"), *(self.root / "content").glob("*.json.gz")]
        self.files = {path.name.removesuffix(".gz").removesuffix(".json"): path for path in sorted(found)}
        if not self.files:
            raise DatasetError(
                f"{self.root}: found no file of sequences; expected {self.root}/content/<Scene>.json.gz. Give the "
                "folder of one set (docs/home-sequences.md)."
            )

    def sequences(self, *, scenes: tuple[str, ...] | None = None) -> Iterator[HomeSequence]:
        """All sequences with their targets, ordered by scene and place in the file.

        Raises:
            DatasetError: A named scene is unknown, or a file is damaged, not in the format, uses an id twice, or names
                objects that it does not hold.
        """
        for scene in scenes or ():
            if scene not in self.files:
                raise DatasetError(
                    f"{self.root}: found no scene {scene!r}; expected one of: {', '.join(self.files)}."
                    f"{did_you_mean(scene, self.files)}"
                )
        for scene, path in self.files.items():
            if scenes is None or scene in scenes:
                yield from self._in_scene(scene, path)

    def digest(self) -> str:
        """sha256 over the decompressed bytes of all content files, in order of the scenes."""
        total = hashlib.sha256()
        for scene, path in sorted(self.files.items()):
            total.update(f"{scene}\n".encode())
            total.update(read_bytes(path))
        return total.hexdigest()

    def _in_scene(self, scene: str, path: Path) -> Iterator[HomeSequence]:
        content, places = read_sequence_file(path), dict[str, int]()
        for index, record in enumerate(content.sequences):
            other = places.setdefault(record.sequence_id, index)
            if other != index:
                raise DatasetError(
                    f"{path}: sequences[{index}].sequence_id is {record.sequence_id!r}, as in sequences[{other}]; "
                    f"expected one use per file. {_ADVICE}"
                )
            try:
                yield resolve_sequence(scene, record, content)
            except KeyError as error:
                raise DatasetError(f"{path}: sequences[{index}]: {error.args[0]}. {_ADVICE}") from None


def read_sequence_file(path: Path) -> SequenceFile:
    """Reads and checks one content file.

    Raises:
        DatasetError: The file is unreadable, not JSON, not in the format, or tells a story that contradicts itself.
    """
    text, _ = content_text(path)
    try:
        return SequenceFile.model_validate_json(text, strict=True)
    except ValidationError as error:
        raise DatasetError(line_from_validation_error(path, error, advice=_ADVICE)) from None


def resolve_sequence(scene: str, record: SequenceRecord, content: SequenceFile) -> HomeSequence:
    """The sequence with its targets.

    Raises:
        KeyError: An object does not resolve exactly once or has no view points, or the owner has another object that
            answers as well; args[0] says which one.
    """
    suffix, goals = scan_suffix_from_id(record.scene_id), content.goals_by_category
    on_storey = tuple(goal for found in goals.values() for goal in found if goal.floor_id == record.floor_id)
    states = ownership_over_time(record.messages, len(record.subtasks))
    targets = []
    for index, (subtask, edges) in enumerate(zip(record.subtasks, states, strict=True)):
        try:
            found = resolve_goals(scene, subtask.object_category, subtask.object_names, goals, suffix=suffix)
        except KeyError as error:
            raise KeyError(f"subtasks[{index}]: {error.args[0]}") from None
        alike = goals_of(scene, subtask.object_category, goals, suffix=suffix) or ()
        owned = {goal.object_name for goal in alike if Edge(subtask.owner, goal.object_name) in edges}
        if owned != set(subtask.object_names):
            more = short(sorted(owned - set(subtask.object_names)), most=80)
            raise KeyError(f"subtasks[{index}]: {subtask.owner} owns {more} of the category too, expected in object_id")
        if hidden := [goal.object_name for goal in found if not goal.view_points]:
            raise KeyError(
                f"subtasks[{index}]: {short(hidden, most=80)} have no view points, expected places to walk to"
            )
        targets.append(found)
    known = {goal.object_name for found in goals.values() for goal in found}
    told = {edge.object_name for message in record.messages for edge in (*message.adds, *message.removes)}
    if told - known:
        raise KeyError(f"messages name {short(sorted(told - known), most=80)}, which goals_by_category does not hold")
    return HomeSequence(SequenceKey(scene, record.sequence_id), record, tuple(targets), states, on_storey)


def sequence_from_episode(episode: Episode) -> SequenceRecord:
    """An episode as a sequence of one search."""
    record, info = episode.record, episode.record.info
    names = record.object_names
    return SequenceRecord(
        sequence_id=record.episode_id,
        split=episode.key.split,
        scene_id=record.scene_id,
        scene_dataset_config=record.scene_dataset_config,
        floor_id=record.floor_id,
        start_position=record.start_position,
        start_rotation=record.start_rotation,
        messages=(
            Message(
                before=0,
                kind="intro",
                text=record.summary,
                adds=tuple(Edge(record.owner, name) for name in names),
                extracted_summary=record.extracted_summary,
            ),
        ),
        subtasks=(
            Subtask(
                query=record.query,
                owner=record.owner,
                object_category=record.object_category,
                object_id=record.object_id,
                kind="fresh",
                message=0,
                description=record.captions,
                info=SubtaskInfo.model_validate(info.model_dump()),
            ),
        ),
        sources=(str(episode.key),),
    )


def episode_from_sequence(sequence: HomeSequence) -> Episode:
    """A sequence of one intro and one `any` search as an episode, the inverse of `sequence_from_episode`.

    Raises:
        DatasetError: It has more messages or searches, or lacks a distance of episodes.
    """
    record = sequence.record
    subtask = record.subtasks[0]
    info = subtask.info.model_dump(exclude_none=True)
    if len(record.subtasks) != 1 or len(record.messages) != 1 or subtask.mode != "any" or len(info) != 3:
        raise DatasetError(
            f"sequence {sequence.key}: found {len(record.messages)} messages, {len(record.subtasks)} searches in mode "
            f"{subtask.mode!r} and the distances {', '.join(info)}; expected one intro, one search in mode 'any', and "
            "geodesic_distance, euclidean_distance, closest_goal_object_id. Take a sequence that is an episode."
        )
    key = EpisodeKey(record.split, sequence.key.scene, record.sequence_id)
    return Episode(key, search_record(record, 0, info=EpisodeInfo.model_validate(info)), sequence.targets[0])


def search_record(record: SequenceRecord, index: int, *, info: EpisodeInfo, **told: Any) -> EpisodeRecord:
    """One search as an episode that begins where the sequence does, with the intro as its description.

    Args:
        record: The sequence.
        index: The search.
        info: The episode's distances.
        told: Other fields of the episode in place of these.
    """
    subtask, intro = record.subtasks[index], record.messages[0]
    fields: dict[str, Any] = {
        "episode_id": record.sequence_id,
        "scene_id": record.scene_id,
        "scene_dataset_config": record.scene_dataset_config,
        "object_category": subtask.object_category,
        "object_id": subtask.object_id,
        "description": subtask.captions,
        "owner": subtask.owner,
        "floor_id": record.floor_id,
        "summary": intro.text,
        "extracted_summary": intro.extracted_summary,
        "query": subtask.query,
        "start_position": record.start_position,
        "start_rotation": record.start_rotation,
        "info": info,
    }
    return EpisodeRecord(**(fields | told))
