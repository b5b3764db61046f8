"""Writes the scene description of an episode by templates: owners, things and rooms, in varied sentences."""

from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from ..words.english import with_article

_THINGS_PER_SENTENCE = 3
"""Most objects in one sentence."""


class OwnedItem(NamedTuple):
    """An object with the names of its owners."""

    phrase: str
    """The object's words without article: "green velvet armchair near the oak bookshelf"."""
    room: str
    owners: tuple[str, ...]


class Describe(Protocol):
    """Writes the paragraph that participants and agents read."""

    def __call__(self, items: Sequence[OwnedItem], *, floor: str, rng: np.random.Generator) -> str | None:
        """The paragraph; None where none could be written for these items, so that others are drawn."""
        ...


def write_description(items: Sequence[OwnedItem], *, floor: str, rng: np.random.Generator) -> str:
    """A paragraph that says, in varied sentences, the floor, the room and the owners of everything.

    It contains every item's phrase word for word, once, with its room and all of its owners; a pronoun always means the
    one object or the one group of people that its own sentence has just named.
    """
    left = [items[k] for k in rng.permutation(len(items))]
    sentences: list[str] = []
    while left:
        group, frames = _next_group(left, rng)
        left = [item for item in left if item not in group]
        sentences.append(frames[int(rng.integers(len(frames)))](group))
    openings = (
        f"We are on the {floor} of the home.", f"This is about the {floor}.", f"Everything here is on the {floor}.",
        f"Walking through the {floor}, one meets the things of several people.",
        f"The {floor} of this home holds the belongings of {number_word(len(_people(items)))} {_people_word(items)}.",
        f"Here is who owns what on the {floor}.", f"Not everything on the {floor} belongs to everybody.",
    )  # fmt: skip
    closings = (
        "", "", "", "Nothing else here has an owner.", "That is all that anyone has claimed on this level.",
        f"So much for the {floor}.",
    )  # fmt: skip
    return " ".join([str(rng.choice(openings)), *sentences, str(rng.choice(closings))]).strip()


def placed(item: OwnedItem) -> str:
    """The thing with its room: "the red lamp in the hall"."""
    return f"the {item.phrase} in the {item.room}"


def capital(text: str) -> str:
    """The text with a capital first letter."""
    return text[0].upper() + text[1:]


def number_word(count: int) -> str:
    """ "one", "two"; digits from eleven on."""
    words = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")
    return words[count] if count < len(words) else str(count)


_Frame = Callable[[Sequence[OwnedItem]], str]


def _next_group(left: Sequence[OwnedItem], rng: np.random.Generator) -> tuple[list[OwnedItem], Sequence[_Frame]]:
    """The subject of the next sentence: things of the same people, things of one room, or a single thing."""
    first = left[0]
    theirs = [item for item in left if item.owners == first.owners][:_THINGS_PER_SENTENCE]
    near = [item for item in left if item.room == first.room][:_THINGS_PER_SENTENCE]
    draw = rng.random()
    if len(theirs) > 1 and draw < 0.6:
        return theirs, _OF_PEOPLE
    if len(near) > 1 and len({item.owners for item in near}) == len(near) and draw < 0.85:
        return near, _OF_ROOM
    others = [item for item in left if item.owners != first.owners and item.room != first.room]
    if others and draw < 0.35:
        return [first, others[0]], _OF_TWO
    return [first], _SHARED if len(first.owners) > 1 else _SINGLE


def _joined(parts: Sequence[str]) -> str:
    """ "a", "a and b", "a, b and c"."""
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"


def _people(items: Sequence[OwnedItem]) -> set[str]:
    return {owner for item in items for owner in item.owners}


def _people_word(items: Sequence[OwnedItem]) -> str:
    return "person" if len(_people(items)) == 1 else "people"


def _names(item: OwnedItem) -> str:
    return _joined(item.owners)


def _verb(item: OwnedItem) -> str:
    return "owns" if len(item.owners) == 1 else "own"


def _the(item: OwnedItem) -> str:
    return f"the {item.phrase}"


def _a(item: OwnedItem) -> str:
    return with_article(item.phrase)


def _is_of(item: OwnedItem) -> str:
    """ "is Ada's", "belongs to Ada and Bo"."""
    return f"is {item.owners[0]}'s" if len(item.owners) == 1 else f"belongs to {_names(item)}"


