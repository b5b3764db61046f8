"""Lets threads other than viser's change a page safely: viser 1.1.1 sets an asyncio event from whatever thread asks.

`AsyncMessageBuffer.push` calls `message_event.set()` at once and again on the event loop. The first call iterates over
the event's waiters while the loop may change them: now and then "deque mutated during iteration" is raised out of a
mere `handle.content = ...`, after the message was queued (seen about once in 1,000 updates of 50 participants). The
second call is enough (private API of the pinned viser; a test watches it).
"""

import asyncio
import threading

import viser
from viser.infra._async_message_buffer import AsyncMessageBuffer


def make_updates_safe(client: viser.ClientHandle) -> None:
    """Call once per connection, on viser's event loop, before another thread changes anything of the client's."""
    wake_on_loop_only(client._websock_connection.get_message_buffer())


def wake_on_loop_only(buffer: AsyncMessageBuffer) -> None:
    """Has only the calling thread, which must be the event loop's, set the buffer's event."""
    loop_thread, event = threading.get_ident(), buffer.message_event

    def set_on_loop() -> None:
        if threading.get_ident() == loop_thread:
            asyncio.Event.set(event)

    event.set = set_on_loop  # type: ignore[method-assign]
