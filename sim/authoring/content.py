"""The files of generated episodes: content files and indexes as released, and the same for Habitat's own class."""

import gzip
import json
import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from sim.errors import DatasetError

from ..episodes.schema import EpisodeRecord, Goal, SceneFile, goals_key
from ..episodes.sequence_files import SequenceFile
from ..episodes.sequences import SequenceRecord
from .annotated import AnnotatedHome

_HABITAT_GOAL = (
    "position", "radius", "object_id", "object_name", "object_name_id", "object_category", "room_id", "room_name",
    "view_points",
)  # fmt: skip
_HABITAT_EPISODE = (
    "episode_id", "scene_id", "scene_dataset_config", "additional_obj_config_paths", "start_position",
    "start_rotation", "info", "goals", "start_room", "shortest_paths", "object_category",
)  # fmt: skip
"""Fields of habitat-lab's `ObjectGoal` and `ObjectGoalNavEpisode`, whose constructors refuse all others
(HABITAT_SEMANTICS.md, section 4; read in habitat-lab at commits 0565fdbf, 009998e1 and 01ce2951)."""


def content_file(home: AnnotatedHome, episodes: Sequence[EpisodeRecord], categories: Sequence[str]) -> SceneFile:
    """The content file of one scene and split, with all goals of the home; `categories` as in `index_file`."""
    goals = _by_category(home, [thing.goal for thing in home.things.values()])
    return index_file(categories).model_copy(update={"goals_by_category": goals, "episodes": tuple(episodes)})


def sequence_file(home: AnnotatedHome, goals: Iterable[Goal], sequences: Sequence[SequenceRecord]) -> SequenceFile:
    """The file of a home's sequences with these goals; ids of categories are places in their sorted list."""
    by_category = _by_category(home, goals)
    ids = index_file(sorted({goal.object_category for found in by_category.values() for goal in found}))
    return SequenceFile(
        goals_by_category=by_category,
        sequences=tuple(sequences),
        category_to_task_category_id=ids.category_to_task_category_id,
        category_to_scene_annotation_category_id=ids.category_to_scene_annotation_category_id,
    )


def index_file(categories: Sequence[str]) -> SceneFile:
    """The index of a split: ids of categories are places in this list."""
    ids = {category: number for number, category in enumerate(categories)}
    return SceneFile(
        goals_by_category={},
        episodes=(),
        category_to_task_category_id=ids,
        category_to_scene_annotation_category_id=ids,
    )


def packed(content: SceneFile | SequenceFile) -> bytes:
    """Compressed JSON without a time stamp, so that the same content gives the same bytes."""
    return _gzipped(content.model_dump_json(by_alias=True, indent=2))


def packed_for_habitat(content: SceneFile) -> bytes:
    """The same for habitat-lab's stock `ObjectNav-v1` class, which refuses unknown fields.

    What PersONAL adds to an episode stands in its `info`. The class counts every object of the category as right, as
    with the released files (DATA_FORMAT.md, section 3): filter goals by `info["object_id"]`.
    """
    whole: dict[str, Any] = json.loads(content.model_dump_json(by_alias=True))
    for goals in whole["goals_by_category"].values():
        goals[:] = [{name: goal[name] for name in _HABITAT_GOAL} for goal in goals]
    for episode in whole["episodes"]:
        added = {name: episode.pop(name) for name in sorted(set(episode) - set(_HABITAT_EPISODE))}
        episode["info"] |= added
    return _gzipped(json.dumps(whole, indent=2, ensure_ascii=False))


def write_files(out: Path, files: dict[str, bytes]) -> None:
    """Writes all files under temporary names, then renames them.

    Raises:
        DatasetError: A file cannot be written.
    """
    staged: list[tuple[Path, Path]] = []
    try:
        for path, data in files.items():
            target = out / path
            target.parent.mkdir(parents=True, exist_ok=True)
            staged.append((target.with_name(target.name + ".part"), target))
            staged[-1][0].write_bytes(data)
        for beside, target in staged:
            os.replace(beside, target)
    except OSError as error:
        for beside, _ in staged:
            beside.unlink(missing_ok=True)
        raise DatasetError(f"{out}: cannot be written ({error}); expected a writable folder. Change --out.") from None


def _by_category(home: AnnotatedHome, goals: Iterable[Goal]) -> dict[str, tuple[Goal, ...]]:
    """The goals by Habitat's key of their category."""
    suffix = home.scene_id.rsplit("/", 1)[-1].removeprefix(home.name)
    by_category: dict[str, tuple[Goal, ...]] = {}
    for goal in goals:
        key = goals_key(home.name, goal.object_category, suffix=suffix)
        by_category[key] = (*by_category.get(key, ()), goal)
    return dict(sorted(by_category.items()))


def _gzipped(text: str) -> bytes:
    return gzip.compress((text + "\n").encode(), mtime=0)
