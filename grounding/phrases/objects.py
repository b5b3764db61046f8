"""Owned things: cuts the words of things out of a clause, splits lists, and looks up "the microwave".

Second step of `rules`. Works with patterns of English words only.
"""

import re

from .rooms import HOLDER, HOLDS, bare

_SHARED_GROUND = re.compile(r"^.*?(?:is shared ground|have owners):\s*")
_LINKS = re.compile(
    r"^(?:[\s,;:]+|(?:and|while|whereas|but|meanwhile|additionally|also|finally|furthermore|similarly|moreover|lastly|"
    r"as well as|along with|nearby|specifically|(?:here|there)(?=,)|both|if|likewise|in addition|then|elsewhere|namely|"
    r"such as|including|for|only|all of|each of|with|of)\b(?! to\b)[\s,:]*)",
    re.I,
)
_ADVERBIAL = re.compile(
    r"^(?:(?:also|just|right|still|back|directly|further|similarly|and|finally) )*(?:in|on|at|inside|within|near|close|"
    r"next|beside|moving|turning|adjacent|between|outside|before|under|beneath|above|below|across|throughout|heading|"
    r"down|up|from|by|continuing|entering|opposite|over|along|alongside|as|among|behind|around|returning|going|stepping|"
    r"towards?|exploring|looking|beyond|upstairs|downstairs|to)\b(?: (?:a|an|the|this|that|one)\b)?[^,;:]*[,:]\s*",
    re.I,
)
_EXISTS = re.compile(
    r"^(?:(?:(?:in|on|at|inside|within|near)\s[^,;]{1,60}?\s)?there (?:also )?(?:is|are|sits?|stands?|exists?)|"
    r"(?:you|we|one|visitors)(?:'ll| will| can| may)? (?:also )?"
    r"(?:finds?|encounters?|sees?|notices?)|whoever looks around [^,;]*? finds|it is|"
    r"(?:resting|hanging|sitting|standing|mounted|located|situated|positioned|placed|above|next to|beside|near|"
    r"on top of|below|under|atop|over|behind)\s+[^,;]*? (?:is|are|sits?|stands?|hangs?|lies?|rests?)"
    r"(?= (?:a|an|the|one|two)\b))\s+(?:also\s+)?",
    re.I,
)
_TAIL = re.compile(
    r"(?:[\s,;:]+|\b(?:both|all|each|none) of (?:which|them|these)|"
    r"\b(?:which|that|who|all|both|also|and|while|whereas|but|is|are|being|each|as well|as|too|meanwhile|additionally|"
    r"jointly|collectively|with|where|whose|nearby|has|have|just surely|along|in addition|addition|notably|"
    r"(?<!on )(?<!above )(?<!over )(?<!it )it|this|they|these|furthermore|likewise|similarly|finally|well|itself|co|"
    r"the|a|together)"
    r"|,?\s+for it is theirs alone|(?:is )?theirs|,?\s*each as much as the other|just as surely"
    r"|is another (?:item|object|piece))\s*$",
    re.I,
)
_TAIL_REACH = 80
"""Number of characters at the end of a text that are searched for loose ends."""
_TAIL_PLACE = re.compile(
    r"(?:,\s*(?:and\s+)?|\s+(?:and|while)\s+|;\s*)(?:also\s+|then\s+|further\s+)?(?:in|on|at|inside|within|moving|near|"
    r"nearby|just|over|down)\b[^,;]{0,70},?\s*$",
    re.I,
)
_PARTED = re.compile(r"\s*(?:;|,?\s+\b(?:while|whereas|but)\b)\s*", re.I)
_MODIFIERS = (
    r"located|situated|positioned|placed|near|next|beside|in|on|under|above|below|that|which|with|mounted|hanging|over|"
    r"behind|close|beneath|atop|found|standing|between|sitting|set|adjacent|topped|made|featuring|to the|without|"
    r"resting"
)
"""Alternatives of a pattern: words that begin a statement about a thing's place or looks."""
_NEW_A = r"(?:a|an|one of|another|two|his|her|their)\s+[\w'-]"
_NEW_THE = rf"the\s+(?:[\w'-]+\s+){{1,5}}?(?:{_MODIFIERS})\b"
_LIST = re.compile(
    rf"\s*[,;]\s*(?:and|as well as|along with|plus|alongside)?\s*(?:also\s+)?(?=(?i:{_NEW_A}|{_NEW_THE}))"
    r"|\s*,?\s*\b(?:as well as|along with|in addition to|and also|together with)\s+(?=(?:a|an|the|one|another|two)\b)"
    r"|\s*;\s*(?:and\s+)?|\s*,\s*and\s+(?=the\s)"
)
_AND = re.compile(rf"\s*,?\s+and\s+(?=(?:a|an|one of|another)\s|{_NEW_THE})")
_ANY_AND = re.compile(r"\s*,?\s+and\s+(?=(?:a|an|the|one|another)\s)")
_NEXT_THING = re.compile(r",\s*(?:and|with)\s+(?=(?:a|an|the|this|that|another|one)\b)", re.I)
_NEXT_AND = re.compile(r"\s+and\s+(?=(?:a|an|the|this)\b)", re.I)
_EMPTY = re.compile(
    r"^(?:(?:several|multiple|various|many|some|two|three|four|a|few|an|the|these|other|different|this|personal|own|"
    r"another|additional|number|variety|range|of|their|couple|set|all|notable|distinct|same|among|across|in|key)\s+)*"
    r"(?:items?|objects?|things?|pieces?|belongings?|possessions?|presence|ownership|furnishings?|spaces?|rooms?|them|"
    r"owners?|ones?|he|she|home|house|area|furniture|residents)?(?:\s+(?:in|across|throughout|here|on|from|within)\b.*)?:?$",
    re.I,
)
_POINTING = re.compile(
    r"^(?:(?:it|them)\b.*|this|that|these|those|they|both|all|which|each|the (?:two|former|latter|items?|objects?)|"
    r"(?:both|all|each) (?:of )?(?:these|them|which|three|two|four)?|(?:these|the) (?:two|three|four) "
    r"(?:items|objects|pieces)|(?:these|both|this|such) (?:items?|objects?|pieces?|things?|belongings))?$",
    re.I,
)
_DEFINITE = re.compile(r"^(?:(?:both|all)\s+)?(?:the|this|that|these|those)\s", re.I)
_STOPS = re.compile(rf"^(?:{_MODIFIERS}|of|at|along|from|by|inside|within|where|is|are|has|have|and|or|to|for)$", re.I)
_PLAIN_WORD = rf"(?:(?!(?:a|an|the|and|of|is|are|{HOLDS}|{_MODIFIERS})\b)[\w'-]+\s+)"
_AFTER_THING = re.compile(r",\s*(?:which|owned|and|while|with\s+[\ue000-\uf8ff])|\s+(?:is|are|belongs?)\s|\bowned\b")
_PLACED_AT = re.compile(
    r"\b(?:near|next to|beside|to|by|of|with|on|under|above|below|over|behind|from|between|facing)\s+$"
)
_SHORT = 4
"""A thing named with at most this many words is looked up in the text before it."""


