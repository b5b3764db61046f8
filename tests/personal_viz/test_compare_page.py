"""The page and the Markdown: self-contained, and no text of runs or episodes is ever read as more than text."""

import re
from dataclasses import replace

import pytest

from personal_viz.compare.page import FIRST, Page, page_html, page_markdown, plain, written
from personal_viz.compare.rows import Row, Section, means_of
from sim.types import EpisodeKey

from .html_tags import Tags
from .test_compare_rows import HOME, trial

EVIL = "<img src=x onerror=alert(1)>|`@@SCRIPT@@`\"'&amp;</td></script>"


def page(*, num_rows: int = 1, who: str = "agent", query: str = "Find it.", num_people: int = 1) -> Page:
    rows = []
    for number in range(num_rows):
        key = EpisodeKey("easy", "Hut", str(number))
        people = [trial("human", success=True, key=key, participant=f"P{n}") for n in range(num_people)]
        trials = (*people, trial(who, success=False, key=key, run_id=who, steps=1))
        rows.append(Row(key, query, f"episodes/easy-Hut-{number}", trials, means_of(trials, "pan")))
    section = Section(HOME, "pan", tuple(rows), ())
    return Page((section,), edition="own", has_scan_pixels=False, has_left_out_pixels=False)


def test_evil_names_and_queries_stay_text() -> None:
    html = page_html(page(who=EVIL, query=EVIL))
    tags = Tags(html)
    assert [tag for tag, _ in tags.found].count("script") == 1
    images = [attributes for tag, attributes in tags.found if tag == "img"]
    assert [image["src"] for image in images] == ["episodes/easy-Hut-0/thumb.jpg"]
    assert not [name for _, attributes in tags.found for name in attributes if name.startswith("on")]
    assert tags.text.count(EVIL) == 2  # the query, and beside the figures


def test_nothing_comes_from_outside_the_folder() -> None:
    tags = Tags(page_html(page(num_rows=3)))
    links = [value for _, at in tags.found for name, value in at.items() if name in ("src", "href") and value]
    assert links
    assert all(link.startswith("episodes/easy-Hut-") or link == "data:," for link in links)
    policy = next(at["content"] for tag, at in tags.found if at.get("http-equiv") == "Content-Security-Policy")
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    assert "unsafe" not in policy


def test_the_page_says_success_in_words_and_signs_not_by_colour_alone() -> None:
    tags = Tags(page_html(page()))
    assert "\u2713success:" in tags.text
    assert "\u2717no success:" in tags.text


def test_only_differences_of_success_have_a_colour() -> None:
    html = page_html(page())  # the person succeeds in 10 steps, the agent fails in 1
    cells = re.findall(r'<td class="num([^"]*)" data-key="([^"]*)"', html)
    coloured = [(key, classes.split()[-1]) for classes, key in cells if "better" in classes]
    assert coloured == [("difference-sr", "better-people")]
    assert ("difference-steps", "") in [(key, classes.strip()) for classes, key in cells]


def test_rows_beyond_the_first_hundred_wait_in_a_template_and_many_runs_are_folded_up_under_their_successes() -> None:
    html = page_html(page(num_rows=FIRST + 5))
    in_table, _, in_template = html.partition('<template class="rest">')
    assert (in_table.count("<tr data-split"), in_template.count("<tr data-split")) == (FIRST, 5)
    assert "<template" not in page_html(page(num_rows=FIRST))
    html = page_html(page(num_people=12))
    assert "<summary>people 12 of 12, agents 0 of 1</summary>" in html
    assert "<details>" not in page_html(page(num_people=3))


def test_a_kind_that_has_no_runs_has_no_columns() -> None:
    only_agents = page()
    section = only_agents.sections[0]
    rows = tuple(replace(row, trials=row.trials[1:]) for row in section.rows)
    html = page_html(replace(only_agents, sections=(replace(section, rows=rows),)))
    assert 'data-key="agents-sr"' in html
    assert 'data-key="people-sr"' not in html
    assert 'data-key="difference-sr"' not in html


def test_markdown_holds_the_same_rows_with_every_text_escaped() -> None:
    text = page_markdown(page(num_rows=2, who=EVIL, query=EVIL))
    lines = [line for line in text.splitlines() if "episodes/easy-Hut-1/replay.rrd" in line]
    assert len(lines) == 1
    cells = re.split(r"(?<!\\)\|", lines[0])[1:-1]
    assert len(cells) == 6 + 12
    assert cells[2].strip() == plain(EVIL)
    assert [cell.strip() for cell in cells[6:10]] == ["100", "50", "10", "4.0"]
    assert [cell.strip() for cell in cells[14:]] == ["+100", "+50", "+9", "-"]
    assert "<img" not in re.sub(r"\\.", "", text)


@pytest.mark.parametrize(
    ("value", "words"), [(None, "-"), (0.004, "0.0"), (-0.04, "0.0"), (-1.25, "\u22121.2"), (3.0, "+3.0")]
)
def test_differences_have_a_sign_and_nothing_has_minus_zero(value: float | None, words: str) -> None:
    assert written(value, 1, is_signed=True) == words


def test_facts_say_how_a_run_ended_unless_it_stopped() -> None:
    assert trial("human", success=True).facts == "SPL 50, 10 steps, 4.0 s"
    assert trial("a", success=False, steps=1, reason="steps").facts == "SPL 0, 1 step, out of steps"
