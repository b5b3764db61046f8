"""What the widgets, the home, the loader and our own HTML tell a visitor, and the queue from which its thread takes it.

viser tells nothing about its HTML elements, but it does about text inputs: hovering and clicking become text messages
in a hidden input. The script listens on the whole page for elements with `data-hover` and `data-click`, and types into
the input; at most ten messages a second leave, of which clicks are never dropped. It also marks graph nodes under the
mouse at once, without waiting for the server, and keeps the arrow keys that move a slider from turning viser's camera.
"""

import html
import queue
from collections.abc import Awaitable, Callable, Iterator
from concurrent.futures import Future
from pathlib import Path
from typing import NamedTuple

import viser

from .catalogue import Wanted
from .library import OpenHome

LABEL = "messages of this page"
"""By which the script finds its input; viser sends no ids to scripts."""
EVERY_MS = 100
_SCRIPT = Path(__file__).with_name("channel.js")
Listen = Callable[[str], Awaitable[None]]


class Filtered(NamedTuple):
    """The filter was changed."""

    wanted: Wanted


class Said(NamedTuple):
    """Our own HTML was hovered or clicked: `hover NODE`, `click WORDS`."""

    words: str


class Stepped(NamedTuple):
    """To an episode before (-1) or after (+1)."""

    by: int


class Slid(NamedTuple):
    """The slider stands at a step of the run."""

    step: int


class BoxClicked(NamedTuple):
    """The box of an object node was clicked in 3-D."""

    index: int


class HomeOpened(NamedTuple):
    """A home that was asked for is there, or cannot be opened."""

    scene: str
    home: "Future[OpenHome]"


Message = Filtered | Said | Stepped | Slid | BoxClicked | HomeOpened


class MessageQueue:
    """Messages in order; of those that overtake each other only the last is handed out."""

    def __init__(self) -> None:
        """Starts empty."""
        self._queue: queue.SimpleQueue[Message | None] = queue.SimpleQueue()

    def put(self, message: Message) -> None:
        """Never waits."""
        self._queue.put(message)

    def end(self) -> None:
        """Ends the iteration; messages that are left are dropped."""
        self._queue.put(None)

    def __iter__(self) -> Iterator[Message]:
        """Waits for each message; ends after `end`."""
        while (batch := self._next_batch()) is not None:
            yield from batch

    def _next_batch(self) -> list[Message] | None:
        """All messages that are there, at least one; None at the end."""
        batch: list[Message] = []
        message = self._queue.get()
        while message is not None:
            if batch and _overtakes(message, batch[-1]):
                batch.pop()
            batch.append(message)
            if self._queue.empty():
                return batch
            message = self._queue.get()
        return None


def _overtakes(new: Message, old: Message) -> bool:
    """Whether the old message need not be handled any more: sliders, typing and the mouse are faster than homes."""
    if isinstance(new, Said) and isinstance(old, Said):
        return new.words.startswith("hover") and old.words.startswith("hover")
    return isinstance(new, (Filtered, Slid)) and type(new) is type(old)


def open_channel(client: viser.ClientHandle, listen: Listen) -> None:
    """Sends the script to a browser; each message is given to `listen`: `hover NODE` or `click WORDS`, in order."""
    field = client.gui.add_text(LABEL, "")

    @field.on_update
    async def _(_: object) -> None:
        await listen(field.value.partition(" ")[2])

    script = _SCRIPT.read_text(encoding="utf-8").replace("LABEL", LABEL).replace("EVERY", str(EVERY_MS))
    client.gui.add_html(f'<img src="data:," style="display:none" alt="" onerror="{html.escape(script)}">')
