"""One participant's page in the browser: what it shows, one screen at a time, and the inputs that come back in order.

viser's callbacks only queue inputs; the seat's own thread takes them, so simulator, rendering and disk are never on
viser's event loop.
"""

import asyncio
import contextlib
import dataclasses
import html
import queue
import time
from collections.abc import Awaitable, Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import viser

from human_study.texts.catalogue import Catalogue
from human_study.trial.commands import Measure, Move, PageChanged, PressStop, Resize
from sim.types import Action

from ..page_script import (
    Device,
    KeyAction,
    OwnKeys,
    PageTold,
    Pressed,
    RoundTrip,
    Said,
    Told,
    page_html,
    sign_html,
    when_shown,
)
from .cards import Card, card_html

PANEL_WIDTH = 400
"""Width at which viser opens the side panel, pixels; `page.css` makes it wider for larger text."""
MAX_WAITING = 200
"""Most inputs that may wait; a person never has more than a few."""
PAGE_COMMANDS = (PageChanged, Resize, Measure)
"""Messages of the page itself that a trial's screen receives."""
PRESS_WITHIN_S = 0.5
"""Longest time from a key's own message to its command; an older message belongs to a press that never arrived."""
WITHDRAW = "withdraw"
"""Name of the button by which somebody leaves the study for good, in messages of the page's script."""
_LAST = 1e6
"""Order of the elements below everything else."""
Press = Callable[[], Awaitable[None]]
Send = Callable[[Any], Awaitable[None]]
CameraListener = Callable[[viser.CameraHandle], Awaitable[None]]


class GoneError(Exception):
    """The browser closed the connection."""


class WithdrawnError(GoneError):
    """The participant leaves the study for good, and has confirmed it; a running trial stops."""


@dataclass(frozen=True, slots=True)
class Item:
    """One input on the queue."""

    content: Any
    """A command of `human_study.trial.commands`, an input of the screen's own, or an error that ends the work."""
    screen: int | None = None
    """Number of the screen whose button, key or canvas it came from; None for messages of the page itself."""
    is_busy: bool = False
    """Whether the frame of an earlier command was under way."""


