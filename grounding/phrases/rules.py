"""Phrases "X owns Y in the Z" from the free text of a description, by rules alone.

`sentences` finds the people, `objects` the things; this module puts them together, sentence by sentence.
"""

import re
from dataclasses import dataclass, field
from itertools import pairwise

from sim.types import Task

from .messages import updated
from .objects import (
    after_words,
    before_words,
    is_empty,
    is_pointing,
    listed,
    parted,
    recalled,
    short_names,
    split_at_next_place,
    split_at_next_thing,
)
from .ownership_text import parse_query
from .rooms import room_in
from .sentences import Cue, cues_of, marked, names_in, sentences_of, unmarked

_SEVERAL = re.compile(r"\b(?:both|all|are)\b(?:\s+\w+){0,3}$", re.I)
_INCLUDING = re.compile(r"\s*(?:[,:]?\s*(?:including|such as|namely|specifically)\b|:)", re.I)
_ALL_OF_THESE = re.compile(r":\s*(?:both|all) of (?:these|them)\s*$", re.I)
_AND_THIS = re.compile(r"[,;]?\s+(?:and\s+|with\s+)?((?:this|these|that) [\w -]+)$", re.I)
_BOTH = re.compile(r"\b(?:both|all|these|they|them)\b", re.I)
_SAME_ROOM = re.compile(r",?\s*\b(?:also )?in (?:the same|this(?: same)?|that) (?:room|area|space)\b", re.I)
_ONE_OF_SEVERAL = re.compile(
    r"^(?:one|another|the other|the first|the second|the third)(?= (?:is |that |which )?\w+)", re.I
)
_SEVERAL_THINGS = re.compile(
    r"\b(?:two|three|four|five|six|several|pair of|identical)\s+((?:[\w-]+\s){0,3}?[\w-]+s)\b(?! of\b)", re.I
)


class RulePhrases:
    """Reads ownership from English paragraphs: lists, pronouns, "both", "shared by", relative clauses.

    Like a person, it sees the description, the news of a home sequence, and the query.
    """

    name = "rules"
    num_fallbacks = 0

    def phrases(self, task: Task) -> tuple[str, ...]:
        """The phrases found, each once, in the order of the text; may be empty."""
        asked = parse_query(task.queries[0]) if task.queries else None
        intro = task.description.removesuffix("".join(f"\n{each.text}" for each in task.news))
        return updated(phrases_in(intro, also=(asked.owner,) if asked else ()), task.news)


def phrases_in(text: str, *, also: tuple[str, ...] = ()) -> tuple[str, ...]:
    """The phrases "X owns Y in the Z" of a paragraph, each once, in order; `also` as in `names_in`."""
    names = names_in(text, also=also)
    reader = _Reader()
    for sentence in sentences_of(text):
        reader.read(marked(sentence, names))
    return tuple(unmarked(phrase, names) for phrase in dict.fromkeys(reader.found))


