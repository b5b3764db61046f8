"""Queries and phrases are parsed in all their forms."""

import pytest

from grounding.encoders.hashed import HashedWords
from grounding.phrases.ownership_text import OwnedThing, Wanted, asked_thing, parse_phrase, parse_query
from sim.episodes.ownership import queries_for

WORDS = HashedWords()


@pytest.mark.parametrize("query", queries_for("Mira", "chest of drawers"))
def test_every_wording_gives_owner_and_category(query: str) -> None:
    assert parse_query(query) == Wanted("Mira", "chest of drawers")


@pytest.mark.parametrize(
    ("query", "wanted"),
    [
        ("Where is one of Bo's chest of drawerss?", Wanted("Bo", "chest of drawers")),
        ("Find Bo's glass", Wanted("Bo", "glass")),
        ("Find Tobias's bed", Wanted("Tobias", "bed")),
        ("Find Tobias' bed", Wanted("Tobias", "bed")),
        ("Find the red chair", None),
    ],
    ids=["one of several loses the bare plural s", "a category in s", "owner in s", "bare apostrophe", "no owner"],
)
def test_unusual_owners_and_plurals_are_parsed(query: str, wanted: Wanted | None) -> None:
    assert parse_query(query) == wanted


@pytest.mark.parametrize(
    ("owner", "text", "thing", "room"),
    [
        ("Mira", "a red chair in the kitchen", "red chair", "kitchen"),
        ("Bo", "an oak desk. in Guest Room", "oak desk", "guest room"),
        ("Bo", "the lamp", "lamp", ""),
        ("Bo", "mirror in gold in the hall", "mirror in gold", "hall"),
        ("Bo", "a bed in the style of a very old palace", "bed in the style of a very old palace", ""),
        ("", "a blue rug in the hall", "blue rug", "hall"),
    ],
)
def test_phrases_give_owner_object_and_room(owner: str, text: str, thing: str, room: str) -> None:
    assert parse_phrase(f"{owner} owns {text}" if owner else text) == OwnedThing(owner, text, thing, room)


def chosen(query: str, *phrases: str) -> int | None:
    asked = asked_thing(phrases, query, WORDS)
    return None if asked is None else asked.chosen


def test_only_phrases_of_the_owner_count_and_the_category_decides_between_them() -> None:
    phrases = ("Bo owns a chair", "Mira owns a lamp with a chain", "Mira owns two wooden chairs in the hall")
    assert chosen("Find Mira's chair", *phrases) == 2
    assert chosen("Find mira's lamp", *phrases) == 1
    assert chosen("Find Bo's sofa", *phrases) == 0
    assert chosen("Find Mira's chair", "Mira owns a red chair", "Mira owns a red chair") == 0
    assert chosen("Find Zoe's chair", "Mira owns a red chair") is None
    assert chosen("Find a chair", "Mira owns a red chair") is None
    # the first phrase is only the second word of the category; the second has the whole category among many words
    phrases = ("Mira owns a table", "Mira owns a low grey stone coffee table beside the big green velvet couch")
    assert chosen("Find Mira's coffee table", *phrases) == 1
