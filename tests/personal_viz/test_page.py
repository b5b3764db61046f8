"""Inputs of a page: what is heard when, keys with their times, and how the waiting thread is told to stop."""

import asyncio
import queue
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any
from unittest.mock import MagicMock

import pytest

from human_study.store.store import SupersededError
from human_study.texts.catalogue import catalogue_of
from human_study.trial.commands import GiveUp, Measure, Move, PageChanged, PressStop, Resize
from personal_viz.study_app.page_script import Device, OwnKeys, PageTold, Pressed, RoundTrip, Told
from personal_viz.study_app.screens.cards import Card, Choice
from personal_viz.study_app.screens.page import (
    MAX_WAITING,
    GoneError,
    Item,
    Page,
    WithdrawnError,
)
from personal_viz.study_app.screens.texts import description_html, names_in
from sim.types import Action

CARD = Card("Title", "<p>text</p>", (Choice("yes", "Yes"),))


@pytest.fixture
def page() -> Page:
    """A page that no browser shows."""
    return Page(MagicMock(), catalogue_of("en"))


def run(work: Awaitable[None]) -> None:
    """Runs the work as viser's event loop would."""

    async def wait() -> None:
        await work

    asyncio.run(wait())


def hear(page: Page, *messages: Any) -> None:
    """Sends messages as the page's script does."""
    for said in messages:
        run(page.heard(said))


def test_a_trial_hears_of_the_page_and_a_card_does_not(page: Page) -> None:
    page.new_screen()
    hear(
        page,
        PageTold(n=1, t_cli_ms=7.0, what="hidden"),
        Device(n=2, t_cli_ms=8.0, webgl2=True, width=1200, height=700),
        RoundTrip(n=3, t_cli_ms=9.0, ms=31.0),
    )
    heard = [page.wait().content for _ in range(3)]
    assert heard == [PageChanged("hidden", 7.0), Resize(1200, 700), Measure(31.0)]
    page.new_screen(hears=())
    hear(page, PageTold(n=4, t_cli_ms=7.0, what="visible"))
    with pytest.raises(queue.Empty):
        page.wait(timeout_s=0.0)


def test_a_screen_gets_only_what_its_own_buttons_send(page: Page) -> None:
    old, new = page.new_screen(), page.new_screen()
    run(old("no"))
    run(new("yes"))
    assert page.wait().content == "yes"
    with pytest.raises(queue.Empty):
        page.wait(timeout_s=0.0)


def test_a_card_waits_for_one_of_its_buttons(page: Page) -> None:
    presses = queue.Queue[Callable[[None], Awaitable[None]]]()
    page.client.gui.add_button.return_value.on_click.side_effect = presses.put
    with ThreadPoolExecutor(1) as pool:
        chosen = pool.submit(page.choose, CARD)
        try:
            press = presses.get(timeout=30)
            assert not chosen.done()
            run(press(None))
            assert chosen.result(30) == "yes"
        finally:
            page.end(GoneError())  # whatever failed, the thread ends


def test_a_key_gets_its_place_and_the_browser_time_and_a_button_does_not(page: Page) -> None:
    send = page.new_screen()
    hear(page, Pressed(n=0, t_cli_ms=123.5, action="forward", code="KeyZ"))
    run(send(Move(Action.FORWARD, code="KeyW")))
    assert page.wait().content == Move(Action.FORWARD, code="KeyZ", t_cli_ms=123.5)
    run(send(Move(Action.FORWARD, code="KeyW")))
    assert page.wait().content == Move(Action.FORWARD, code="KeyW")
    hear(page, Pressed(n=0, t_cli_ms=150.0, action="left", code="KeyQ"))
    run(send(Move(Action.FORWARD, code="KeyW")))
    assert page.wait().content == Move(Action.FORWARD, code="KeyW"), "a press whose command never came"
    hear(page, Pressed(n=0, t_cli_ms=200.0, action="stop", code="Enter"))
    run(send(PressStop(code="button-stop")))
    assert page.wait().content == PressStop(code="button-stop")
    run(send(PressStop()))
    assert page.wait().content == PressStop()
    page.own_keys = {"left": "KeyJ"}
    run(send(Move(Action.LEFT, code="KeyA")))
    assert page.wait().content == Move(Action.LEFT, code="KeyJ"), "an own key whose message was lost"
    run(send(Move(Action.LEFT, code="button-left")))
    assert page.wait().content == Move(Action.LEFT, code="button-left")


