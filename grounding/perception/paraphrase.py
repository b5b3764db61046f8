"""Paraphrases captions for maps, to measure how much a method depends on the exact words of a description.

Levels: 0 unchanged; 1 other words in another order; 2 half of the attributes gone; 3 only the category. The category's
own words stay at every level, so that a level removes words and never adds any. Queries and phrases are not changed.
"""

import re
import zlib
from typing import Literal

import numpy as np

from sim.words.places import PLACED
from sim.words.synonyms import REWORDINGS

from ..encoders.hashed import STOP_WORDS

ParaphraseLevel = Literal[0, 1, 2, 3]

_LONG_FIRST = sorted(REWORDINGS, key=len, reverse=True)
_KNOWN = re.compile(rf"(?<![\w-])({'|'.join(map(re.escape, _LONG_FIRST))})(?![\w-])")
_CLAUSE = re.compile(
    r"[.,;:!?]+\s*|\s+(?=(?:near|beside|next to|above|over|below|under|in front of|behind|between|located|positioned|"
    r"standing|on|in|with|against|opposite|that|which|and|is|has|there)\b)"
)
_POSITION = frozenset((*PLACED, "standing"))
_LEADING = re.compile(r"^(?:and|that|which|it|there|is|are|has|also)\s+")


def paraphrase(caption: str, category: str, *, level: ParaphraseLevel, seed: int = 0) -> str:
    """The caption at this level; the same arguments give the same text.

    Args:
        category: The object's category; its words are never replaced and never dropped.
        level: 0 to 3, as in the module's docstring.
        seed: Chooses among the possible wordings.
    """
    if level == 0:
        return caption
    if level == 3:
        return category
    rng = np.random.default_rng([seed, zlib.crc32(caption.encode())])
    kept = {_stem(word) for word in category.lower().split()}
    clauses = _clauses(caption)
    if not clauses:
        return category
    head = next((i for i, clause in enumerate(clauses) if kept & set(map(_stem, clause.split()))), 0)
    first = clauses[head]
    others = [clause for i, clause in enumerate(clauses) if i != head and _says_more(clause, kept)]
    if level == 1:
        parts = [_reworded(_reordered(first, kept, rng), kept, rng)]
        parts += [_reworded(clause, kept, rng) for clause in others]
        text = ", ".join(parts[index] for index in rng.permutation(len(parts)))
    else:
        text = ", ".join(_half(first, others, kept, rng))
    return text if kept <= set(map(_stem, re.findall(r"[\w-]+", text))) else f"{category}, {text}".rstrip(", ")


def _stem(word: str) -> str:
    return word.lower().removesuffix("s")


def _clauses(caption: str) -> list[str]:
    """The head noun with its adjectives, and each further statement, without the words that tied them together."""
    found = []
    for clause in _CLAUSE.split(caption.lower()):
        while (shorter := _LEADING.sub("", clause.strip())) != clause:
            clause = shorter
        if any(_is_content(word) for word in clause.split()):
            found.append(clause)
    return found


def _is_content(word: str) -> bool:
    return word not in STOP_WORDS and word not in _POSITION and len(word) > 1


def _says_more(clause: str, kept: set[str]) -> bool:
    """Whether the clause says more than the category, as "the bed" in "the bed is located ..." does not."""
    return any(_is_content(word) and _stem(word) not in kept for word in clause.split())


def _reordered(clause: str, kept: set[str], rng: np.random.Generator) -> str:
    """The attributes in another order; function words and the category keep their places."""
    words = clause.split()
    places = [i for i, word in enumerate(words) if _is_content(word) and _stem(word) not in kept]
    for place, source in zip(places, rng.permutation(places).tolist(), strict=True):
        words[place] = clause.split()[source]
    return " ".join(words)


def _reworded(clause: str, kept: set[str], rng: np.random.Generator) -> str:
    def other(match: re.Match[str]) -> str:
        word = match.group(1)
        choices = REWORDINGS[word]
        return word if _stem(word) in kept else choices[int(rng.integers(len(choices)))]

    return _KNOWN.sub(other, clause)


def _half(first: str, others: list[str], kept: set[str], rng: np.random.Generator) -> list[str]:
    """The clauses that remain when half of the attributes (the larger half) are dropped.

    An attribute is a word of the head, or another clause as a whole.
    """
    words = first.split()
    own = [i for i, word in enumerate(words) if _is_content(word) and _stem(word) not in kept]
    units: list[tuple[str, int]] = [("word", i) for i in own] + [("clause", i) for i in range(len(others))]
    dropped = {units[index] for index in rng.permutation(len(units))[: (len(units) + 1) // 2]}
    head = " ".join(word for i, word in enumerate(words) if ("word", i) not in dropped)
    return [head, *(clause for i, clause in enumerate(others) if ("clause", i) not in dropped)]
