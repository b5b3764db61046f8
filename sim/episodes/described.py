"""Reads a description's words about one object: colour, pattern, material, size, shape, room, things nearby.

Episode text + the object's caption -> `Described`. The caption tells which words belong to the object; only words that
the description (`summary`) repeats are kept, because people and agents read nothing else.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, get_args

from sim.words.captions import own_words
from sim.words.colours import COLOUR_NAMES
from sim.words.finishes import Material, Pattern
from sim.words.places import RELATIONS, UPON
from sim.words.synonyms import ONE_NAME

from .ownership import OwnershipEdge, parse_ownership
from .schema import EpisodeRecord

Size = Literal["large", "small", "tall", "low", "long", "short"]
Shape = Literal["round", "square", "rectangular", "l-shaped"]

_ATTRIBUTIVE = frozenset({"with", "has", "having", "of"})
"""Words after which a caption is still about the object, but a colour may belong to a thing on it."""
_SUBJECT = frozenset({"it", "its", "they", "their", "this", "these"})
_STOP = frozenset({
    "a", "an", "the", "of", "to", "and", "is", "are", "it", "that", "there", "one", "which", "with", "in", "s", "two",
    "three",
})  # fmt: skip
_SAME = 0.6
"""Least share of a caption's words in the sentence that was made from it."""


@dataclass(frozen=True, slots=True)
class Described:
    """A description's words about one object; empty where it has none."""

    colours: tuple[str, ...] = ()
    """Colour words, each after "dark" or "light" where the text says so."""
    materials: tuple[Material, ...] = ()
    patterns: tuple[Pattern, ...] = ()
    sizes: tuple[Size, ...] = ()
    shapes: tuple[Shape, ...] = ()
    room: str | None = None
    """The room of the ownership sentence."""
    beside: frozenset[str] = frozenset()
    """Words for the things that it stands next to, in front of, between ..."""
    upon: frozenset[str] = frozenset()
    """Words for the things that it is on, over or under."""


def described_object(record: EpisodeRecord, *, caption: str, category: str, owner: str | None) -> Described | None:
    """The words of the episode's description about the object with this caption, category and owner (None = any owner).

    None where the description does not mention the object.
    """
    edges = [edge for edge in _edges(record.extracted_summary) if owner in (None, edge.owner)]
    wanted = content_words(caption)
    shares = [len(wanted & content_words(f"{edge.phrase} {edge.room or ''}")) / max(1, len(wanted)) for edge in edges]
    if not edges or (owner is None and max(shares) < _SAME):
        return None
    edge = edges[shares.index(max(shares))]
    said = _said_words(record, content_words(f"{caption} {edge.phrase} {category}"), {edge.owner.lower()})
    own, beside, upon = _parts(f"{caption}. {edge.phrase}", category)
    own += [_normal(word) for word in _furniture_words(caption, category)]
    own = [word for word in own if word in said]
    return Described(
        colours=_colours(own),
        materials=tuple(name for name in get_args(Material) if name in own),
        patterns=tuple(name for name in get_args(Pattern) if name in own),
        sizes=tuple(name for name in get_args(Size) if name in own),
        shapes=tuple(name for name in get_args(Shape) if name in own),
        room=edge.room if edge.room and content_words(edge.room) & content_words(record.summary) else None,
        beside=frozenset(beside & said),
        upon=frozenset(upon & said),
    )


def names_category(words: Iterable[str], category: str) -> bool:
    """Whether some of the (normalised) words name a category: all its words, or its last one."""
    words = frozenset(words)
    parts = [_normal(part) for part in category.lower().replace("-", " ").split()]
    return bool(parts) and (parts[-1] in words or frozenset(parts) <= words)


def content_words(text: str) -> frozenset[str]:
    """The normalised words of a text that carry meaning."""
    return frozenset(_words(text)) - _STOP


def _edges(sentences: Iterable[str]) -> list[OwnershipEdge]:
    """The well-formed ownership sentences; `personal-viz validate` reports the others."""
    return [parse_ownership(sentence) for sentence in sentences if re.search(r"\S owns \S", sentence)]


def _said_words(record: EpisodeRecord, wanted: frozenset[str], names: set[str]) -> set[str]:
    """Words of the description's sentences about the object: the most similar ones, those that name its owner, and the
    sentences that continue them ("It is ...")."""
    sentences = [_words(sentence) for sentence in re.split(r"(?<=[.!?;])\s+", record.summary)]
    best = max(len(wanted.intersection(sentence)) for sentence in sentences)
    found: set[str] = set()
    is_about_it = False
    for sentence in sentences:
        is_likely = len(wanted.intersection(sentence)) >= max(1, best - 1) or not names.isdisjoint(sentence)
        is_about_it = is_likely or (is_about_it and sentence[:1] != [] and sentence[0] in _SUBJECT)
        if is_about_it:
            found.update(sentence)
    return found


def _parts(text: str, category: str) -> tuple[list[str], set[str], set[str]]:
    """Words about the object itself in order, words of things beside it, and words of things that it is on or under."""
    own: list[str] = []
    beside: set[str] = set()
    upon: set[str] = set()
    head = _normal(category.lower().split()[-1])
    for index, sentence in enumerate(re.split(r"[.!?;]", text)):
        words = _words(sentence)
        is_subject = index == 0 or (bool(words) and (words[0] in _SUBJECT or head in words[:3]))
        relation = "" if is_subject else "of another"
        for word in words:
            if word in RELATIONS or (word in _ATTRIBUTIVE and not relation):
                relation = word
            elif not relation:
                own.append(word)
            elif relation in _ATTRIBUTIVE:
                own += [word] if word not in COLOUR_NAMES else []
                upon.add(word)
            elif relation in UPON:
                upon.add(word)
            else:
                beside.add(word)
    return own, beside, upon


def _furniture_words(caption: str, category: str) -> list[str]:
    """Words for finishes, found as for building furniture: misspellings are corrected, parts of things recognised."""
    words = own_words(caption, category)
    return [*words.noun, *words.rest, *words.parts]


def _colours(own: list[str]) -> tuple[str, ...]:
    found = []
    for before, word in zip(["", *own], own, strict=False):
        if word in COLOUR_NAMES:
            found.append(f"{before} {word}" if before in ("dark", "light") else word)
    return tuple(dict.fromkeys(found))


def _words(text: str) -> list[str]:
    return [_normal(word) for word in re.findall(r"[a-z]+(?:-[a-z]+)*", text.lower().replace("l-shape ", "l-shaped "))]


def _normal(word: str) -> str:
    """One form for a word, its plural and its synonyms."""
    if word in ONE_NAME:
        return ONE_NAME[word]
    single = word[:-1] if len(word) > 3 and word.endswith("s") and word[-2:] not in ("ss", "is", "us") else word
    return ONE_NAME.get(single, single)
