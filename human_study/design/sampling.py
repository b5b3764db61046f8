"""Draws a study's episodes or home sequences by the study's seed, as evenly over the homes as the study wants."""

import math
from collections import Counter, defaultdict
from collections.abc import Sequence
from typing import Literal

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import maximum_flow

from sim.errors import StudyError
from sim.types import EpisodeKey, Split

from .study import StudyConfig


def sample_episodes(config: StudyConfig, pool: Sequence[EpisodeKey]) -> tuple[EpisodeKey, ...]:
    """The study's episodes, or its home sequences, sorted; the order of the pool does not matter.

    Raises:
        StudyError: The pool has too few episodes or a repeated one, or the limit per home leaves too few.
    """
    wanted_scenes = set(config.dataset.scenes) or {key.scene for key in pool}
    left = sorted(key for key in set(pool) if key.scene in wanted_scenes)
    missing = wanted_scenes - {key.scene for key in left}
    if missing or len(set(pool)) != len(pool):
        found = f"no episode of {sorted(missing)}" if missing else "episodes that are named twice"
        raise StudyError(f"study {config.study}: found {found}; expected each home and each episode once. See stats.")
    rng = np.random.default_rng(config.dataset.seed)
    if config.sequences is not None:
        return _sequences(config, left, config.sequences.number, rng)
    groups: dict[tuple[Split, str], list[EpisodeKey]] = defaultdict(list)
    for key in left:
        groups[key.split, key.scene].append(key)
    counts = _counts(config, groups, rng)
    drawn = []
    for group, count in counts.items():
        drawn += [groups[group][place] for place in rng.permutation(len(groups[group]))[:count]]
    return tuple(sorted(drawn))


def _sequences(
    config: StudyConfig, pool: Sequence[EpisodeKey], number: int | Literal["all"], rng: np.random.Generator
) -> tuple[EpisodeKey, ...]:
    """So many sequences of any split, in turns from each home; raises StudyError where there are fewer."""
    places: Counter[str] = Counter()
    found: list[tuple[int, EpisodeKey]] = []
    for key in (pool[place] for place in rng.permutation(len(pool))):
        places[key.scene] += 1
        found.append((places[key.scene], key))
    cap = config.dataset.max_per_scene or len(pool)
    allowed = [(place, key) for place, key in found if place <= cap]
    wanted = len(pool) if number == "all" else number
    if len(allowed) < wanted:
        raise StudyError(
            f"study {config.study}: sequences.number asks for {wanted}, the set with at most {cap} of one home gives "
            f"{len(allowed)}; expected enough sequences. Ask for fewer or raise dataset.max_per_scene."
        )
    if config.dataset.stratify == "scene":
        allowed.sort(key=lambda one: one[0])
    return tuple(sorted(key for _, key in allowed[:wanted]))


def _counts(
    config: StudyConfig, groups: dict[tuple[Split, str], list[EpisodeKey]], rng: np.random.Generator
) -> dict[tuple[Split, str], int]:
    """Number of episodes of each (split, home): the most even choice that the limits allow.

    It uses the smallest bound per (split, home), and then the smallest bound per home, with which a maximum flow fills
    all splits; raises StudyError when there is none.
    """
    wanted = {
        split: sum(len(keys) for (of, _), keys in groups.items() if of == split) if count == "all" else count
        for split, count in config.dataset.splits.items()
    }
    names = sorted(groups)
    order = [names[place] for place in rng.permutation(len(names))]
    num_wanted = sum(wanted.values())

    def flow(bound: int, cap: int) -> dict[tuple[str, str], int]:
        edges = [("from", f"split {split}", count) for split, count in wanted.items()]
        edges += [(f"split {of}", f"scene {home}", min(bound, len(groups[of, home]))) for of, home in order]
        edges += [(f"scene {home}", "to", cap) for home in sorted({home for _, home in order})]
        return _flow([edge for edge in edges if edge[2] > 0])

    def is_full(found: dict[tuple[str, str], int]) -> bool:
        return sum(amount for (tail, _), amount in found.items() if tail == "from") == num_wanted

    cap = config.dataset.max_per_scene or num_wanted
    largest = max((len(keys) for keys in groups.values()), default=0)
    is_even = config.dataset.stratify == "scene"
    bound = next((bound for bound in (range(1, largest + 1) if is_even else ()) if is_full(flow(bound, cap))), largest)
    found = flow(bound, cap)
    if not is_full(found):
        reached = {split: found.get(("from", f"split {split}"), 0) for split in wanted}
        raise StudyError(
            f"study {config.study}: dataset.splits asks for {wanted}, the dataset with at most {cap} of one home gives "
            f"{reached}; expected enough episodes. Ask for fewer or raise dataset.max_per_scene."
        )
    if is_even:
        least = math.ceil(num_wanted / len({home for _, home in order}))
        found = next(evener for most in range(least, cap + 1) if is_full(evener := flow(bound, most)))
    return {(split, scene): found.get((f"split {split}", f"scene {scene}"), 0) for split, scene in order}


def _flow(edges: Sequence[tuple[str, str, int]]) -> dict[tuple[str, str], int]:
    """A largest possible flow from `from` to `to`, as amounts > 0 by (tail, head).

    The edges are (tail, head, capacity > 0), each pair once. The choice among equal flows depends only on the order in
    which nodes first appear.
    """
    numbers: dict[str, int] = {}
    for name in ("from", "to", *(name for edge in edges for name in edge[:2])):
        numbers.setdefault(name, len(numbers))
    tails = [numbers[tail] for tail, _, _ in edges]
    heads = [numbers[head] for _, head, _ in edges]
    capacities = np.array([capacity for _, _, capacity in edges], np.int32)
    graph = csr_array((capacities, (tails, heads)), shape=(len(numbers), len(numbers)))
    flow = maximum_flow(graph, numbers["from"], numbers["to"], method="dinic").flow.tocoo()
    names = list(numbers)
    return {
        (names[tail], names[head]): int(amount)
        for tail, head, amount in zip(flow.coords[0], flow.coords[1], flow.data, strict=True)
        if amount > 0
    }
