"""Makes the plan of a study from the seed, offline: episodes, conditions and order of the trials of each person."""

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from sim.errors import StudyError
from sim.homes.plan import HOMES_VERSION
from sim.tasks.provenance import program_release
from sim.types import EpisodeKey, Split, TaskKind
from sim.words.english import how_many

from .dealing import deal
from .plan import Phase, PlannedParticipant, PlannedTrial, Slot, StudyPlan, StudyScene, per_person, with_groups
from .study import Condition, StudyConfig

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Practice:
    """Trials outside the pool."""

    scenes: tuple[StudyScene, ...] = ()
    keys: tuple[EpisodeKey, ...] = ()
    """Practice episodes, easiest first; used in turns."""
    check_keys: tuple[EpisodeKey, ...] = ()
    """Episodes of attention trials, whose target is in plain view; used in turns."""


def make_plan(
    config: StudyConfig,
    scenes: Sequence[StudyScene],
    episodes: Sequence[EpisodeKey],
    *,
    practice: Practice | None = None,
    is_pilot: bool = False,
) -> StudyPlan:
    """The plan; it does not depend on the order of scenes and episodes (which `sample_episodes` drew).

    With several conditions of a task, homes are dealt into as many groups, and a person's arm gives each group its
    condition; so conditions are mixed over a person's order and need no blocks.

    Raises:
        StudyError: There are no episodes, or they are repeated or outside the homes; the design is not possible; the
            study needs practice or attention trials but there is no episode for them.
    """
    keys, practice = sorted(set(episodes)), practice or Practice()
    _require_plannable(config, scenes, episodes, practice)
    rng = np.random.default_rng([config.dataset.seed, 1])
    homes = sorted(scenes, key=lambda scene: scene.name)
    grouped = with_groups(config, homes, [int(place) for place in rng.permutation(len(homes))])
    groups = {scene.name: scene.group for scene in grouped}
    people: list[tuple[TaskKind, int, list[Slot]]] = []
    by_task = [_people(config, task, keys, groups, rng) for task in config.task]
    for place in range(max(len(found) for found in by_task)):  # tasks in turns
        for task, found in zip(config.task, by_task, strict=True):
            if place < len(found):
                people.append((task, *found[place]))
    num_spare = math.ceil(len(people) * config.design.overbook) - len(people)
    for number in range(num_spare):
        people.append((config.task[number % len(config.task)], number // len(config.task), []))
    draft = StudyPlan(
        study_version=config.study_version,
        homes_version=HOMES_VERSION,
        made_by=program_release(),
        scenes=tuple(sorted(grouped, key=lambda scene: scene.name)),
        practice_scenes=practice.scenes,
        is_pilot=is_pilot,
        participants=(PlannedParticipant(code="p01", task=config.task[0], trials=()),),
    )
    planned = []
    for number, (task, arm, slots) in enumerate(people, start=1):
        order = in_order(slots, np.random.default_rng([config.dataset.seed, 2, number]), key=lambda slot: slot.key)
        trials = _trials(config, task, order, practice)
        planned.append(PlannedParticipant(code=f"p{number:02d}", task=task, arm=arm, trials=trials))
    return draft.model_copy(update={"participants": tuple(planned), "changes": _changes(config, planned)})


def in_order(items: Sequence[T], rng: np.random.Generator, *, key: Callable[[T], EpisodeKey]) -> list[T]:
    """The items in a random order in which all splits progress evenly.

    The items come in a fixed order, so that only `rng` decides (sort them first); `key` gives an item's episode.
    """
    left = [items[place] for place in rng.permutation(len(items))]
    totals: Counter[Split] = Counter(key(item).split for item in left)
    homes: Counter[str] = Counter(key(item).scene for item in left)
    splits = totals.copy()
    ordered: list[T] = []
    last = ""
    while left:
        must = next((home for home, count in homes.items() if home != last and count > len(left) // 2), None)

        def cost(item: T, last: str = last, must: str | None = must) -> tuple[bool, bool, float]:
            """Costs of the same home again, of not choosing a home that must be every second one, of a split ahead."""
            episode = key(item)
            return (
                episode.scene == last,
                must is not None and episode.scene != must,
                -splits[episode.split] / totals[episode.split],
            )

        best = min(left, key=cost)
        left.remove(best)
        ordered.append(best)
        last = key(best).scene
        homes[last] -= 1
        splits[key(best).split] -= 1
    return ordered


def _changes(config: StudyConfig, people: Sequence[PlannedParticipant]) -> tuple[str, ...]:
    """Requests of the study file that the plan does not meet, with the reasons."""
    main = [[trial for trial in person.trials if trial.phase == "main"] for person in people]
    counts = [len(trials) for trials in main if trials]
    asked, every = config.design.trials_per_person, config.checks.every
    changes = []
    if asked is not None and set(counts) != {asked}:
        planned = f"{max(counts)}" if len(set(counts)) == 1 else f"{min(counts)} to {max(counts)}"
        per_home = Counter(key.scene for key in {trial.key for trials in main for trial in trials})
        changes.append(
            f"design.trials_per_person: {asked} asked, {planned} planned, because {len(counts)} people, the fewest "
            f"among whom nobody meets a home twice, share {sum(counts)} counted trials evenly "
            f"({how_many(len(per_home), 'home')}, up to {max(per_home.values())} episodes in one)"
        )
    if config.design.kind == "house-once":
        changes += [line for task in config.task for line in _uneven_splits(people, task)]
    if every is not None and not any(trial.phase == "check" for person in people for trial in person.trials):
        changes.append(f"checks.every: {every} asked, no attention trial planned, because nobody has that many trials")
    return tuple(changes)


def _uneven_splits(people: Sequence[PlannedParticipant], task: TaskKind) -> list[str]:
    """A sentence for each split of which a person has more than one trial above or below the mean."""
    lines = []
    of_task = [person for person in people if person.task == task]
    for split, (least, most) in per_person(of_task).items():
        trials = [trial for person in of_task for trial in person.trials if trial.phase == "main"]
        homes = {trial.scene for trial in trials if trial.split == split}
        num_people = sum(any(trial.phase == "main" for trial in person.trials) for person in of_task)
        mean = sum(trial.split == split for trial in trials) / num_people
        if least < mean - 1 or most > mean + 1:
            lines.append(
                f"splits of each person: {least} to {most} {split} {task.upper()} trials planned, {mean:.1f} in the "
                f"mean, because nobody meets a home twice and these lie in {how_many(len(homes), 'home')}"
            )
    return lines


def _people(
    config: StudyConfig, task: TaskKind, keys: list[EpisodeKey], groups: dict[str, int], rng: np.random.Generator
) -> list[tuple[int, list[Slot]]]:
    """(arm, slots) of each person who does the task."""
    conditions = config.conditions(task)
    if config.design.kind == "crossed":
        num_people = config.design.raters_per_episode * len(conditions)
        chosen = [
            [Slot(task, _condition(conditions, groups, key, person), key, 0) for key in keys]
            for person in range(num_people)
        ]
    else:
        chosen = _house_once(config, task, keys, groups, rng)
    raters: Counter[tuple[Condition, EpisodeKey]] = Counter()
    people = []
    for person, slots in enumerate(chosen):
        numbered = []
        for slot in slots:
            raters[slot.condition, slot.key] += 1
            numbered.append(slot._replace(rep=raters[slot.condition, slot.key]))
        people.append((person % len(conditions), numbered))
    return people


def _house_once(
    config: StudyConfig, task: TaskKind, keys: list[EpisodeKey], groups: dict[str, int], rng: np.random.Generator
) -> list[list[Slot]]:
    """Slots of each person, never twice in one home: the fewest people, arms in turns, all with equally much to do."""
    conditions = config.conditions(task)
    raters, most = config.design.raters_per_episode, config.design.trials_per_person or len(groups)
    per_home = Counter(key.scene for key in keys)
    num_people = max(raters * max(per_home.values()), math.ceil(raters * len(keys) / min(most, len(per_home))))
    parts = {home: group % len(conditions) for home, group in groups.items()}
    arms = [deal(keys, raters, num_people, parts, rng) for _ in conditions]
    people = [found for in_turn in zip(*arms, strict=True) for found in in_turn]
    return [
        [Slot(task, _condition(conditions, groups, key, person), key, 0) for key in found]
        for person, found in enumerate(people)
    ]


def _condition(conditions: tuple[Condition, ...], groups: dict[str, int], key: EpisodeKey, person: int) -> Condition:
    return conditions[(groups[key.scene] + person % len(conditions)) % len(conditions)]


def _trials(config: StudyConfig, task: TaskKind, slots: Sequence[Slot], practice: Practice) -> tuple[PlannedTrial, ...]:
    """A person's trials: practice first, then the counted ones with attention trials between them."""
    conditions = config.conditions(task)
    num_practice = config.practice.pan if task == "pan" else config.practice.pog
    trials: list[PlannedTrial] = []

    def add(phase: Phase, slot: Slot) -> None:
        trials.append(PlannedTrial.of(slot, order_no=len(trials) + 1, phase=phase))

    for number in range(num_practice):
        key = practice.keys[number % len(practice.keys)]
        add("practice", Slot(task, conditions[number % len(conditions)], key, 0))
    for number, slot in enumerate(slots, start=1):
        add("main", slot)
        if config.checks.every is not None and number % config.checks.every == 0:
            place = number // config.checks.every - 1
            add("check", slot._replace(key=practice.check_keys[place % len(practice.check_keys)], rep=0))
    return tuple(trials)


def _require_plannable(
    config: StudyConfig, scenes: Sequence[StudyScene], episodes: Sequence[EpisodeKey], practice: Practice
) -> None:
    """Raises StudyError unless each episode is named once, in one of the homes, and the needed trials exist."""
    if not episodes or len(set(episodes)) != len(episodes):
        raise StudyError(
            f"study {config.study}: found {len(episodes)} episodes, {len(set(episodes))} of them different; "
            "expected at least one, each once. Correct the list of episodes."
        )
    outside = {key.scene for key in episodes} - {scene.name for scene in scenes}
    if outside:
        raise StudyError(
            f"study {config.study}: episodes lie in {sorted(outside)}; expected the study's homes "
            f"{sorted(scene.name for scene in scenes)}. Add the homes."
        )
    wants_practice = any(config.practice.pan if task == "pan" else config.practice.pog for task in config.task)
    most = config.design.trials_per_person or len(episodes)
    wants_checks = config.checks.every is not None and most >= config.checks.every
    for what, is_wanted, keys in (
        ("practice", wants_practice, practice.keys),
        ("checks", wants_checks, practice.check_keys),
    ):
        if is_wanted and not keys:
            raise StudyError(f"study {config.study}: {what} asks for trials, but there is no episode for them.")
    if config.design.kind == "crossed" and config.design.trials_per_person not in (None, len(episodes)):
        raise StudyError(
            f"study {config.study}: design.trials_per_person is {config.design.trials_per_person}; expected "
            f"{len(episodes)} in a crossed design, where everybody does every episode. Leave it out."
        )
