"""Reads owner, thing and room out of queries and phrases with regular expressions.

Queries of the release are "Find Mira's chair" in six wordings, phrases "Mira owns a red chair in the kitchen"; all of
them parse (GROUNDING.md, section 1).
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..encoders.protocol import TextEncoder

_QUERY = re.compile(
    r"(?P<one_of>\b(?:one|all) of )?(?P<owner>[^\s'’]+)['’]s?\s+(?P<category>.+?)(?:\s+position)?\s*[?.!]*$",
    re.IGNORECASE,
)
_OWNS = re.compile(r"^\s*(?P<owner>\S+)\s+owns\s+(?P<thing>.*\S)\s*$", re.IGNORECASE | re.DOTALL)
_ROOM = re.compile(r"^(?P<thing>.*\S)[\s,.]+in\s+(?P<room>(?:the|a|an|one|another)?\s*[^,.]+?)[\s.]*$", re.DOTALL)
_ARTICLE = re.compile(r"^(?:an?|the|one|some|another)\s+", re.IGNORECASE)
_LONGEST_ROOM = 4
"""Most words in a room's name; a longer tail after the last " in " belongs to the thing ("in the style of ...")."""


@dataclass(frozen=True, slots=True)
class Wanted:
    """The owner and category that a query asks for."""

    owner: str
    category: str
    """Singular, as the dataset names it."""


@dataclass(frozen=True, slots=True)
class OwnedThing:
    """The owner, thing and room of a phrase."""

    owner: str
    """Empty where the phrase names none."""
    text: str
    """The phrase without its owner: "a red chair in the kitchen"."""
    thing: str
    """`text` without article and room: "red chair"."""
    room: str
    """Lower case, without article; empty where the phrase names none."""


class Asked(NamedTuple):
    """The things that a task's phrases name, and the one that its query means."""

    things: tuple[OwnedThing, ...]
    """Each text once: a thing that several people own competes for a place only once."""
    chosen: int
    """Index into `things`."""

    @property
    def texts(self) -> tuple[str, ...]:
        """The text of each thing."""
        return tuple(item.text for item in self.things)


def parse_query(query: str) -> Wanted | None:
    """Owner and category of "Find X's Y" in any wording; None where the query names no owner."""
    found = _QUERY.search(query.strip())
    if found is None:
        return None
    category = found["category"]
    if found["one_of"] and category.endswith("s"):
        category = category[:-1]  # the release's plural is a bare "s": "one of Mira's chest of drawerss"
    return Wanted(found["owner"], category)


def parse_phrase(phrase: str) -> OwnedThing:
    """Owner, thing and room of "X owns Y in Z"; a phrase of another form is a thing without owner and room."""
    found = _OWNS.match(phrase)
    owner, text = (found["owner"], found["thing"]) if found else ("", phrase.strip())
    tail = _ROOM.match(text)
    room = _ARTICLE.sub("", tail["room"]).strip().lower() if tail else ""
    if tail is None or not 0 < len(room.split()) <= _LONGEST_ROOM:
        return OwnedThing(owner, text, _ARTICLE.sub("", text), "")
    return OwnedThing(owner, text, _ARTICLE.sub("", tail["thing"]).rstrip(" .,"), room)


def asked_thing(phrases: Sequence[str], query: str, encoder: TextEncoder) -> Asked | None:
    """The thing that the query means: the owner's phrase most like the category; None if the owner has none.

    Likeness = cosine of the phrase without its owner with the category, + 1 where the category's word or plural
    occurs in it (GROUNDING.md, section 0); ties go to the first.
    """
    things = [parse_phrase(phrase) for phrase in phrases]
    wanted = parse_query(query)
    index = None if wanted is None else _wanted(things, wanted, encoder)
    if index is None:
        return None
    distinct = {item.text: item for item in things}
    return Asked(tuple(distinct.values()), list(distinct).index(things[index].text))


def says_category(text: str, category: str) -> bool:
    """Whether the category's word or plural occurs in a text."""
    return re.search(rf"\b{re.escape(category)}(?:e?s)?\b", text, re.IGNORECASE) is not None


def _wanted(things: Sequence[OwnedThing], wanted: Wanted, encoder: TextEncoder) -> int | None:
    mine = [index for index, item in enumerate(things) if item.owner.casefold() == wanted.owner.casefold()]
    if len(mine) < 2:
        return mine[0] if mine else None
    vectors = encoder.encode_texts([*(things[index].text for index in mine), wanted.category])
    likeness = vectors[:-1] @ vectors[-1] + [says_category(things[index].text, wanted.category) for index in mine]
    return mine[int(np.argmax(likeness))]
