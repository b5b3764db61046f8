"""Home sequences on a trial's page in real Chromium, and whole trials by bots through the gateway."""

import dataclasses
import itertools
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import BrowserContext, Page, WebSocket, expect

from human_study.design.plan import StudyScene
from human_study.design.study import StudyPog
from human_study.store.records import read_study
from human_study.trial.events import SearchBegun
from personal_viz.bots.crowd import run_bots
from personal_viz.bots.page import decoded
from personal_viz.bots.server import Server
from personal_viz.bots.site import make_pilot
from personal_viz.study_app.home.frames import RenderThreads
from personal_viz.study_app.home.homes import Home
from personal_viz.study_app.server import open_home
from sim.episodes.dataset import PersonalDataset
from sim.sequences.runs import SequenceEnd
from sim.sequences.searches import sequence_key
from tests.sim.home_story import SCENE, leaks, marked_story, told_in

from ..human_study.small_world import study
from .flow_steps import HOLD_MS, resting_camera
from .program import personal_viz
from .stage import staged

pytestmark = pytest.mark.browser
CHOICES = {"sequences": {"sha256": "0" * 64}, "pog": {"conditions": ["map_open"]}}
MESSAGES, SUBTASKS = marked_story()
QUERIES = [told["query"][0] for told in SUBTASKS]
TEXTS = [told["text"] for told in MESSAGES]


@pytest.fixture(scope="module")
def home(small_home_root: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Home]:
    """The invented home Small with the story of `home_story`."""
    story = told_in(small_home_root, tmp_path_factory.mktemp("set"), messages=MESSAGES, subtasks=SUBTASKS)
    scene = StudyScene(name=SCENE, kind="invented")
    opened = open_home(study(**CHOICES), scene, PersonalDataset(small_home_root), None, threads=RenderThreads(1))
    yield dataclasses.replace(opened, sequences={sequence_key(story): story})
    opened.close()


def heard_by(page: Page) -> list[str]:
    """All that the page will receive, as text."""
    heard: list[str] = []

    def take(frame: Any) -> None:
        if isinstance(frame, bytes):
            heard.extend(str(message)[:20_000] for message in decoded(frame))

    def listen(socket: WebSocket) -> None:
        socket.on("framereceived", take)

    page.on("websocket", listen)
    return heard


def require_unheard(heard: list[str], *, search: int) -> None:
    """Nothing of later searches has come, and nothing of what is or was right."""
    said = "\n".join(heard).replace("&#x27;", "'")
    assert QUERIES[search] in said
    said = re.sub(r"'owner': '\d*'", "", said)  # viser's: the client to whom a message belongs
    assert leaks(said, search) == []


def see_search(page: Page, search: int) -> None:
    expect(page.locator(f'[data-search="{search}"]')).to_contain_text(f"Search {search + 1} of 6")
    expect(page.locator(".personal-query")).to_have_text(QUERIES[search])


def found(page: Page) -> None:
    """Says FOUND by key."""
    button = page.get_by_role("button", name="press again (Enter)")
    expect(button).to_have_count(0)
    page.wait_for_timeout(2 * HOLD_MS)
    page.keyboard.press("Enter", delay=HOLD_MS)
    expect(button).to_be_visible()
    page.keyboard.press("Enter", delay=HOLD_MS)
    expect(button).to_have_count(0)


def give_up(page: Page) -> None:
    """Gives the present search up; a double click would be one press."""
    button = page.get_by_role("button", name="Give up this search")
    button.click()
    expect(page.get_by_text("again to end this search")).to_be_visible()
    page.wait_for_timeout(600)
    button.click()


def require_in_sight(page: Page, *names: str) -> None:
    """The query and these buttons are whole in the window, and nothing covers them."""
    height = page.viewport_size["height"] if page.viewport_size else 0
    shown = [page.locator(".personal-query"), *(page.get_by_role("button", name=name, exact=True) for name in names)]
    boxes = [one.bounding_box() for one in shown]
    for box in boxes:
        assert box is not None
        assert 0 <= box["y"] <= height - box["height"], boxes
    tops = sorted((box["y"], box["y"] + box["height"]) for box in boxes if box is not None)
    assert all(before[1] <= after[0] for before, after in itertools.pairwise(tops)), boxes


