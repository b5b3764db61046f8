"""Our web server in front of viser: personal links, sessions, checks, and a filtered proxy of viser's websocket.

viser itself has no login and listens on loopback only; whatever a browser sends passes through here.
"""

import asyncio
import secrets
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
from websockets.exceptions import ConnectionClosed
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
_OWN_PAGES_CSP = "default-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'self'"
_VISER_CSP = (
    "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval' 'wasm-unsafe-eval' blob:; style-src 'unsafe-inline'; "
    "img-src 'self' data: blob:; font-src data:; worker-src blob:; connect-src 'self' data: blob:; "
    "frame-ancestors 'none'; base-uri 'none'"
)


@dataclass(frozen=True, slots=True)
class Ticket:
    """Admission of one browser session to the websocket; revoked when the gateway stops."""

    session_id: str
    code: str
    """Public code of the participant."""


class Tickets:
    """Who may open a websocket, and as whom; in memory only."""

    def __init__(self) -> None:
        """Starts empty."""
        self._by_id: dict[str, Ticket] = {}

    def issue(self, code: str) -> tuple[str, str]:
        """A new (session id, ticket id) for a participant."""
        session_id, ticket_id = secrets.token_urlsafe(16), secrets.token_urlsafe(16)
        self._by_id[ticket_id] = Ticket(session_id, code)
        return session_id, ticket_id

    def find(self, ticket_id: str) -> Ticket | None:
        """The ticket, None if it was never issued."""
        return self._by_id.get(ticket_id)


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


def make_gateway(
    code_of_token: Callable[[str], str | None],
    worker_port: Callable[[str], int],
    *,
    tickets: Tickets,
    hosts: frozenset[str],
) -> Starlette:
    """The ASGI application.

    Args:
        code_of_token: Participant code of a personal token, None if unknown.
        worker_port: Loopback port of the viser worker that serves a participant.
        tickets: Filled here; the worker asks whose connection it has got.
        hosts: Host names (without port) under which browsers may reach us.
    """

    async def enter_page(_: Request) -> Response:
        return FileResponse(STATIC / "enter.html")

    async def enter(request: Request) -> Response:
        if not _is_same_origin(request.headers.get("origin"), request.headers.get("host", "")):
            return Response("foreign origin", status_code=403)
        code = await run_in_threadpool(code_of_token, await _token_in(request))
        if code is None:
            return Response("unknown token", status_code=401)
        session_id, ticket_id = tickets.issue(code)
        reply = JSONResponse({"view": f"/view/?websocket=ws://{request.headers['host']}/ws/{ticket_id}"})
        reply.set_cookie(SESSION_COOKIE, session_id, httponly=True, samesite="strict", path="/")
        return reply

    async def view(_: Request) -> Response:
        return FileResponse(VISER_CLIENT, headers={"Content-Security-Policy": _VISER_CSP})

    async def websocket(socket: WebSocket) -> None:
        ticket = tickets.find(socket.path_params["ticket"])
        cookie = socket.cookies.get(SESSION_COOKIE, "")
        host = socket.headers.get("host", "")
        admitted = (
            ticket is not None
            and secrets.compare_digest(cookie, ticket.session_id)
            and _is_own_host(host, hosts)
            and _is_same_origin(socket.headers.get("origin"), host)
        )
        if ticket is None or not admitted:
            await socket.close(code=1008)
            return
        await _proxy(socket, worker_port(ticket.code), socket.path_params["ticket"])

    app = Starlette(
        routes=[
            Route("/", enter_page),
            Route("/enter", enter, methods=["POST"]),
            Route("/view/", view),
            WebSocketRoute("/ws/{ticket:str}", websocket),
            Mount("/static", StaticFiles(directory=STATIC)),
        ],
        middleware=[Middleware(SecureHeaders)],
    )
    app.state.hosts = hosts
    return app


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
    return urlsplit(f"//{host}").hostname in hosts


def _is_same_origin(origin: str | None, host: str) -> bool:
    return origin is not None and urlsplit(origin).netloc == host


async def _proxy(socket: WebSocket, port: int, ticket_id: str) -> None:
    """Joins a browser to viser until either side leaves."""
    offered = [Subprotocol(name) for name in socket.scope.get("subprotocols", [])]
    url = f"ws://127.0.0.1:{port}/?ticket={ticket_id}"
    try:
        upstream = await connect(url, subprotocols=offered, max_size=None, compression=None, open_timeout=10)
    except (OSError, TimeoutError):
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
    while True:
        try:
            data = await socket.receive_bytes()
        except (WebSocketDisconnect, KeyError, RuntimeError):  # gone, or sent text, which viser never does
            return
        if not is_allowed_message(data):
            await socket.close(code=1008)
            return
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


def is_allowed_message(data: bytes) -> bool:
    """Whether a browser's message is small, well formed, of an allowed type and free of NaN and infinities."""
    if len(data) > MAX_MESSAGE_BYTES:
        return False
    try:
        message = msgspec.msgpack.decode(data)
    except (msgspec.MsgspecError, RecursionError):
        return False
    return isinstance(message, dict) and message.get("type") in ALLOWED_MESSAGES and _is_finite(message)


def _is_finite(value: object) -> bool:
    if isinstance(value, float):
        return value - value == 0
    if isinstance(value, dict):
        return all(_is_finite(item) for item in value.values())
    if isinstance(value, (list, tuple)):
        return all(_is_finite(item) for item in value)
    return True
