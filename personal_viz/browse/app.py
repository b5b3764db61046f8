"""`personal-viz browse` and `view`: a viser server on loopback that gives each browser a visitor of its own.

It shows ground truth and scans, so only pages that this server delivered get an answer; viser alone would answer any
website.
"""

import asyncio
import contextlib
import io
import socket
import threading
from collections.abc import Callable, Iterator
from typing import Protocol
from urllib.parse import urlsplit

import viser

from sim.errors import PersonalVizError

from ..study_app.worker_door import make_updates_safe, refuse_tunnels
from .library import Library
from .visitor import Visitor

OWN_HOSTS = ("127.0.0.1", "localhost")
"""Host names in the address of our own pages."""


class Guest(Protocol):
    """What one browser looks at."""

    def leave(self) -> None:
        """The browser is gone."""
        ...


@contextlib.contextmanager
def browser_app(library: Library, *, port: int = 0) -> Iterator[str]:
    """The address of the running app of `browse`, which ends with the block.

    Raises:
        PersonalVizError: The port is taken.
    """
    with loopback_app(lambda client: Visitor(client, library), port=port) as address:
        try:
            yield address
        finally:
            library.homes.close()


@contextlib.contextmanager
def loopback_app(welcome: Callable[[viser.ClientHandle], Guest], *, port: int = 0) -> Iterator[str]:
    """The address of a running app, which ends with the block.

    Args:
        welcome: Builds what a browser looks at; called on a thread of its own.
        port: 0 takes a free one.

    Raises:
        PersonalVizError: The port is taken.
    """
    port = _free_port(port)
    with contextlib.redirect_stdout(io.StringIO()):  # viser prints a banner of its own, whatever `verbose` is
        server = viser.ViserServer(host="127.0.0.1", port=port, verbose=False)
    refuse_tunnels(server)
    server.scene.set_up_direction("+y")  # before any camera is placed: the browser turns cameras with the scene
    visitors: dict[int, Guest] = {}
    lock = threading.Lock()

    def leave(client_id: int) -> None:
        with lock:
            visitor = visitors.pop(client_id, None)
        if visitor is not None:
            visitor.leave()

    def arrive(client: viser.ClientHandle) -> None:
        visitor = welcome(client)
        with lock:
            visitors[client.client_id] = visitor
        if client.client_id not in server.get_clients():
            leave(client.client_id)  # gone while the panels were built

    @server.on_client_connect
    async def _(client: viser.ClientHandle) -> None:
        if is_own_page(origin_of(server, client.client_id), server.get_port()):
            make_updates_safe(client)
            await asyncio.get_running_loop().run_in_executor(None, arrive, client)

    @server.on_client_disconnect
    def _(client: viser.ClientHandle) -> None:
        leave(client.client_id)

    try:
        yield f"http://127.0.0.1:{server.get_port()}/"
    finally:
        for visitor in visitors.values():
            visitor.leave()
        with contextlib.redirect_stdout(io.StringIO()):
            server.stop()


def is_own_page(origin: str | None, port: int) -> bool:
    """Whether a connection comes from a page that this server delivered, as its `Origin` header says.

    Browsers always send the header, and no page can change it. Another website's page has another origin, even if that
    website's name leads to this machine.
    """
    if origin is None:
        return False
    try:
        parts = urlsplit(origin)
        return parts.scheme == "http" and parts.hostname in OWN_HOSTS and parts.port == port
    except ValueError:
        return False


def origin_of(server: viser.ViserServer, client_id: int) -> str | None:
    """The `Origin` header of a connection (private API of the pinned viser; a test watches it)."""
    connection = server._websock_server._live_connections.get(client_id)
    request = connection.request if connection is not None else None
    return None if request is None else request.headers.get("Origin")


def _free_port(port: int) -> int:
    """The port itself, or a free one for 0; viser would silently take the next one when it is busy."""
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", port))
        except (OSError, OverflowError) as error:
            why = getattr(error, "strerror", None) or error
            raise PersonalVizError(
                f"--port {port}: cannot be used ({why}); expected a free one. Give another, or 0 for any free one."
            ) from None
        return probe.getsockname()[1]
