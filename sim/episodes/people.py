"""Who owns what in an invented episode: first names, and ownership graphs that keep the rules of their split."""

from collections import Counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.errors import DatasetError
from sim.types import Split

NAMES = (
    "Ada", "Bruno", "Carmen", "Dmitri", "Elif", "Farid", "Greta", "Hiro", "Ingrid", "Jonas", "Kofi", "Leila", "Mateo",
    "Nadia", "Oskar", "Priya", "Quentin", "Rosalind", "Sven", "Tamara", "Umar", "Viola", "Wanda", "Xenia", "Yusuf",
    "Zelda", "Anselm", "Beatriz", "Cosima", "Emeka",
)  # fmt: skip
"""No name begins another one, and none is a word of the templates."""
MAX_OBJECTS_PER_PERSON = 3
_TRIES = 300


class Edge(NamedTuple):
    """One person owns one object; both are indices."""

    person: int
    item: int


class _Range(NamedTuple):
    people: tuple[int, int]
    items: tuple[int, int]
    """Fewest and most, inclusive."""


_SIZES: dict[Split, _Range] = {
    "easy": _Range((3, 5), (3, 5)),
    "medium": _Range((2, 4), (4, 7)),
    "hard": _Range((4, 6), (5, 8)),
}


def draw_ownership(split: Split, conflicts: NDArray[np.bool_], *, rng: np.random.Generator) -> list[Edge]:
    """Who owns what, keeping the split's rule; people and objects are numbered from 0 without gaps.

    Rules (paper): easy, everybody owns one object and every object has one owner; medium, every object has one owner
    and somebody owns several; hard, somebody owns several and some object has several owners.

    Args:
        split: Which rule.
        conflicts: (M, M) symmetric; True where one person may not own both, because a query could mean either.
        rng: Draws sizes and edges.

    Raises:
        DatasetError: The rule cannot be met with these objects.
    """
    most = len(conflicts)
    sizes = _SIZES[split]
    for _ in range(_TRIES if most >= sizes.items[0] else 0):
        num_items = int(rng.integers(sizes.items[0], min(sizes.items[1], most) + 1))
        num_people = num_items if split == "easy" else int(rng.integers(sizes.people[0], sizes.people[1] + 1))
        edges = _drawn(split, num_people, num_items, rng)
        if broken_rule(split, edges) is None and not _has_conflict(edges, conflicts):
            return edges
    raise DatasetError(
        f"ownership graph: found no graph for split {split!r} over {most} objects in {_TRIES} tries; expected at least "
        f"{sizes.items[0]} objects of different categories on one storey. Take another --seed."
    )


def broken_rule(split: Split, edges: list[Edge]) -> str | None:
    """What is wrong with a graph for its split, in words; None when it keeps the rule."""
    per_person = Counter(edge.person for edge in edges)
    per_item = Counter(edge.item for edge in edges)
    if len(set(edges)) < len(edges):
        return "an edge stands twice"
    if max(per_person.values()) > MAX_OBJECTS_PER_PERSON:
        return f"somebody owns more than {MAX_OBJECTS_PER_PERSON} objects"
    shares, owns_several = max(per_item.values()) > 1, max(per_person.values()) > 1
    if split != "hard" and shares:
        return "an object has several owners"
    if split == "hard" and not shares:
        return "no object has several owners"
    if (split == "easy") == owns_several:
        return "somebody owns several objects" if owns_several else "nobody owns several objects"
    return None


def _drawn(split: Split, num_people: int, num_items: int, rng: np.random.Generator) -> list[Edge]:
    """Every object gets an owner, everybody an object; in hard some objects get more owners."""
    owners = np.concatenate([np.arange(num_people), rng.integers(num_people, size=max(0, num_items - num_people))])
    owners = rng.permutation(owners)[: max(num_items, num_people)]
    items = np.arange(len(owners)) % num_items
    edges = {Edge(int(person), int(item)) for person, item in zip(owners, items, strict=True)}
    if split == "hard":
        for _ in range(int(rng.integers(2, 6))):
            edges.add(Edge(int(rng.integers(num_people)), int(rng.integers(num_items))))
    return sorted(edges)


def _has_conflict(edges: list[Edge], conflicts: NDArray[np.bool_]) -> bool:
    return any(a.person == b.person and a.item < b.item and conflicts[a.item, b.item] for a in edges for b in edges)
