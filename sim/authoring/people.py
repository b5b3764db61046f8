"""Owners in generated episodes: first names, and ownership graphs that keep the rules of their split."""

from collections import Counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.errors import DatasetError
from sim.types import Split

NAMES = (
    "Ada", "Bruno", "Carmen", "Dmitri", "Elif", "Farid", "Greta", "Hiro", "Ingrid", "Jonas", "Kofi", "Leila", "Mateo",
    "Nadia", "Oskar", "Priya", "Quentin", "Rosalind", "Sven", "Tamara", "Umar", "Viola", "Wanda", "Xenia", "Yusuf",
    "Zelda", "Anselm", "Beatriz", "Cosima", "Emeka", "Fiona", "Gustav", "Hanako", "Idris", "Jelena", "Kamal", "Lorenzo",
    "Mirela", "Nils", "Olga", "Pavel", "Ravi", "Sofia", "Thiago", "Ulrike", "Valentin", "Winston", "Yara", "Zoltan",
    "Amara", "Benedikt", "Chiara", "Diego", "Estelle", "Florian", "Gwen", "Haruto", "Imani", "Jakub", "Katarina",
    "Lucas", "Malik", "Noemi", "Omar", "Petra", "Rafael", "Selma", "Tobias", "Ursula", "Vikram", "Wilhelm", "Yasmin",
    "Zainab", "Alba", "Bjorn", "Camille", "Dagny", "Ezra", "Freya", "Giulia", "Henrik", "Ismail", "Joaquin", "Keiko",
    "Ludmila", "Marisol", "Nkechi", "Orla", "Pascal", "Rashid", "Svetlana", "Teodora", "Usha", "Veronika", "Wojtek",
    "Yannick", "Zora",
)  # fmt: skip
"""No name is the beginning of another name, and none is a word of the templates."""
MAX_OBJECTS_PER_PERSON = 3
_TRIES = 400
_GREED = 0.75
"""Chance of each object beyond a person's first, in hard."""
_SHARING = 2.0
"""Concentration of the weights by which people choose objects in hard (upstream draws 1.5 to 4)."""


class Edge(NamedTuple):
    """One person owns one object; both are indices."""

    person: int
    item: int


class _Range(NamedTuple):
    people: tuple[int, int]
    items: tuple[int, int]
    """Smallest and largest number, inclusive."""


_SIZES: dict[Split, _Range] = {
    "easy": _Range((3, 5), (3, 5)),
    "medium": _Range((2, 5), (4, 7)),
    "hard": _Range((4, 8), (5, 9)),
}
"""Approximately the sizes of the release (DATA_FORMAT.md, section 10)."""


def draw_ownership(split: Split, conflicts: NDArray[np.bool_], *, rng: np.random.Generator) -> list[Edge]:
    """Pairs of owner and object that keep the split's rule; people and objects are numbered from 0 without gaps.

    Rules (paper): easy, everybody owns one object and every object has one owner; medium, every object has one owner
    and somebody owns several; hard, somebody owns several and some object has several owners. `conflicts` (M, M) is
    True where one person may not own both, because a query could mean either.

    Raises:
        DatasetError: The rule cannot be met with these objects.
    """
    most = len(conflicts)
    sizes = _SIZES[split]
    for _ in range(_TRIES if most >= sizes.items[0] else 0):
        num_items = int(rng.integers(sizes.items[0], min(sizes.items[1], most) + 1))
        num_people = num_items if split == "easy" else int(rng.integers(sizes.people[0], sizes.people[1] + 1))
        drawn = _drawn_hard(num_people, num_items, rng) if split == "hard" else _drawn(num_people, num_items, rng)
        if drawn is not None and broken_rule(split, drawn) is None and not _has_conflict(drawn, conflicts):
            return drawn
    raise DatasetError(
        f"ownership graph: found no graph for split {split!r} over {most} objects in {_TRIES} tries; expected at least "
        f"{sizes.items[0]} objects of different categories on one storey. Take another --seed."
    )


def unmet_need(split: Split, conflicts: NDArray[np.bool_]) -> str | None:
    """The constraint of a split that no graph over these objects can keep, with what is found and needed; or None.

    Args:
        split: The split.
        conflicts: As in `draw_ownership`.
    """
    most, least = len(conflicts), _SIZES[split].items[0]
    if most < least:
        rule = {"easy": "everybody owns one object and every object has one owner"}.get(split, "every object is owned")
        return f"{rule}: found {most} objects, needs {least}"
    if split != "easy" and (conflicts | np.eye(most, dtype=bool)).all():
        return f"somebody owns several objects: any two of the {most} could answer one query, needs two that cannot"
    return None


def broken_rule(split: Split, edges: list[Edge]) -> str | None:
    """The rule of its split that a graph breaks, in words; None when it keeps it."""
    per_person = Counter(edge.person for edge in edges)
    per_item = Counter(edge.item for edge in edges)
    if len(set(edges)) < len(edges):
        return "an edge appears twice"
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


def _drawn(num_people: int, num_items: int, rng: np.random.Generator) -> list[Edge] | None:
    """Every object has one owner, everybody an object; None where there are more people than objects."""
    if num_people > num_items:
        return None
    owners = np.concatenate([np.arange(num_people), rng.integers(num_people, size=num_items - num_people)])
    return sorted(Edge(int(person), item) for item, person in enumerate(rng.permutation(owners)))


def _drawn_hard(num_people: int, num_items: int, rng: np.random.Generator) -> list[Edge] | None:
    """Everybody owns up to three objects, some of which are popular; None where objects would be left over."""
    counts = np.minimum(1 + rng.binomial(MAX_OBJECTS_PER_PERSON - 1, _GREED, size=num_people), num_items)
    if counts.sum() < num_items:
        return None
    weights = rng.dirichlet(np.full(num_items, _SHARING))
    slots = rng.permutation(np.repeat(np.arange(num_people), counts))
    owned: dict[int, set[int]] = {person: set() for person in range(num_people)}
    for item, person in enumerate(slots[:num_items].tolist()):  # every object gets one owner first
        owned[person].add(item)
    for person in slots[num_items:].tolist():
        left = np.array([0.0 if item in owned[person] else weights[item] for item in range(num_items)])
        owned[person].add(int(rng.choice(num_items, p=left / left.sum())))
    return sorted(Edge(person, item) for person, items in owned.items() for item in items)


def _has_conflict(edges: list[Edge], conflicts: NDArray[np.bool_]) -> bool:
    return any(a.person == b.person and a.item < b.item and conflicts[a.item, b.item] for a in edges for b in edges)
