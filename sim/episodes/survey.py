"""The readable part of a dataset, and the type of a check: `validate` runs the rules of checks_*.py on a `Survey`."""

import json
import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

from pydantic import ValidationError

from sim.errors import DatasetError, short
from sim.types import SPLITS, EpisodeKey, Split

from .dataset import MANY_OBJECTS, PersonalDataset, read_bytes, repeated_ids
from .ownership import parse_ownership
from .schema import Episode, Goal, SceneFile, resolve_episode, scene_name_from_id

Level = Literal["error", "defect", "note"]
"""`error` = unusable, `defect` = wrong but has a workaround, `note` = normal for the format."""
Unit = Literal[
    "episodes", "sentences", "goal entries", "view points", "extra view points", "original view points", "objects",
    "categories", "files", "problems", "numbers", "fields", "pairs of starts", "episode ids",
]  # fmt: skip


@dataclass(frozen=True, slots=True)
class Hit:
    """One finding of a check."""

    splits: tuple[Split, ...]
    """Splits in which it occurs."""
    name: str
    """`split/scene/id` of an episode, or the name of an object, file, category or field."""
    count: int = 1
    """Number of units in this finding (sentences of an episode, view points of a goal)."""


Find = Callable[["Survey"], Iterable[Hit]]


@dataclass(frozen=True, slots=True)
class Rule:
    """One row of DATA_FORMAT.md, section 8."""

    row: int
    slug: str
    level: Level
    unit: Unit
    """The things that `find` counts."""
    title: str
    find: Find
    also: tuple[tuple[str, Unit, Find], ...] = ()
    """Further measurements of the same row: slug, unit, finder."""


@dataclass(frozen=True, slots=True)
class GoalEntry:
    """One goal object as listed in one split."""

    split: Split
    scene: str
    goal: Goal

    @property
    def name(self) -> str:
        """`split/scene/object_name`."""
        return f"{self.split}/{self.scene}/{self.goal.object_name}"


@dataclass(frozen=True)
class Survey:
    """Every readable part of a dataset, with the problems of the rest."""

    dataset: PersonalDataset
    contents: dict[tuple[Split, str], SceneFile]
    """Files that fit the schema, in order of split (easy, medium, hard) and scene."""
    records: tuple[Episode, ...]
    """All episodes of `contents`; those whose targets do not resolve have `targets == ()`."""
    unresolved: tuple[tuple[Hit, str], ...]
    """Episodes whose targets do not resolve, with one line each."""
    problems: tuple[tuple[Hit, str], ...]
    """Problems of files: the file and one line each."""
    non_finite: tuple[Hit, ...]
    """Files with NaN or infinite numbers."""

    @cached_property
    def episodes(self) -> tuple[Episode, ...]:
        """Episodes with targets; the geometric checks use only these."""
        return tuple(episode for episode in self.records if episode.targets)

    @cached_property
    def goal_entries(self) -> tuple[GoalEntry, ...]:
        """Every goal object of every split."""
        return tuple(
            GoalEntry(split, scene, goal)
            for (split, scene), content in self.contents.items()
            for goals in content.goals_by_category.values()
            for goal in goals
        )

    @cached_property
    def objects(self) -> dict[tuple[str, str], tuple[Goal, tuple[Split, ...]]]:
        """Distinct objects by (scene, object_name): the first split's goal, and the splits that list it."""
        found: dict[tuple[str, str], tuple[Goal, tuple[Split, ...]]] = {}
        for entry in self.goal_entries:
            goal, splits = found.get((entry.scene, entry.goal.object_name), (entry.goal, ()))
            found[(entry.scene, entry.goal.object_name)] = (goal, tuple(dict.fromkeys((*splits, entry.split))))
        return found

    def population(self, unit: Unit) -> dict[Split, int] | None:
        """Number of these units in each split; None where such a count makes no sense."""
        counts: dict[Split, int] = dict.fromkeys(SPLITS, 0)
        if unit in ("episodes", "sentences"):
            for episode in self.records:
                counts[episode.key.split] += 1 if unit == "episodes" else len(episode.record.extracted_summary)
        elif unit in ("goal entries", "view points", "extra view points", "original view points"):
            for entry in self.goal_entries:
                num_original = len(entry.goal.original_view_points)
                num_points = len(entry.goal.view_points)
                counts[entry.split] += {
                    "goal entries": 1,
                    "view points": num_points,
                    "original view points": num_original,
                    "extra view points": num_points - num_original,
                }[unit]
        else:
            return None
        return counts


