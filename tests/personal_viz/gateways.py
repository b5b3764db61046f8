"""A gateway in this process, with a viser that only remembers and answers, for tests of what gets through."""

import asyncio
import contextlib
import http.cookies
import json
import socket
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import msgspec
from starlette.testclient import TestClient
from starlette.types import ASGIApp
from websockets.asyncio.server import ServerConnection, serve
from websockets.sync.client import ClientConnection, connect

from human_study.design.study import StudyConfig, StudyDataset, StudyPrivacy, StudyRecruit
from human_study.store.store import StudyStore
from personal_viz.study_app.gateway.admission import Admission, PayFile, Tickets
from personal_viz.study_app.gateway.app import Gateway
from personal_viz.study_app.gateway.http import PromptProtocol, listen, served_in_thread, uvicorn_server
from personal_viz.study_app.gateway.options import ServeOptions
from personal_viz.study_app.gateway.pages import Pages
from personal_viz.study_app.worker_door import WorkerDoor
from sim.errors import StudyError

KEY = b"k" * 32
PRESS: dict[str, Any] = {"type": "GuiUpdateMessage", "uuid": "b-1", "updates": {"value": True}}
CLICK: dict[str, Any] = {
    "type": "ScenePointerMessage",
    "event_type": "click",
    "ray_origin": [0.0, 3.0, 0.0],
    "ray_direction": [0.0, -1.0, 0.0],
    "screen_pos": [[0.5, 0.5]],
    "modifier": None,
}
KEY_PRESS: dict[str, Any] = {"type": "CommandTriggerMessage", "uuid": "c-1"}


def pack(message: object) -> bytes:
    """A message in viser's encoding."""
    return msgspec.msgpack.encode(message)


def small_config(**choices: Any) -> StudyConfig:
    """A study file with these choices."""
    return StudyConfig(study="small", dataset=StudyDataset(sha256="0"), task=("pan",), **choices)


@dataclass
class FewPeople:
    """A store with as many places as tokens."""

    tokens: dict[str, str]
    """Codes of participants by token."""
    claimed: dict[str, str | None] = field(default_factory=dict)
    """Hashes of claimed places by code."""
    is_full: bool = False
    """Whether the disk is full."""

    def code_of_token(self, token: str) -> str | None:
        """Participant of a token."""
        return self.tokens.get(token)

    def claim_person(self, ext_hash: str | None) -> str | None:
        """The next free place."""
        if self.is_full:
            raise StudyError("study.db: the disk is full; expected space. Free some.")
        for code, known in self.claimed.items():
            if ext_hash is not None and known == ext_hash:
                return code
        for code in self.tokens.values():
            if code not in self.claimed:
                self.claimed[code] = ext_hash
                return code
        return None


def few_people() -> FewPeople:
    """A store with three places."""
    return FewPeople({"good": "p01", "fine": "p02", "nice": "p03"})


def admission_for(
    people: FewPeople, folder: Path, *, recruit: str = "local", platform_id: str = "none", **choices: Any
) -> Admission:
    """Admission of these people."""
    config = small_config(
        recruit=StudyRecruit(kind=recruit),
        privacy=StudyPrivacy(platform_id=platform_id),
        **choices,
    )
    tokens = {code: token for token, code in people.tokens.items()}
    return Admission(people, config, token_of_code=tokens, platform_key=KEY, pay_file=PayFile(folder))


@dataclass
class OnePort:
    """Every participant's worker."""

    port: int | None

    def seat(self, code: str) -> AbstractContextManager[WorkerDoor | None]:
        """The only door."""
        return contextlib.nullcontext(None if self.port is None else WorkerDoor(self.port, "any"))


class NoPages(Pages):
    """Everybody is in a trial."""

    def __init__(self) -> None:
        """Pages of a study that only has its file."""
        super().__init__(cast(StudyStore, SimpleNamespace(config=small_config())), texts={})

    def shown(self, code: str, base: str, *, page: int = 1) -> None:
        """Viser comes next."""

    def leaving(self, code: str, base: str) -> None:
        """There is nothing to leave."""

    def answer(self, code: str, form: Mapping[str, str]) -> None:
        """Nothing was asked."""


NO_PAGES = NoPages()


class EchoViser:
    """A websocket server that answers every message with its type, and remembers who sent what."""

    def __init__(self) -> None:
        """Starts in its own thread."""
        self.received: dict[str, list[dict[str, Any]]] = {}
        """Ticket to messages."""
        self.port = 0
        self.ended = 0
        """Connections that were closed."""
        self.open = 0
        """Connections that are open."""
        self._is_ready = threading.Event()
        self._changed = threading.Condition()
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_until_complete, args=(self._run(),), daemon=True)
        self._thread.start()
        self._is_ready.wait(10)

    def close(self) -> None:
        """Ends the thread."""
        self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join(10)

    def wait_until(self, wanted: Callable[[], bool]) -> None:
        """Waits until a received message makes the condition true."""
        with self._changed:
            assert self._changed.wait_for(wanted, 20)

    async def _run(self) -> None:
        self._stop = asyncio.Event()
        async with serve(self._answer, "127.0.0.1", 0, max_size=None, close_timeout=1) as server:
            self.port = next(iter(server.sockets)).getsockname()[1]
            self._is_ready.set()
            await self._stop.wait()

    async def _answer(self, connection: ServerConnection) -> None:
        mine = self.received.setdefault(connection.request.path.rpartition("=")[2], [])
        with self._changed:
            self.open += 1
        try:
            async for data in connection:
                assert isinstance(data, bytes)
                message = msgspec.msgpack.decode(data)
                with self._changed:
                    mine.append(message)
                    self._changed.notify_all()
                await connection.send(message["type"].encode())
        finally:
            with self._changed:
                self.ended += 1
                self.open -= 1
                self._changed.notify_all()


