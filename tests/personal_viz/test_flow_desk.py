"""The desk between browser and seat: what is heard when, keys with their times, and how a seat is told to stop."""

import asyncio
import queue
from collections.abc import Awaitable
from typing import Any

import pytest

from human_study.store.store import SupersededError
from human_study.trial.commands import GiveUp, Measure, Move, PageChanged, PressStop, Resize
from personal_viz.study_app.page_script import Device, OwnKeys, PageTold, Pressed, RoundTrip, Told
from personal_viz.study_app.screens.desk import MAX_WAITING, Chosen, Desk, GoneError, Item, Signal, WithdrawnError
from personal_viz.study_app.screens.panels import Card, Choice
from sim.types import Action

CARD = Card("Title", "<p>text</p>", (Choice("yes", "Yes"),))


class FakePage:
    """Keeps the card that is shown."""

    def __init__(self) -> None:
        """Nothing is shown."""
        self.shown: list[tuple[Card, Any]] = []

    def card(self, card: Card, chosen: Any) -> None:
        """As `Page.card`."""
        self.shown.append((card, chosen))


@pytest.fixture
def desk() -> Desk:
    """A desk whose page shows nothing to anybody."""
    return Desk(FakePage(), "p01")  # type: ignore[arg-type]


def run(work: Awaitable[None]) -> None:
    """Does what viser's event loop would."""

    async def wait() -> None:
        await work

    asyncio.run(wait())


def hear(desk: Desk, *messages: Any) -> None:
    """As the page's script tells them."""
    for said in messages:
        run(desk.heard(said))


def test_a_trial_hears_of_the_page_and_a_card_does_not(desk: Desk) -> None:
    desk.new_screen()
    hear(
        desk,
        PageTold(n=1, t_cli_ms=7.0, what="hidden"),
        Device(n=2, t_cli_ms=8.0, webgl2=True, width=1200, height=700),
        RoundTrip(n=3, t_cli_ms=9.0, ms=31.0),
    )
    heard = [desk.wait().content for _ in range(3)]
    assert heard == [PageChanged("hidden", 7.0), Resize(1200, 700), Measure(31.0)]
    desk.show(CARD)
    hear(desk, PageTold(n=4, t_cli_ms=7.0, what="visible"))
    with pytest.raises(queue.Empty):
        desk.wait(timeout_s=0.0)


def test_a_screen_gets_only_what_its_own_buttons_send(desk: Desk) -> None:
    desk.show(CARD)
    old = desk.page.shown[-1][1]  # type: ignore[attr-defined]
    desk.show(CARD)
    new = desk.page.shown[-1][1]  # type: ignore[attr-defined]
    run(old("yes"))
    run(new("yes"))
    assert desk.wait().content == Chosen("yes")
    with pytest.raises(queue.Empty):
        desk.wait(timeout_s=0.0)


def test_a_key_gets_its_place_and_the_browser_time_and_a_button_does_not(desk: Desk) -> None:
    send = desk.new_screen()
    hear(desk, Pressed(n=0, t_cli_ms=123.5, code="KeyZ"))
    run(send(Move(Action.FORWARD, code="KeyW")))
    assert desk.wait().content == Move(Action.FORWARD, code="KeyZ", t_cli_ms=123.5)
    run(send(Move(Action.FORWARD, code="KeyW")))
    assert desk.wait().content == Move(Action.FORWARD, code="KeyW")
    hear(desk, Pressed(n=0, t_cli_ms=200.0, code="Enter"))
    run(send(PressStop(code="button-stop")))
    assert desk.wait().content == PressStop(code="button-stop")
    run(send(PressStop()))
    assert desk.wait().content == PressStop()


def test_presses_while_a_frame_is_under_way_are_marked_busy(desk: Desk) -> None:
    send = desk.new_screen()
    run(send(Move(Action.LEFT, code="KeyA")))
    run(send(Move(Action.LEFT, code="KeyA")))
    hear(desk, RoundTrip(n=1, t_cli_ms=0.0, ms=5.0))
    first, second, page = (desk.wait() for _ in range(3))
    assert (first.is_busy, second.is_busy, page.is_busy) == (False, True, False)
    desk.done_with(page)
    run(send(GiveUp()))
    assert desk.wait().is_busy
    desk.done_with(first)
    run(send(GiveUp()))
    assert not desk.wait().is_busy


@pytest.mark.parametrize(
    ("signal", "error"),
    [(Signal.GONE, GoneError), (Signal.SUPERSEDED, SupersededError), (Signal.WITHDRAWN, WithdrawnError)],
)
def test_signals_end_any_screen(desk: Desk, signal: Signal, error: type[Exception]) -> None:
    desk.show(CARD)
    desk.put(Item(signal))
    with pytest.raises(error):
        desk.wait()


def test_leaving_the_study_comes_through_the_script(desk: Desk) -> None:
    desk.new_screen()
    hear(desk, Told(n=1, t_cli_ms=0.0, name="something else"), Told(n=2, t_cli_ms=0.0, name="withdraw"))
    with pytest.raises(WithdrawnError):
        desk.wait()


def test_chosen_keys_are_kept_on_the_waiting_thread_and_do_not_disturb_it(desk: Desk) -> None:
    kept: list[dict[str, str]] = []
    desk.on_keys = lambda keys: kept.append({str(action): code for action, code in keys.items()})
    desk.show(CARD)
    hear(desk, OwnKeys(n=1, t_cli_ms=0.0, keys={"forward": "KeyI"}))
    assert kept == []
    with pytest.raises(queue.Empty):
        desk.wait(timeout_s=0.0)
    assert kept == [{"forward": "KeyI"}]


def test_a_lost_picture_is_remembered_until_the_page_is_new(desk: Desk) -> None:
    assert not desk.has_lost_picture
    hear(desk, PageTold(n=1, t_cli_ms=0.0, what="context_lost"), PageTold(n=2, t_cli_ms=0.0, what="focus"))
    assert desk.has_lost_picture


def test_a_flood_is_cut_off(desk: Desk) -> None:
    send = desk.new_screen()
    for _ in range(2 * MAX_WAITING):
        run(send(GiveUp()))
    found = 0
    while True:
        try:
            desk.wait(timeout_s=0.0)
        except queue.Empty:
            break
        found += 1
    assert found == MAX_WAITING


def test_a_flooded_seat_still_hears_that_its_browser_is_gone(desk: Desk) -> None:
    desk.new_screen()
    for _ in range(MAX_WAITING):
        desk.put(Item("told", screen=-1))
    desk.put(Item(Signal.GONE))
    with pytest.raises(GoneError):
        desk.wait(timeout_s=1.0)
