"""The order of a person's trials: random, with splits interleaved, and if possible no home twice in a row."""

from collections import Counter
from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

from sim.types import EpisodeKey, Split

T = TypeVar("T")


def in_order(items: Sequence[T], rng: np.random.Generator, *, key: Callable[[T], EpisodeKey]) -> list[T]:
    """The items in a random order in which all splits progress evenly.

    Args:
        items: The items in a fixed order, so that only `rng` decides (sort them first).
        rng: Draws the order.
        key: The episode of an item.
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
