"""Nothing that an outsider sends, over HTTP or as a participant's browser, causes a traceback."""

import gc
import itertools
import json
import logging
import random
import socket
import struct
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from human_study.trial.clock import SHORTEST_PRESS_S
from personal_viz.study_app.gateway.filter import CAMERA, browser_message, viser_bytes
from personal_viz.study_app.home.homes import Home
from personal_viz.study_app.screens import play as play_module

from ..human_study.small_world import study
from .gateways import CLICK, PRESS, connected, pack, raw, running, says
from .stage import invented_home, staged
from .wire import WireClient, line_to, texts_of

VECTORS = (
    *([0.0, 0.0, 0.0], [1e9, -1e9, 1e9], [1e308, 1e308, 1e308], [5e-324, 0.0, 0.0], [3.0, 3.0, 3.0]),
    *(None, [1, 2], "x"),
)
SCALARS = (0, -1, 0.0, 1e-320, 1e308, 2**63, None, "1", True)
VALUES = (
    *(None, True, False, 0, -7, 1e308, 2**63, "", "Left", "Nowhere", "\x00", "x" * 60_000),
    *([], [1.5, 2.5], [[1], [2]], "{}", "[[["),
)
LETTERS = (
    {"kind": "press", "action": "left", "n": 1, "t_cli_ms": 1, "code": "\x00\x1b[2J"},
    {"kind": "press", "action": "left", "n": 2**53, "t_cli_ms": 1e12, "code": "é" * 32},
    {"kind": "device", "n": 3, "t_cli_ms": 1, "webgl2": False, "width": 0, "height": 0},
    {"kind": "device", "n": 3, "t_cli_ms": 1, "webgl2": 7, "width": -1, "height": 1e99},
    {"kind": "page", "n": 4, "t_cli_ms": 0, "what": "hidden"},
    {"kind": "page", "n": 4, "t_cli_ms": 0, "what": ["hidden"]},
    {"kind": "round_trip", "n": 5, "t_cli_ms": 0, "ms": 1e12},
    {"kind": "keys", "n": 6, "t_cli_ms": 0, "keys": {"forward": "KeyQ", "left": "KeyQ", "stop": "KeyQ"}},
    {"kind": "keys", "n": 6, "t_cli_ms": 0, "keys": {"constructor": "KeyQ"}},
    {"kind": "told", "n": 7, "t_cli_ms": 0, "name": "<script>"},
    {"kind": "nothing", "n": 8},
    ["kind"],
)

PATHS = ("/", "/enter", "/join", "/view/", "/check/download", "/page-version", "/ws/x", "/ws/x/y", "/static/enter.js")
TAILS = ("", "?", "?websocket=%ff/ws/%00", "?websocket=/ws/%ed%a0%80/x", "/%ff%fe", "/" + "a" * 5000, "?" + "a&" * 3000)
BODIES = (
    b"",
    b"{",
    b"[" * 4000,
    b'{"token":7}',
    b'{"token":"\xff"}',
    b'{"token":"\\ud800"}',
    b'{"token":"\\u0000"}',
    b'{"token":"x","device":{"webgl2":1}}',
    b'{"token":' + b"9" * 4000 + b"}",
    b"\x00" * 5000,
)
HEADERS = (
    "X: y",
    "Cookie: " + "=;" * 900,
    'Cookie: personal_session="\\777',
    "Cookie: \xff\xfe=\xfd",
    "Origin: http://[",
    f"X-Forwarded-For: {'9' * 900}, ::%, ",
    "Content-Length: " + "1" * 5000,
    "Content-Type: multipart/form-data",
    "Upgrade: websocket\r\nConnection: Upgrade",
    "Transfer-Encoding: chunked",
    "Expect: 100-continue",
    "Range: bytes=9-1,-",
)
SOCKET_HEADERS = ("", "Protocol: ,viser-v\xff", "Protocol: ,", "Extensions: ;;=", "Extensions: \xff", "Version: \xb2")


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Home]:
    """An invented home with two storeys."""
    opened = invented_home(tmp_path_factory.mktemp("dataset"), study())
    yield opened
    opened.close()


