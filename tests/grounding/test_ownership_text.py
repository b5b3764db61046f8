"""Queries and phrases in all their forms."""

import pytest

from grounding.encoders.hashed import HashedWords
from grounding.phrases.ownership_text import OwnedThing, Wanted, asked_thing, parse_phrase, parse_query

from .small_homes import QUERIES

WORDS = HashedWords()


@pytest.mark.parametrize("wording", QUERIES)
def test_every_wording_gives_owner_and_category(wording: str) -> None:
    assert parse_query(wording.format("Mira's chest of drawers")) == Wanted("Mira", "chest of drawers")


def test_one_of_several_loses_the_bare_plural_s() -> None:
    assert parse_query("Where is one of Bo's chest of drawerss?") == Wanted("Bo", "chest of drawers")
    assert parse_query("Find Bo's glass") == Wanted("Bo", "glass")


def test_owners_may_end_in_s() -> None:
    assert parse_query("Find Tobias's bed") == parse_query("Find Tobias' bed") == Wanted("Tobias", "bed")


def test_a_query_without_an_owner_is_not_parsed() -> None:
    assert parse_query("Find the red chair") is None


@pytest.mark.parametrize(
    ("phrase", "parsed"),
    [
        (
            "Mira owns a red chair in the kitchen",
            OwnedThing("Mira", "a red chair in the kitchen", "red chair", "kitchen"),
        ),
        (
            "Bo owns an oak desk. in Guest Room",
            OwnedThing("Bo", "an oak desk. in Guest Room", "oak desk", "guest room"),
        ),
        ("Bo owns the lamp", OwnedThing("Bo", "the lamp", "lamp", "")),
        (
            "Bo owns mirror in gold in the hall",
            OwnedThing("Bo", "mirror in gold in the hall", "mirror in gold", "hall"),
        ),
        (
            "Bo owns a bed in the style of a very old palace",
            OwnedThing("Bo", "a bed in the style of a very old palace", "bed in the style of a very old palace", ""),
        ),
        ("a blue rug in the hall", OwnedThing("", "a blue rug in the hall", "blue rug", "hall")),
    ],
)
def test_phrases_give_owner_thing_and_room(phrase: str, parsed: OwnedThing) -> None:
    assert parse_phrase(phrase) == parsed


def chosen(query: str, *phrases: str) -> int | None:
    asked = asked_thing(phrases, query, WORDS)
    return None if asked is None else asked.chosen


def test_only_the_owners_phrases_are_looked_at_and_the_category_decides() -> None:
    phrases = ("Bo owns a chair", "Mira owns a lamp with a chain", "Mira owns two wooden chairs in the hall")
    assert chosen("Find Mira's chair", *phrases) == 2
    assert chosen("Find mira's lamp", *phrases) == 1
    assert chosen("Find Bo's sofa", *phrases) == 0


def test_the_categorys_word_counts_more_than_its_likeness() -> None:
    # the first phrase is nothing but the category's second word; the second holds the category among many words
    phrases = ("Mira owns a table", "Mira owns a low grey stone coffee table beside the big green velvet couch")
    assert chosen("Find Mira's coffee table", *phrases) == 1


def test_equal_phrases_go_to_the_first_and_none_of_the_owner_gives_none() -> None:
    assert chosen("Find Mira's chair", "Mira owns a red chair", "Mira owns a red chair") == 0
    assert chosen("Find Zoe's chair", "Mira owns a red chair") is None
    assert chosen("Find a chair", "Mira owns a red chair") is None
