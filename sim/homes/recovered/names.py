"""Finds the rooms of recorded objects in texts, and the kind of each room; for rooms.py."""

import re
from collections import Counter
from collections.abc import Iterable
from typing import NamedTuple

from sim.episodes.ownership import normalise_phrase, parse_ownership
from sim.episodes.schema import Episode
from sim.words.places import ROOM_WORDS, RoomKind

_TURNS = re.compile(r"\b(?:of|near|next to|close to|with|without|before|between|from|front|on|connected|where)\b|[(,]")
"""The words after these give a room's place or content, not its kind."""
_SPELLING = {"closeth": "closet", "dinign": "dining", "edroom": "bedroom", "mastrt": "master", "bathrom": "bathroom"}
_PATTERN = re.compile(r"\b(?:" + "|".join(sorted(map(re.escape, ROOM_WORDS), key=lambda w: (-len(w), w))) + r")s?\b")
_VAGUE = re.compile(r"^(?:near|corner) | (?:part|area|region|section)$")
_LONGEST_NAME = 30

_USUAL: tuple[tuple[RoomKind, str], ...] = (
    ("bathroom", "toilet bathtub shower bath bathroom washbasin"),
    ("laundry room", "washing washer dryer washer-dryer"),
    ("kitchen", "refrigerator freezer oven stove dishwasher kitchen microwave cooker countertop worktop"),
    ("bedroom", "bed nightstand crib wardrobe"),
    ("dining room", "dining"),
    ("living room", "couch sofa fireplace"),
    ("studio", "desk office computer"),
    ("stairs", "stair stairs"),
)
"""Usual kinds of rooms by words in a thing's category; used only where no text names a room."""


class RoomName(NamedTuple):
    """A room's name in a text."""

    kind: RoomKind
    name: str
    """Short and in lower case: "master bedroom"."""
    text: str
    """The whole text, normalised: rooms with equal texts are one room if they are near."""


def room_texts(episodes: Iterable[Episode]) -> dict[str, Counter[str]]:
    """Counts of the rooms that ownership sentences give each target of a scene's episodes, by `object_name`.

    If the owner has several sentences, the one most similar to the target's caption and category counts.

    Raises:
        DatasetError: A sentence cannot be parsed.
    """
    found: dict[str, Counter[str]] = {}
    for episode in episodes:
        record = episode.record
        edges = [parse_ownership(sentence) for sentence in record.extracted_summary]
        theirs = [edge for edge in edges if edge.owner == record.owner and edge.room]
        for name, captions in zip(record.object_names, record.captions_per_object, strict=True):
            wanted = _words(" ".join((*captions[:1], record.object_category)))
            scored = [(len(wanted & _words(edge.phrase)) / max(len(_words(edge.phrase)), 1), edge) for edge in theirs]
            best = max(scored, key=lambda entry: entry[0], default=(0.0, None))
            if best[1] is not None and best[0] > 0 and best[1].room is not None:
                found.setdefault(name, Counter())[best[1].room.lower()] += 1
    return found


def _words(text: str) -> set[str]:
    return set(normalise_phrase(text).split()) - {"the", "a", "an", "is", "in", "of", "and", "on", "with", "it", "to"}


def room_name(text: str) -> RoomName | None:
    """The room in a text; None where the text has no word for a kind of room."""
    plain = " ".join(_SPELLING.get(word, word) for word in normalise_phrase(text.replace("-", " ")).split())
    plain = re.sub(r"\bthe\b|\b(?:an?|its)\b", " ", plain)
    plain = " ".join(plain.split())
    turned = _TURNS.split(plain)
    for place, part in enumerate(turned):
        words = _PATTERN.findall(part)
        if not words:
            continue
        last = words[-1] if place == 0 else words[0]  # "bedroom bathroom"; "between kitchen and living room"
        kind = _kind(last)
        head = _VAGUE.sub("", " ".join(part.split())) if place == 0 else kind
        return RoomName(kind, head if len(head) <= _LONGEST_NAME else kind, plain.replace("main bed", "master bed"))
    return None


def _kind(word: str) -> RoomKind:
    return ROOM_WORDS[word] if word in ROOM_WORDS else ROOM_WORDS[word.removesuffix("s")]


def usual_room(category: str) -> RoomKind | None:
    """The usual kind of room for things of this category; None for things that fit any room."""
    words = set(category.split())
    return next((kind for kind, names in _USUAL if words & set(names.split())), None)
