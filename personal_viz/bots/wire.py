"""How a bot comes in: the personal link's token for a session, as the entry page does it, then viser's websocket."""

import asyncio
import http.client
import http.cookies
import json
import urllib.request
from urllib.parse import parse_qs, urlsplit

import msgspec
import viser
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, WebSocketException
from websockets.typing import Subprotocol

from sim.errors import StudyError

from ..study_app.first_camera import CAMERA
from .page import BotPage

ENTER_S = 60.0
"""Longest wait for the gateway's answers."""


class BotConnection:
    """One open connection and the page that came over it."""

    def __init__(self, socket: ClientConnection) -> None:
        """Nothing received yet."""
        self._socket = socket
        self.page = BotPage()
        self.is_open = True

    async def receive(self) -> bool:
        """Waits for viser's next words; False when the connection has ended."""
        try:
            data = await self._socket.recv()
        except ConnectionClosed:
            self.is_open = False
            return False
        if isinstance(data, bytes):
            self.page.apply(data)
        return True

    async def trigger(self, uuid: str) -> None:
        """Presses the key of a command."""
        await self.send({"type": "CommandTriggerMessage", "uuid": uuid})

    async def set_value(self, uuid: str, value: object) -> None:
        """Presses a button (True), or fills a box."""
        await self.send({"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": value}})

    async def tell(self, said: dict[str, object]) -> bool:
        """Writes one message of the page's script; False while the page cannot take it."""
        box, seat = self.page.letter_box, self.page.seat
        if box is None or seat is None:
            return False
        await self.set_value(box.uuid, json.dumps({"seat": seat, "said": [said]}))
        return True

    async def send(self, message: dict[str, object]) -> None:
        """As a browser sends it; nothing when the connection has ended."""
        try:
            await self._socket.send(msgspec.msgpack.encode(message))
        except ConnectionClosed:
            self.is_open = False

    async def close(self) -> None:
        """Hangs up as a closed tab does."""
        self.is_open = False
        await self._socket.close()

    def abort(self) -> None:
        """Hangs up as a lost network does: no closing words."""
        self.is_open = False
        self._socket.transport.abort()


async def enter(link: str) -> BotConnection:
    """Opens a personal link.

    Raises:
        StudyError: The gateway does not let the bot in, or cannot be reached.
    """
    view, cookie, origin = await asyncio.to_thread(_session, link)
    (address,) = parse_qs(urlsplit(view).query)["websocket"]
    try:
        socket = await connect(
            address,
            subprotocols=[Subprotocol(f"viser-v{viser.__version__}")],
            additional_headers={"Cookie": cookie, "Origin": origin},
            max_size=None,
            compression=None,
            open_timeout=ENTER_S,
            ping_interval=None,
        )
    except (OSError, WebSocketException) as error:
        raise StudyError(
            f"{origin}: the websocket did not open ({error or type(error).__name__}); expected viser's page. "
            "Check that the study is being served."
        ) from None
    connection = BotConnection(socket)
    await connection.send(CAMERA)
    return connection


def _session(link: str) -> tuple[str, str, str]:
    """(address of the view, cookie, origin) for a link's token."""
    origin, _, token = link.partition("/#")
    body = json.dumps({"token": token}).encode()
    headers = {"Content-Type": "application/json", "Origin": origin}
    try:
        with urllib.request.urlopen(urllib.request.Request(f"{origin}/enter", body, headers), timeout=ENTER_S) as reply:
            view = json.load(reply)["view"]
            cookie = http.cookies.SimpleCookie()
            for line in reply.headers.get_all("Set-Cookie") or []:
                cookie.load(line)
    except (OSError, http.client.HTTPException, ValueError, KeyError) as error:
        raise StudyError(
            f"{origin}/enter: {error}; expected a session for a personal link. Check that the study is being served."
        ) from None
    return view, "; ".join(f"{name}={morsel.value}" for name, morsel in cookie.items()), origin
