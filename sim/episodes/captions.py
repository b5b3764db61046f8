"""Words for invented homes: what an object is called, ownership sentences, scene descriptions, queries."""

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sim.scenes.plan import Furniture, HomePlan

_NEAR = 2.0
"""A neighbour this close (planar metres) is worth a mention."""
_QUERIES = (
    "Find {}", "Where is {}?", "Locate {}", "Retrieve {} position", "Identify the position of {}",
    "Give me the coordinates of {}",
)  # fmt: skip
"""The six sentences of the release (DATA_FORMAT.md, section 3)."""


class OwnedItem(NamedTuple):
    """An object with the names of the people it belongs to."""

    phrase: str
    """Without article: "green velvet armchair near the oak bookshelf"."""
    room: str
    owners: tuple[str, ...]


def with_article(phrase: str) -> str:
    """ "a green armchair", "an oak desk"."""
    return f"{'an' if phrase[0] in 'aeiou' else 'a'} {phrase}"


def caption_of(piece: Furniture, plan: HomePlan) -> str:
    """What a person would call the piece: colour, material, category, and what it stands on or near; no article."""
    own = piece.caption or piece.category
    others = [other for other in plan.furniture if other.room == piece.room and other.category != piece.category]
    below = next((other for other in others if _stands_on(piece, other)), None)
    if below is not None:
        return f"{own} on the {below.caption or below.category}"
    near = [
        (_planar(piece, other), other.name, other) for other in others if abs(other.centre[1] - piece.centre[1]) < 2
    ]
    if near and min(near)[0] <= _NEAR:
        neighbour = min(near)[2]
        return f"{own} next to the {neighbour.caption or neighbour.category}"
    return f"{own} against the wall" if _near_edge(piece, plan) else f"{own} with space around it"


def are_mixed_up(first: str, second: str) -> bool:
    """Whether one category's word is part of the other's ("chair" of "desk chair"), so that a query could mean both."""
    return any(re.search(rf"\b{re.escape(a)}s?\b", b) is not None for a, b in ((first, second), (second, first)))


def ownership_sentence(owner: str, phrase: str, room: str) -> str:
    """The `extracted_summary` sentence of one edge."""
    return f"{owner} owns {with_article(phrase)} in the {room}"


def queries_for(owner: str, category: str) -> tuple[str, ...]:
    """The six equivalent questions for one object."""
    return tuple(query.format(f"{owner}'s {category}") for query in _QUERIES)


def write_description(items: Sequence[OwnedItem], *, floor: str, rng: np.random.Generator) -> str:
    """A paragraph that says, with varied syntax, on which floor and in which room everything is and whose it is."""
    order = [items[k] for k in rng.permutation(len(items))]
    if rng.random() < 0.5:
        sentences = _by_person(order, rng)
    else:
        rooms = list(dict.fromkeys(item.room for item in order))
        sentences = [s for room in rooms for s in _of_room(room, [i for i in order if i.room == room], rng)]
    openings = (
        f"We are on the {floor} of the home.", f"This is about the {floor}.", f"Everything here is on the {floor}.",
        f"Walking through the {floor}, one meets the things of several people.",
    )  # fmt: skip
    return " ".join([str(rng.choice(openings)), *sentences])


def _planar(a: Furniture, b: Furniture) -> float:
    return float(np.hypot(a.centre[0] - b.centre[0], a.centre[2] - b.centre[2]))


def _stands_on(piece: Furniture, other: Furniture) -> bool:
    gap = (piece.centre[1] - piece.size[1] / 2) - (other.centre[1] + other.size[1] / 2)
    return abs(gap) < 0.03 and other.rect.holds(piece.centre[0], piece.centre[2])


def _near_edge(piece: Furniture, plan: HomePlan) -> bool:
    rects = [room.rect for room in plan.rooms if room.name == piece.room and room.rect is not None]
    return any(not rect.grown(-0.3).holds_rect(piece.rect) for rect in rects)


def _joined(parts: Sequence[str]) -> str:
    """ "a", "a and b", "a, b and c"."""
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"


def _by_person(items: Sequence[OwnedItem], rng: np.random.Generator) -> list[str]:
    """One sentence per group of owners, with all that is theirs."""
    found = []
    for owners in dict.fromkeys(item.owners for item in items):
        things = _joined([f"the {item.phrase} in the {item.room}" for item in items if item.owners == owners])
        people, verb = _joined(owners), "owns" if len(owners) == 1 else "own"
        several = sum(item.owners == owners for item in items) > 1
        found.append(
            str(
                rng.choice(
                    [
                        f"{people} {verb} {things}.",
                        f"To {people} {'belong' if several else 'belongs'} {things}.",
                        f"Ask {people} before you use {things}: {'they are' if several else 'it is'} theirs alone.",
                    ]
                )
            )
        )
    return found


def _of_room(room: str, items: Sequence[OwnedItem], rng: np.random.Generator) -> list[str]:
    """Sentences about one room's objects."""
    found = []
    for k, item in enumerate(items):
        people, verb = _joined(item.owners), "owns" if len(item.owners) == 1 else "own"
        place = f"the {room}" if k == 0 else str(rng.choice([f"the {room}", "the same room"]))
        found.append(
            str(
                rng.choice(
                    [
                        f"In {place}, the {item.phrase} belongs to {people}.",
                        f"There is {with_article(item.phrase)} in {place}, which {people} {verb}.",
                        f"{people} {verb} the {item.phrase}, which one finds in {place}.",
                        f"Whoever looks around {place} sees {with_article(item.phrase)}; it is owned by {people}.",
                    ]
                )
            )
        )
    return found