@pytest.mark.parametrize("is_large", [False, True])
def test_a_walker_reads_a_message_in_its_search_only(home: Home, browser: BrowserContext, is_large: bool) -> None:
    with staged(home, "pan", "history_hidden", **CHOICES) as stage:
        page = browser.new_page()
        page.set_viewport_size({"width": 1024, "height": 700})
        if is_large:
            page.add_init_script("localStorage.setItem('personal-large', '1')")
        heard = heard_by(page)
        page.goto(stage.url)
        messages = page.get_by_role("region", name="Messages")
        see_search(page, 0)
        expect(messages).to_contain_text(TEXTS[0])
        require_in_sight(page, "FOUND here (Enter twice)", "Give up this search")
        require_unheard(heard, search=0)
        found(page)
        see_search(page, 1)
        expect(messages).to_contain_text("No new message before this search.")
        expect(messages).not_to_contain_text(TEXTS[0])
        found(page)
        expect(page.locator('[data-search="1"]')).to_contain_text("1 marked so far")
        expect(page.get_by_role("button", name="FOUND again: that is all (Enter twice)")).to_be_visible()
        require_unheard(heard, search=1)
        found(page)
        see_search(page, 2)
        expect(messages).to_contain_text("Message before search 3")
        expect(messages).to_contain_text(TEXTS[1])
        expect(page.get_by_role("alert").filter(has_text="New message. Search 3 of 6.")).to_be_visible()
        page.keyboard.press("a", delay=HOLD_MS)
        expect(page.get_by_text("Step 1 of 500")).to_be_visible()
        expect(page.get_by_text("New message. Search 3 of 6.")).to_have_count(0)
        give_up(page)
        see_search(page, 3)
        require_unheard(heard, search=3)
        for search in (4, 5):
            give_up(page)
            see_search(page, search)
        give_up(page)
        expect(page.get_by_role("heading", name="Saved")).to_be_visible()
        outcome, events = stage.link.outcome, stage.link.events()
    assert isinstance(outcome, SequenceEnd)
    assert [search.reason for search in outcome.searches] == ["found", "found", *["giveup"] * 4]
    told = [event.notes for event in events if isinstance(event, SearchBegun)]
    assert told == [(0,), (), (1,), (2,), (), ()], "the exposure is logged"


def test_somebody_who_points_marks_all_objects_and_reads_the_history(home: Home, browser: BrowserContext) -> None:
    with staged(home, "pog", "history_visible", **CHOICES) as stage:
        page = browser.new_page()
        page.set_viewport_size({"width": 1024, "height": 700})
        heard = heard_by(page)
        page.goto(stage.url)
        messages, confirm = (
            page.get_by_role("region", name="Messages"),
            page.get_by_role("button", name="Confirm the mark"),
        )
        see_search(page, 0)
        resting_camera(page, stage.link.events)
        page.keyboard.press("ArrowUp", delay=HOLD_MS)  # a mark without a mouse
        expect(page.get_by_text("Click again to move your mark")).to_be_visible()
        expect(page.get_by_role("button", name="Take back the last mark")).to_have_count(0)
        confirm.click()
        see_search(page, 1)
        expect(messages).to_contain_text(TEXTS[0])
        require_unheard(heard, search=1)
        counter, more = page.locator('[data-search="1"]'), page.get_by_role("button", name="Set one more mark")
        expect(counter).to_contain_text("0 marked so far")
        page.keyboard.press("ArrowUp", delay=HOLD_MS)
        expect(counter).to_contain_text("1 marked so far")
        page.keyboard.press("ArrowUp", delay=HOLD_MS)  # moves it
        page.wait_for_timeout(500)
        expect(counter).to_contain_text("1 marked so far")
        more.click()
        expect(counter).to_contain_text("2 marked so far")
        more.click()
        expect(counter).to_contain_text("3 marked so far")
        require_in_sight(page, "Take back the last mark", "Confirm the marks", "Give up this search")
        page.get_by_role("button", name="Take back the last mark").click()
        expect(counter).to_contain_text("2 marked so far")
        page.get_by_role("button", name="Confirm the marks").click()
        see_search(page, 2)
        expect(messages).to_contain_text(TEXTS[1])
        expect(messages).to_contain_text(TEXTS[0])
        expect(messages.locator("article").first).to_contain_text("Message before search 3 New")
        require_unheard(heard, search=2)
        for search in (3, 4, 5):
            give_up(page)
            see_search(page, search)
        give_up(page)
        expect(page.get_by_role("heading", name="Saved")).to_be_visible()
        outcome = stage.link.outcome
    assert [len(search.points) for search in outcome.searches] == [1, 2, 0, 0, 0, 0]


@pytest.mark.slow
def test_bots_do_a_whole_study_of_home_sequences_and_it_is_verified(small_home_root: Path, tmp_path: Path) -> None:
    told_in(small_home_root, tmp_path / "set", messages=MESSAGES[:2], subtasks=SUBTASKS[:3])
    folder, choices = tmp_path / "study", {"task": ("pan", "pog"), "flow": ("instructions",)}
    pog = StudyPog(conditions=("map_open",))
    make_pilot(folder, small_home_root, participants=1, sequence_set=tmp_path / "set", pog=pog, **choices)
    with Server(folder, small_home_root, workers=1) as server:
        figures = run_bots(
            server.start(), participants=2, seconds=120, rate=3, kinds=["shortest"], seed=1, tasks=("pan", "pog")
        )
    assert (figures.finished, figures.problems) == (2, ())
    assert (figures.lost, figures.duplicated, figures.unknown) == (0, 0, 0)
    with read_study(folder) as reader:
        ends = [trial.outcome for code in reader.codes() for trial in reader.trials(code)]
    assert [[search.succeeds("paper") for search in end.searches] for end in ends] == [[True] * 3] * 2
    done = personal_viz("study", "verify", folder, "--dataset", small_home_root, "--sequences", tmp_path / "set")
    assert done.returncode == 0, done.stdout + done.stderr
