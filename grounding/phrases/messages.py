"""Ownership that messages change: reads who gives what to whom in English sentences, and keeps the table of owners.

Texts -> `Change`s -> `updated` phrases "X owns Y in Z". No language model, no ground truth.
"""

import re
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from sim.types import News

from .ownership_text import parse_phrase

_A, _B = r"(?P<giver>[A-Z][\w-]*)", r"(?P<taker>[A-Z][\w-]*)"
_THING = r"(?P<thing>[^;]+?)(?=;|\.?\s*$|\. )"
_FORMS = tuple(
    re.compile(form)
    for form in (
        rf"(?:(?<=^)|(?<=[:;] )|(?<=return, )|(?<=\. )){_A} (?:gave|has given|gives|handed|passed) (?:{_B} )?{_THING}",
        rf"From {_A}, {_B} (?:has )?(?:received|got|borrowed) {_THING}",
        rf"^{_B} (?:has )?(?:received|got|borrowed|took over) (?P<thing>[^;]+?) from {_A}\b",
        rf"from {_A} to {_B}(?:: | is ){_THING}",
        rf"[Tt]o {_B} went {_THING}",
        rf"{_A} (?:lends|lent|has lent) {_B} {_THING}",
        rf"{_B},? (?:and )?not {_A}, (?:owns|is the owner of) {_THING}",
        rf"[Oo]wner is {_B},? (?:and )?not {_A}, of {_THING}",
    )
)
"""Forms in which a thing goes from one person to another."""
_SHARES = tuple(
    re.compile(form)
    for form in (
        rf"{_B} is now an owner, too, of {_THING}",
        rf"{_B} now (?:has a share in|also owns|shares) {_THING}",
        rf"[Oo]ne more person, {_B}, now owns {_THING}",
    )
)
_ENDS = tuple(
    re.compile(form)
    for form in (
        rf"{_A}(?:, and nobody else,)? "
        rf"(?:no longer (?:has a share in|owns|shares)|has given up (?:a|the) share (?:in|of)) {_THING}",
    )
)
_LEAVES = re.compile(rf"{_A} (?:has )?(?:moved out|moved away|left the home|left this home|left for good)")
_LOAN = re.compile(r"\b(?:[Nn]ext|following) (?:(?P<count>\w+) )?search(?:es)?\b")
_NUMBERS = ("zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")
_NOT_NAMES = frozenset(["The", "From", "To", "One", "Two", "For", "Since", "During", "Correction", "Without", "On"])
_WORD = re.compile(r"[a-z0-9]+")
_LITTLE = frozenset(
    ("a", "an", "the", "in", "of", "on", "at", "to", "it", "is", "its", "and", "with", "one", "near", "next")
)


class Change(NamedTuple):
    """What a message says that has changed."""

    giver: str
    """The person who owns it no longer; empty where a new owner joins the others."""
    taker: str
    """The new owner; empty where there is none."""
    thing: str
    """In the message's words; empty = all that the giver owns."""
    searches: int | None = None
    """Number of searches after which a loan ends; None = it stays so."""


def changes_in(text: str) -> list[Change]:
    """The changes of ownership that a message tells, in its order; [] where it tells none that these rules know."""
    loan = _LOAN.search(text)
    searches = None if loan is None else _count(loan["count"])
    found = [*_moves(text, searches), *_joins(text), *_ends(text)]
    return list(dict.fromkeys(found))


def updated(phrases: Sequence[str], news: Iterable[News]) -> tuple[str, ...]:
    """Phrases "X owns Y in Z" after some news, oldest first; a loan that is over has changed nothing."""
    rows = [(item.owner, item.text) for item in map(parse_phrase, phrases)]
    for each in news:
        for line in each.text.splitlines():
            before = rows  # each change of a message means a thing as it was before all of them
            for change in changes_in(line):
                if change.searches is None or each.searches_ago < change.searches:
                    rows = _changed(rows, change, before)
    return tuple(dict.fromkeys(f"{owner} owns {text}" if owner else text for owner, text in rows))


def _moves(text: str, searches: int | None) -> Iterator[Change]:
    people = list(dict.fromkeys(name for name in re.findall(r"\b[A-Z][\w-]*", text) if name not in _NOT_NAMES))
    for form in _FORMS:
        for found in form.finditer(text):
            named = found.groupdict()
            giver, taker = named.get("giver"), named.get("taker")
            if giver is None or taker is None:  # the other one of two who exchange things
                other = [name for name in people if name != (giver or taker)]
                giver, taker = (giver or other[0], taker or other[0]) if other else (giver, taker)
            if giver and taker and giver != taker:
                yield Change(giver, taker, named["thing"].strip(), searches)


def _joins(text: str) -> Iterator[Change]:
    for form in _SHARES:
        for found in form.finditer(text):
            yield Change("", found["taker"], found["thing"].strip())


def _ends(text: str) -> Iterator[Change]:
    for form in _ENDS:
        for found in form.finditer(text):
            yield Change(found["giver"], "", found["thing"].strip())
    if found := _LEAVES.search(text):
        yield Change(found["giver"], "", "")


def _changed(rows: list[tuple[str, str]], change: Change, before: Sequence[tuple[str, str]]) -> list[tuple[str, str]]:
    """The table of (owner, thing) after a change; its thing is one of `before`, or a new one."""
    if not change.thing:
        return [row for row in rows if row[0] != change.giver]
    mine = [row for row in before if row[0] == change.giver] if change.giver else before
    row = _meant(mine, change.thing) or _meant(before, change.thing)
    text = change.thing if row is None else row[1]
    kept = [each for each in rows if each != (change.giver, text)]
    return [*kept, (change.taker, text)] if change.taker else kept


def _meant(rows: Sequence[tuple[str, str]], thing: str) -> tuple[str, str] | None:
    """The row about the thing: the one that shares the greatest part of the shorter one's words, and has the fewest
    others; None where none shares half.
    """
    words = _words(thing)
    shares = []
    for _, text in rows:
        own = _words(text)
        both = len(words & own)
        shares.append((both / max(1, min(len(words), len(own))), both / max(1, len(words | own))))
    best = max(range(len(rows)), key=lambda index: shares[index], default=None)
    return rows[best] if best is not None and shares[best][0] >= 0.5 else None


def _words(text: str) -> frozenset[str]:
    return frozenset(_WORD.findall(text.lower())) - _LITTLE


def _count(word: str | None) -> int:
    """A number in words or digits; one where there is none."""
    if word is None:
        return 1
    return _NUMBERS.index(word.lower()) if word.lower() in _NUMBERS else int(word) if word.isdigit() else 1
