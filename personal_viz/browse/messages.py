"""What a visitor is told by the widgets, the home and the loader, and the queue from which its thread takes it."""

import queue
from collections.abc import Iterator
from concurrent.futures import Future
from typing import NamedTuple

from .catalogue import Wanted
from .homes import OpenHome


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
        """Ends the iteration, whatever is still to be handed out."""
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
