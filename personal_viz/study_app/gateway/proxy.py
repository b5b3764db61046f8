"""Joins a browser's websocket to a viser worker's: all of viser's messages pass, and allowed ones of the browser."""

import asyncio
import contextlib
import re
import time

from starlette.websockets import WebSocket, WebSocketDisconnect
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidHandshake
from websockets.typing import Subprotocol

from ..worker_door import SECRET_HEADER, WorkerDoor
from .filter import ACTION_RATE, CAMERA_RATE, FLOOD_RATE, RateLimit, ViewerCameraMessage, browser_message, viser_bytes

OPEN_WITHIN_S = 10.0
CLOSE_WITHIN_S = 1.0
"""Longest wait for a worker's goodbye; when its line is full of messages that nobody reads any more, none arrives."""
_SUBPROTOCOL = re.compile(r"\Aviser-v[0-9.]{1,16}\Z")
BAD, LATER, RESTART = 1008, 1013, 1012
"""Close codes: a message that is not allowed; come back in a moment; the worker ended."""


async def join(socket: WebSocket, door: WorkerDoor, ticket_id: str, number: int) -> str | None:
    """Passes messages until either side leaves.

    Args:
        socket: The browser's websocket, not accepted yet.
        door: The worker's door.
        ticket_id: Sent to the worker, which looks up its participant.
        number: The connection's number, also sent to the worker; a participant's newest connection has the highest.

    Returns:
        The reason why we ended the connection, in words for the researcher; None when either side left.
    """
    offered = [Subprotocol(name) for name in socket.scope.get("subprotocols", []) if _SUBPROTOCOL.match(name)][:1]
    url = f"ws://127.0.0.1:{door.port}/?connection={number}&ticket={ticket_id}"
    try:
        upstream = await connect(
            url,
            additional_headers={SECRET_HEADER: door.secret},
            subprotocols=offered or None,
            max_size=None,
            compression=None,
            open_timeout=OPEN_WITHIN_S,
            close_timeout=CLOSE_WITHIN_S,
            ping_interval=None,  # a worker that loads a home may be silent for long; its end is noticed anyway
            proxy=None,
        )
    except (OSError, TimeoutError, InvalidHandshake):
        await socket.close(code=LATER)
        return None
    async with upstream:
        await socket.accept(subprotocol=upstream.subprotocol)
        to_viser = asyncio.create_task(_ToViser(socket, upstream).run())
        to_browser = asyncio.create_task(_to_browser(socket, upstream))
        _, pending = await asyncio.wait({to_viser, to_browser}, return_when=asyncio.FIRST_COMPLETED)
        for task in pending:
            task.cancel()
        await asyncio.gather(to_viser, to_browser, return_exceptions=True)
        reason = None if to_viser.cancelled() else to_viser.result()
        with contextlib.suppress(WebSocketDisconnect, RuntimeError):  # the browser left by itself
            await socket.close(code=RESTART if reason is None else BAD)
        return reason


class _ToViser:
    """Passes messages of the browser to viser. Of camera messages only the newest waits until the next one may pass."""

    def __init__(self, socket: WebSocket, upstream: ClientConnection) -> None:
        """Takes both websockets; sends nothing yet."""
        self._socket, self._upstream = socket, upstream
        self._cameras, self._all = RateLimit(*CAMERA_RATE), RateLimit(*FLOOD_RATE)
        self._actions: dict[type, RateLimit] = {}
        """A limit for each type of message, so that the page's own reports do not use up key presses."""
        self._waiting: bytes | None = None
        """The newest camera message, if it came too early."""

    async def run(self) -> str | None:
        """Passes messages until either side leaves; returns the reason if we end the connection."""
        while True:
            try:
                async with asyncio.timeout(self._patience_s()):
                    received = await self._socket.receive()
            except TimeoutError:
                received = None
            except RuntimeError:  # closed while we waited
                return None
            try:
                reason = await self._take(received)
            except (ConnectionClosed, WebSocketDisconnect):
                return None
            if reason is not None:
                return reason

    async def _take(self, received: object) -> str | None:
        """Passes one message on; returns a reason to end the connection, or None."""
        if received is None:
            await self._send_camera()
            return None
        assert isinstance(received, dict)
        if received["type"] == "websocket.disconnect":
            raise WebSocketDisconnect
        data = received.get("bytes")
        if data is None:
            return "a text message, which viser never sends"
        now_s = time.monotonic()
        if not self._all.allows(now_s):
            return "more messages than any browser sends"
        message = browser_message(data)
        if message is None:
            return "a message that is damaged or not allowed"
        if isinstance(message, ViewerCameraMessage):
            self._waiting = viser_bytes(message)
            if self._cameras.has_one(now_s):
                await self._send_camera()
        elif self._actions.setdefault(type(message), RateLimit(*ACTION_RATE)).allows(now_s):
            await self._send_camera()  # first, because the action was made from this camera
            await self._upstream.send(viser_bytes(message))
        return None

    def _patience_s(self) -> float | None:
        return self._cameras.wait_s(time.monotonic()) if self._waiting is not None else None

    async def _send_camera(self) -> None:
        data, self._waiting = self._waiting, None
        if data is not None:
            self._cameras.allows(time.monotonic())
            await self._upstream.send(data)


async def _to_browser(socket: WebSocket, upstream: ClientConnection) -> None:
    try:
        async for data in upstream:
            await socket.send_bytes(data if isinstance(data, bytes) else data.encode())
    except (ConnectionClosed, WebSocketDisconnect, RuntimeError):
        return
