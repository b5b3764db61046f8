"""How well phrases read from the text agree with reference phrases: F1 of (owner, object) pairs and of owners."""

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from grounding.encoders.hashed import STOP_WORDS
from grounding.phrases.ownership_text import parse_phrase

SAME = 0.5
"""Two object texts at least this alike are the same object (GROUNDING.md, section 6)."""
_Alike = Callable[[frozenset[str], frozenset[str]], float]
_PLACING = frozenset(("located", "situated", "positioned", "placed", "owns", "found", "set"))


@dataclass(frozen=True, slots=True)
class PhraseScores:
    """Agreement over some descriptions, in [0, 1], all pairs (or owners) of all of them together."""

    pair_f1: float
    """Pairs match when their owners are equal and the objects' words have a token F1 of at least SAME."""
    pair_overlap_f1: float
    """The same with shared words over the words of the shorter text."""
    owner_f1: float
    num_descriptions: int


def phrase_scores(found: Iterable[Sequence[str]], reference: Iterable[Sequence[str]]) -> PhraseScores:
    """Compares the phrases of each description with its reference phrases.

    Words are lower case; articles, prepositions and "located", "situated" do not count. Each phrase matches at most
    one other, the most alike first.

    Args:
        found: Of each description, phrases "X owns Y in the Z".
        reference: Of the same descriptions in the same order.
    """
    pairs = list(zip(found, reference, strict=True))
    token = _f1((_num_matches(ours, theirs, _token_f1), len(ours), len(theirs)) for ours, theirs in pairs)
    overlap = _f1((_num_matches(ours, theirs, _overlap), len(ours), len(theirs)) for ours, theirs in pairs)
    people = [(_owners(ours), _owners(theirs)) for ours, theirs in pairs]
    owner = _f1((len(ours & theirs), len(ours), len(theirs)) for ours, theirs in people)
    return PhraseScores(token, overlap, owner, len(pairs))


def _f1(counts: Iterable[tuple[int, int, int]]) -> float:
    """F1 of matches among all found and all wanted; 1 when there is nothing to find and nothing was found."""
    rows = list(counts)
    matches, found, wanted = (sum(row[k] for row in rows) for k in range(3))
    return 2 * matches / (found + wanted) if found + wanted else 1.0


def _owners(phrases: Sequence[str]) -> set[str]:
    return {owner for phrase in phrases if (owner := parse_phrase(phrase).owner)}


def _num_matches(ours: Sequence[str], theirs: Sequence[str], alike: _Alike) -> int:
    ranked = sorted(
        (
            (-score, i, j)
            for i, first in enumerate(ours)
            for j, second in enumerate(theirs)
            if parse_phrase(first).owner == parse_phrase(second).owner
            and (score := alike(_words(parse_phrase(first).text), _words(parse_phrase(second).text))) >= SAME
        ),
    )
    used_ours: set[int] = set()
    used_theirs: set[int] = set()
    for _, i, j in ranked:
        if i not in used_ours and j not in used_theirs:
            used_ours.add(i)
            used_theirs.add(j)
    return len(used_ours)


def _words(text: str) -> frozenset[str]:
    return frozenset(re.findall(r"\w+", text.lower())) - STOP_WORDS - _PLACING


def _token_f1(first: frozenset[str], second: frozenset[str]) -> float:
    return 2 * len(first & second) / max(1, len(first) + len(second))


def _overlap(first: frozenset[str], second: frozenset[str]) -> float:
    return len(first & second) / max(1, min(len(first), len(second)))
