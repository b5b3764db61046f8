"""Rooms in a description: "in the bathroom of the bedroom", "the kitchen features ...". Part of `rules`."""

import re

from sim.words.places import ROOM_NOUN

_WORDS = r"(?:(?!in\b|on\b|and\b|is\b|next\b|near\b)[\w'-]+\s+)"
_NO_FURNITURE = (
    r"(?!'s?\b|[ -](?:cabinets?|counter\w*|tables?|chairs?|island|doors?|sinks?|windows?|shel\w+|walls?|worktop|"
    r"lamps?))"
)
"""Not before the nouns of furniture: "kitchen cabinets" is not a room."""
_NAME = (
    rf"(?:(?:the|a|an|another|this|that|same)\s+)*{_WORDS}{{0,3}}?{ROOM_NOUN}\b(?:\s+{ROOM_NOUN}\b)*{_NO_FURNITURE}"
    r"(?:\s+(?:\d|one|two)\b)?"
    rf"(?:\s+(?:of|before|after|between|next to|near|leading to|and|or)\s+(?:the\s+)?{_WORDS}{{0,2}}?{ROOM_NOUN}\b"
    r"(?:\s+\d\b)?)*"
    r"(?:\s+with(?:out)?\s+(?:(?:a|an|the|two|three)\s+)?(?!which)[\w'-]+(?:\s+(?:beds?|single beds?))?(?=\s*,|\s*$))?"
)
_IN = re.compile(rf"\b(?:in|inside|within|into|to|at|from|enter(?:ing)?|around|of|just before)\s+({_NAME})", re.I)
HOLDS = (
    r"features?|contains?|houses?|holds?|has|have|(?:is|are) home to|includes?|showcases?|displays?|boasts?|offers?|"
    r"hosts?|is (?:furnished|equipped|fitted|adorned) with|accommodates?|presents?|is characterized by|provides?|"
    r"comprises?|stores?|reveals?|is where|is shared ground"
)
"""Alternatives of a pattern: verbs that tie a room to its things."""
HOLDER = re.compile(
    rf"^(?:(?:also|and|while)\s+)*({_NAME}|the (?:scene|floor|home|house|space|layout|setting))"
    rf"(?:\s[^,;]*?|,[^,;]*,)??\s+(?:\w+ly\s+|also\s+|itself\s+)*(?:{HOLDS})(?:\s+(?:both\s+|also\s+)?|:\s*)",
    re.I,
)
"""The words up to the things in "the kitchen, also on the first floor, features"; group 1 is the room."""
_UNNAMED = re.compile(
    r"^(?:the\s+)?(?:(?:the|this|that)?\s*same\b|(?:this|that)\b|(?:the )?(?:room|area|rooms|same area)$)", re.I
)
_ARTICLES = re.compile(
    r"^(?:(?:the|a|an|this|that|these|those|both|another|his|her|their|its|said|same|own|all)\s+)+", re.I
)


def room_in(text: str) -> str | None:
    """The last room that the text gives as a place, without article; None if there is none, or for "the same room"."""
    rooms = [match[1] for match in _IN.finditer(text)]
    rooms += [match[1] for part in (text, *re.split(r"[,;]\s*", text)) if (match := HOLDER.match(part))]
    rooms = [bare(room) for room in rooms if not _UNNAMED.match(room)]
    return rooms[-1] if rooms else None


def bare(text: str) -> str:
    """The text without leading articles."""
    return _ARTICLES.sub("", text)