def test_presses_while_a_frame_is_under_way_are_marked_busy(page: Page) -> None:
    send = page.new_screen()
    run(send(Move(Action.LEFT, code="KeyA")))
    run(send(Move(Action.LEFT, code="KeyA")))
    hear(page, RoundTrip(n=1, t_cli_ms=0.0, ms=5.0))
    first, second, told = (page.wait() for _ in range(3))
    assert (first.is_busy, second.is_busy, told.is_busy) == (False, True, False)
    page.done_with(told)
    run(send(GiveUp()))
    assert page.wait().is_busy
    page.done_with(first)
    run(send(GiveUp()))
    assert not page.wait().is_busy


@pytest.mark.parametrize("error", [GoneError(), SupersededError("another tab")])
def test_an_end_is_heard_on_any_screen_and_by_a_thread_that_does_not_wait(page: Page, error: Exception) -> None:
    page.require_here()
    page.new_screen(hears=())
    page.end(error)
    for listen in (page.require_here, page.wait):
        with pytest.raises(type(error)):
            listen()


def test_leaving_the_study_comes_through_the_script(page: Page) -> None:
    page.new_screen()
    hear(page, Told(n=1, t_cli_ms=0.0, name="something else"), Told(n=2, t_cli_ms=0.0, name="withdraw"))
    with pytest.raises(WithdrawnError):
        page.wait()


def test_chosen_keys_are_kept_on_the_waiting_thread_and_do_not_disturb_it(page: Page) -> None:
    kept: list[dict[str, str]] = []
    page.on_keys = lambda keys: kept.append({str(action): code for action, code in keys.items()})
    page.new_screen(hears=())
    hear(page, OwnKeys(n=1, t_cli_ms=0.0, keys={"forward": "KeyI"}))
    assert kept == []
    with pytest.raises(queue.Empty):
        page.wait(timeout_s=0.0)
    assert kept == [{"forward": "KeyI"}]


def test_a_lost_picture_is_remembered_until_the_page_is_new(page: Page) -> None:
    assert not page.has_lost_picture
    hear(page, PageTold(n=1, t_cli_ms=0.0, what="context_lost"), PageTold(n=2, t_cli_ms=0.0, what="focus"))
    assert page.has_lost_picture


def test_a_flood_is_cut_off_and_the_seat_still_hears_that_its_browser_is_gone(page: Page) -> None:
    send = page.new_screen()
    for _ in range(2 * MAX_WAITING):
        run(send(GiveUp()))
    found = 0
    while True:
        try:
            page.wait(timeout_s=0.0)
        except queue.Empty:
            break
        found += 1
    assert found == MAX_WAITING
    page.new_screen()
    for _ in range(MAX_WAITING):
        page.put(Item("told", screen=-1))
    page.end(GoneError())
    with pytest.raises(GoneError):
        page.wait(timeout_s=1.0)


@pytest.mark.parametrize(
    ("query", "description", "names"),
    [
        ("Find Ludmila's tv", "Ludmila owns the black tv; Emeka the book.", ("Ludmila",)),
        (
            "Find the mug of Anne-Marie and Bo",
            "Bo likes tea. Anne-Marie has a mug. Find it.",
            ("Anne-Marie", "Bo"),
        ),
        ("Find the mug of Will or Mark", "Will lives with Mark. He will mark the mug. Find it.", ("Will", "Mark")),
        ("Ludmila's tv?", "The tv belongs to Ludmila.", ("Ludmila",)),
        ("Where is the mug?", "The mug is where the tea is.", ()),
        ("Find the mug of Ada", "Adam and ADA own mugs.", ()),
        ("", "", ()),
    ],
)
def test_names_are_the_words_that_have_a_capital_inside_a_sentence(
    query: str, description: str, names: tuple[str, ...]
) -> None:
    assert names_in(query, description) == names


def test_a_paragraph_marks_names_only_on_demand_and_is_escaped() -> None:
    shown = description_html("Ada's <b> & Ada", "Find Ada's mug", catalogue_of("en"))
    assert shown.count('<span class="personal-name">Ada</span>') == 2
    assert "<b>" not in shown
    assert "&lt;b&gt; &amp; " in shown
    assert 'data-tool="names"' in shown
    assert 'data-after="Remove highlights"><span>Highlight names</span></span></button>' in shown


def test_a_paragraph_without_names_of_the_query_has_no_button() -> None:
    shown = description_html("A mug stands on the shelf.", "Find the mug", catalogue_of("en"))
    assert "<button" not in shown
    assert "<p>A mug stands on the shelf.</p>" in shown
