"""The messages of one browser, and the queue from which its visitor's thread takes them.

Most messages are words, because our own HTML can send nothing else: `hover NODE`, `object INDEX`, `episode NUMBER`,
`step BY`, `slide STEP` and so on. `Visitor` obeys them.
"""

import queue
from collections.abc import Iterator
from concurrent.futures import Future
from typing import NamedTuple

from .library import OpenHome, Wanted


class HomeOpened(NamedTuple):
    """A home that was asked for is open, has failed to open, or was given up by another visitor."""

    scene: str
    home: "Future[OpenHome]"


Words = tuple[str, ...]
Message = Words | Wanted | HomeOpened


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
    match new, old:
        case (Wanted(), Wanted()) | (("hover", *_), ("hover", *_)) | (("slide", *_), ("slide", *_)):
            return True
    return False
