"""A participant without a browser: enters through the gateway and keeps everything that it is sent."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import msgspec
import zstandard
from websockets.exceptions import InvalidStatus
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from personal_viz.bots.forms import answer_pages, open_session
from personal_viz.study_app.gateway.filter import CAMERA
from personal_viz.study_app.page_script import SUBPROTOCOL


class WireClient:
    """An open connection and all that came over it."""

    def __init__(self, connection: ClientConnection) -> None:
        """Nothing received yet."""
        self._connection = connection
        self.messages: list[dict[str, Any]] = []
        self.buffers: list[bytes] = []

    def receive_until(self, wanted: Callable[[dict[str, Any]], bool], *, timeout: float = 60.0) -> dict[str, Any]:
        """The first message that is wanted, among those received before and those that come now."""
        for message in self.messages:
            if wanted(message):
                return message
        while True:
            data = self._connection.recv(timeout=timeout)
            assert isinstance(data, bytes)
            new = self._decode(data)
            self.messages += new
            for message in new:
                if wanted(message):
                    return message

    def press(self, label: str) -> None:
        """Clicks a button of the panel."""
        button = self.receive_until(lambda message: message.get("props", {}).get("label") == label)
        time.sleep(0.06)  # a person's pace: sessions drop presses within 50 ms of the last one
        self.send({"type": "GuiUpdateMessage", "uuid": button["uuid"], "updates": {"value": True}})

    def see_step(self, step: int) -> None:
        """Waits for the picture of a step: a key that comes before it counts as busy."""
        self.receive_until(lambda message: f'data-step="{step}"' in str(message))

    def give_up(self) -> None:
        """Presses "Give up" twice at a person's pace: a second press within half a second does not count."""
        self.press("Give up this search")
        self.receive_until(lambda message: "again to end this search" in str(message))
        time.sleep(0.6)  # a person's pace
        self.press("Give up this search")

    def send(self, message: dict[str, Any]) -> None:
        """Sends a message as a browser does."""
        self._connection.send(msgspec.msgpack.encode(message))

    def _decode(self, data: bytes) -> list[dict[str, Any]]:
        """viser's wire format: sizes, compressed msgpack, raw buffers."""
        compressed_size = int.from_bytes(data[8:16], "little")
        self.buffers.append(data[16 + compressed_size :])
        inner = zstandard.ZstdDecompressor().decompress(data[16 : 16 + compressed_size])
        return list(msgspec.msgpack.decode(inner)["messages"])


@contextmanager
def enter(link: str, *, patience_s: float = 0.0) -> Iterator[WireClient]:
    """Opens a personal link and answers its pages up to the first trial; retries for `patience_s`, as viser does."""
    session = open_session(link)
    assert answer_pages(session) is None
    headers = {"Cookie": session.cookie, "Origin": session.origin}
    with _connected(session.view.split("websocket=")[1], headers, patience_s) as connection:
        client = WireClient(connection)
        client.send(CAMERA)  # viser admits a client when it tells its camera
        yield client


def _connected(url: str, headers: dict[str, str], patience_s: float) -> ClientConnection:
    """An open connection; raises InvalidStatus where it is refused for longer than `patience_s`."""
    until_s = time.monotonic() + patience_s
    while True:
        try:
            return line_to(url, additional_headers=headers)
        except InvalidStatus:
            if time.monotonic() > until_s:
                raise
            time.sleep(1)  # between two tries, as viser's client does


def line_to(url: str, **choices: Any) -> ClientConnection:
    """A connection to viser as its client makes it; `choices` are those of `connect`."""
    address = url.replace("http", "ws", 1)
    return connect(address, subprotocols=[Subprotocol(SUBPROTOCOL)], max_size=None, proxy=None, **choices)


def texts_of(value: Any) -> Iterator[str]:
    """Every string in a message, keys too, and bytes as Latin-1."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, bytes):
        yield value.decode("latin-1")
    elif isinstance(value, dict):
        for key, item in value.items():
            yield from texts_of(key)
            yield from texts_of(item)
    elif isinstance(value, list | tuple):
        for item in value:
            yield from texts_of(item)


def numbers_of(value: Any) -> Iterator[float]:
    """Every number in a message."""
    if isinstance(value, bool):
        return
    if isinstance(value, int | float):
        yield float(value)
    elif isinstance(value, dict):
        for item in value.values():
            yield from numbers_of(item)
    elif isinstance(value, list | tuple):
        for item in value:
            yield from numbers_of(item)