def before_words(text: str) -> tuple[str, bool]:
    """The things in the text before "belongs to", without a leading place, "there is" and loose ends.

    Returns:
        The words, and whether the text lists a room's things ("the room features ..."), so that there may be more.
    """
    text = _trimmed(text)
    lists = False
    for _ in range(12):
        shorter = _SHARED_GROUND.sub("", text, count=1)
        shorter = _LINKS.sub("", shorter)
        lists |= _EXISTS.match(shorter) is not None
        shorter = _EXISTS.sub("", shorter)
        if match := HOLDER.match(shorter):
            lists = True
            shorter = shorter[match.end() :]
        elif match := _ADVERBIAL.match(shorter):
            shorter = shorter[match.end() :]
        if shorter == text or not shorter:
            break
        text = shorter
    return text, lists


def after_words(text: str) -> str:
    """The things in the text after "Ada owns", without loose ends."""
    text = _trimmed(text)
    while (shorter := _LINKS.sub("", text)) != text:
        text = shorter
    return text


def split_at_next_place(text: str) -> tuple[str, str]:
    """Splits "the bed, while in the hall" between two owners: the first owner's things, then the second's place."""
    *_, last = [None, *_PARTED.finditer(text)]
    if last and (_ADVERBIAL.match(text[last.end() :].strip() + ",") or not text[last.end() :].strip(" ,")):
        return _trimmed(text[: last.start()]), text[last.end() :]
    if place := _TAIL_PLACE.search(text):
        return _trimmed(text[: place.start()]), place[0]
    return _trimmed(text), ""


