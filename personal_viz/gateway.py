"""Our web server in front of viser: personal links, sessions, checks, and a filtered proxy of viser's websocket.

viser itself has no login and listens on loopback only; whatever a browser sends passes through here.
"""

import asyncio
import secrets
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

import msgspec
import viser
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.middleware.base import BaseHTTPMiddleware, RequestResponseEndpoint
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket, WebSocketDisconnect
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidHandshake
from websockets.typing import Subprotocol

MAX_MESSAGE_BYTES = 64 * 1024
"""Largest message that a browser may send; clicks and camera poses need under 1 kB."""
SESSION_COOKIE = "personal_session"
STATIC = Path(__file__).parent / "static"
VISER_CLIENT = Path(viser.__file__).parent / "client" / "build" / "index.html"
ALLOWED_MESSAGES = frozenset(
    {"ViewerCameraMessage", "ScenePointerMessage", "GuiUpdateMessage", "CommandTriggerMessage"}
)
"""What a participant's browser has to say to viser; share (tunnel), upload and render messages are not among it."""
CAMERA_RATE = (100.0, 200)
ACTION_RATE = (20.0, 40)
"""(a second, at once): viser sends up to 50 camera messages a second, a person presses at most some 10 keys."""
_OWN_PAGES_CSP = "default-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'self'"
_VISER_CSP = (
    "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval' 'wasm-unsafe-eval' blob:; style-src 'unsafe-inline'; "
    "img-src 'self' data: blob:; font-src data:; worker-src blob:; connect-src 'self' data: blob:; "
    "frame-ancestors 'none'; base-uri 'none'"
)


@dataclass(frozen=True, slots=True)
class Ticket:
    """Admission of one browser session to the websocket."""

    session_id: str
    code: str
    """Public code of the participant."""


class Tickets:
    """Who may open a websocket, and as whom; in memory only. A participant's newest ticket revokes the older ones."""

    def __init__(self) -> None:
        """Starts empty."""
        self._by_id: dict[str, Ticket] = {}

    def issue(self, code: str) -> tuple[str, str]:
        """A new (session id, ticket id) for a participant."""
        session_id, ticket_id = secrets.token_urlsafe(16), secrets.token_urlsafe(16)
        kept = {known: ticket for known, ticket in self._by_id.items() if ticket.code != code}
        self._by_id = {**kept, ticket_id: Ticket(session_id, code)}
        return session_id, ticket_id

    def find(self, ticket_id: str) -> Ticket | None:
        """The ticket, None if it was never issued or is revoked."""
        return self._by_id.get(ticket_id)


class RateLimit:
    """A token bucket: `rate` a second on average, `burst` at once."""

    def __init__(self, rate: float, burst: int) -> None:
        """Starts full."""
        self._rate, self._burst = rate, burst
        self._left, self._last_s = float(burst), 0.0

    def allows(self, now_s: float) -> bool:
        """Whether one more is allowed at this time (seconds on a steady clock)."""
        self._left = min(self._burst, self._left + (now_s - self._last_s) * self._rate)
        self._last_s = now_s
        if self._left < 1:
            return False
        self._left -= 1
        return True


class SecureHeaders(BaseHTTPMiddleware):
    """Refuses foreign Host headers and puts the security headers on every reply."""

    async def dispatch(self, request: Request, call_next: RequestResponseEndpoint) -> Response:
        """One request."""
        if not _is_own_host(request.headers.get("host", ""), request.app.state.hosts):
            return Response("unknown host", status_code=400)
        response = await call_next(request)
        response.headers.setdefault("Content-Security-Policy", _OWN_PAGES_CSP)
        response.headers["X-Content-Type-Options"] = "nosniff"
        response.headers["Referrer-Policy"] = "no-referrer"
        response.headers["Cache-Control"] = "no-store"
        return response