def _listed(items: Sequence[OwnedItem]) -> str:
    """The things with their rooms, separated by semicolons, because phrases have an "and" of their own."""
    parts = [placed(item) for item in items]
    return parts[0] if len(parts) == 1 else f"{'; '.join(parts[:-1])}; and {parts[-1]}"


_SINGLE: Sequence[_Frame] = (
    lambda g: f"In the {g[0].room}, {_the(g[0])} belongs to {_names(g[0])}.",
    lambda g: f"{capital(placed(g[0]))} {_is_of(g[0])}.",
    lambda g: f"{_names(g[0])} is the owner of {placed(g[0])}.",
    lambda g: f"There is {_a(g[0])} in the {g[0].room}; it belongs to {_names(g[0])}.",
    lambda g: f"Whoever looks around the {g[0].room} finds {_a(g[0])}, which {_names(g[0])} owns.",
    lambda g: f"The {g[0].room} is where {_names(g[0])} keeps a thing of their own: {_the(g[0])}.",
    lambda g: f"As for {_names(g[0])}, {placed(g[0])} is theirs.",
    lambda g: f"It is {_names(g[0])} who owns {_the(g[0])}, which is to be found in the {g[0].room}.",
    lambda g: f"Ask {_names(g[0])} before you touch {placed(g[0])}, for it is theirs alone.",
)
_SHARED: Sequence[_Frame] = (
    lambda g: f"{_names(g[0])} share {placed(g[0])}.",
    lambda g: f"In the {g[0].room}, {_the(g[0])} belongs to {_names(g[0])} together.",
    lambda g: f"{capital(placed(g[0]))} has {number_word(len(g[0].owners))} owners: {_names(g[0])}.",
    lambda g: f"There is {_a(g[0])} in the {g[0].room}; it is owned jointly by {_names(g[0])}.",
    lambda g: f"One thing that {_names(g[0])} have bought together is {placed(g[0])}.",
    lambda g: f"{_names(g[0])} are the owners of {placed(g[0])}, each as much as the other.",
)
_OF_PEOPLE: Sequence[_Frame] = (
    lambda g: f"{_names(g[0])} {_verb(g[0])} {_listed(g)}.",
    lambda g: f"{number_word(len(g)).capitalize()} things belong to {_names(g[0])}: {_listed(g)}.",
    lambda g: f"To {_names(g[0])} belong {_listed(g)}.",
    lambda g: f"{capital(_listed(g))}: {'both' if len(g) == 2 else 'all'} of these belong to {_names(g[0])}.",
    lambda g: f"{_names(g[0])} {_verb(g[0])} {placed(g[0])}, and {_listed(g[1:])} as well.",
)
_OF_ROOM: Sequence[_Frame] = (
    lambda g: f"In the {g[0].room}, {', and '.join(f'{_the(item)} belongs to {_names(item)}' for item in g)}.",
    lambda g: (
        f"{number_word(len(g)).capitalize()} things in the {g[0].room} have owners: "
        + "; ".join(f"{_the(item)} {_is_of(item)}" for item in g)
        + "."
    ),
    lambda g: (
        f"The {g[0].room} is shared ground: {'; '.join(f'{_names(item)} {_verb(item)} {_the(item)}' for item in g)}."
    ),
    lambda g: (
        f"While {_the(g[0])} in the {g[0].room} {_is_of(g[0])}, "
        + ", and ".join(f"{_the(item)} in the same room belongs to {_names(item)}" for item in g[1:])
        + "."
    ),
)
_OF_TWO: Sequence[_Frame] = (
    lambda g: f"{_names(g[0])} {_verb(g[0])} {placed(g[0])}, whereas {placed(g[1])} belongs to {_names(g[1])}.",
    lambda g: f"{capital(placed(g[0]))} {_is_of(g[0])}, and {placed(g[1])} {_is_of(g[1])}.",
    lambda g: f"If {placed(g[0])} belongs to {_names(g[0])}, {placed(g[1])} belongs to {_names(g[1])} just as surely.",
    lambda g: (
        f"In the {g[0].room} {_names(g[0])} {_verb(g[0])} {_the(g[0])}; in the {g[1].room} "
        f"{_names(g[1])} {_verb(g[1])} {_the(g[1])}."
    ),
)