@pytest.fixture
def no_traceback(capfd: pytest.CaptureFixture[str]) -> Iterator[None]:
    """Fails the test when one was printed or logged."""
    kept: list[logging.LogRecord] = []
    handler = logging.Handler()
    handler.emit = kept.append
    logging.getLogger().addHandler(handler)
    yield
    gc.collect()  # a task's exception is logged when the task is collected
    logging.getLogger().removeHandler(handler)
    printed = "".join(capfd.readouterr())
    assert "Traceback" not in printed, printed[-3000:]
    told = [logging.Formatter().format(record)[-1500:] for record in kept if record.exc_info]
    assert not told, "\n".join([f"{len(told)} tracebacks", *sorted(set(told))])[-9000:]


def hostile_messages(uuids: dict[str, list[str]], seat: str) -> Iterator[dict[str, Any]]:
    """Messages that a foreign client might send."""
    for vector in VECTORS:
        for name in ("position", "look_at", "up_direction", "wxyz"):
            yield {**CAMERA, name: [*vector, 0.0] if name == "wxyz" and isinstance(vector, list) else vector}
        for name in ("ray_origin", "ray_direction"):
            yield CAMERA
            yield {**CLICK, name: vector}
        yield {**CAMERA, "position": vector, "look_at": vector}
        yield from ({**CLICK, "ray_origin": vector, "ray_direction": vector}, CAMERA)
    for name, scalar in itertools.product(("fov", "near", "far", "image_height", "image_width"), SCALARS):
        yield {**CAMERA, name: scalar}
    for screen in ([], [[0.0, 0.0]] * 4, [[1e308, -1e308]], [[1]], [0.5, 0.5], None):
        yield {**CLICK, "screen_pos": screen}
        yield {**CLICK, "event_type": "rect-select", "screen_pos": screen}
    yield {**CLICK, "event_type": "rect-select", "ray_origin": None, "ray_direction": None}
    for modifier in ("shift", "cmd/ctrl+shift", "///", "+", 3):
        yield {**CLICK, "modifier": modifier}
    for uuid in [*uuids.get("other", []), "nobody"]:
        yield from ({"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": value}} for value in VALUES)
        yield {"type": "CommandTriggerMessage", "uuid": uuid}
    for uuid in uuids.get("text", []):
        letters = [json.dumps({"seat": seat, "said": [letter]}) for letter in LETTERS]
        letters += [
            json.dumps({"seat": seat, "said": list(LETTERS[:1]) * 41}),
            '{"seat":"' + seat + '","said":' + "[" * 30_000,
        ]
        letters += [
            json.dumps(
                {"seat": seat, "said": [{"kind": "press", "action": "left", "n": 1, "t_cli_ms": 1, "code": "\ud800"}]}
            )
        ]
        yield from ({"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": text}} for text in letters)


def uuids_of(client: WireClient) -> dict[str, list[str]]:
    """Ids of the buttons, fields and commands that a browser received, except those that end a trial."""
    found: dict[str, list[str]] = {"text": [], "other": []}
    for message in client.messages:
        label = str(message.get("props", {}).get("label", "")) + str(message.get("props", {}).get("name", ""))
        if "uuid" in message and not label.startswith(("Give up", "Confirm", "STOP", "Stop")):
            found["text" if message["type"] == "GuiTextMessage" else "other"].append(message["uuid"])
    return found


def seat_of(client: WireClient) -> str:
    """The id by which the page's script names its connection: the first argument of its `begin`."""
    return (
        next(text for m in client.messages for text in texts_of(m) if "begin(" in text)
        .split("begin(&quot;")[1]
        .split("&")[0]
    )


