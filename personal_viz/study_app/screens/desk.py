"""Connects one browser with the thread that serves it: a queue of the participant's inputs, one screen at a time.

viser's callbacks only put items on the queue; the seat's own thread takes them, so simulator, rendering and disk are
never on viser's event loop.
"""

import dataclasses
import enum
import queue
import time
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from typing import Any

from human_study.store.store import SupersededError
from human_study.trial.commands import Measure, Move, PageChanged, PressStop, Resize

from ..page_script import Device, KeyAction, OwnKeys, PageTold, Pressed, RoundTrip, Said, Told, when_shown
from .panels import Card, Page

MAX_WAITING = 200
"""Most items that may wait; a person never has more than a few."""
PAGE_COMMANDS = (PageChanged, Resize, Measure)
"""Messages of the page itself that a trial's screen receives."""
PRESS_WITHIN_S = 0.5
"""Longest time from a key's own message to its command; an older message belongs to a key without command."""
WITHDRAW = "withdraw"
"""Name of the button by which somebody leaves the study for good, in messages of the page's script."""
Send = Callable[[Any], Awaitable[None]]


class Signal(enum.Enum):
    """Signals to a seat besides the participant's commands."""

    GONE = enum.auto()
    """The browser closed the connection."""
    SUPERSEDED = enum.auto()
    """The participant opened the study in another tab."""
    WITHDRAWN = enum.auto()
    """The participant leaves the study for good, and has confirmed it."""


class GoneError(Exception):
    """The browser closed the connection."""


class WithdrawnError(GoneError):
    """The participant leaves the study for good; a running trial stops, as when the browser is gone."""


@dataclass(frozen=True, slots=True)
class Chosen:
    """A button of a card, or its key, was pressed."""

    name: str


@dataclass(frozen=True, slots=True)
class Item:
    """One thing on the queue."""

    content: Any
    """A command of `human_study.trial.commands`, a ClickRay, a Signal, or an item of a screen's own."""
    screen: int | None = None
    """The screen whose button, key or canvas it came from; None for signals and for messages of the page itself."""
    is_busy: bool = False
    """Whether the frame of an earlier command was under way."""


class Desk:
    """One participant's page and queue."""

    def __init__(self, page: Page, code: str) -> None:
        """Nothing is shown yet.

        Args:
            page: The page in the participant's browser.
            code: The participant.
        """
        self.page, self.code = page, code
        self.has_lost_picture = False
        """Whether the browser can no longer draw in 3-D until the page is loaded again."""
        self.own_keys: Mapping[KeyAction, str] = {}
        """Keys that the participant chose (`KeyboardEvent.code`); other actions have the usual ones."""
        self.on_keys: Callable[[Mapping[KeyAction, str]], None] = lambda _: None
        """Called on the waiting thread when the participant chose other keys."""
        self._queue: queue.Queue[Item] = queue.Queue()
        self._screen = 0
        self._hears: tuple[type, ...] = ()
        self._is_busy = False
        self._pressed: tuple[Pressed, float] | None = None

    def put(self, item: Item) -> None:
        """Queues an item. Items over MAX_WAITING, from a browser that floods its seat, are dropped; signals are not."""
        if isinstance(item.content, Signal) or self._queue.qsize() < MAX_WAITING:
            self._queue.put(item)

    def require_here(self) -> None:
        """Raises as `wait` if the browser has gone or a newer tab has come; for use after long work."""
        with self._queue.mutex:
            waiting = [item.content for item in self._queue.queue]
        for content in waiting:
            self._end_on(content)

    def new_screen(self, *, hears: tuple[type, ...] = PAGE_COMMANDS) -> Send:
        """Begins a screen, so that items of older screens are dropped; returns the function by which it sends.

        Args:
            hears: Types of the page's own messages that `wait` returns: page commands in a trial.
        """
        self._screen += 1
        self._hears = hears
        self._is_busy = False
        screen = self._screen

        async def send(content: Any) -> None:
            if screen != self._screen:
                return
            is_busy, self._is_busy = self._is_busy, True
            self.put(Item(self._with_press(content), screen, is_busy))

        return send

    def done_with(self, item: Item) -> None:
        """Tells that the answer to an item is about to be shown: later items are not busy any more."""
        if item.screen is not None:  # messages of the page itself are not presses
            self._is_busy = self._is_busy and item.is_busy

    async def heard(self, said: Said) -> None:
        """Takes a message of the page's script; on viser's event loop, so it only queues."""
        match said:
            case Pressed():
                self._pressed = (said, time.monotonic())
            case Device(width=width, height=height):
                self.put(Item(Resize(width, height)))
            case PageTold(what=what, t_cli_ms=t_cli_ms):
                self.has_lost_picture = self.has_lost_picture or what == "context_lost"
                self.put(Item(PageChanged(what, t_cli_ms)))
            case RoundTrip(ms=ms):
                self.put(Item(Measure(ms)))
            case OwnKeys():
                self.put(Item(said))
            case Told(name=name) if name == WITHDRAW:
                self.put(Item(Signal.WITHDRAWN))

    def wait(self, *, timeout_s: float | None = None) -> Item:
        """The next item of the present screen, or the next message of the page that it receives.

        Raises:
            queue.Empty: Nothing came within `timeout_s`.
            GoneError: The browser closed the connection.
            SupersededError: A newer tab took over.
            WithdrawnError: The participant leaves the study for good.
        """
        until_s = None if timeout_s is None else time.monotonic() + timeout_s
        while True:
            item = self._queue.get(timeout=None if until_s is None else max(0.0, until_s - time.monotonic()))
            self._end_on(item.content)
            if isinstance(item.content, OwnKeys):
                self.own_keys = item.content.keys
                self.on_keys(item.content.keys)
            elif item.screen == self._screen or (item.screen is None and isinstance(item.content, self._hears)):
                return item

    def show(self, card: Card) -> None:
        """Shows a card; `wait` returns presses of its buttons and their keys as `Chosen`."""
        send = self.new_screen(hears=())

        async def chosen(name: str) -> None:
            await send(Chosen(name))

        self.page.card(card, chosen)

    def choose(self, card: Card) -> str:
        """Shows a card until one of its buttons is pressed; returns the button's name. Raises as `wait`."""
        self.show(card)
        chosen = self.wait().content
        assert isinstance(chosen, Chosen), chosen
        return chosen.name

    def reload(self) -> None:
        """Makes the browser load the page again."""
        self.page.client.gui.add_html(when_shown("reload"))
        self.page.client.flush()

    def go_on(self) -> None:
        """Makes the browser open the page that the gateway has for the participant now."""
        self.new_screen(hears=())
        self.page.clear()
        self.page.client.gui.add_html(when_shown("goOn"))
        self.page.client.flush()

    def _end_on(self, content: Any) -> None:
        """Raises on the signals that end a seat's work."""
        if content is Signal.GONE:
            raise GoneError
        if content is Signal.SUPERSEDED:
            raise SupersededError(f"{self.code} opened the study in another tab.")
        if content is Signal.WITHDRAWN:
            raise WithdrawnError

    def _with_press(self, content: Any) -> Any:
        """The command of a key, with the key's place on the keyboard and the time of its press from the browser."""
        pressed, self._pressed = self._pressed, None
        if pressed is None or not isinstance(content, Move | PressStop) or content.code.startswith("button"):
            return content
        said, at_s = pressed
        if time.monotonic() - at_s > PRESS_WITHIN_S:
            return content
        return dataclasses.replace(content, code=said.code, t_cli_ms=said.t_cli_ms)
