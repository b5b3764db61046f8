"""Guards every route: limits on a request's time and size, Host, Origin, connections per address, reply headers."""

import asyncio
import contextlib
import socket
import threading
from collections.abc import Awaitable, Callable, Iterable, Iterator, MutableMapping
from typing import Any

import h11
import uvicorn
from starlette.applications import Starlette
from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import ClientDisconnect, HTTPConnection, Request
from starlette.responses import PlainTextResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocket
from uvicorn.protocols.http.h11_impl import H11Protocol

from sim.errors import StudyError

from .filter import MAX_MESSAGE_BYTES
from .limits import LOOPBACK, Holds, client_address
from .options import ServeOptions, host_name

MAX_HEADER_BYTES = 16 * 1024
MAX_BODY_BYTES = 64 * 1024
REQUEST_WITHIN_S = 15.0
"""Longest time from a request's first byte, or from the connection, to its last; slower clients are disconnected."""
ANSWER_WITHIN_S = 120.0
"""Longest time for an answer: enough for a browser on a slow line to read a page of 1 MB."""
CONNECTIONS_SHARE = 0.2
"""Share of the stopping time that connections get; the workers and the last backup need the rest."""
OWN_PAGES_CSP = "default-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'self'"
_HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), microphone=(), geolocation=()",
}
_HANDSHAKE = (b"connection", b"upgrade")
_HSTS = "max-age=86400"
"""One day: long enough for a sitting, short enough to take a study's name back to plain HTTP."""


class PromptProtocol(H11Protocol):
    """HTTP/1.1 for clients that send a whole request within `REQUEST_WITHIN_S` and open few connections."""

    request_within_s = REQUEST_WITHIN_S
    per_address = 64
    most_connections = 1000
    unlimited: frozenset[str] = frozenset()
    """Addresses that are not limited, besides loopback."""
    _deadline: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Refuses the connection if its address has too many, else waits for a request."""
        super().connection_made(transport)
        peer = self.client[0] if self.client else ""
        peers = [getattr(connection, "client", None) for connection in self.connections]
        mine = sum(other is not None and other[0] == peer for other in peers)
        is_limited = client_address(peer, [], None) != LOOPBACK and peer not in self.unlimited
        if len(self.connections) > self.most_connections or (is_limited and mine > self.per_address):
            transport.abort()
            return
        self._wait()

    def data_received(self, data: bytes) -> None:
        """Takes bytes; the clock runs from the first byte of a request to its last, however slowly they come."""
        super().data_received(data)
        if self.transport.get_protocol() is not self:  # it became a websocket, which may be quiet for long
            self._stop_waiting()
        elif self.conn.their_state in (h11.IDLE, h11.SEND_BODY):
            self._wait()
        else:
            self._stop_waiting()

    def handle_websocket_upgrade(self, event: h11.Request) -> None:
        """Refuses damaged headers: `websockets` would quote them in its answer, but can write only ASCII there."""
        if all(value.isascii() for name, value in event.headers if name in _HANDSHAKE or name.startswith(b"sec-")):
            super().handle_websocket_upgrade(event)
        else:
            self.send_400_response("Bad handshake.")

    def connection_lost(self, exc: Exception | None) -> None:
        """Stops the clock of the request."""
        self._stop_waiting()
        super().connection_lost(exc)

    def _wait(self) -> None:
        if self._deadline is None:
            self._deadline = self.loop.call_later(self.request_within_s, self.transport.abort)

    def _stop_waiting(self) -> None:
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None


class Guard:
    """ASGI middleware: refuses requests that no route should see, and puts the secure headers on every reply."""

    def __init__(self, app: ASGIApp, options: ServeOptions) -> None:
        """Guards one application.

        Args:
            app: All routes.
            options: Accepted host names, the trusted proxy, limits.
        """
        self._app, self._options = app, options
        self._names = options.host_names
        self._open = Holds()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handles one request or websocket."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        refusal = _refusal(scope, self._names)
        address = address_of(HTTPConnection(scope), self._options)
        most = None if address == LOOPBACK else self._options.per_address
        with self._open.one(address, most) as is_allowed:
            if not is_allowed:
                refusal = (503, "too many connections")
            if refusal is not None:
                await _refuse(scope, receive, send, *refusal)
            elif scope["type"] == "websocket":
                await self._app(scope, receive, send)
            else:
                await self._answer(scope, receive, send)

    async def _answer(self, scope: Scope, receive: Receive, send: Send) -> None:
        is_secure = self._options.is_secure(Headers(scope=scope)["host"])
        try:
            async with asyncio.timeout(ANSWER_WITHIN_S):
                await self._app(scope, receive, _with_headers(send, is_secure=is_secure))
        except TimeoutError:
            return  # the server then closes the connection of this slow reader
        except ClientDisconnect:
            return  # in the middle of a body: nobody is left to answer


class OwnOrigin:
    """ASGI middleware of a route: refuses websockets and forms of pages that are not ours."""

    def __init__(self, app: ASGIApp, options: ServeOptions) -> None:
        """Guards one route; `options` name the pages that are ours."""
        self._app, self._options = app, options

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handles one request or websocket."""
        headers = Headers(scope=scope)
        is_ours = self._options.is_own_origin(headers["host"], headers.get("origin", ""))
        if is_ours or (scope["type"] == "http" and scope["method"] != "POST"):
            await self._app(scope, receive, send)
        else:
            await _refuse(scope, receive, send, 403, "foreign origin")


