"""Words of home sequences: what released episodes tell, and messages in three phrasings per kind.

A message says what it adds and removes and nothing else; no pronoun stands for a person or a thing.
"""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from sim.errors import DatasetError
from sim.types import Split

from ...episodes.dataset import PersonalDataset
from ...episodes.described import content_words
from ...episodes.ownership import OwnershipEdge, ownership_graph
from ...episodes.schema import Episode
from ...episodes.sequences import Edge, MessageKind
from ..annotated import AnnotatedHome, Thing
from ..captions import names_category, ownership_sentence
from ..descriptions import OwnedItem, capital, number_word, placed
from .stories import Change

_LEAST = 0.8
"""Least share of a sentence's words in the captions of the object that it means."""
_AHEAD = 0.15
"""By so much less fits any other object of the storey."""


class Intro(NamedTuple):
    """An initial ownership and the words that tell it."""

    edges: tuple[Edge, ...]
    text: str
    sentences: tuple[str, ...]
    """One per edge, as in the `extracted_summary` of episodes."""
    source: str = ""
    """The episode that tells it; empty where none does."""


class Told(NamedTuple):
    """The words that a message is made of."""

    giver: str
    """The person who has less afterwards; of a `swap`, the first one; empty for `share`."""
    taker: str
    """The person who has more afterwards; of a `swap`, the other one; empty for `unshare` and `leave`."""
    things: tuple[str, ...]
    """The giver's thing with its room, then the taker's thing of a `swap`; none for `leave`."""
    loan: str = ""
    """How long a loan lasts: "the next two searches"."""


def message_text(change: Change, *, things: Mapping[str, Thing], rng: np.random.Generator) -> str:
    """One of the phrasings of a message that is no intro."""
    edges = change.removes or change.adds
    giver = change.removes[0].owner if change.removes else ""
    taker = next((edge.owner for edge in change.adds if edge.owner != giver), "")
    names = () if change.kind == "leave" else tuple(edge.object_name for edge in edges)
    words = tuple(placed(OwnedItem(things[name].phrase, things[name].room, ())) for name in names)
    length = (change.until or 0) - change.before
    loan = "the next search" if length == 1 else f"the next {number_word(length)} searches"
    phrasings = PHRASINGS[change.kind]
    return capital(phrasings[int(rng.integers(len(phrasings)))](Told(giver, taker, words, loan)))


def owned_items(edges: Iterable[Edge], things: Mapping[str, Thing]) -> list[OwnedItem]:
    """The objects of an ownership with their owners, as descriptions tell them."""
    owners: dict[str, list[str]] = {}
    for edge in edges:
        owners.setdefault(edge.object_name, []).append(edge.owner)
    return [OwnedItem(things[name].phrase, things[name].room, tuple(found)) for name, found in owners.items()]


def sentences(edges: Iterable[Edge], things: Mapping[str, Thing]) -> tuple[str, ...]:
    """One sentence per edge, as in the `extracted_summary` of episodes."""
    return tuple(
        ownership_sentence(edge.owner, things[edge.object_name].phrase, things[edge.object_name].room) for edge in edges
    )


def released_intros(dataset: PersonalDataset, home: AnnotatedHome) -> dict[tuple[Split, str], list[Intro]]:
    """The ownerships that the episodes of a home tell about its things, by split and `floor_id`.

    Raises:
        DatasetError: The episodes are damaged.
    """
    found: dict[tuple[Split, str], list[Intro]] = {}
    for episode in dataset.episodes(scenes=(home.name,)):
        intro = _intro(episode, home)
        if intro is not None:
            found.setdefault((episode.key.split, episode.record.floor_id), []).append(intro)
    return found


