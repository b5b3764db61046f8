"""Asks a viser worker whether its event loop still runs; a worker that hangs is killed, and its participants move on.

The question is a request that the worker's own web server answers, on the same loop as every participant's messages.
"""

import errno
import select
import socket
import threading
from collections.abc import Iterator
from dataclasses import dataclass

_ASKED = b"GET /is-anybody-there HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n"
"""A request without the worker's secret: the worker refuses it, but answers at once."""
_SLICES = 30
"""Number of waits that make up the patience. A time in which this process itself stood still counts as one wait."""


@dataclass(frozen=True, slots=True)
class Heartbeat:
    """Settings: how often workers are asked, and how long they may take to answer."""

    every_s: float = 5.0
    """Seconds between an answer and the next question."""
    patience_s: float = 90.0
    """A worker that has not answered for this many seconds hangs. Homes are opened on other threads, so that the event
    loop of an idle machine answers in milliseconds; with twenty times more work than cores it takes seconds."""


def answers(port: int, *, patience_s: float, over: threading.Event) -> bool:
    """Whether a worker answers within the patience.

    Args:
        port: The worker's port on loopback.
        patience_s: Longest time from the first try to the first byte, seconds in which this process was running.
        over: Ends the waiting when the answer is no longer needed.

    Returns:
        False when it did not answer in time. True when it did, when `over` is set, and when this process cannot ask
        (no file descriptor or port is left), which says nothing about the worker.
    """
    slices = _until(patience_s, over)
    for slice_s in slices:
        try:
            with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as asking:
                asking.setblocking(False)
                asking.connect_ex(("127.0.0.1", port))
                if not _is_ready(asking, select.POLLOUT, slices):
                    break
                found = asking.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
                if found == errno.ECONNREFUSED:
                    over.wait(slice_s)  # nobody listens there, although the process has not ended
                    continue
                asking.sendall(_ASKED)
                if not _is_ready(asking, select.POLLIN, slices):
                    break
                return True
        except OSError:
            return True
    return over.is_set()


def _until(patience_s: float, over: threading.Event) -> Iterator[float]:
    """Yields the seconds of each wait, until the patience is used up or `over` is set."""
    for _ in range(_SLICES):
        if over.is_set():
            return
        yield patience_s / _SLICES


def _is_ready(asking: socket.socket, wanted: int, slices: Iterator[float]) -> bool:
    """Whether the socket can be written or read, or is at its end, before the slices are used up."""
    poll = select.poll()  # unlike select, for any number of open files
    poll.register(asking, wanted)
    return any(poll.poll(1000 * slice_s) for slice_s in slices)