def address_of(connection: HTTPConnection, options: ServeOptions) -> str:
    """The client's address for limits (`client_address`)."""
    peer = connection.client.host if connection.client is not None else None
    return client_address(peer, connection.headers.getlist("x-forwarded-for"), options.proxy)


def too_many_tries() -> Response:
    """The reply to clients that guess tokens, or ask for more than a person would."""
    return PlainTextResponse("too many tries; wait a minute", status_code=429, headers={"Retry-After": "60"})


async def small_body(request: Request, most: int) -> bytes:
    """The body of a request; empty when it is larger than `most` bytes.

    Raises:
        ClientDisconnect: The client left before the body's end; `Guard` handles this.
    """
    body = b""
    async for chunk in request.stream():
        body += chunk
        if len(body) > most:
            return b""
    return body


def uvicorn_server(app: Starlette, options: ServeOptions) -> uvicorn.Server:
    """A server for the application that trusts no header about forwarding and logs no request."""
    limited = {
        "per_address": options.per_address,
        "most_connections": 3 * options.max_people + 256,
        "unlimited": frozenset({options.proxy} if options.proxy else ()),
    }
    config = uvicorn.Config(
        app,
        http=type("GatewayProtocol", (PromptProtocol,), limited),
        log_level="error",
        access_log=False,
        proxy_headers=False,
        server_header=False,
        ws="websockets-sansio",
        ws_max_size=MAX_MESSAGE_BYTES,
        ws_per_message_deflate=False,  # viser compresses its messages, and no client can send a compression bomb
        ws_ping_interval=20,
        ws_ping_timeout=120,  # on a line of 1 Mbit/s, a ping waits behind a home of 15 MB
        h11_max_incomplete_event_size=MAX_HEADER_BYTES,
        timeout_graceful_shutdown=max(1, round(CONNECTIONS_SHARE * options.drain_s)),
        ssl_certfile=options.tls_cert,
        ssl_keyfile=options.tls_key,
    )
    return uvicorn.Server(config)


def listen(
    bind: str, port: int, *, advice: str = "Take another: make demo PORT=8090, or --port 8090."
) -> socket.socket:
    """A listening socket, so that browsers that come before the server runs wait instead of failing.

    Raises:
        StudyError: The port is taken, or the address is not this machine's.
    """
    bind = "127.0.0.1" if bind == "localhost" else bind
    listener = socket.socket(socket.AF_INET6 if ":" in bind else socket.AF_INET, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((bind, port))
        listener.listen(128)
    except OSError as error:
        listener.close()
        raise StudyError(
            f"port {port} of {bind}: cannot be used ({error.strerror}); expected a free one of this machine. {advice}"
        ) from None
    return listener


@contextlib.contextmanager
def served_in_thread(server: uvicorn.Server, listener: socket.socket) -> Iterator[None]:
    """Serves in a thread of its own until the end of the block."""
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]}, daemon=True, name="server")
    thread.start()
    try:
        yield
    finally:
        server.should_exit = True
        thread.join()


def _refusal(scope: Scope, names: frozenset[str]) -> tuple[int, str] | None:
    """Status and text of a request that is refused before any route sees it; None = it is not refused."""
    headers: Iterable[tuple[bytes, bytes]] = scope["headers"]
    target = len(scope.get("raw_path", b"")) + len(scope["query_string"])
    if sum(len(name) + len(value) + 4 for name, value in headers) + target > MAX_HEADER_BYTES:
        return 431, "headers too large"
    hosts = [value.decode("latin-1") for name, value in headers if name == b"host"]
    if len(hosts) != 1 or host_name(hosts[0]) not in names:
        return 400, "unknown host"
    path = scope["path"]
    if ".." in path.split("/") or any(ord(letter) < 32 or letter in "\\\x7f" for letter in path):
        return 400, "bad path"
    lengths = [value for name, value in headers if name == b"content-length"]
    if any(not value.isdigit() or int(value) > MAX_BODY_BYTES for value in lengths):
        return 413, "body too large"
    return None


async def _refuse(scope: Scope, receive: Receive, send: Send, status: int, text: str) -> None:
    if scope["type"] == "websocket":
        await WebSocket(scope, receive, send).close(code=1008 if status < 500 else 1013)
        return
    response = PlainTextResponse(text, status_code=status, headers={"Connection": "close"})
    await response(scope, receive, _with_headers(send, is_secure=False))


def _with_headers(send: Send, *, is_secure: bool) -> Callable[[Message], Awaitable[None]]:
    async def sending(message: MutableMapping[str, Any]) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            headers.setdefault("Content-Security-Policy", OWN_PAGES_CSP)
            for name, value in _HEADERS.items():
                headers.setdefault(name, value)
            if is_secure:
                headers["Strict-Transport-Security"] = _HSTS
        await send(message)

    return sending