def split_at_next_thing(text: str) -> tuple[str, str]:
    """Splits "the bed, while the lamp near it" between "Ada owns" and "belongs to Bo": her things, then his."""
    if parting := _PARTED.search(text):
        return _trimmed(text[: parting.start()]), text[parting.end() :]
    for pattern in (_NEXT_THING, _NEXT_AND):
        *_, last = [None, *pattern.finditer(text)]
        if last:
            return _trimmed(text[: last.start()]), text[last.end() :]
    return text, ""


def parted(text: str) -> list[str]:
    """Clauses between ";", "while", "whereas", "but"; empty ones are left out."""
    return [part for part in _PARTED.split(text) if part.strip(" ,")]


def listed(text: str, *, several: bool = False) -> list[str]:
    """The things of a list, each with its own words.

    Args:
        text: From `before_words` or `after_words`.
        several: Whether there is certainly more than one thing ("both are owned by"), so that any "and" may separate
            them.
    """
    parts = [part for part in _LIST.split(text) if part.strip(" ,")]
    if several and len(parts) == 1:
        for pattern in (_AND, _ANY_AND):
            if len(found := pattern.split(text)) > 1:
                return found
    return [part for whole in parts for part in _AND.split(whole)] if several else parts


def is_empty(text: str) -> bool:
    """Whether the text names no thing ("several items across the home")."""
    return not text.strip(" ,") or _EMPTY.match(text.strip(" ,")) is not None


def is_pointing(text: str) -> bool:
    """Whether the text only refers back ("it", "both", "these items")."""
    return _POINTING.match(text.strip(" ,")) is not None


def short_names(text: str) -> list[str]:
    """The names in a list of short names ("the oven, the glass window and microwave"); none if one has more words."""
    parts = [part for part in re.split(r"\s*(?:,\s*(?:and\s+)?|\band\b)\s*", text) if part]
    short = all(len(part.split()) <= _SHORT and not any(map(_STOPS.match, part.split())) for part in parts)
    return [f"the {bare(part)}" for part in parts] if short and len(parts) > 1 and _DEFINITE.match(text) else []


def recalled(text: str, before: str) -> str:
    """The fuller words that the earlier text used for a thing with a short name ("the microwave").

    Args:
        text: The thing, e.g. "the microwave".
        before: The whole description before the thing.

    Returns:
        The fuller words, or `text` itself if it is long, new ("a microwave") or not found.
    """
    words = re.findall(r"[\w'-]+", bare(text))
    cut = next((k for k, word in enumerate(words) if _STOPS.match(word)), len(words))
    if not _DEFINITE.match(text) or cut == 0 or len(words) > _SHORT + 2 or cut > _SHORT:
        return text
    for noun in (" ".join(words[:cut]), words[cut - 1]):
        noun = re.escape(noun).replace(r"\ ", r"\s+")
        pattern = rf"\b(?:a|an|the|one of the|one of|another|two)\s+{_PLAIN_WORD}{{0,5}}?{noun}\b(?!-)[^;.]*"
        for match in reversed([*re.finditer(pattern, before, re.I)]):
            found = _trimmed(_AFTER_THING.split(listed(match[0], several=True)[0])[0])
            if not _PLACED_AT.search(before[: match.start()]) and len(found) > len(text):
                return found
    return text


def _trimmed(text: str) -> str:
    text = text.replace(", which is to be found in ", " in ")
    while (end := _TAIL.search(text, max(0, len(text) - _TAIL_REACH))) and end[0]:
        text = text[: end.start()]
    return text.strip(" ,;:")
