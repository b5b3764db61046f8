"""Makes the plan of a study from the seed, offline: episodes, conditions and order of the trials of each person."""

import math
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from sim.errors import StudyError
from sim.homes.plan import HOMES_VERSION
from sim.tasks.provenance import program_release
from sim.types import EpisodeKey, Split, TaskKind
from sim.words.english import how_many

from .max_flow import flow_of
from .plan import Phase, PlannedParticipant, PlannedTrial, Slot, StudyPlan, StudyScene, with_groups
from .study import Condition, StudyConfig

T = TypeVar("T")
_MORE_PEOPLE = 200
"""Number of people above the minimum that are tried before a plan counts as impossible."""


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
    if every is not None and not any(trial.phase == "check" for person in people for trial in person.trials):
        changes.append(f"checks.every: {every} asked, no attention trial planned, because nobody has that many trials")
    return tuple(changes)


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
    config: StudyConfig,
    task: TaskKind,
    keys: list[EpisodeKey],
    groups: dict[str, int],
    rng: np.random.Generator,
) -> list[list[Slot]]:
    """Slots of each person, never twice in one home: the fewest people that a maximum flow allows, as even as possible.

    Raises:
        StudyError: No number of people is enough.
    """
    conditions = config.conditions(task)
    raters, most = config.design.raters_per_episode, config.design.trials_per_person or len(groups)
    num_slots = raters * len(keys) * len(conditions)
    per_home = Counter(key.scene for key in keys)
    least = max(math.ceil(num_slots / min(most, len(per_home))), raters * len(conditions) * max(per_home.values()))
    step = len(conditions)
    shuffled = [keys[place] for place in rng.permutation(len(keys))]
    for num_people in range(math.ceil(least / step) * step, least + _MORE_PEOPLE, step):
        edges: list[tuple[str, str, int]] = []
        order = [int(place) for place in rng.permutation(num_people)]
        for person in order:
            edges += [(f"person {person}", f"visit {person} {scene}", 1) for scene in sorted(per_home)]
            for key in (shuffled[place] for place in rng.permutation(len(shuffled))):
                condition = _condition(conditions, groups, key, person)
                edges.append((f"visit {person} {key.scene}", f"episode {condition} {key}", 1))
        edges += [(f"episode {condition} {key}", "to", raters) for condition in conditions for key in shuffled]
        even = math.ceil(num_slots / num_people)
        for each in sorted({even, min(even + 1, most), most}):
            loads = [("from", f"person {person}", each) for person in order]
            flow = flow_of([*loads, *edges], source="from", sink="to")
            if sum(amount for (tail, _), amount in flow.items() if tail == "from") == num_slots:
                by_name = {f"episode {of} {key}": Slot(task, of, key, 0) for of in conditions for key in keys}
                return _slots_of(flow, num_people, by_name)
    raise StudyError(
        f"study {config.study}: design house-once with {most} trials a person and {max(per_home.values())} episodes in "
        f"one home found no plan with up to {least + _MORE_PEOPLE} people; expected one. Lower dataset.max_per_scene."
    )


def _slots_of(flow: dict[tuple[str, str], int], num_people: int, by_name: dict[str, Slot]) -> list[list[Slot]]:
    """Slots of each person in a flow; `by_name` has them by the names of their nodes."""
    slots: dict[int, list[Slot]] = defaultdict(list)
    for tail, head in flow:
        if tail.startswith("visit "):
            slots[int(tail.split()[1])].append(by_name[head])
    return [sorted(slots[person], key=lambda slot: slot.key) for person in range(num_people)]


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
