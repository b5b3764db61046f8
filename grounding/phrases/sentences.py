"""Sentences of a description, the names in it, and the words that tie names to things ("owned by", "belongs to").

First step of `rules`; no language model and no list of first names: a name is a capitalised word that stands
where only an owner can stand.
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

Side = Literal["left", "right"]

_ADVERB = (
    r"(?:also|both|each|all|jointly|collectively|together|additionally|likewise|similarly|solely|individually|equally|"
    r"further|still|now|currently|notably|meanwhile|in turn|separately|exclusively|alone|mutually|commonly|proudly|"
    r"uniquely|respectively|furthermore|as well|too|instead|in common|either|specifically)"
)
_GAP = rf"(?:\s*,?\s*(?:{_ADVERB}\b|on the other hand|in addition|for example|by contrast),?)*\s+"
_OWNERSHIP = r"(?:[\w-]+ ){0,3}?(?:co-)?(?:ownership|possession|stake|claim)s? (?:of|over|in|to)"
_HAS = r"(?:has|have|having|holds?|holding|takes?|shar(?:es?|ing)|claims?|with|enjoys?|retains?|maintains?|lays?)"
_OWNS = (
    rf"(?:{_HAS} {_OWNERSHIP}|(?:is|are|being|as) (?:[\w-]+ ){{0,3}}?(?:co-)?owners? of|have bought together is|"
    r"keeps? a thing of their own:|(?:jointly |collectively )?(?:co-?)?own(?:s|ing|ed)?|"
    r"(?:co-?)?possess(?:es|ing|ed)?|shar(?:es?|ing))(?!\s+(?:\w+\s+)?(?:by|among|between)\b)"
)
"""Words that always mean ownership."""
_KEEPS = (
    r"(?:has|have|having|had|keeps?|claims?|holds?|boasts?|enjoys?|uses?|maintains?|cherish(?:es)?)"
    r"(?!\s+(?:\w+ed|been|chosen)\b)"
)
"""Words that mean ownership only after a name."""
_BELONGS = (
    rf"(?:(?:is|are|being)\s+)?(?:{_ADVERB}\s+|(?:\w+ly)\s+|co-)*(?:co-?)?(?:owned|possessed|shared|claimed|held|kept)"
    rf"(?:\s+(?:{_ADVERB}|ownership|property))*\s*,?\s*(?:by|among(?:st)?|between|with)"
    rf"|belong(?:s|ing)?(?:\s+{_ADVERB}|,)*\s+to|under the ownership of|in the possession of"
    r"|(?:is|are|being|as)\s+(?:[\w-]+ ){0,3}?(?:property|possessions?|belongings?) of|the property of"
    r"|(?:has|have) \w+ owners:|with(?: [\w-]+)? owners?|owners? (?:is|are|being|includes?)"
    r"|(?:is|are) (?:attributed|assigned|credited) to|ownership (?:belongs|goes|is attributed) to"
)
_PEOPLE = (
    r"(?:(?:both|all|each of|only|everyone|people|individuals|owners|residents|members|occupants|named|including|"
    r"namely|by|to|the|group|trio|pair|duo|of|two|three|four|five|six|seven|eight|nine|several|multiple|a|larger|"
    r"different|these|following|household|roommates|same)\b[:,]?\s+)*"
)
"""Words between the verb and the names, as in "shared by all four individuals: Ada, Bo ..."."""
_CAPITAL = r"\b(?:[A-Z]')?[^\W\d_a-z][^\W\d_A-Z]+(?:[A-Z][^\W\d_A-Z]+)*(?:[-'][^\W\d_a-z][^\W\d_]+)*\b"
_NO_NAMES = frozenset(
    word
    for line in (
        "A After All Also Although An And Another Any As Ask At Because Before Below Beneath Beside Besides",
        "Between Both But By Down Each Either Every Everyone Finally First From Further Furthermore He Her",
        "Here His If In Inside It Its Just Lastly Located Meanwhile Moreover Moving Near Nearby Next No Not",
        "Nothing On One Only Or Other Outside Over Overall Ownership Second Several She Similarly Since",
        "Situated Some That The Their Them Then There These They This Those Three Through Throughout To",
        "Together Two Under Up Upstairs We What When Where Which While Who Whoever With Within Additionally",
        "Across Adjacent Altogether Downstairs Four Five Six Many Most Others Opposite Single Such Thus",
        "Turning Various Floor Room Rooms People Residents Individuals Whereas Likewise Specifically Notably",
        "Adjoining Alongside Beyond Continuing Entering Elsewhere Towards Toward Collectively Objects Items",
    )
    for word in line.split()
)
"""Words that begin sentences."""
_SENTENCE_END = re.compile(r"(?<=[.!?])[\"')]*\s+(?=[^a-z\s])")
_RELATIVE = re.compile(r"(?:,\s*|\b)(?:which|that|whom)\s+$")
_ENDS = re.compile(r"\s*(?:$|[,;.]|and\b|in\b|on\b|jointly|together|as well|too\b|collectively|while\b)")
_MANY = re.compile(r"\b(?:are|both|all)\b.*\b(?:owned|belong|possessed|shared)|\bbelong\b", re.I)
_SAME = (
    r"(?:she|he|they|the same (?:person|owner|individual|resident|group)|the (?:same )?(?:two|pair|trio|latter|group)|"
    r"this (?:person|owner|individual)|all (?:of them|three|four))"
)
_NAME = "[\ue000-\uf8ff]"
"""A marked name: one private character, so that one pattern fits all texts (compiling one per text took 80 ms)."""


@dataclass(frozen=True, slots=True)
class Cue:
    """Words that name the owner of something, at [start, end) of a sentence."""

    start: int
    end: int
    owners: str
    """Marked names; empty means the people named last ("she also owns")."""
    side: Side
    """Whether the things come before the words ("... belongs to Ada") or after them ("Ada owns ...")."""
    several: bool
    """The words speak of more than one thing ("are both owned by Ada")."""


def sentences_of(text: str) -> list[str]:
    """The paragraph's sentences without their periods; dashes between words become commas."""
    flat = " ".join(re.sub(_NAME, "", text).replace("\u2019", "'").split())
    flat = re.sub(r"\s*(?:\u2014|\s-\s|\s\u2013\s)\s*", ", ", flat)
    return [bare for sentence in _SENTENCE_END.split(flat) if (bare := sentence.rstrip(" .!"))]