def _intro(episode: Episode, home: AnnotatedHome) -> Intro | None:
    """The ownership that an episode tells; None where an object is not known."""
    record = episode.record
    try:
        graph = ownership_graph(episode)
    except DatasetError:
        return None
    things = {name: home.things[name] for name in home.on_storey(record.floor_id)}
    names = {edge.node: _meant(edge, things) for edge in graph.edges}
    known = [name for name in names.values() if name is not None]
    edges = tuple(Edge(edge.owner, name) for edge in graph.edges if (name := names[edge.node]) is not None)
    asked = {Edge(record.owner, name) for name in record.object_names}
    if len(known) < len(names) or len(set(known)) < len(names) or not asked <= set(edges):
        return None
    if not all(re.search(rf"\b{re.escape(owner)}\b", record.summary) for owner in graph.people):
        return None
    return Intro(edges, record.summary, record.extracted_summary, str(episode.key))


def _meant(edge: OwnershipEdge, things: Mapping[str, Thing]) -> str | None:
    """The name of the only object that a sentence can mean."""
    words, room = content_words(edge.phrase), content_words(edge.room or "")
    scored = [
        (len(words & content_words(" ".join((*thing.captions, thing.goal.object_category)))) / max(len(words), 1), name)
        for name, thing in things.items()
        if names_category(thing.goal.object_category, edge.phrase) and content_words(thing.room) & room
    ]
    first, second = (*sorted(scored, reverse=True), (0.0, ""), (0.0, ""))[:2]
    return first[1] if first[0] >= _LEAST and second[0] < first[0] - _AHEAD else None


PHRASINGS: Mapping[MessageKind, Sequence[Callable[[Told], str]]] = {
    "transfer": (
        lambda t: f"{t.giver} gave {t.taker} {t.things[0]}.",
        lambda t: f"From {t.giver}, {t.taker} has received {t.things[0]}.",
        lambda t: f"One thing has changed hands, from {t.giver} to {t.taker}: {t.things[0]}.",
    ),
    "swap": (
        lambda t: (
            f"{t.giver} and {t.taker} have made an exchange: {t.giver} gave {t.things[0]}; {t.taker} gave "
            f"{t.things[1]}."
        ),
        lambda t: (
            f"Two things have changed places between {t.giver} and {t.taker}. To {t.taker} went {t.things[0]}; "
            f"to {t.giver} went {t.things[1]}."
        ),
        lambda t: f"{t.giver} gave {t.taker} {t.things[0]}; in return, {t.taker} gave {t.giver} {t.things[1]}.",
    ),
    "share": (
        lambda t: f"{t.taker} is now an owner, too, of {t.things[0]}.",
        lambda t: f"Without any loss to others, {t.taker} now has a share in {t.things[0]}.",
        lambda t: f"One more person, {t.taker}, now owns {t.things[0]}.",
    ),
    "unshare": (
        lambda t: f"{t.giver} no longer has a share in {t.things[0]}.",
        lambda t: f"{t.giver}, and nobody else, has given up a share in {t.things[0]}.",
        lambda t: f"For other owners nothing changes, but {t.giver} no longer owns {t.things[0]}.",
    ),
    "lend": (
        lambda t: (
            f"{t.giver} lends {t.taker} {t.things[0]}. For {t.loan}, {t.taker} counts as the owner, and then "
            f"{t.giver} again."
        ),
        lambda t: (
            f"From {t.giver}, {t.taker} has borrowed {t.things[0]}. The owner is {t.taker} for {t.loan}, and "
            f"{t.giver} afterwards."
        ),
        lambda t: (
            f"On loan from {t.giver} to {t.taker} is {t.things[0]}. During {t.loan} the owner is {t.taker}; "
            f"afterwards, {t.giver}."
        ),
    ),
    "leave": (
        lambda t: f"{t.giver} has moved out and owns nothing here any more.",
        lambda t: f"{t.giver} has left the home; nothing here belongs to {t.giver} any longer.",
        lambda t: f"Since {t.giver} moved away, nothing in the home belongs to {t.giver}.",
    ),
    "correction": (
        lambda t: f"Correction: {t.taker}, not {t.giver}, owns {t.things[0]}.",
        lambda t: f"The earlier account was mistaken: {t.taker}, and not {t.giver}, is the owner of {t.things[0]}.",
        lambda t: f"A mistake has to be put right. The owner is {t.taker}, not {t.giver}, of {t.things[0]}.",
    ),
}
"""The phrasings of each kind but `intro`."""
