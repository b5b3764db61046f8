"""The list of episodes, its filter, and the runs that are shown beside an episode."""

import re

import pytest

from personal_viz.browse.library import PAGE, Wanted, nearest_page, neighbour
from personal_viz.browse.messages import MessageQueue
from personal_viz.browse.panel_html import part_html, runs_html, story_html
from recordings.traces import RUN_COLORS
from sim.episodes.ownership import ownership_graph

from .browse_worlds import episode, library, run_of

SENTENCES = ("Nell owns a red couch under the round window in the hall",)
EPISODES = (
    episode("1", "couch_1", SENTENCES),
    episode("2", "lamp_3", SENTENCES, split="hard", summary="Ivo reads at night."),
    episode("3", "couch_2", SENTENCES, scene="Barn", owner="Ivo"),
)


LISTED = library(
    *EPISODES, runs=[run_of(EPISODES[1].key, "explorer"), run_of(EPISODES[1].key, "pilot", participant="P07")]
)


@pytest.mark.parametrize(
    ("wanted", "numbers"),
    [
        (Wanted(), (0, 1, 2)),
        (Wanted(words="NIGHT"), (1,)),
        (Wanted(words="lamp_3"), (1,)),
        (Wanted(words="find ivo's"), (2,)),
        (Wanted(words="barn/3"), (2,)),
        (Wanted(words="share couch"), (0, 2)),
        (Wanted(words="share zebra"), ()),
        (Wanted(split="hard"), (1,)),
        (Wanted(scene="Hut"), (0, 1)),
        (Wanted(scene="Hut", split="easy", words="couch"), (0,)),
        (Wanted(with_runs=True), (1,)),
        (Wanted(with_runs=True, scene="Barn"), ()),
    ],
)
def test_split_scene_runs_and_words_of_texts_query_owner_object_or_key_narrow_the_list(
    wanted: Wanted, numbers: tuple[int, ...]
) -> None:
    assert LISTED.scenes == ("Barn", "Hut")
    assert LISTED.matching(wanted) == numbers


def test_a_long_list_is_shown_fifty_at_a_time() -> None:
    assert [nearest_page(range(2000), index) for index in (-1, 0, 39, 99)] == [0, 0, 39, 39]
    assert nearest_page((), 3) == 0
    last = part_html("list", library=LISTED, matching=(0,) * PAGE + (2,), first=PAGE, size=PAGE, here=2)
    assert re.findall('data-click="(.*?)"( disabled)?', last) == [
        ("page -1", ""),
        ("page 1", " disabled"),
        ("episode 2", ""),
    ]
    assert "51&#8211;51 of 51 episodes" in last


@pytest.mark.parametrize(
    ("number", "by", "found"), [(5, 1, 9), (9, 1, 9), (2, -1, 2), (6, 1, 9), (6, -1, 5), (0, -1, 2), (11, 1, 9)]
)
def test_the_neighbour_is_the_nearest_in_the_filtered_list_and_its_ends_hold(number: int, by: int, found: int) -> None:
    assert neighbour((2, 5, 9), number, by) == found
    assert neighbour((), number, by) is None


def test_everything_from_files_is_escaped() -> None:
    evil = "<img src=x onerror=alert(1)>"
    bad = episode("1", "couch_1", (f"{evil} owns a couch in the hall",), owner=evil, summary=f"{evil} has a couch.")
    graph = ownership_graph(bad)
    assert graph.people == (evil,)
    for text in (
        part_html("list", library=library(bad), matching=(0,), first=0, size=PAGE, here=0),
        part_html("head", episode=bad, place=0, total=1),
        part_html("facts", episode=bad),
        story_html(bad, graph),
    ):
        assert "<img src=x" not in text
        assert "&lt;img src=x onerror=alert(1)&gt;" in text


def test_the_paragraph_shows_each_persons_name_in_bold_and_underlines_the_owner() -> None:
    told = episode(
        "1",
        "couch_1",
        ("Nell owns a red couch in the hall", "Ivo owns a lamp in the hall"),
        summary="Nell owns a couch; Ivo a lamp. Nellie nothing.",
    )
    story = story_html(told, ownership_graph(told))
    assert story.count("<b style=") == 2
    assert 'underline">Nell</b>' in story
    assert ">Ivo</b> a lamp. Nellie nothing." in story


def test_runs_of_an_episode_have_distinct_names_and_colours_and_people_come_first() -> None:
    key = EPISODES[0].key
    runs = [
        run_of(key, "explorer"),
        run_of(key, "explorer"),
        run_of(key, "pilot", participant="P07"),
        run_of(EPISODES[1].key, "rpg", points=3),
    ]
    listed = library(*EPISODES, runs=runs)
    shown = listed.read(0).traces
    assert [trace.title for trace in shown] == ["human-P07", "explorer", "explorer-2"]
    assert [trace.rgb for trace in shown] == list(RUN_COLORS[:3])
    assert listed.num_runs == (3, 1, 0)
    assert listed.read(2).traces == ()


def test_the_table_of_runs_has_a_check_box_for_each_that_is_off_for_hidden_ones() -> None:
    key = EPISODES[0].key
    shown = library(*EPISODES, runs=[run_of(key, "explorer"), run_of(key, "rpg", points=2)])
    table = runs_html(shown.read(0), hidden={"rpg"}, walked=0)
    assert 'data-click="show 0" checked' in table
    assert 'data-click="show 1" aria-label="Show rpg"' in table
    assert "No run" in runs_html(shown.read(2), hidden=set(), walked=None)


def test_a_slow_visitor_handles_only_the_last_of_many_slides_and_hovers() -> None:
    messages = MessageQueue()
    for step in range(100):
        messages.put(("slide", str(step)))
    kept = [("hover", "o2"), ("object", "1"), ("object", "2"), ("step", "1"), ("step", "1"), Wanted(words="lamp")]
    for message in (("hover", "o1"), *kept[:-1], Wanted(words="la"), kept[-1]):
        messages.put(message)
    taken = []
    for message in messages:
        taken.append(message)
        if message == kept[-1]:
            messages.end()
    assert taken == [("slide", "99"), *kept]


def test_a_home_says_which_storeys_no_record_tells_of() -> None:
    home = {"label": "Home", "storeys": 1, "storey": 0, "layers": set()}
    assert "No record tells of: ground floor, floor 3." in part_html(
        "home", missing=("ground floor", "floor 3"), **home
    )
    assert "No record" not in part_html("home", missing=(), **home)