@pytest.mark.slow
@pytest.mark.parametrize(("task", "condition"), [("pog", "map_open"), ("pan", "none")])
def test_no_message_of_a_browser_makes_a_traceback(
    home: Home, no_traceback: None, monkeypatch: pytest.MonkeyPatch, task: Any, condition: Any
) -> None:
    readings = itertools.count()
    hurried = SimpleNamespace(monotonic=lambda: time.monotonic() + SHORTEST_PRESS_S * next(readings))
    monkeypatch.setattr(play_module, "time", hurried)  # no message comes too early, however fast all are sent
    choices: dict[str, Any] = {"pog": {"conditions": [condition]}} if task == "pog" else {"actions": "paper6"}
    with staged(home, task, condition, **choices) as stage, line_to(stage.url) as line:
        client = WireClient(line)
        client.send(CAMERA)
        client.receive_until(lambda message: "Give up" in str(message.get("props", {}).get("label")))
        client.receive_until(lambda message: "begin(" in str(message))
        num_sent = 0
        for message in hostile_messages(uuids_of(client), seat_of(client)):
            try:
                packed = pack(message)
            except UnicodeEncodeError:
                continue
            passed = browser_message(packed)
            if passed is not None:
                line.send(viser_bytes(passed))
                num_sent += 1
        assert num_sent > 50
        stage.link.wait_for("open")
        client.give_up()
        stage.link.wait_for_outcome()


def hostile_requests(address: str) -> Iterator[bytes]:
    """Requests that a hostile program might send."""
    seeded = random.Random(0)
    yield from hostile_pages(address, seeded)
    yield from hostile_handshakes(address)
    yield from (seeded.randbytes(300) + b"\r\n\r\n" for _ in range(20))


def hostile_pages(address: str, seeded: random.Random) -> Iterator[bytes]:
    """Requests for each path by each method, with a random body and header."""
    host, own = f"Host: {address[7:]}", f"Origin: {address}"
    bodies = [*BODIES, seeded.randbytes(500)]
    for path, tail in itertools.product(PATHS, TAILS):
        for method in ("GET", "POST", "HEAD", "PUT"):
            body, header = seeded.choice(bodies), seeded.choice(HEADERS)
            first = f"{method} {path}{tail} HTTP/1.1"
            head = "\r\n".join([first, host, own, header, "Connection: close", f"Content-Length: {len(body)}", "", ""])
            yield head.encode("latin-1") + body


def hostile_handshakes(address: str) -> Iterator[bytes]:
    """Beginnings of a websocket that no browser makes."""
    host, own = f"Host: {address[7:]}", f"Origin: {address}"
    handshake = f"GET /ws/x/y HTTP/1.1\r\n{host}\r\n{own}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    whole = "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n"
    for key in ("", "Sec-WebSocket-Key: x\r\n", "Sec-WebSocket-Key: \xff\r\n", whole, whole * 2):
        for more in SOCKET_HEADERS:
            named = f"Sec-WebSocket-{more}\r\n" if more else ""
            yield f"{handshake}{key}{named}\r\n".encode("latin-1")


def leave_in_the_middle(port: int, request: bytes, *, at: int, is_rude: bool) -> None:
    """Sends the beginning of a request and goes, with a goodbye or without."""
    with socket.create_connection(("127.0.0.1", port), timeout=30) as line:
        line.sendall(request[:at])
        if is_rude:
            line.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))


def test_no_request_of_an_outsider_makes_a_traceback(tmp_path: Path, no_traceback: None) -> None:
    with running(tmp_path, recruit="link", request_within_s=1.0) as gateway:
        for request in hostile_requests(gateway.address):
            raw(gateway.port, request)
        for path in (b"/enter", b"/join"):
            head = (
                b"POST " + path + f" HTTP/1.1\r\nHost: {gateway.address[7:]}\r\nOrigin: {gateway.address}\r\n".encode()
            )
            half = head + b'Content-Length: 90\r\n\r\n{"token":"go'
            chunked = head + b'Transfer-Encoding: chunked\r\n\r\n5\r\n{"tok\r\n5\r\nen'
            for request, is_rude in itertools.product((half, chunked), (False, True)):
                for at in (10, len(head) + 5, len(request) - 3, len(request)):
                    leave_in_the_middle(gateway.port, request, at=at, is_rude=is_rude)
        with connected(gateway, "good") as survivor:
            assert says(survivor, PRESS) == b"GuiUpdateMessage"
    assert gateway.told == []
