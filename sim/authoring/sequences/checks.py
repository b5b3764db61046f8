"""What is wrong in a set of home sequences: files that cannot be used, and guarantees of generation that are broken.

The generator asks `broken_guarantees` after each message, `personal-viz validate` for a whole set.
"""

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from sim.errors import DatasetError
from sim.frames import planar_distance
from sim.types import Split

from ...episodes.checks_geometry import GEODESIC_LIMITS
from ...episodes.schema import Goal
from ...episodes.sequence_files import HomeSequence, SequenceSet
from ...episodes.sequences import Edge, MessageKind, SubtaskKind, ownership_over_time
from .. import people
from ..captions import are_mixed_up

LEAST_APART = 2.0
"""Least planar distance between the right objects of two searches, one after the other, and of a right object from the
one that was right before (metres); otherwise FOUND at one could succeed for the other."""


@dataclass(frozen=True, slots=True)
class SequenceReport:
    """The findings on a set."""

    root: Path
    num_sequences: int
    """Sequences in readable files."""
    num_subtasks: int
    subtasks: Mapping[SubtaskKind, int]
    messages: Mapping[MessageKind, int]
    problems: tuple[str, ...]
    """One line per file that cannot be used."""
    broken: tuple[str, ...]
    """One line per broken guarantee; sequences that are an episode give none."""


def validate_sequences(root: Path) -> SequenceReport:
    """Checks a set; damaged files are reported and everything else is still checked.

    Raises:
        DatasetError: The folder does not exist or holds no content file.
    """
    found, problems, broken = SequenceSet(root), list[str](), list[str]()
    subtasks, messages = Counter[SubtaskKind](), Counter[MessageKind]()
    num_sequences = 0
    for scene in found.files:
        try:
            of_scene = list(found.sequences(scenes=(scene,)))
        except DatasetError as error:
            problems.append(str(error))
            continue
        for sequence in of_scene:
            num_sequences += 1
            subtasks.update(subtask.kind for subtask in sequence.record.subtasks)
            messages.update(message.kind for message in sequence.record.messages)
            if len(sequence.record.subtasks) > 1:
                broken += [f"{sequence.key}: {line}" for line in broken_guarantees(sequence)]
    return SequenceReport(
        found.root, num_sequences, subtasks.total(), subtasks, messages, tuple(problems), tuple(broken)
    )


def broken_guarantees(sequence: HomeSequence) -> Iterator[str]:
    """The guarantees that a sequence breaks, as far as its file tells; whether a robot gets there, its home tells."""
    record = sequence.record
    low, high = GEODESIC_LIMITS[record.split]
    first = record.subtasks[0].info.geodesic_distance
    if not low <= first <= high:
        yield f"subtasks[0] begins {first:.2f} m from its object; expected {low:g} to {high:g} m in {record.split}"
    rule = None
    for place, edges in _states(sequence):
        before, rule = rule, broken_rule(record.split, edges)
        if rule is not None and rule != before:
            yield f"{place}: {rule}; expected the rule of {record.split} after each message"
    for index, (one, other) in enumerate(zip(sequence.targets, sequence.targets[1:], strict=False), start=1):
        if (apart := _apart(one, other)) < LEAST_APART:
            yield f"subtasks[{index}] is {apart:.2f} m from the object before; expected at least {LEAST_APART:g} m"
        if record.subtasks[index].info.previous_geodesic is None:
            yield f"subtasks[{index}].info.previous_geodesic is null; expected the walk from the object before"
    for index, (subtask, targets) in enumerate(zip(record.subtasks, sequence.targets, strict=True)):
        right = {goal.object_name for goal in targets}
        alike = {goal.object_name for goal in sequence.of_category(subtask.object_category)} - right
        if subtask.kind in ("changed", "stale") and not alike:
            yield f"subtasks[{index}] is {subtask.kind!r} without another {subtask.object_category!r} on its storey"
        elif subtask.old_object_id not in (None, *alike):
            found = f"subtasks[{index}].old_object_id is {subtask.old_object_id!r}"
            yield f"{found}; expected another {subtask.object_category!r} on its storey"
        old = [goal for goal in sequence.goals if goal.object_name == subtask.old_object_id]
        if (apart := _apart(targets, old)) < LEAST_APART:
            yield f"subtasks[{index}] is {apart:.2f} m from {old[0].object_name!r}; expected at least {LEAST_APART:g} m"
        told = {edge.object_name for edge in record.messages[0].adds if edge.owner == subtask.owner}
        if subtask.kind == "changed" and told & right:
            yield f"subtasks[{index}] is 'changed', but the intro gives {min(told & right)!r}; expected another answer"
        yield from _other_meanings(index, sequence)


def _apart(some: Sequence[Goal], others: Sequence[Goal]) -> float:
    """Least planar distance between two groups of objects, metres; inf where one is empty."""
    return min((planar_distance(a.position, b.position) for a in some for b in others), default=math.inf)


def _states(sequence: HomeSequence) -> Iterator[tuple[str, Mapping[Edge, int]]]:
    """Who owns what after each message and at each subtask, with its place in the file."""
    messages = sequence.record.messages
    for index, edges in enumerate(sequence.ownership):
        for number in [number for number, message in enumerate(messages) if message.before == index][:-1]:
            yield f"messages[{number}]", ownership_over_time(messages[: number + 1], index + 1)[index]
        yield f"subtasks[{index}]", edges


def _other_meanings(index: int, sequence: HomeSequence) -> Iterator[str]:
    """The categories of the owner's other objects that the query of a search could mean."""
    subtask = sequence.record.subtasks[index]
    categories = {goal.object_name: goal.object_category for goal in sequence.goals}
    theirs = {edge.object_name for edge in sequence.ownership[index] if edge.owner == subtask.owner}
    for other in sorted({categories[name] for name in theirs & categories.keys()} - {subtask.object_category}):
        if are_mixed_up(subtask.object_category, other):
            yield f"subtasks[{index}] could mean {subtask.owner}'s {other!r} too; expected a query with one meaning"


def broken_rule(split: Split, edges: Mapping[Edge, int]) -> str | None:
    """The rule of its split that an ownership breaks, in words; None where it keeps it."""
    if not edges:
        return "nobody owns anything"
    owners, items = (list(dict.fromkeys(names)) for names in zip(*edges, strict=True))
    numbered = [people.Edge(owners.index(edge.owner), items.index(edge.object_name)) for edge in edges]
    return people.broken_rule(split, numbered)
