"""Tables of owners that follow messages: every phrasing of every kind, whole stories, loans, and texts that rules do
not know."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grounding.phrases.messages import Change, changes_in, updated
from grounding.phrases.rules import RulePhrases
from sim.authoring.annotated import Thing
from sim.authoring.people import NAMES
from sim.authoring.sequences.stories import Needs, Setting, StoryError, draw_story
from sim.authoring.sequences.texts import PHRASINGS, Told, message_text, sentences
from sim.episodes.schema import Goal
from sim.episodes.sequences import Edge, Message, MessageKind, ownership_over_time
from sim.types import News, Task

BOWL, MUG, VASE = "red bowl on the oak shelf", "blue mug near the sink", "tall L-shaped vase"
TABLE = (f"Ada owns a {BOWL} in the kitchen", f"Bo owns a {MUG} in the hall", f"Ada owns a {VASE} in the den")
THINGS = (f"the {BOWL} in the kitchen", f"the {MUG} in the hall")
VASE_OF_ADA, MUG_OF_BO = TABLE[2], TABLE[1]
AFTER: dict[MessageKind, set[str]] = {
    "transfer": {f"Bo owns a {BOWL} in the kitchen", MUG_OF_BO, VASE_OF_ADA},
    "swap": {f"Bo owns a {BOWL} in the kitchen", f"Ada owns a {MUG} in the hall", VASE_OF_ADA},
    "share": {*TABLE, f"Bo owns a {BOWL} in the kitchen"},
    "unshare": {MUG_OF_BO, VASE_OF_ADA},
    "lend": {f"Bo owns a {BOWL} in the kitchen", MUG_OF_BO, VASE_OF_ADA},
    "leave": {MUG_OF_BO},
    "correction": {f"Bo owns a {BOWL} in the kitchen", MUG_OF_BO, VASE_OF_ADA},
}
"""The table after a message of each kind about Ada, Bo and THINGS."""


@pytest.mark.parametrize("number", range(3))
@pytest.mark.parametrize("kind", PHRASINGS)
def test_each_phrasing_of_each_kind_changes_the_table(kind: MessageKind, number: int) -> None:
    text = PHRASINGS[kind][number](Told("Ada", "Bo", THINGS, "the next two searches"))
    text = text[0].upper() + text[1:]
    assert set(updated(TABLE, [News(text, 0)])) == AFTER[kind], text
    assert len(updated(TABLE, [News(text, 0)])) == len(AFTER[kind]), "each once"


@pytest.mark.parametrize("number", range(3))
@pytest.mark.parametrize(("loan", "length"), [("the next search", 1), ("the next three searches", 3)])
def test_a_loan_ends_after_its_searches(number: int, loan: str, length: int) -> None:
    text = PHRASINGS["lend"][number](Told("Ada", "Bo", THINGS[:1], loan))
    assert changes_in(text) == [Change("Ada", "Bo", THINGS[0], length)]
    assert set(updated(TABLE, [News(text, length - 1)])) == AFTER["lend"]
    assert updated(TABLE, [News(text, length)]) == TABLE


def test_messages_of_one_search_are_read_line_by_line_and_in_their_order() -> None:
    both = f"Ada gave Bo {THINGS[0]}.\nCorrection: Cy, not Bo, owns {THINGS[0]}."
    assert updated(TABLE, [News(both, 0)]) == (*TABLE[1:], f"Cy owns a {BOWL} in the kitchen")
    apart = [News(line, ago) for line, ago in zip(both.splitlines(), (1, 0), strict=True)]
    assert updated(TABLE, apart) == updated(TABLE, [News(both, 0)])


@pytest.mark.parametrize(
    "text", ["", "Nothing has changed.", "Ada moved the red bowl.", "The kitchen has moved out of fashion."]
)
def test_a_text_without_a_change_changes_nothing(text: str) -> None:
    assert changes_in(text) == []
    assert updated(TABLE, [News(text, 0)]) == TABLE


def test_a_thing_that_no_phrase_is_about_is_new_to_the_table() -> None:
    lamp = "the brass lamp in the attic"
    assert updated(TABLE, [News(f"Ada gave Bo {lamp}.", 0)]) == (*TABLE, f"Bo owns {lamp}")
    assert updated(TABLE, [News(f"Ada no longer owns {lamp}.", 0)]) == TABLE
    assert updated((), [News(f"Ada gave Bo {lamp}.", 0)]) == (f"Bo owns {lamp}",)


def test_of_two_things_alike_the_one_with_the_message_s_words_is_meant() -> None:
    """All words of the shorter phrase are in the message too."""
    short, long = "mirror over a sink in the bathroom", "mirror over a sink near a shower in the bathroom"
    table = (f"Ada owns a {short}", f"Ada owns a {long}", "Bo owns a stool in the den")
    text = f"Bo gave Ada the stool in the den; in return, Ada gave Bo the {long}."
    assert set(updated(table, [News(text, 0)])) == {
        table[0],
        f"Bo owns a {long}",
        "Ada owns a stool in the den",
    }


def test_things_of_a_swap_are_those_that_the_two_had_before_it() -> None:
    table = ("Ada owns a white bowl in the hall", "Bo owns a white and blue bowl in the den")
    text = "Ada gave Bo the white bowl; in return, Bo gave Ada the white bowl."  # the rooms are not told
    assert set(updated(table, [News(text, 0)])) == {
        "Bo owns a white bowl in the hall",
        "Ada owns a white and blue bowl in the den",
    }


def test_rules_read_the_intro_and_the_news_apart() -> None:
    intro, text = (
        "In the hall, Ada owns a red lamp near the door. Bo owns a blue sofa in the den.",
        "Ada has moved out.",
    )
    lent = "From Bo, Cy has borrowed the blue sofa in the den. The owner is Cy for the next search, and Bo afterwards."
    task = Task("pog", f"{intro}\n{lent}\n{text}", ("Find Bo's sofa",), news=(News(lent, 1), News(text, 0)))
    assert RulePhrases().phrases(task) == ("Bo owns a blue sofa in the den",)
    earlier = Task("pog", f"{intro}\n{lent}", ("Find Cy's sofa",), news=(News(lent, 0),))
    assert set(RulePhrases().phrases(earlier)) == {
        "Ada owns a red lamp near the door in the hall",
        "Cy owns a blue sofa in the den",
    }


WORDS = {
    name: Thing(
        Goal(position=(0, 0, 0), object_id=1, object_name=name, object_category="cup", floor_id="0", view_points=()),
        phrase,
        room,
        (),
    )
    for name, phrase, room in (
        ("cup_1", "white cup near the kettle", "kitchen"),
        ("cup_2", "white cup near the window", "kitchen"),
        ("cup_3", "white cup near the kettle", "hall"),
        ("bed_1", "low bed with grey sheets", "bedroom"),
        ("bed_2", "low bed with a grey blanket", "guest bedroom"),
        ("rug_1", "L-shaped rug", "hall"),
        ("rug_2", "rug", "hall"),
    )
}
"""Things that share most of their words."""


@settings(max_examples=40)
@given(seed=st.integers(0, 10**6), people=st.lists(st.sampled_from(NAMES), min_size=4, max_size=4, unique=True))
def test_tables_of_drawn_stories_are_right_at_each_search_whatever_people_are_called(
    seed: int, people: list[str]
) -> None:
    truth, read = told_story(seed, people)
    assert read == truth
    plain_truth, plain = told_story(seed, ["Ada", "Bo", "Cy", "Di"])
    names = dict(zip(["Ada", "Bo", "Cy", "Di"], people, strict=True))
    assert [{renamed(phrase, names) for phrase in table} for table in plain] == read
    assert len(plain_truth) == len(truth)


def renamed(phrase: str, names: dict[str, str]) -> str:
    owner, rest = phrase.split(" ", 1)
    return f"{names[owner]} {rest}"


def told_story(seed: int, people: list[str]) -> tuple[list[set[str]], list[set[str]]]:
    """At each search of a drawn story, the true phrases and those that follow its messages."""
    rng = np.random.default_rng(seed)
    setting = Setting(
        split="hard",
        category={name: name.split("_")[0] for name in WORDS},
        askable=frozenset(WORDS),
        num_alike={"cup": 3, "bed": 2, "rug": 2},
        conflicts=frozenset(),
        near=frozenset(),
    )
    owners = {
        "cup_1": (0, 1),
        "cup_2": (0,),
        "cup_3": (1,),
        "bed_1": (0,),
        "bed_2": (2,),
        "rug_1": (2,),
        "rug_2": (1, 2),
    }
    edges = [Edge(people[index], name) for name, found in owners.items() for index in found]
    try:
        story = draw_story(setting, edges, newcomers=people[3:], num_asks=8, needs=Needs(), rng=rng)
    except StoryError:
        return [], []
    messages = [
        Message(
            before=change.before,
            kind=change.kind,
            text="." if change.kind == "intro" else message_text(change, things=WORDS, rng=rng),
            adds=change.adds,
            removes=change.removes,
            until=change.until,
        )
        for change in story.changes
    ]
    truth = [set(sentences(state, WORDS)) for state in ownership_over_time(messages, len(story.asks))]
    intro = sentences(messages[0].adds, WORDS)
    return truth, [
        set(updated(intro, [News(one.text, index - one.before) for one in messages[1:] if one.before <= index]))
        for index in range(len(story.asks))
    ]
