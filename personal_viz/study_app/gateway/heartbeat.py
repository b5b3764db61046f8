"""Asks a viser worker whether its event loop still runs; one that hangs is killed, its participants move to another.

The question is a request that the worker's own web server answers, on the same loop as every participant's messages.
"""

import errno
import select
import socket
import threading
from collections.abc import Iterator
from dataclasses import dataclass

_ASKED = b"GET /is-anybody-there HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n"
"""The worker's door is shut for who brings no secret, and says so at once."""
_SLICES = 30
"""Number of waits that make up the patience: time in which this process itself stood still counts as one of them."""


@dataclass(frozen=True, slots=True)
class Heartbeat:
    """How often workers are asked, and how long they may take."""

    every_s: float = 5.0
    """Between an answer and the next question."""
    patience_s: float = 90.0
    """A worker that has not answered for so long hangs. Homes are opened on other threads, so that the event loop of an
    idle machine answers in milliseconds; with twenty times more to do than there are cores it takes seconds."""


def answers(port: int, *, patience_s: float, over: threading.Event) -> bool:
    """Whether a worker answers within the patience.

    Args:
        port: Where it listens, on loopback.
        patience_s: Seconds from the first try to the first byte, in which this process was running.
        over: Ends the waiting: nobody cares any more.

    Returns:
        False when it did not answer in time. True when it did, when nobody cares, and when this process cannot ask
        (no file descriptor or port is left), which says nothing of the worker.
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
                    over.wait(slice_s)  # nobody listens there, and yet the process has not ended
                    continue
                asking.sendall(_ASKED)
                if not _is_ready(asking, select.POLLIN, slices):
                    break
                return True
        except OSError:
            return True
    return over.is_set()


def _until(patience_s: float, over: threading.Event) -> Iterator[float]:
    """Seconds to wait, again and again until the patience is at its end or nobody cares."""
    for _ in range(_SLICES):
        if over.is_set():
            return
        yield patience_s / _SLICES


def _is_ready(asking: socket.socket, wanted: int, slices: Iterator[float]) -> bool:
    """Whether the socket can be written or read, or is at its end, before the slices are used up."""
    poll = select.poll()  # unlike select, for any number of open files
    poll.register(asking, wanted)
    return any(poll.poll(1000 * slice_s) for slice_s in slices)
