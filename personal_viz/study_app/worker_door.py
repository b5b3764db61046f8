"""The door of a viser worker: a loopback port that opens to those who know the worker's secret, which is the gateway.

Loopback keeps other machines out, but not other users and programs of this one; viser asks nobody who they are.
"""

import functools
import hmac
import http
import logging
import secrets
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import msgspec
import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

if TYPE_CHECKING:
    import viser

SECRET_HEADER = "X-Worker-Secret"
_Process = Callable[[ServerConnection, Request], Response | None]
_making = threading.Lock()
_logger = logging.getLogger("personal_viz.study_app.worker_door")
"""Of viser's websockets."""


class WorkerDoor(msgspec.Struct, frozen=True):
    """Where a worker listens, and what it wants to hear."""

    port: int
    secret: str
    """Sent as `SECRET_HEADER` with each request; known to the worker and the gateway, and never on disk."""


def open_door() -> "tuple[viser.ViserServer, WorkerDoor]":
    """A viser server on a free loopback port that refuses every request without its new secret, and opens no tunnel.

    viser 1.1.1 takes no such check, so `websockets` gets it while the server is made (private API of the pinned viser;
    a test watches it).
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
    """No visitor may open viser's public tunnel (private API of the pinned viser; a test watches it)."""
    from viser import _messages

    server._websock_server.unregister_handler(_messages.ShareUrlRequest)


def _serve(original: Callable[..., Any], secret: str, *args: Any, process_request: _Process, **options: Any) -> Any:
    """`websockets`' own, with the secret asked for before viser sees anything of a request."""

    def checked(connection: ServerConnection, request: Request) -> Response | None:
        given = request.headers.get_all(SECRET_HEADER)
        if len(given) != 1 or not hmac.compare_digest(given[0].encode("utf-8", "surrogateescape"), secret.encode()):
            return connection.respond(http.HTTPStatus.FORBIDDEN, "only the study's gateway may connect\n")
        return process_request(connection, request)

    return original(*args, process_request=checked, logger=_logger, **options)


def _is_worth_telling(record: logging.LogRecord) -> bool:
    """What strangers send instead of a handshake is theirs, not the researcher's."""
    return not record.getMessage().startswith(("opening handshake failed", "connection rejected"))


_logger.addFilter(_is_worth_telling)
