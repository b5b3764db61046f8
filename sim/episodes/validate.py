"""Runs every check of DATA_FORMAT.md section 8 on a folder of episode files; callers need only `validate_dataset`."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from sim.errors import DatasetError
from sim.types import SPLITS, Split

from .checks_geometry import GEOMETRY_RULES
from .checks_text import TEXT_RULES
from .dataset import read_bytes
from .survey import Hit, Level, Rule, Survey, Unit, splits_in_order, survey_dataset

PAPER_EPISODES: dict[Split, int] = {"easy": 600, "medium": 700, "hard": 720}
"""Episodes per split as the paper counts them (Table "network-metrics")."""


@dataclass(frozen=True, slots=True)
class Measure:
    """Number of findings of one kind."""

    slug: str
    unit: Unit
    count: int
    """In all splits; an object found in two splits counts once."""
    per_split: dict[Split, int]
    population: dict[Split, int] | None
    """Number of units in each split; None where such a count makes no sense."""
    names: tuple[str, ...]
    """`split/scene/id` of the episodes, or names of objects, files, categories, fields."""


@dataclass(frozen=True, slots=True)
class CheckResult:
    """The findings of one row of the table."""

    row: int
    level: Level
    title: str
    measure: Measure
    also: tuple[Measure, ...] = ()


@dataclass(frozen=True, slots=True)
class ValidationReport:
    """The findings of all checks on a dataset's files."""

    root: Path
    num_episodes: dict[Split, int]
    """Episodes in readable files."""
    checks: tuple[CheckResult, ...]
    """One per row, in order of the rows."""
    problems: tuple[str, ...]
    """One line per problem of a file, and one per episode whose target does not resolve."""

    @property
    def num_errors(self) -> int:
        """Number of findings that make a file or an episode unusable."""
        return sum(check.measure.count for check in self.checks if check.level == "error")


def validate_dataset(root: Path) -> ValidationReport:
    """Checks a dataset; damaged files are reported and everything else is still checked.

    Args:
        root: Folder that holds the splits.

    Raises:
        DatasetError: The folder does not exist or holds no episode file.
    """
    survey = survey_dataset(root)
    checks = (_run_rule(rule, survey) for rule in (*_FILE_RULES, *TEXT_RULES, *GEOMETRY_RULES))
    return ValidationReport(
        survey.dataset.root,
        survey.population("episodes") or {},
        tuple(sorted(checks, key=lambda check: check.row)),
        tuple(line for _, line in (*survey.problems, *survey.unresolved)),
    )


def _run_rule(rule: Rule, survey: Survey) -> CheckResult:
    measure = _measure(rule.slug, rule.unit, hits=rule.find(survey), survey=survey)
    also = tuple(_measure(slug, unit, hits=find(survey), survey=survey) for slug, unit, find in rule.also)
    return CheckResult(rule.row, rule.level, rule.title, measure, also)


def _measure(slug: str, unit: Unit, *, hits: Iterable[Hit], survey: Survey) -> Measure:
    found = tuple(hits)
    per_split: dict[Split, int] = {split: sum(hit.count for hit in found if split in hit.splits) for split in SPLITS}
    total = sum(hit.count for hit in found)
    return Measure(slug, unit, total, per_split, survey.population(unit), tuple(hit.name for hit in found))


def _all_episodes(survey: Survey) -> Iterator[Hit]:
    return (Hit((episode.key.split,), str(episode.key)) for episode in survey.records)


def _plain_twins(survey: Survey) -> Iterator[Hit]:
    """Plain .json files beside a .gz of the same scene, which a loader of `*.json*` reads as well."""
    for (split, scene), path in survey.dataset.files.items():
        twin = path.with_name(f"{scene}.json")
        if path.suffix == ".gz" and twin.is_file():
            yield Hit((split,), f"{twin.relative_to(survey.dataset.root)} {_relation(twin, path)}")


def _relation(twin: Path, path: Path) -> str:
    try:
        same = read_bytes(twin) == read_bytes(path)
    except DatasetError:
        return "(cannot be compared)"
    return "(same content)" if same else "(OTHER content)"


_OPTIONAL_GOAL_FIELDS = ("radius", "room_id", "room_name", "object_name_id")
_OPTIONAL_EPISODE_FIELDS = ("start_room", "shortest_paths")


def _types_of_optional_fields(survey: Survey) -> dict[str, dict[str, set[Split]]]:
    """For each field that may be null: the types found, and in which splits."""
    found: dict[str, dict[str, set[Split]]] = {}
    items: list[tuple[object, Split, tuple[str, ...]]] = [
        (entry.goal, entry.split, _OPTIONAL_GOAL_FIELDS) for entry in survey.goal_entries
    ]
    items.extend((episode.record, episode.key.split, _OPTIONAL_EPISODE_FIELDS) for episode in survey.records)
    for item, split, fields in items:
        for field in fields:
            found.setdefault(field, {}).setdefault(type(getattr(item, field)).__name__, set()).add(split)
    return found


def _always_null(survey: Survey) -> Iterator[Hit]:
    for field, splits_of_type in _types_of_optional_fields(survey).items():
        if set(splits_of_type) == {"NoneType"}:
            yield Hit(splits_in_order(splits_of_type["NoneType"]), field)


def _several_types(survey: Survey) -> Iterator[Hit]:
    for field, splits_of_type in _types_of_optional_fields(survey).items():
        if len(splits_of_type) > 1:
            splits = splits_in_order(split for splits in splits_of_type.values() for split in splits)
            yield Hit(splits, f"{field}: {', '.join(sorted(splits_of_type))}")


_PAPER_COUNTS = " / ".join(map(str, PAPER_EPISODES.values()))
_FILE_RULES = (
    Rule(1, "episodes-per-split", "note", "episodes", f"in readable files; the paper has {_PAPER_COUNTS}",
         _all_episodes),
    Rule(2, "file-not-in-format", "error", "problems", "a file is unreadable or a value has the wrong type",
         lambda survey: (hit for hit, _ in survey.problems)),
    Rule(3, "target-not-resolved", "error", "episodes", "an episode's object is not in the goal list exactly once",
         lambda survey: (hit for hit, _ in survey.unresolved)),
    Rule(8, "number-not-finite", "error", "numbers", "NaN or infinity", lambda survey: survey.non_finite),
    Rule(45, "plain-twin", "defect", "files", "a .json file stands beside the .json.gz", _plain_twins),
    Rule(46, "field-always-null", "note", "fields", "a field is null everywhere", _always_null),
    Rule(47, "field-with-several-types", "defect", "fields", "a field's type differs between files", _several_types),
)  # fmt: skip