def names_in(text: str, *, also: Iterable[str] = ()) -> tuple[str, ...]:
    """People who own something in the text, or are among `also`, in the order of their first mention in the text."""
    flat = ". ".join(sentences_of(text))
    found = set(also)
    for pattern in _name_patterns():
        for match in pattern.finditer(flat):
            found |= {name for name in re.findall(_CAPITAL, match[match.lastindex or 0]) if name not in _NO_NAMES}
    return tuple(dict.fromkeys(name for name in re.findall(_CAPITAL, flat) if name in found))


def marked(sentence: str, names: Sequence[str]) -> str:
    """The sentence with the k-th name replaced by the k-th private character."""
    marks = {name: chr(0xE000 + k) for k, name in enumerate(names)}
    return re.sub(_CAPITAL, lambda found: marks.get(found[0], found[0]), sentence)


def unmarked(text: str, names: Sequence[str]) -> str:
    """Undoes `marked`."""
    return re.sub(_NAME, lambda found: names[ord(found[0]) - 0xE000], text)


def cues_of(sentence: str) -> list[Cue]:
    """All words of a marked sentence that name an owner, from left to right, without overlaps."""
    cues = []
    for match in _cue_pattern().finditer(sentence):
        owners = "".join(dict.fromkeys(re.findall(_NAME, match[0])))
        side: Side = "left" if match.lastgroup == "left" else "right"
        start, before = match.start(), _RELATIVE.search(sentence[: match.start()])
        if match.lastgroup == "active" and before and _ENDS.match(sentence[match.end() :]):
            side, start = "left", before.start()
        cues.append(Cue(start, match.end(), owners, side, side == "left" and _MANY.search(match[0]) is not None))
    return cues


@lru_cache(maxsize=1)
def _name_patterns() -> tuple[re.Pattern[str], ...]:
    listed = rf"({_CAPITAL}(?:(?:\s*,\s*(?:and\s+)?|\s+and\s+(?:also\s+)?){_CAPITAL})*)"
    return (
        re.compile(rf"\b(?i:{_BELONGS})\s+(?i:{_PEOPLE}){listed}"),
        re.compile(rf"\b{listed}(?i:{_GAP}(?:who )?{_OWNS})\b"),
        re.compile(rf"\b(?:is|are)\s+({_CAPITAL})'s?(?!\w)(?!\s+\w)"),
        re.compile(rf"\b(?:As for|Ask)\s+{listed}|\bTo {listed} belong\b"),
        re.compile(rf"\b{listed} (?:is|are) (?:its|the|their)(?: \w+)? owners?\b"),
        re.compile(rf"\b{listed}(?i:{_GAP}{_KEEPS}) (?:a|an|the|one|several|two)\b"),
    )


@lru_cache(maxsize=1)
def _cue_pattern() -> re.Pattern[str]:
    more = r"(?:\s*,\s*(?:and\s+)?(?:also\s+)?|\s+and\s+(?:also\s+)?|\s*&\s*|\s+as well as\s+)"
    verb = rf"{_GAP}(?:{_OWNS}|{_KEEPS})\b"
    # "belongs to Ada, and Bo owns": a name in front of a verb begins the next clause
    closed = rf"{_NAME}(?:{more}{_NAME}(?!(?i:{verb})))*"
    opened = rf"{_NAME}(?:{more}{_NAME})*"
    told = (
        rf"(?i:\bas for)\s+{opened},|\bAsk\s+{opened} before you touch|(?i:\bthings belong to)\s+{opened}:"
        rf"|\bTo\s+{opened} belong\b"
    )
    left = (
        rf"\b(?i:{_BELONGS})\s+(?i:{_PEOPLE}){closed}(?:\s+(?:together|jointly|alone|respectively)\b)?"
        rf"|\b(?:is|are)\s+{_NAME}'s?(?!\w)(?!\s+\w)|{opened} (?:is|are) (?:its|the|their)(?: \w+)? owners?\b(?! of)"
    )
    active = (
        rf"(?<!\w)(?i:{_PEOPLE}){opened}(?i:(?:,? who)?{verb}"
        r"|'s (?:\w+ )?(?:items|possessions|belongings|things)(?: here)?(?: include| are|:))"
    )
    again = rf"(?i:\b{_SAME}{verb}|\b(?:and|while|who|but|as well as){_GAP}(?:is also |are also )?(?:{_OWNS}|claims)\b)"
    return re.compile(rf"(?P<told>{told})|(?P<left>{left})|(?P<active>{active})|(?P<again>{again})")
