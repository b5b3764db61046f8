"""The list of episodes, its filter, and the runs that are shown beside an episode."""

from personal_viz.browse.catalogue import PAGE, Catalogue, ListPage, Wanted, list_page, neighbour
from personal_viz.browse.episode_texts import facts_html, head_html, list_html, runs_html, story_html
from personal_viz.browse.messages import MessageQueue, Said, Slid, Stepped
from personal_viz.browse.shown import RunIndex
from recordings.traces import RUN_COLORS
from sim.episodes.ownership import ownership_graph

from .browse_worlds import episode, run_of

SENTENCES = ("Nell owns a red couch under the round window in the hall",)
EPISODES = (
    episode("1", "couch_1", SENTENCES),
    episode("2", "lamp_3", SENTENCES, split="hard", summary="Ivo reads at night."),
    episode("3", "couch_2", SENTENCES, scene="Barn", owner="Ivo"),
)


def catalogue() -> Catalogue:
    return Catalogue(EPISODES, num_runs=(0, 2, 0))


def test_the_filter_looks_into_text_query_owner_object_and_key() -> None:
    listed = catalogue()
    assert listed.matching(Wanted()) == (0, 1, 2)
    assert listed.matching(Wanted(words="NIGHT")) == (1,)
    assert listed.matching(Wanted(words="lamp_3")) == (1,)
    assert listed.matching(Wanted(words="find ivo's")) == (2,)
    assert listed.matching(Wanted(words="barn/3")) == (2,)
    assert listed.matching(Wanted(words="share couch")) == (0, 2)
    assert listed.matching(Wanted(words="share zebra")) == ()


def test_split_scene_and_runs_narrow_the_list_together() -> None:
    listed = catalogue()
    assert listed.scenes == ("Barn", "Hut")
    assert listed.matching(Wanted(split="hard")) == (1,)
    assert listed.matching(Wanted(scene="Hut")) == (0, 1)
    assert listed.matching(Wanted(scene="Hut", split="easy", words="couch")) == (0,)
    assert listed.matching(Wanted(with_runs=True)) == (1,)
    assert listed.matching(Wanted(with_runs=True, scene="Barn")) == ()


def test_a_list_of_two_thousand_is_shown_fifty_at_a_time() -> None:
    numbers = tuple(range(2000))
    assert PAGE == 50
    assert list_page(numbers, 0) == ListPage(numbers[:50], 0, 2000)
    assert list_page(numbers, 39) == ListPage(numbers[1950:], 1950, 2000)
    assert list_page(numbers, 99) == list_page(numbers, 39)
    assert list_page(numbers, -1) == list_page(numbers, 0)
    assert list_page((), 3) == ListPage((), 0, 0)
    assert list_page(tuple(range(51)), 1).numbers == (50,)


def test_the_neighbour_is_in_the_filtered_list_and_its_ends_hold() -> None:
    assert neighbour((2, 5, 9), 5, 1) == 9
    assert neighbour((2, 5, 9), 9, 1) == 9
    assert neighbour((2, 5, 9), 2, -1) == 2
    assert neighbour((), 2, 1) is None


def test_from_a_hidden_episode_the_first_step_leads_to_the_nearest_listed_one() -> None:
    assert neighbour((2, 5, 9), 6, 1) == 9
    assert neighbour((2, 5, 9), 6, -1) == 5
    assert neighbour((2, 5, 9), 0, -1) == 2
    assert neighbour((2, 5, 9), 11, 1) == 9


def test_everything_from_files_is_escaped() -> None:
    evil = "<img src=x onerror=alert(1)>"
    bad = episode("1", "couch_1", (f"{evil} owns a couch in the hall",), owner=evil, summary=f"{evil} has a couch.")
    graph = ownership_graph(bad)
    listed = list_html(Catalogue((bad,), num_runs=(0,)), ListPage((0,), 0, 1), 0)
    assert graph.people == (evil,)
    for text in (listed, head_html(bad, place=0, total=1), story_html(bad, graph), facts_html(bad)):
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
    index = RunIndex(
        [
            run_of(key, "explorer"),
            run_of(key, "explorer"),
            run_of(key, "pilot", participant="P07"),
            run_of(EPISODES[1].key, "rpg", points=3),
        ]
    )
    shown = index.of(key)
    assert [one.label for one in shown] == ["human P07", "explorer (explorer)", "explorer (explorer) #3"]
    assert [one.rgb for one in shown] == list(RUN_COLORS[:3])
    assert index.count(key) == 3
    assert index.count(EPISODES[2].key) == 0
    (answer,) = index.of(EPISODES[1].key)
    assert answer.run is None
    assert answer.answer is not None


def test_the_table_of_runs_has_a_check_box_for_each_that_is_off_for_hidden_ones() -> None:
    key = EPISODES[0].key
    shown = RunIndex([run_of(key, "explorer"), run_of(key, "rpg", points=2)]).of(key)
    table = runs_html(shown, hidden={"rpg"}, walked="explorer")
    assert 'data-click="show 0" checked' in table
    assert 'data-click="show 1" aria-label="Show rpg"' in table
    assert "No run" in runs_html((), hidden=(), walked=None)


def test_a_slow_visitor_handles_only_the_last_of_many_slides_and_hovers() -> None:
    messages = MessageQueue()
    for step in range(100):
        messages.put(Slid(step))
    messages.put(Said("hover o1"))
    messages.put(Said("hover o2"))
    messages.put(Said("click object 1"))
    messages.put(Said("click object 2"))
    messages.put(Stepped(1))
    messages.put(Stepped(1))
    taken = []
    for message in messages:
        taken.append(message)
        if len(taken) == 6:
            messages.end()
    assert taken == [
        Slid(99),
        Said("hover o2"),
        Said("click object 1"),
        Said("click object 2"),
        Stepped(1),
        Stepped(1),
    ]