class Page:
    """One participant's page; `clear` empties it for the next screen."""

    def __init__(self, client: viser.ClientHandle, words: Catalogue) -> None:
        """Sets up the page in a language, once per connection."""
        self.client, self.words = client, words
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
        self._handles: list[Any] = []
        self._on_camera: list[CameraListener] = []
        client.gui.configure_theme(dark_mode=False, show_logo=False, show_share_button=False)
        client.gui.set_panel_label(words("study.title"))
        client.gui.main_panel.dock_right()
        client.gui.main_panel.set_width(PANEL_WIDTH)
        client.camera.on_update(self._camera_moved)
        client.gui.add_html(page_html(words))
        self._sign, self._signed = client.gui.add_html(""), ("", 0)

    def new_screen(self, *, hears: tuple[type, ...] = PAGE_COMMANDS) -> Send:
        """Begins a screen, so that inputs of older screens are dropped; returns the function by which it sends.

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

    def wait(self, *, timeout_s: float | None = None) -> Item:
        """The next input of the present screen, or the next message of the page that it receives.

        Raises:
            queue.Empty: Nothing came within `timeout_s`.
            GoneError: The browser closed the connection.
            SupersededError: A newer tab took over.
            WithdrawnError: The participant leaves the study for good.
        """
        until_s = None if timeout_s is None else time.monotonic() + timeout_s
        while True:
            item = self._queue.get(timeout=None if until_s is None else max(0.0, until_s - time.monotonic()))
            if isinstance(item.content, Exception):
                raise item.content
            if isinstance(item.content, OwnKeys):
                self.own_keys = item.content.keys
                self.on_keys(item.content.keys)
            elif item.screen == self._screen or (item.screen is None and isinstance(item.content, self._hears)):
                return item

    def done_with(self, item: Item) -> None:
        """Tells that the answer to an input is about to be shown: later inputs are not busy any more."""
        if item.screen is not None:  # messages of the page itself are not presses
            self._is_busy = self._is_busy and item.is_busy

    def require_here(self) -> None:
        """Raises as `wait` if the browser has gone or a newer tab has come; for use after long work."""
        with self._queue.mutex:
            waiting = [item.content for item in self._queue.queue]
        for content in waiting:
            if isinstance(content, Exception):
                raise content

    def put(self, item: Item) -> None:
        """Queues an input. A browser that floods its seat loses inputs over MAX_WAITING; errors are always kept."""
        if isinstance(item.content, Exception) or self._queue.qsize() < MAX_WAITING:
            self._queue.put(item)

    def end(self, error: Exception) -> None:
        """Makes the waiting thread raise an error, whatever the page shows."""
        self.put(Item(error))

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
                self.end(WithdrawnError())

    def clear(self) -> None:
        """Removes all elements of the present screen."""
        self.sign("")
        for handle in self._handles:
            handle.remove()
        self._handles, self._on_camera = [], []

    def add(self, handle: Any) -> Any:
        """Keeps anything that has `remove` (a GUI element, a command, a home) until the next `clear`; returns it."""
        self._handles.append(handle)
        return handle

    def button(self, label: str, press: Press, *, color: str | None = None) -> viser.GuiButtonHandle:
        """Adds a button to the panel; returns it so that its label can change.

        Args:
            label: Says what happens; no meaning depends on colour alone.
            press: Called on viser's event loop.
            color: viser's colour name; None = the usual blue.
        """
        button = self.client.gui.add_button(label, color=color)  # type: ignore[arg-type]

        @button.on_click
        async def _(_: object) -> None:
            await press()

        return self.add(button)

    def hotkey(self, key: str, label: str, press: Press) -> None:
        """Adds a key that works wherever the focus is; one press is one call, the browser filters auto-repeat."""
        command = self.client.gui.add_command(label, hotkey=key)  # type: ignore[arg-type]

        @command.on_trigger
        async def _(_: object) -> None:
            await press()

        self.add(command)

    def listen_to_camera(self, listener: CameraListener) -> None:
        """Calls `listener` too whenever the 3-D camera has moved, until the next `clear`."""
        self._on_camera.append(listener)

    @contextlib.contextmanager
    def always_visible(self, edge: Literal["top", "bottom"]) -> Iterator[None]:
        """Keeps the elements that are added in the block in sight at an edge of the panel; the others scroll."""
        folder = self.client.gui.add_folder(edge)
        with folder:
            self.add(self.client.gui.add_html(f'<i class="personal-{edge}"></i>'))
            yield
        self.add(folder)

    def overlay(self, content: str) -> viser.GuiHtmlHandle:
        """Adds a sheet over the 3-D canvas, which then gets no mouse; returns it so that its content can change."""
        return self.add(self.client.gui.add_html(overlay_html(content)))

    def sign(self, text: str, number: int = 0, *, is_news: bool = False) -> None:
        """Shows a line over the picture or the home and has it read aloud; nothing on the page moves.

        Args:
            text: The line; an empty text removes it.
            number: A different number shows the same text once more.
            is_news: Whether the line tells of something new, such as a search that begins, and asks for nothing.
        """
        if (text, number) != self._signed:
            self._signed = text, number
            self._sign.content = sign_html(text, number, is_news=is_news)

    def card(self, card: Card, chosen: Callable[[str], Awaitable[None]] | None = None) -> None:
        """Shows a card over the whole page.

        Args:
            card: The card.
            chosen: Called with the name of the button that is pressed, by mouse or key; None = the card has no buttons.
        """
        self.clear()
        with self.client.atomic():
            self.add(self.client.gui.add_html(card_html(card, self.words) + when_shown("shown")))
            for choice in card.choices:
                assert chosen is not None, card.title
                press = partial(chosen, choice.name)
                self.button(choice.label, press)
                if choice.hotkey is not None:
                    self.hotkey(choice.hotkey, choice.label, press)
        self.client.flush()

    def choose(self, card: Card) -> str:
        """Shows a card until one of its buttons is pressed; returns the button's name. Raises as `wait`."""
        self.card(card, self.new_screen(hears=()))
        name = self.wait().content
        assert isinstance(name, str), name
        return name

    def tools(self, *, has_keys: bool, on_leave: str) -> None:
        """Adds the buttons that are always there, below everything else: keys, larger text, leaving the study.

        Args:
            has_keys: Whether the participant uses keys that can be chosen.
            on_leave: Text on what happens to the answers of somebody who leaves.
        """
        tools, keys, large, leave = (
            html.escape(self.words(key)) for key in ("page.tools", "script.keys", "page.large", "page.leave")
        )
        keys = f'<button type="button" data-tool="keys">{keys}</button>' if has_keys else ""
        leave = f'<button type="button" data-tool="leave" data-text="{html.escape(on_leave)}">{leave}</button>'
        self.client.gui.add_html(
            f'<div class="personal-tools" role="group" aria-label="{tools}">{keys}'
            f'<button type="button" data-tool="large" aria-pressed="false">{large}</button>{leave}</div>'
            + when_shown("refresh"),
            order=_LAST,
        )

    def reload(self) -> None:
        """Makes the browser load the page again."""
        self.client.gui.add_html(when_shown("reload"))
        self.client.flush()

    def go_on(self) -> None:
        """Makes the browser open the page that the gateway has for the participant now."""
        self.new_screen(hears=())
        self.clear()
        self.client.gui.add_html(when_shown("goOn"))
        self.client.flush()

    async def _camera_moved(self, camera: viser.CameraHandle) -> None:
        await asyncio.gather(*(listener(camera) for listener in self._on_camera))

    def _with_press(self, content: Any) -> Any:
        """The command of a key, with the key's place on the keyboard and the time of its press from the browser.

        viser may lose the message of a press; then an own key is known by its action, and the time is not.
        """
        pressed, self._pressed = self._pressed, None
        if not isinstance(content, Move | PressStop) or content.code.startswith("button"):
            return content
        actions = (content.action,) if isinstance(content, Move) else (Action.STOP, Action.FOUND)
        names = {action.value for action in actions}
        if pressed is not None and pressed[0].action in names and time.monotonic() - pressed[1] <= PRESS_WITHIN_S:
            return dataclasses.replace(content, code=pressed[0].code, t_cli_ms=pressed[0].t_cli_ms)
        own = next((code for name, code in self.own_keys.items() if name in names), content.code)
        return dataclasses.replace(content, code=own)


def relabel(button: viser.GuiButtonHandle, label: str, color: str | None = None) -> None:
    """Changes the label and colour of a button, if they differ, without moving it."""
    if button.label != label:
        button.label = label
    if color is not None and button.color != color:
        button.color = color  # type: ignore[assignment]


def show_giving_up(button: viser.GuiButtonHandle, words: Catalogue, *, is_giving_up: bool) -> None:
    """Labels the button of giving up, before and after its first press."""
    key = "give_up.press_again" if is_giving_up else "give_up.button"
    relabel(button, words(key), "red" if is_giving_up else "gray")


def roomy_html(shown: str, *others: str) -> str:
    """HTML of a text with room for each of the other texts, so that nothing below moves when it changes.

    Args:
        shown: HTML of the present text.
        others: At most two plain texts that are shown in this place at other times.
    """
    before, after = (html.escape(text) for text in (*others, "", "")[:2])
    return f'<div class="personal-room" data-before="{before}" data-after="{after}"><div>{shown}</div></div>'


def overlay_html(content: str) -> str:
    """HTML that covers the page except the side panel."""
    return f'<div class="personal-overlay">{content}</div>'
