"""Ownerships that the episodes of an edition tell, with their descriptions: they begin home sequences.

Ownership sentences -> the objects that they mean -> `Intro`; an episode in which a sentence fits no object of the home,
or two, gives none.
"""

import re
from collections.abc import Mapping
from typing import NamedTuple

from sim.errors import DatasetError
from sim.types import Split

from ..episodes.dataset import PersonalDataset
from ..episodes.described import content_words
from ..episodes.ownership import OwnershipEdge, ownership_graph
from ..episodes.schema import Episode
from ..episodes.sequences import Edge
from .annotated import AnnotatedHome, Thing
from .captions import names_category

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
