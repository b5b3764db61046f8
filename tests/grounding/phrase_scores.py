"""Agreement of phrases found in a text with reference phrases: F1 of (owner, object) pairs and of owners."""

import re
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

from grounding.encoders.hashed import STOP_WORDS
from grounding.phrases.ownership_text import parse_phrase

SAME = 0.5
"""Two object texts with at least this similarity are the same object (GROUNDING.md section 6)."""
_PLACING = frozenset(("located", "situated", "positioned", "placed", "owns", "found", "set"))


class PhraseScores(NamedTuple):
    """Agreement in [0, 1], pooled over the pairs (or owners) of all descriptions."""

    pair_f1: float
    """Pairs match if their owners are equal and the words of the objects have a token F1 of at least SAME."""
    pair_overlap_f1: float
    """The same with the share of the shorter text's words that both texts have, instead of the token F1."""
    owner_f1: float


def phrase_scores(found: Iterable[Sequence[str]], reference: Iterable[Sequence[str]]) -> PhraseScores:
    """Compares the phrases "X owns Y in the Z" of each description with its reference phrases.

    Words are lower case; articles, prepositions and words such as "located" do not count. Each phrase matches at most
    one other; the most similar phrases are matched first.
    """
    parsed = [
        tuple([(parse_phrase(phrase).owner, _words(parse_phrase(phrase).text)) for phrase in side] for side in both)
        for both in zip(found, reference, strict=True)
    ]
    people = [tuple({owner for owner, _ in side if owner} for side in both) for both in parsed]
    return PhraseScores(
        _f1((_num_matches(*both, lambda shared, one, other: 2 * shared / (one + other)), both) for both in parsed),
        _f1((_num_matches(*both, lambda shared, one, other: shared / min(one, other)), both) for both in parsed),
        _f1((len(both[0] & both[1]), both) for both in people),
    )


def _f1(counts: Iterable[tuple[int, Sequence]]) -> float:
    """F1 of (matches, both sides); 1 if both sides are empty."""
    rows = [(matches, len(ours) + len(theirs)) for matches, (ours, theirs) in counts]
    total = sum(size for _, size in rows)
    return 2 * sum(matches for matches, _ in rows) / total if total else 1.0


def _num_matches(ours: list, theirs: list, alike: Callable[[int, int, int], float]) -> int:
    """Number of matched pairs; `alike` gives the similarity for the numbers of shared words and of words of both."""
    ranked = sorted(
        (-score, i, j)
        for i, (owner, words) in enumerate(ours)
        for j, (other, others) in enumerate(theirs)
        if owner == other and words & others and (score := alike(len(words & others), len(words), len(others))) >= SAME
    )
    used: set[tuple[str, int]] = set()
    for _, i, j in ranked:
        if ("ours", i) not in used and ("theirs", j) not in used:
            used |= {("ours", i), ("theirs", j)}
    return len(used) // 2


def _words(text: str) -> frozenset[str]:
    return frozenset(re.findall(r"\w+", text.lower())) - STOP_WORDS - _PLACING