@dataclass
class Running:
    """A gateway that answers on a port."""

    address: str
    port: int
    viser: EchoViser
    tickets: Tickets
    people: FewPeople
    told: list[str]
    """Lines for the person at the terminal."""

    def forget(self) -> None:
        """Lets a test begin with a gateway that has not been asked anything."""
        self.viser.wait_until(lambda: self.viser.open == 0)
        self.viser.received.clear()
        self.viser.ended = 0
        self.told.clear()


@contextmanager
def running(
    folder: Path, *, options: ServeOptions | None = None, request_within_s: float = 15.0, **admission: Any
) -> Iterator[Running]:
    """A gateway on loopback until the end of the block."""
    options, viser = options or ServeOptions(port=0), EchoViser()
    app, *parts = _gateway(folder, viser.port, options, **admission)
    server = uvicorn_server(app, options)
    protocol = server.config.http
    assert isinstance(protocol, type)
    assert issubclass(protocol, PromptProtocol)
    protocol.request_within_s = request_within_s
    with contextlib.closing(viser), listen(options.bind, options.port) as listener:
        port = listener.getsockname()[1]
        with served_in_thread(server, listener):
            yield Running(f"http://127.0.0.1:{port}", port, viser, *parts)


def _gateway(
    folder: Path, port: int, options: ServeOptions, **admission: Any
) -> tuple[ASGIApp, Tickets, FewPeople, list[str]]:
    """(application, tickets, people, told lines) of a gateway in front of a port."""
    tickets, people, told = Tickets(), few_people(), list[str]()
    gateway = Gateway(
        admission_for(people, folder, **admission),
        OnePort(port),
        tickets=tickets,
        options=options,
        pages=NO_PAGES,
        screen_out_code="FULL-1",
        tell=told.append,
    )
    return gateway.app(), tickets, people, told


@dataclass
class Site:
    """A gateway without workers, and its parts."""

    client: TestClient
    tickets: Tickets
    people: FewPeople
    told: list[str]


def site(folder: Path, *, options: ServeOptions | None = None, peer: str = "192.0.2.7", **admission) -> Site:
    """A gateway whose requests all come from one address."""
    app, *parts = _gateway(folder, 9, options or ServeOptions(), **admission)
    return Site(TestClient(app, base_url="http://127.0.0.1", client=(peer, 5000)), *parts)


def enter(address: str, token: str, *, origin: str | None = None, **context: Any) -> tuple[str, dict[str, str]]:
    """(websocket address, headers for it) of a personal token, as the page gets them."""
    body = json.dumps({"token": token}).encode()
    headers = {"Content-Type": "application/json", "Origin": origin or address}
    request = urllib.request.Request(f"{address}/enter", body, headers)
    with urllib.request.urlopen(request, timeout=30, **context) as reply:
        view = json.load(reply)["view"]
        cookie = http.cookies.SimpleCookie(reply.headers["Set-Cookie"])
    pair = "; ".join(f"{name}={morsel.value}" for name, morsel in cookie.items())
    return view.split("websocket=")[1], {"Cookie": pair, "Origin": origin or address}


@contextmanager
def connected(gateway: Running, token: str) -> Iterator[ClientConnection]:
    """A participant's open websocket."""
    url, headers = enter(gateway.address, token)
    with connect(url, additional_headers=headers, max_size=None, proxy=None, close_timeout=1) as connection:
        yield connection


def says(connection: ClientConnection, message: dict[str, Any]) -> bytes:
    """The answer to a message that passes."""
    connection.send(pack(message))
    answer = connection.recv(timeout=20)
    assert isinstance(answer, bytes)
    return answer


def raw(port: int, data: bytes) -> bytes:
    """All that comes back for these bytes until the other side closes."""
    with socket.create_connection(("127.0.0.1", port), timeout=30) as connection:
        with contextlib.suppress(OSError):  # refused in the middle
            connection.sendall(data)
        received = b""
        with contextlib.suppress(OSError):
            while piece := connection.recv(65536):
                received += piece
        return received


def wait_until(wanted: Callable[[], object], *, patience_s: float = 60) -> None:
    """Waits until the condition is true."""
    deadline_s = time.monotonic() + patience_s
    while not wanted():
        assert time.monotonic() < deadline_s
        threading.Event().wait(0.02)