class Gateway:
    """The handlers of all routes."""

    def __init__(
        self,
        code_of_token: Callable[[str], str | None],
        worker_port: int,
        *,
        tickets: Tickets,
        hosts: frozenset[str],
    ) -> None:
        """Knows whom to let in and where viser is.

        Args:
            code_of_token: Participant code of a personal token, None if unknown.
            worker_port: Loopback port of the viser worker.
            tickets: Filled here; the worker asks whose connection it has got.
            hosts: Host names (without port) under which browsers may reach us.
        """
        self._code_of_token, self._worker_port, self._tickets, self._hosts = code_of_token, worker_port, tickets, hosts

    def app(self) -> Starlette:
        """The ASGI application."""
        app = Starlette(
            routes=[
                Route("/", self.enter_page),
                Route("/enter", self.enter, methods=["POST"]),
                Route("/view/", self.view),
                WebSocketRoute("/ws/{ticket:str}", self.websocket),
                Mount("/static", StaticFiles(directory=STATIC)),
            ],
            middleware=[Middleware(SecureHeaders)],
        )
        app.state.hosts = self._hosts
        return app

    async def enter_page(self, _: Request) -> Response:
        """The page that trades the token in its address for a session."""
        return FileResponse(STATIC / "enter.html")

    async def enter(self, request: Request) -> Response:
        """A session for a known token: a cookie for its websocket alone, and the address of the view."""
        if not _is_same_origin(request.headers.get("origin"), request.headers.get("host", "")):
            return Response("foreign origin", status_code=403)
        code = await run_in_threadpool(self._code_of_token, await _token_in(request))
        if code is None:
            return Response("unknown token", status_code=401)
        session_id, ticket_id = self._tickets.issue(code)
        reply = JSONResponse({"view": f"/view/?websocket=ws://{request.headers['host']}/ws/{ticket_id}"})
        reply.set_cookie(SESSION_COOKIE, session_id, httponly=True, samesite="strict", path=f"/ws/{ticket_id}")
        return reply

    async def view(self, request: Request) -> Response:
        """viser's client; the entry page instead when the ticket in the address is not valid any more."""
        ticket_id = request.query_params.get("websocket", "").rpartition("/")[2]
        if self._tickets.find(ticket_id) is None:
            return FileResponse(STATIC / "enter.html")
        return FileResponse(VISER_CLIENT, headers={"Content-Security-Policy": _VISER_CSP})

    async def websocket(self, socket: WebSocket) -> None:
        """A participant's connection, joined to viser."""
        ticket_id = socket.path_params["ticket"]
        ticket = self._tickets.find(ticket_id)
        host = socket.headers.get("host", "")
        cookie = socket.cookies.get(SESSION_COOKIE, "").encode()
        if (
            ticket is None
            or not secrets.compare_digest(cookie, ticket.session_id.encode())
            or not _is_own_host(host, self._hosts)
            or not _is_same_origin(socket.headers.get("origin"), host)
        ):
            await socket.close(code=1008)
            return
        await _proxy(socket, self._worker_port, ticket_id)


async def _token_in(request: Request) -> str:
    """The token in a small JSON body; empty when there is none."""
    body = b""
    async for chunk in request.stream():
        body += chunk
        if len(body) > 1024:
            return ""
    try:
        return msgspec.json.decode(body, type=dict[str, str]).get("token", "")
    except msgspec.MsgspecError:
        return ""


def _is_own_host(host: str, hosts: frozenset[str]) -> bool:
    try:
        return urlsplit(f"//{host}").hostname in hosts
    except ValueError:
        return False


def _is_same_origin(origin: str | None, host: str) -> bool:
    try:
        return origin is not None and urlsplit(origin).netloc == host
    except ValueError:
        return False


async def _proxy(socket: WebSocket, port: int, ticket_id: str) -> None:
    """Joins a browser to viser until either side leaves."""
    offered = [Subprotocol(name) for name in socket.scope.get("subprotocols", [])]
    url = f"ws://127.0.0.1:{port}/?ticket={ticket_id}"
    try:
        upstream = await connect(url, subprotocols=offered, max_size=None, compression=None, open_timeout=10)
    except (OSError, TimeoutError, InvalidHandshake):
        await socket.close(code=1013)
        return
    async with upstream:
        await socket.accept(subprotocol=upstream.subprotocol)
        pumps = {asyncio.create_task(_to_viser(socket, upstream)), asyncio.create_task(_to_browser(socket, upstream))}
        _, pending = await asyncio.wait(pumps, return_when=asyncio.FIRST_COMPLETED)
        for task in pending:
            task.cancel()
        await asyncio.gather(*pumps, return_exceptions=True)


async def _to_viser(socket: WebSocket, upstream: ClientConnection) -> None:
    """Passes allowed messages on; a bad one ends the connection, one too many is dropped."""
    camera, actions = RateLimit(*CAMERA_RATE), RateLimit(*ACTION_RATE)
    while True:
        try:
            data = await socket.receive_bytes()
        except (WebSocketDisconnect, KeyError, RuntimeError):  # gone, or sent text, which viser never does
            return
        kind = allowed_kind(data)
        if kind is None:
            await socket.close(code=1008)
            return
        limit = camera if kind == "ViewerCameraMessage" else actions
        if not limit.allows(time.monotonic()):
            continue
        try:
            await upstream.send(data)
        except ConnectionClosed:
            return


async def _to_browser(socket: WebSocket, upstream: ClientConnection) -> None:
    try:
        async for data in upstream:
            await socket.send_bytes(data if isinstance(data, bytes) else data.encode())
        await socket.close(code=1012)
    except (ConnectionClosed, WebSocketDisconnect, RuntimeError):
        return


def allowed_kind(data: bytes) -> str | None:
    """The type of a browser's message; None unless it is small, well formed, of an allowed type and finite."""
    if len(data) > MAX_MESSAGE_BYTES:
        return None
    try:
        message = msgspec.msgpack.decode(data)
    except (msgspec.MsgspecError, RecursionError):
        return None
    if not isinstance(message, dict) or message.get("type") not in ALLOWED_MESSAGES or not _is_finite(message):
        return None
    if message["type"] == "GuiUpdateMessage" and set(message.get("updates", {})) != {"value"}:
        return None  # viser would set any attribute that is named
    return message["type"]


def _is_finite(value: object) -> bool:
    if isinstance(value, float):
        return value - value == 0
    if isinstance(value, dict):
        return all(_is_finite(item) for item in value.values())
    if isinstance(value, (list, tuple)):
        return all(_is_finite(item) for item in value)
    return True
