"""Finds the words of a caption that are about the object itself, not about things beside, on or under it."""

import re
from functools import lru_cache
from typing import NamedTuple

from .colours import corrected
from .places import PLACE_PHRASES
from .synonyms import ALSO_CALLED

_CUT = re.compile(rf"\b(?:{'|'.join(PLACE_PHRASES)})\b")
_OWN_START = re.compile(
    r"\s*(?:and |also |then )*(?:it|they|these|this|which|that|its)\b|\s*(?:the|a|an|one of the|this)\b"
)
_PARTS = (
    "frame|frames|border|edges?|cushions?|sheets?|cover|covers|comforter|duvet|blanket|bedding|bedspread|seat|legs?|base|"
    "top|tops|countertops?|doors?|drawers|pot|shade|lampshade|handles?|stripes?|pattern|patterns|patterned|flowers|motif|"
    "dots|squares|lines|decorations?|structure|upholstery|fabric|backrest|surface|color|colors|body"
)
_WITH = re.compile(r"\bwith\b|\bhas\b|\bhaving\b|\bcontaining\b")
_OF_PART = re.compile(rf"^(?:\W*[\w'-]+){{0,6}}?\W*\b(?:{_PARTS})\b")
_STOP = frozenset(
    ["the", "a", "an", "of", "is", "are", "it", "that", "which", "this", "one", "two", "three", "four", "some", "with",
     "on", "in", "at", "to", "by", "from", "there", "its", "over", "under", "near", "has", "these", "they", "for"]
)  # fmt: skip


class OwnWords(NamedTuple):
    """The words of a caption about its object, in order; "-" stands where a hyphen joins two."""

    noun: list[str]
    """Attributes before the first mention of the category's own noun: of "a large blue sofa", "large blue"."""
    rest: list[str]
    """All words about the object itself, without `parts`."""
    parts: list[str]
    """Words about the object's parts and patterns: "golden frame", "white and blue stripes"."""

    @property
    def all(self) -> frozenset[str]:
        """Every word about the object."""
        return frozenset([*self.noun, *self.rest, *self.parts])


@lru_cache(maxsize=4096)
def own_words(text: str, category: str) -> OwnWords:
    """The words of a caption that describe the object of `category` itself."""
    lowered = re.sub(r"l[- ]?shape", "l shape", text.lower())
    rest: list[str] = []
    parts: list[str] = []
    for number, sentence in enumerate(re.split(r"[.;!]+", lowered)):
        if number and not _OWN_START.match(sentence):
            continue
        cut = _CUT.search(sentence)
        own = sentence[: cut.start()] if cut else sentence
        before, *with_phrases = _WITH.split(own)
        rest += _words(before)
        for phrase in with_phrases:
            if _OF_PART.match(phrase):
                parts += _words(phrase)
    return OwnWords(_before_noun(_words(lowered), category), rest, parts)


def _words(text: str) -> list[str]:
    return [corrected(word) for word in re.findall(r"[a-z]+|(?<=[a-z])-(?=[a-z])", text)]


def _before_noun(words: list[str], category: str) -> list[str]:
    """Up to eight words before the first mention of the category's noun, back to an article or preposition."""
    last = category.lower().replace("-", " ").split()[-1]
    nouns = {last, f"{last}s", f"{last}es", *ALSO_CALLED.get(last, ())}
    at = next((k for k, word in enumerate(words) if word in nouns), None)
    if at is None:
        return []
    start = at
    while start > 0 and at - start < 8 and words[start - 1] not in _STOP:
        start -= 1
    return words[start:at]
