"""The door of a viser worker: a loopback port that opens only to the gateway, which knows the worker's secret.

Loopback keeps out other machines, but not other users and programs of this one, and viser has no login. Two more gaps
of the pinned viser are closed here: its public tunnel, and threads that change a page.
"""

import asyncio
import functools
import hmac
import http
import logging
import secrets
import sys
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import msgspec
import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

if TYPE_CHECKING:
    import viser
    from viser.infra._async_message_buffer import AsyncMessageBuffer

SECRET_HEADER = "X-Worker-Secret"
_Process = Callable[[ServerConnection, Request], Response | None]
_making = threading.Lock()
_logger = logging.getLogger("personal_viz.study_app.worker_door")
"""Logger of viser's websockets."""


class WorkerDoor(msgspec.Struct, frozen=True):
    """The port where a worker listens, and its secret."""

    port: int
    secret: str
    """Secret that each request sends as `SECRET_HEADER`; known to the worker and the gateway, and never on disk."""


class WorkerTask(msgspec.Struct, frozen=True):
    """The study that a worker serves; its command line holds this as JSON."""

    study: str
    """The study's folder."""
    dataset: str
    """Folder of the dataset of the counted trials; practice episodes are in the study's folder."""
    scenes_dir: str | None = None
    """Folder of licensed scans."""
    evidence: tuple[str, ...] = ()
    """Folders of the dataset's evidence."""
    sequences: str | None = None
    """Folder of the set of home sequences, in a study of them."""
    rerun: str | None = None
    """A folder or a viewer's address, to which trials are streamed for a researcher."""
    with_pixels: bool = False
    """Whether the stream holds pictures of licensed scans too."""
    public: bool = False
    """Whether the study is served beyond this machine."""

    def command(self, fd: int) -> list[str]:
        """The command line of a worker, for the file descriptor of its socket."""
        return [sys.executable, "-m", "personal_viz.study_app.server", str(fd), msgspec.json.encode(self).decode()]


def open_door() -> "tuple[viser.ViserServer, WorkerDoor]":
    """A viser server on a free loopback port that refuses every request without its new secret, and opens no tunnel.

    viser 1.1.1 has no option for such a check, so we give it to `websockets` while the server is made (private API of
    the pinned viser; a test watches it).
    """
    import viser  # not for the gateway, which only knows what a door is

    secret = secrets.token_urlsafe(32)
    with _making:
        original = websockets.asyncio.server.serve
        websockets.asyncio.server.serve = functools.partial(_serve, original, secret)  # type: ignore[assignment, misc]
        try:
            server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        finally:
            websockets.asyncio.server.serve = original  # type: ignore[misc]
    refuse_tunnels(server)
    return server, WorkerDoor(server.get_port(), secret)


def refuse_tunnels(server: "viser.ViserServer") -> None:
    """Keeps visitors from opening viser's public tunnel (private API of the pinned viser; a test watches it)."""
    from viser import _messages

    server._websock_server.unregister_handler(_messages.ShareUrlRequest)


def _serve(original: Callable[..., Any], secret: str, *args: Any, process_request: _Process, **options: Any) -> Any:
    """The server of `websockets`, which checks the secret before viser sees anything of a request."""

    def checked(connection: ServerConnection, request: Request) -> Response | None:
        given = request.headers.get_all(SECRET_HEADER)
        if len(given) != 1 or not hmac.compare_digest(given[0].encode("utf-8", "surrogateescape"), secret.encode()):
            return connection.respond(http.HTTPStatus.FORBIDDEN, "only the study's gateway may connect\n")
        return process_request(connection, request)

    return original(*args, process_request=checked, logger=_logger, **options)


def _is_worth_telling(record: logging.LogRecord) -> bool:
    """Whether a log record is worth showing; errors about strangers' broken handshakes are not."""
    return not record.getMessage().startswith(("opening handshake failed", "connection rejected"))


_logger.addFilter(_is_worth_telling)


def make_updates_safe(client: "viser.ClientHandle") -> None:
    """Lets threads other than viser's change a page; call it first, on viser's event loop, once per connection.

    viser 1.1.1 sets an asyncio event from any thread: `AsyncMessageBuffer.push` calls `message_event.set()` at once and
    again on the event loop. The first call iterates over the event's waiters, which the loop may change at the same
    time. Now and then a plain `handle.content = ...` therefore raises "deque mutated during iteration", after the
    message was queued (seen about once in 1,000 updates of 50 participants). The second call is enough (private API of
    the pinned viser; a test watches it).
    """
    wake_on_loop_only(client._websock_connection.get_message_buffer())


def wake_on_loop_only(buffer: "AsyncMessageBuffer") -> None:
    """Lets only the calling thread, which must be the event loop's, set the buffer's event."""
    loop_thread, event = threading.get_ident(), buffer.message_event

    def set_on_loop() -> None:
        if threading.get_ident() == loop_thread:
            asyncio.Event.set(event)

    event.set = set_on_loop  # type: ignore[method-assign]
