"""`browse --sequences`: the history of a home sequence, and the graph before and after its messages."""

import re
from pathlib import Path

import pytest

from personal_viz.browse.library import Library, Wanted
from personal_viz.browse.panel_html import graph_html, history_html
from personal_viz.cli.browse import Browse
from personal_viz.study_app.home.homes import HomeLibrary
from sim.errors import PersonalVizError
from sim.sequences.searches import search_episode

from ..recordings.sequence_worlds import lent, told

SEQUENCE = told()
STORIES = [(SEQUENCE, index) for index in range(3)]
LIBRARY = Library([search_episode(*story) for story in STORIES], [], {}, HomeLibrary({}.__getitem__), stories=STORIES)


def edges(drawing: str) -> list[tuple[str, str]]:
    """Classes and ends of the drawing's edges."""
    return re.findall(r'class="edge([^"]*)" data-ends="([^"]+)"', drawing)


def test_the_graph_marks_the_edges_that_a_message_adds_and_removes() -> None:
    shown = LIBRARY.read(1)
    assert shown.graph.people == ("Nell", "Ivo")
    assert [(link.goal, link.is_target) for link in shown.links] == [("table_3", False), ("table_4", True)]
    assert shown.changes == {
        ("Nell", "table_3"): "gone",
        ("Ivo", "table_4"): "gone",
        ("Nell", "table_4"): "new",
        ("Ivo", "table_3"): "new",
    }
    assert sorted(edges(graph_html(shown))) == [
        (" gone", "p0 o0"), (" gone", "p1 o1"), (" new", "p0 o1"), (" new", "p1 o0"),
    ]  # fmt: skip


def test_without_a_message_nothing_is_marked() -> None:
    assert [edges(graph_html(LIBRARY.read(number))) for number in (0, 2)] == [
        [("", "p0 o0"), ("", "p1 o1")],
        [("", "p0 o0"), ("", "p1 o1")],
    ]


def test_the_history_tells_messages_and_searches_in_order_and_leads_to_each_search() -> None:
    told_here = [(line.kind, line.text, line.number, line.is_here) for line in LIBRARY.read(1).history]
    assert told_here == [
        ("fresh", "Find Nell's table", 0, False),
        ("swap", "Nell and Ivo swapped tables.", None, True),
        ("changed", "Find Nell's table", 1, True),
        ("changed", "Find Ivo's table", 2, False),
    ]
    assert re.findall(r'data-click="([^"]+)"', history_html(LIBRARY.read(1))) == ["episode 0", "episode 1", "episode 2"]


def test_the_end_of_a_loan_is_a_line_of_the_history_where_the_thing_goes_back() -> None:
    loan = lent()
    stories = [(loan, index) for index in range(3)]
    library = Library([search_episode(*one) for one in stories], [], {}, HomeLibrary({}.__getitem__), stories=stories)
    shown = library.read(2)
    assert [(line.kind, line.text, line.is_here) for line in shown.history] == [
        ("fresh", "Find Nell's table", False),
        ("lend", "Nell lent Una a table for one search.", False),
        ("fresh", "Find Ivo's table", False),
        ("loan ends", "Nell lent Una a table for one search.", True),
        ("revisit", "Find Ivo's table", True),
    ]
    assert shown.changes == {("Una", "table_3"): "gone", ("Nell", "table_3"): "new"}


def test_searches_are_found_by_their_words() -> None:
    assert LIBRARY.matching(Wanted(words="ivo's")) == (2,)


def test_runs_beside_a_set_are_refused(tmp_path: Path) -> None:
    with pytest.raises(PersonalVizError, match="--runs beside --sequences: expected one of them"):
        Browse(dataset=tmp_path, runs=(tmp_path,), sequences=tmp_path).run()