@dataclass(slots=True)
class _Reader:
    """Reads sentence by sentence and keeps the last room, people and things."""

    found: list[str] = field(default_factory=list)
    before: str = ""
    """Everything read so far; "the microwave" is looked up in it."""
    room: str = ""
    """The room mentioned last, without article."""
    owners: str = ""
    """The people named last, as marked names."""
    things: tuple[str, ...] = ()
    """The things mentioned last, for "it belongs to"."""

    def read(self, sentence: str) -> None:
        """Reads one sentence with marked names."""
        cues = cues_of(sentence)
        for cue, lead, rest in _portions(sentence, cues):
            self.room = room_in(lead) or self.room
            self.owners = cue.owners or self.owners
            self.before += f" {lead}"
            things = self._things_before(lead, cue) if cue.side == "left" else self._things_after(rest)
            if not things and _INCLUDING.match(rest):
                things = self._things_after(rest)
            if cue.side == "right" and things and all(map(is_pointing, things)):
                things = self._things_before(lead, cue)
            things = [whole for thing in things for whole in self._wholes(thing)]
            self.before += f" {rest};"
            if things:
                self.things = tuple(things)
                self._own(things)
            self.room = room_in(rest) or self.room
        if not cues:
            self.room = room_in(sentence) or self.room
            self.things = tuple(listed(before_words(sentence)[0])) or self.things
            self.before += f" {sentence};"

    def _things_before(self, lead: str, cue: Cue) -> list[str]:
        """The things in "... belongs to Ada"."""
        several = cue.several or _SEVERAL.search(lead.strip(" ,")) is not None
        parts = parted(_ALL_OF_THESE.sub("", lead))
        last, lists = before_words(parts[-1]) if parts else ("", False)
        if len(parts) > 1 and _ALL_OF_THESE.search(lead):
            return [thing for part in parts for thing in listed(before_words(part)[0])]
        if not is_pointing(last) and not is_empty(last):
            if several:
                return listed(last, several=True)
            if (this := _AND_THIS.search(last)) and this.start():
                fuller = recalled(this[1], self.before)
                return [fuller if len(fuller) > len(this[1]) else last[: this.start()]]
            return listed(last)[-1:] if lists else [last]
        if parts and not is_pointing(last):
            return []
        together = several or _BOTH.search(parts[-1] if parts else "") is not None
        alone = len(parts) == 2 and together
        earlier = [thing for part in parts[:-1] for thing in listed(before_words(part)[0], several=alone)]
        things = [thing for thing in earlier if not is_pointing(thing)] or list(self.things)
        return things if together else things[-1:]

    def _things_after(self, rest: str) -> list[str]:
        """The things in "Ada owns ..."."""
        text = after_words(rest)
        head, colon, tail = text.partition(":")
        if colon and (is_empty(head) or len(head) < len(tail) / 3):
            text = after_words(tail)
        things = listed(text, several=re.match(r"\s*both\b", rest) is not None)
        if len(things) == 1 and is_pointing(things[0]) and self.things:
            return list(self.things)
        return things

    def _wholes(self, thing: str) -> list[str]:
        """The thing, or each thing in "the oven and the chair" if the text has described them before."""
        names = short_names(thing)
        fuller = [recalled(name, self.before) for name in names]
        if names and all(full != name for full, name in zip(fuller, names, strict=True)):
            return list(dict.fromkeys(fuller))
        return [self._whole(thing)]

    def _whole(self, thing: str) -> str:
        """The thing in full words: with the noun that the text left out, or as the text first described it."""
        if one := _ONE_OF_SEVERAL.match(thing):
            several = _SEVERAL_THINGS.findall(self.before)
            if several and not thing.startswith(("one of", "One of")):
                thing = f"one of the {several[-1]}{thing[one.end() :]}"
        thing = _SAME_ROOM.sub("", thing)
        return recalled(thing, self.before)

    def _own(self, things: list[str]) -> None:
        for thing in things:
            thing = after_words(thing)
            if is_empty(thing) or is_pointing(thing):
                continue
            place = "" if room_in(thing) or not self.room else f" in the {self.room}"
            self.found += [f"{owner} owns {thing}{place}" for owner in self.owners]


def _portions(sentence: str, cues: list[Cue]) -> list[tuple[Cue, str, str]]:
    """Each cue with the text before it and after it that belongs to it."""
    if not cues:
        return []
    leads, rests = [sentence[: cues[0].start]], []
    for first, second in pairwise(cues):
        between = sentence[first.end : second.start]
        if first.side == "left":
            rest, lead = "", between
        elif second.side == "right":
            rest, lead = split_at_next_place(between)
        else:
            rest, lead = split_at_next_thing(between)
        rests.append(rest)
        leads.append(lead)
    rests.append(sentence[cues[-1].end :])
    return list(zip(cues, leads, rests, strict=True))