def splits_in_order(splits: Iterable[Split]) -> tuple[Split, ...]:
    """The splits once each, from easy to hard."""
    found = set(splits)
    return tuple(split for split in SPLITS if split in found)


def survey_dataset(root: Path) -> Survey:
    """Reads everything that can be read below `root`.

    Raises:
        DatasetError: The folder does not exist or holds no content file; damaged files do not raise.
    """
    dataset = PersonalDataset(root)
    contents: dict[tuple[Split, str], SceneFile] = {}
    records: list[Episode] = []
    unresolved: list[tuple[Hit, str]] = []
    problems: list[tuple[Hit, str]] = []
    non_finite: list[Hit] = []
    for split, scene in sorted(dataset.files, key=lambda key: (SPLITS.index(key[0]), key[1])):
        path = dataset.files[(split, scene)]
        name = str(path.relative_to(dataset.root))
        try:
            content = dataset.content(split, scene)
        except DatasetError as error:
            problems += [(Hit((split,), name), line) for line in _problems_of_file(path, error)]
            if num_bad := _num_non_finite(path):
                non_finite.append(Hit((split,), name, num_bad))
            continue
        contents[(split, scene)] = content
        problems += [(Hit((split,), name), f"{path}: {line}") for line in _problems_of_content(scene, content)]
        for index, record in enumerate(content.episodes):
            try:
                records.append(resolve_episode(split, scene, record, content))
            except KeyError as error:
                key = EpisodeKey(split, scene, record.episode_id)
                records.append(Episode(key, record, ()))
                unresolved.append((Hit((split,), str(key)), f"{path}: episodes.{index}: {error.args[0]}."))
    problems += _problems_of_indexes(dataset.root)
    return Survey(dataset, contents, tuple(records), tuple(unresolved), tuple(problems), tuple(non_finite))


def _problems_of_file(path: Path, error: DatasetError) -> Iterator[str]:
    """The line of the error, then one line for every further invalid field."""
    yield str(error)
    try:
        text = read_bytes(path)
        if text.count(b"{") <= MANY_OBJECTS:
            SceneFile.model_validate_json(text, strict=True)
    except DatasetError:
        return
    except ValidationError as invalid:
        for problem in invalid.errors()[1:]:
            field = ".".join(map(str, problem["loc"]))
            found = "nothing" if problem["type"] == "missing" else short(problem["input"], most=80)
            yield f"{path}: {field} is {found}; expected: {problem['msg']}."


def _problems_of_content(scene: str, content: SceneFile) -> Iterator[str]:
    """Errors that the schema cannot see: an episode of another scene, a repeated key, a sentence without owner."""
    repeated = dict(repeated_ids(content))
    for index, record in enumerate(content.episodes):
        where = f"episodes.{index}"
        if scene_name_from_id(record.scene_id) != scene:
            found = short(record.scene_id, most=80)
            yield f"{where}.scene_id is {found}; expected: a path to scene {scene!r}, as the file is named."
        if index in repeated:
            found = f"{record.episode_id!r}, as in episodes.{repeated[index]}"
            yield f"{where}.episode_id is {found}; expected: one use per file."
        for number, sentence in enumerate(record.extracted_summary):
            try:
                parse_ownership(sentence)
            except DatasetError:
                field = f"{where}.extracted_summary.{number}"
                yield f"{field} is {short(sentence, most=80)}; expected: '<Name> owns <object> in the <room>'."


def _problems_of_indexes(root: Path) -> Iterator[tuple[Hit, str]]:
    """Index files that exist but are damaged; our code does not read them, Habitat does."""
    for split in SPLITS:
        path = root / split / f"{split}.json.gz"
        if not path.is_file():
            continue
        hit = Hit((split,), str(path.relative_to(root)))
        try:
            index = json.loads(read_bytes(path))
        except DatasetError as error:
            yield hit, str(error)
        except (ValueError, RecursionError) as error:
            yield hit, f"{path}: found text that is not JSON ({error}); expected an index. Copy the file again."
        else:
            if not isinstance(index, dict) or index.get("episodes") != []:
                yield hit, f"{path}: found an index without 'episodes': []; expected the category maps only."


def _num_non_finite(path: Path) -> int:
    """Number of NaN or infinite values in a file; 0 where the file cannot be read at all."""
    try:
        return _num_non_finite_in(json.loads(read_bytes(path)))
    except (DatasetError, ValueError, RecursionError):
        return 0


def _num_non_finite_in(value: Any) -> int:
    if isinstance(value, dict):
        return sum(map(_num_non_finite_in, value.values()))
    if isinstance(value, list):
        return sum(map(_num_non_finite_in, value))
    return int(isinstance(value, float) and not math.isfinite(value))
