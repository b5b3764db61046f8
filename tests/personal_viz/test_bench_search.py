"""The comparison of agents that search: paired differences, intervals by home, tables and curves."""

import pytest

from personal_viz.bench.search.figures import GEOMETRY, Outcome, Search, group_figures, search_document
from personal_viz.bench.search.page import curves_png, rewritten
from sim.errors import RunFileError
from sim.types import EpisodeKey


def outcomes(successes: str) -> list[Outcome]:
    """One episode in each of six homes, with this success each."""
    keys = [EpisodeKey("easy", f"Home{number}", "0") for number in range(len(successes))]
    return [
        Outcome(key, mark == "1", spl=0.5 * (mark == "1"), at_view_point=False, num_steps=100)
        for key, mark in zip(keys, successes, strict=True)
    ]


def two_agents() -> dict[Search, list[Outcome]]:
    return {
        Search("random-frontier", ""): outcomes("000001"),
        Search("vlfm", "oracle:mild"): outcomes("111001"),
        Search(GEOMETRY, "oracle:mild"): outcomes("100001"),
    }


def test_a_method_stands_beside_geometry_on_the_same_episodes() -> None:
    blind, vlfm, control = group_figures("invented", two_agents()).rows
    assert (vlfm.sr, vlfm.spl, vlfm.successes) == (pytest.approx(200 / 3), pytest.approx(100 / 3), "111001")
    assert vlfm.beside_geometry == pytest.approx(100 / 3)  # two homes of six are won, none is lost
    assert vlfm.beside_geometry_by_home is not None
    assert vlfm.beside_geometry_by_home.low == 0.0
    assert vlfm.beside_geometry_by_home.high == pytest.approx(200 / 3)
    assert (blind.beside_geometry, control.beside_geometry) == (None, None)


def test_a_target_without_a_view_point_does_not_count_there() -> None:
    marks = (True, None, False, None, True, None)
    found = [each._replace(at_view_point=mark) for each, mark in zip(outcomes("111111"), marks, strict=True)]
    (row,) = group_figures("invented", {Search("random-frontier", ""): found}).rows
    assert row.sr_at_view_point == pytest.approx(200 / 3)
    assert row.sr == 100.0


def test_runs_of_different_episodes_are_no_pairs() -> None:
    with pytest.raises(RunFileError, match="found runs of 6 and 5 episodes"):
        group_figures("invented", {**two_agents(), Search("onemap", "oracle:mild"): outcomes("11111")})


def test_the_page_gets_the_table_between_its_marks_and_a_picture() -> None:
    document = search_document([group_figures("invented", two_agents())], git_commits=["b", "a", "b"])
    assert document.git_commits == ("a", "b")
    page = rewritten("before\n<!-- search -->\nold\n<!-- end -->\nafter\n", document)
    assert page.startswith("before\n<!-- search -->\n")
    assert page.endswith("\n<!-- end -->\nafter\n")
    assert "old" not in page
    assert "| vlfm | mild | 66.7 |" in page
    assert "| +33.3 (0.0 to 66.7) |" in page
    assert "no human baseline" in page
    with pytest.raises(RunFileError, match="Add both lines"):
        rewritten("no marks", document)
    assert curves_png(document).startswith(b"\x89PNG")
