"""Owners in an episode: ownership sentences to edges, edges to a graph of people and objects; the six queries.

Reads `extracted_summary` only, which is ground truth for people and PAN agents (DESIGN.md, "what may be seen").
"""

import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

from sim.errors import DatasetError

from .schema import Episode, EpisodeRecord

_LEADING_ARTICLE = re.compile(r"^(?:an?|the)\s+", re.IGNORECASE)
_NO_WORD = re.compile(r"[^\w\s]")
_QUERIES = (
    "Find {}", "Where is {}?", "Locate {}", "Retrieve {} position", "Identify the position of {}",
    "Give me the coordinates of {}",
)  # fmt: skip
"""The six sentences of the release (DATA_FORMAT.md, section 3)."""
_QUERIES_FOR_ALL = (
    "Find {}", "Where are {}?", "Locate {}", "Retrieve the positions of {}", "Identify the positions of {}",
    "Give me the coordinates of {}",
)  # fmt: skip
"""The same for several objects that are all wanted; our own."""


@dataclass(frozen=True, slots=True)
class OwnershipEdge:
    """One sentence "<owner> owns <phrase> in the <room>"."""

    owner: str
    """A person's first name."""
    phrase: str
    """The object as it is written, with its article, without room and final period."""
    room: str | None
    """The room as it is written, without its article; None where the sentence names none."""

    @property
    def node(self) -> str:
        """The object's name in the graph: normalised phrase and room; equal nodes are the same object."""
        phrase = normalise_phrase(self.phrase)
        return phrase if self.room is None else f"{phrase} in {normalise_phrase(self.room)}"


@dataclass(frozen=True, slots=True)
class OwnershipGraph:
    """People and objects of one episode, joined where a person owns an object."""

    edges: tuple[OwnershipEdge, ...]
    """One per (owner, node), in the order of the sentences; a repeated sentence counts once."""

    @property
    def people(self) -> tuple[str, ...]:
        """Owners in the order in which they appear."""
        return tuple(dict.fromkeys(edge.owner for edge in self.edges))

    @property
    def objects(self) -> tuple[str, ...]:
        """Object nodes in the order in which they appear."""
        return tuple(dict.fromkeys(edge.node for edge in self.edges))

    @property
    def num_objects_of(self) -> Counter[str]:
        """Number of objects of each person (r_i of the paper)."""
        return Counter(edge.owner for edge in self.edges)

    @property
    def num_owners_of(self) -> Counter[str]:
        """Number of owners of each object (c_j of the paper)."""
        return Counter(edge.node for edge in self.edges)

    @property
    def shared(self) -> tuple[str, ...]:
        """Objects with more than one owner."""
        return tuple(node for node, count in self.num_owners_of.items() if count > 1)

    @property
    def density(self) -> float:
        """Edges over all possible edges, in (0, 1]; 0 for an empty graph."""
        return _ratio(len(self.edges), len(self.people) * len(self.objects))

    @property
    def degree_per_person(self) -> float:
        """Mean number of objects per person; 0 for an empty graph."""
        return _ratio(len(self.edges), len(self.people))

    @property
    def degree_per_object(self) -> float:
        """Mean number of owners per object; 0 for an empty graph."""
        return _ratio(len(self.edges), len(self.objects))

    @property
    def overlap_ratio(self) -> float:
        """Shared objects over all objects, in [0, 1]; 0 for an empty graph."""
        return _ratio(len(self.shared), len(self.objects))


def parse_ownership(sentence: str) -> OwnershipEdge:
    """Owner, object phrase and room of one ownership sentence.

    The owner is the text before the first " owns ", the room the text after the last " in " (periods inside belong to
    pasted captions and do not end the sentence). 44 of the release's 16,873 sentences name no room.

    Raises:
        DatasetError: The sentence has no owner or no object.
    """
    owner, verb, rest = " ".join(sentence.split()).partition(" owns ")
    phrase, preposition, room = f" {rest}".rstrip(" .").rpartition(" in ")
    if not preposition:
        phrase, room = room, ""
    phrase = phrase.strip(" .,")
    if not verb or not owner or not phrase:
        raise DatasetError(
            f"ownership sentence: found {sentence!r}; expected '<Name> owns <object> in the <room>'. "
            '"personal-viz validate" lists every such sentence.'
        )
    return OwnershipEdge(owner, phrase, _LEADING_ARTICLE.sub("", room) or None)


def queries_for(owner: str, category: str, *, one_of: bool = False, all_of: bool = False) -> tuple[str, ...]:
    """The six equivalent questions for one object, for one of several of a category, or for all of them."""
    if all_of:
        return tuple(query.format(f"all of {owner}'s {category}s") for query in _QUERIES_FOR_ALL)
    asked = f"one of {owner}'s {category}s" if one_of else f"{owner}'s {category}"
    return tuple(query.format(asked) for query in _QUERIES)


def normalise_phrase(text: str) -> str:
    """Lower case, without leading article, punctuation and extra spaces.

    Articles inside stay: in hard/GLAQ4DNUx5U/787 two objects of one person differ only in an article.
    """
    return " ".join(_NO_WORD.sub("", _LEADING_ARTICLE.sub("", text.strip().lower())).split())


def graph_from_sentences(sentences: Iterable[str]) -> OwnershipGraph:
    """The graph of these ownership sentences.

    Raises:
        DatasetError: A sentence cannot be parsed.
    """
    unique: dict[tuple[str, str], OwnershipEdge] = {}
    for edge in map(parse_ownership, sentences):
        unique.setdefault((edge.owner, edge.node), edge)
    return OwnershipGraph(tuple(unique.values()))


def ownership_graph(episode: Episode) -> OwnershipGraph:
    """The graph of all the episode's sentences, including those about people who are not in the query.

    Raises:
        DatasetError: A sentence cannot be parsed; the message names the episode.
    """
    try:
        return graph_from_sentences(episode.record.extracted_summary)
    except DatasetError as error:
        raise DatasetError(f"{episode.key}: {error}") from None


def anonymous_summary(record: EpisodeRecord) -> tuple[str, dict[str, int]]:
    """The summary with every owner's name replaced by <1>, <2>, ... in the order of the text, and name to number.

    Two episodes with the same anonymous summary tell the same story: the release draws new names for each.

    Raises:
        DatasetError: An ownership sentence cannot be parsed.
    """
    names = sorted({parse_ownership(sentence).owner for sentence in record.extracted_summary}, key=len, reverse=True)
    if not names:
        return record.summary, {}
    slots: dict[str, int] = {}
    pattern = re.compile(rf"\b(?:{'|'.join(map(re.escape, names))})\b")
    text = pattern.sub(lambda found: f"<{slots.setdefault(found[0], len(slots) + 1)}>", record.summary)
    return text, slots


def _ratio(part: int, whole: int) -> float:
    return part / whole if whole else 0.0
