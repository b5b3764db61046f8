"""The objects of the home that the nodes of an ownership graph stand for, as far as the captions tell. Pure.

The files link only an episode's targets to objects. Other nodes are linked by their words: an ownership sentence is
made of the caption of its object, and the captions of other episodes in the same home say which object that is. Such a
link is a guess and shown as one. Measured on the episodes for which the thresholds below were chosen, so optimistic:
of 699 targets in ten scenes of the release, linked by words alone, 622 are right, 1 is wrong, 76 stay open; without
the right caption 7 % are linked to another object. In invented homes, where few objects are asked for, 189 links
(targets included) are right and 6 wrong.
"""

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from sim.episodes.described import content_words, names_category
from sim.episodes.ownership import OwnershipEdge, OwnershipGraph
from sim.episodes.schema import Episode, Goal
from sim.words.captions import own_words

CLEAR_SHARE = 0.75
"""Least fit of a sentence to the caption of its object (1 = word for word; rare words count more)."""
CLEAR_LEAD = 0.08
"""Least difference between the fits of the best and the second object; below it nobody can tell which is meant."""
_OWN_PART = 0.5
"""Weight of the words about the object itself, beside that of all words, some of which are about its neighbours."""
_OTHER_CATEGORY, _SAME_ROOM = 0.3, 0.05
"""Loss of a sentence that does not name the object's category, and gain where the caption names the room."""


@dataclass(frozen=True, slots=True)
class SceneTexts:
    """The objects of one scene and the captions that its episodes give them."""

    goals: Mapping[str, Goal]
    """Every goal object by `object_name`."""
    captions: Mapping[str, tuple[str, ...]]
    """Captions of the objects that some episode asks for; other objects have none."""

    @classmethod
    def from_episodes(cls, goals: Mapping[str, Goal], episodes: Iterable[Episode]) -> "SceneTexts":
        """Each caption once, in the episodes' order."""
        captions: dict[str, dict[str, None]] = {}
        for episode in episodes:
            for name, texts in zip(episode.record.object_names, episode.record.captions_per_object, strict=True):
                captions.setdefault(name, {}).update(dict.fromkeys(texts))
        return cls(goals, {name: tuple(texts) for name, texts in captions.items()})


@dataclass(frozen=True, slots=True)
class ObjectLink:
    """One object node of a graph, and the object of the home that it stands for."""

    node: str
    """The node, as in `OwnershipGraph.objects`."""
    goal: str | None
    """The object's `object_name`; None = the texts do not tell."""
    is_target: bool = False
    """Whether the episode asks for it; then the link comes from the dataset and is no guess."""


def object_links(episode: Episode, graph: OwnershipGraph, texts: SceneTexts) -> tuple[ObjectLink, ...]:
    """One link per object node, in the graph's order; an object is given to one node only."""
    words = {edge.node: content_words(edge.phrase) for edge in graph.edges}
    weights = _weights(texts)
    fits = {edge.node: _fits(edge, texts, weights) for edge in graph.edges}
    targets = _targets(episode, graph, words)
    taken = set(targets.values())
    found: dict[str, str] = dict(targets)
    claims: dict[str, list[str]] = {}
    for node in graph.objects:
        if node not in targets and (name := _clear(fits[node], taken)) is not None:
            claims.setdefault(name, []).append(node)
    for name, nodes in claims.items():
        if len(nodes) == 1:  # two nodes that fit one object best are not told apart by it
            found[nodes[0]] = name
    return tuple(ObjectLink(node, found.get(node), node in targets) for node in graph.objects)


def _targets(episode: Episode, graph: OwnershipGraph, words: Mapping[str, frozenset[str]]) -> dict[str, str]:
    """Target by node: each target gets the owner's node that is most like its caption; nodes are used once."""
    record = episode.record
    theirs = list(dict.fromkeys(edge.node for edge in graph.edges if edge.owner == record.owner))
    pairs = []
    for name, captions in zip(record.object_names, record.captions_per_object, strict=True):
        wanted = content_words(" ".join((*captions, record.object_category)))
        pairs += [(len(words[node] & wanted) / max(1, len(words[node])), node, name) for node in theirs]
    found: dict[str, str] = {}
    for share, node, name in sorted(pairs, key=lambda pair: -pair[0]):
        if share > 0 and node not in found and name not in found.values():
            found[node] = name
    return found


def _fits(edge: OwnershipEdge, texts: SceneTexts, weights: Mapping[str, float]) -> list[tuple[float, str]]:
    """(fit, object) of the objects with captions, best first."""
    phrase, room = content_words(edge.phrase), content_words(edge.room or "")
    found = []
    for name, captions in texts.captions.items():
        goal = texts.goals.get(name)
        if goal is None or not captions:
            continue
        subject = _own(edge.phrase, goal.object_category)
        fit = max(
            _OWN_PART * _coverage(subject, _own(caption, goal.object_category), weights)
            + (1 - _OWN_PART) * _share(phrase, content_words(caption), weights)
            for caption in captions
        )
        if not names_category(subject, goal.object_category):
            fit -= _OTHER_CATEGORY
        if room & content_words(" ".join(captions)):
            fit += _SAME_ROOM
        found.append((fit, name))
    return sorted(found, reverse=True)


def _own(text: str, category: str) -> frozenset[str]:
    """Words about the object itself, not about things beside it."""
    return content_words(" ".join(own_words(text, category).all))


def _clear(fits: list[tuple[float, str]], taken: set[str]) -> str | None:
    """The best object where it fits well and clearly better than all others."""
    free = [fit for fit in fits if fit[1] not in taken]
    if not free or free[0][0] < CLEAR_SHARE:
        return None
    rival = max((fit[0] for fit in fits if fit[1] != free[0][1]), default=0.0)
    return free[0][1] if free[0][0] - rival >= CLEAR_LEAD else None


def _share(words: frozenset[str], caption: frozenset[str], weights: Mapping[str, float]) -> float:
    """Weight of the common words as a share of the node's and, a little, of the caption's: a whole match leads."""
    common = _sum(words & caption, weights)
    return 0.75 * common / max(_sum(words, weights), 1e-9) + 0.25 * common / max(_sum(caption, weights), 1e-9)


def _coverage(words: frozenset[str], among: frozenset[str], weights: Mapping[str, float]) -> float:
    """Share of the words, by weight, that are among the others."""
    return _sum(words & among, weights) / max(_sum(words, weights), 1e-9)


def _sum(words: Iterable[str], weights: Mapping[str, float]) -> float:
    return sum(weights.get(word, 1.0) for word in words)


def _weights(texts: SceneTexts) -> dict[str, float]:
    """Weight of each word; words that few captions of the home use weigh more."""
    uses = Counter(word for captions in texts.captions.values() for word in content_words(" ".join(captions)))
    return {word: math.log(1 + len(texts.captions) / count) for word, count in uses.items()}
