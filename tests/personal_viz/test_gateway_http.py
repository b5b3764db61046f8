"""Limits around every route, asked in this process: connections of one address, of all, and pages that nobody reads."""

import asyncio
from typing import Any

import pytest
from starlette.applications import Starlette
from starlette.types import Message, Receive, Scope, Send
from uvicorn.server import ServerState

from personal_viz.study_app.gateway import http as gateway_http
from personal_viz.study_app.gateway.http import Guard, PromptProtocol, uvicorn_server
from personal_viz.study_app.gateway.options import ServeOptions, host_name


def scope_from(peer: str, *, forwarded_for: str = "", kind: str = "http") -> Scope:
    """A request from an address."""
    headers = [(b"host", b"127.0.0.1")] + [(b"x-forwarded-for", forwarded_for.encode())] * bool(forwarded_for)
    common = {"client": (peer, 5000), "path": "/", "raw_path": b"/", "query_string": b"", "headers": headers}
    return {"type": kind, "method": "GET", **common}


async def statuses(guard: Guard, scopes: list[Scope], go_on: asyncio.Event) -> list[int]:
    """Status of each request when all are open at once."""
    found: dict[int, int] = {}

    async def ask(number: int, scope: Scope) -> None:
        async def send(message: Message) -> None:
            if message["type"] in ("http.response.start", "websocket.close"):
                found[number] = message.get("status", message.get("code", 0))

        async def receive() -> Message:
            return {"type": "websocket.connect"}

        await guard(scope, receive, send)

    tasks = [asyncio.create_task(ask(number, scope)) for number, scope in enumerate(scopes)]
    await asyncio.sleep(0)
    go_on.set()
    await asyncio.gather(*tasks)
    return [found[number] for number in range(len(scopes))]


def waiting_app(go_on: asyncio.Event) -> Any:
    """An application that answers when it is told."""

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        await go_on.wait()
        if scope["type"] == "http":
            await send({"type": "http.response.start", "status": 200, "headers": []})
            await send({"type": "http.response.body", "body": b""})

    return app


def open_at_once(options: ServeOptions, scopes: list[Scope]) -> list[int]:
    """Their statuses."""

    async def run() -> list[int]:
        go_on = asyncio.Event()
        return await statuses(Guard(waiting_app(go_on), options), scopes, go_on)

    return asyncio.run(run())


def test_one_address_has_few_requests_and_websockets_open_and_others_do_not_notice() -> None:
    options = ServeOptions(per_address=2)
    scopes = [scope_from("192.0.2.1") for _ in range(3)] + [scope_from("192.0.2.2")]
    assert open_at_once(options, scopes) == [200, 200, 503, 200]
    assert open_at_once(options, [scope_from("127.0.0.1") for _ in range(5)]) == [200] * 5
    scopes = [scope_from("192.0.2.1"), scope_from("192.0.2.1", kind="websocket")]
    assert open_at_once(ServeOptions(per_address=1), scopes) == [200, 1013]


def test_behind_the_named_proxy_the_address_that_it_names_counts() -> None:
    options = ServeOptions(per_address=1, proxy="10.0.0.9")
    asked = [scope_from("10.0.0.9", forwarded_for=f"spoofed, 192.0.2.{number}") for number in (1, 1, 2)]
    assert open_at_once(options, asked) == [200, 503, 200]
    spoofed = [scope_from("192.0.2.7", forwarded_for=f"192.0.2.{number}") for number in (1, 2)]
    assert open_at_once(options, spoofed) == [200, 503]


def test_a_page_that_nobody_reads_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gateway_http, "ANSWER_WITHIN_S", 0.01)

    async def run() -> None:
        await Guard(waiting_app(asyncio.Event()), ServeOptions())(scope_from("192.0.2.1"), _nothing, _nothing)

    asyncio.run(run())


async def _nothing(*_: Any) -> Any:
    return None


class Connection(asyncio.Transport):
    """A connection from an address; remembers whether it was closed at once."""

    def __init__(self, peer: str) -> None:
        super().__init__({"peername": (peer, 5000)})
        self.is_aborted = False

    def abort(self) -> None:
        self.is_aborted = True


def aborted(options: ServeOptions, peers: list[str]) -> list[bool]:
    """Which of these connections are closed at once when they come in this order."""

    async def run() -> list[bool]:
        config = uvicorn_server(Starlette(), options).config
        config.load()
        state, made = ServerState(), []
        for peer in peers:
            protocol: Any = config.http_protocol_class(config=config, server_state=state, app_state={})
            assert isinstance(protocol, PromptProtocol)
            made.append(Connection(peer))
            protocol.connection_made(made[-1])
        return [transport.is_aborted for transport in made]

    return asyncio.run(run())


def test_one_address_and_all_together_have_few_connections_even_before_their_first_request() -> None:
    options = ServeOptions(per_address=2, proxy="10.0.0.9")
    assert aborted(options, ["192.0.2.1"] * 3 + ["192.0.2.2"]) == [False, False, True, False]
    assert aborted(options, ["127.0.0.1"] * 5) == [False] * 5
    assert aborted(options, ["10.0.0.9"] * 5) == [False] * 5
    found = aborted(ServeOptions(max_people=1), ["127.0.0.1"] * 300)
    assert found == [False] * 259 + [True] * 41


@pytest.mark.parametrize(
    ("host", "name"),
    [
        ("study.example.org", "study.example.org"),
        ("Study.Example.ORG:8443", "study.example.org"),
        ("[::1]:8080", "::1"),
        ("127.0.0.1", "127.0.0.1"),
        ("a@127.0.0.1", ""),
        ("127.0.0.1/x", ""),
        ("127.0.0.1\\@evil", ""),
        ("[", ""),
        ("", ""),
        ("a" * 300, ""),
    ],
)
def test_names_in_host_headers(host: str, name: str) -> None:
    assert host_name(host) == name
