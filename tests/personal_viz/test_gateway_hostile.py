"""HUMAN_STUDY.md, section 10, tests 10, 13, 14: hostile websockets and requests, while others work on."""

import contextlib
import logging
import math
import random
import resource
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from personal_viz.study_app.gateway.filter import CAMERA
from personal_viz.study_app.gateway.options import ServeOptions

from .gateways import CLICK, KEY_PRESS, PRESS, Running, connected, enter, pack, raw, running, says, wait_until


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """One gateway for the tests of this module."""
    with running(tmp_path_factory.mktemp("gateway")) as found:
        yield found


@pytest.fixture(scope="module")
def hasty(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """A gateway at which a request has half a second."""
    with running(tmp_path_factory.mktemp("hasty"), request_within_s=0.5) as found:
        yield found


@pytest.fixture
def gateway(shared: Running) -> Iterator[Running]:
    """The shared gateway, which must still let a participant work at the end of each test."""
    shared.forget()
    yield shared
    with connected(shared, "nice") as survivor:
        assert says(survivor, PRESS) == b"GuiUpdateMessage"


def closed_code(connection: ClientConnection) -> int | None:
    """The close code that the gateway sent, after whatever it had to say before."""
    try:
        while True:
            connection.recv(timeout=20)
    except ConnectionClosed as ended:
        return ended.rcvd.code if ended.rcvd is not None else None


@pytest.mark.parametrize(
    ("data", "codes"),
    [
        ("a text message", {1008}),
        (pack(PRESS).decode("latin-1"), {1008}),
        (random.Random(1).randbytes(300), {1008}),
        (pack(CAMERA)[:-4], {1008}),
        (b"", {1008}),
        (pack({**CAMERA, "position": [math.nan, 0.0, 0.0]}), {1008}),
        (pack({**CLICK, "ray_origin": [0.0, 0.0, math.inf]}), {1008}),
        (b"\x91" * 60_000, {1008}),
        (pack({"type": "ShareUrlRequest"}), {1008}),
        (pack({"type": "ShareUrlDisconnect"}), {1008}),
        (pack({"type": "FileTransferStartUpload", "transfer_uuid": "x", "size_bytes": 1}), {1008}),
        (pack({"type": "NoSuchMessage"}), {1008}),
        (pack({**PRESS, "uuid": ["of somebody else"]}), {1008}),
        (b"\x00" * 70_000, {1009, None}),
        (b"\x00" * 40_000_000, {1009, None}),
    ],
    ids=lambda value: None if isinstance(value, set) else f"{value[:12]!s}-{len(value)}",
)
def test_one_bad_message_ends_its_own_connection_only(gateway: Running, data: str | bytes, codes: set) -> None:
    with connected(gateway, "fine") as other:
        assert says(other, PRESS) == b"GuiUpdateMessage"
        with connected(gateway, "good") as bad:
            assert says(bad, PRESS) == b"GuiUpdateMessage"
            with contextlib.suppress(ConnectionClosed):  # the gateway does not wait for 40 MB
                bad.send(data)
            assert closed_code(bad) in codes
        gateway.viser.wait_until(lambda: gateway.viser.ended == 1)
        assert says(other, KEY_PRESS) == b"CommandTriggerMessage"
    assert all(message in (PRESS, KEY_PRESS) for sent in gateway.viser.received.values() for message in sent)
    if codes == {1008}:
        wait_until(lambda: gateway.told)
        assert len(gateway.told) == 1
        assert gateway.told[0].startswith("a connection of p01 was closed: it sent a")


def test_fragments_count_together(gateway: Running) -> None:
    with connected(gateway, "good") as bad:
        with contextlib.suppress(ConnectionClosed):
            bad.send(b"\x00" * 1000 for _ in range(80))
        assert closed_code(bad) in (1009, None), "data under way may break the line before the code comes"


def test_a_foreign_uuid_of_sane_shape_passes_to_viser_which_knows_whose_it_is(gateway: Running) -> None:
    with connected(gateway, "good") as one, connected(gateway, "fine") as two:
        assert says(one, {**PRESS, "uuid": "of-the-other"}) == b"GuiUpdateMessage"
        assert says(two, PRESS) == b"GuiUpdateMessage"
    assert len(gateway.viser.received) == 2, "each has a connection of its own, which viser takes for the person"


def test_keys_over_twenty_a_second_are_dropped_and_the_newest_camera_arrives(gateway: Running) -> None:
    with connected(gateway, "good") as masher:
        began_s = time.monotonic()
        for number in range(60):
            masher.send(pack(KEY_PRESS))
            masher.send(pack({**CAMERA, "far": float(number)}))
        masher.send(pack(PRESS))  # reports of the page have a limit of their own
        gateway.viser.wait_until(lambda: bool(gateway.viser.received))  # the connection behind the gateway is there
        sent = next(iter(gateway.viser.received.values()))
        gateway.viser.wait_until(lambda: PRESS in sent and any(message.get("far") == 59.0 for message in sent))
        took_s = time.monotonic() - began_s
    keys = [message for message in sent if message == KEY_PRESS]
    cameras = [message["far"] for message in sent if "far" in message]
    assert 20 <= len(keys) <= 21 + 20 * took_s
    assert len(cameras) < 60 or took_s > 2
    assert cameras == sorted(cameras)


def test_a_flood_ends_the_connection(gateway: Running) -> None:
    with connected(gateway, "good") as flood:
        with contextlib.suppress(ConnectionClosed):
            for _ in range(5000):
                flood.send(pack(CAMERA))
        assert closed_code(flood) == 1008
    wait_until(lambda: gateway.told)
    assert gateway.told == ["a connection of p01 was closed: it sent more messages than any browser sends"]


def test_one_session_has_few_connections(gateway: Running) -> None:
    url, headers = enter(gateway.address, "good")
    with contextlib.ExitStack() as stack:
        for _ in range(6):
            stack.enter_context(connect(url, additional_headers=headers, proxy=None))
        with pytest.raises(InvalidStatus) as refused:
            connect(url, additional_headers=headers, proxy=None)
    assert refused.value.response.status_code == 403


def test_people_over_the_limit_wait_and_those_inside_come_back(tmp_path: Path) -> None:
    with running(tmp_path, options=ServeOptions(port=0, max_people=1)) as gateway:
        early = enter(gateway.address, "fine")
        with connected(gateway, "good"):
            with pytest.raises(InvalidStatus):
                connect(early[0], additional_headers=early[1], proxy=None)
            body = b'{"token":"nice"}'
            assert b" 503 " in raw(gateway.port, post("/enter", body, gateway.address)).splitlines()[0]
            enter(gateway.address, "good")


def post(path: str, body: bytes, origin: str, *, length: int | None = None) -> bytes:
    """A whole request as bytes."""
    head = [f"POST {path} HTTP/1.1", f"Host: {origin[7:]}", f"Origin: {origin}", "Connection: close"]
    head += [f"Content-Length: {len(body) if length is None else length}", "", ""]
    return "\r\n".join(head).encode() + body


def get(path: str, *more: str, host: str = "127.0.0.1") -> bytes:
    """A whole request as bytes."""
    return "\r\n".join([f"GET {path} HTTP/1.1", f"Host: {host}", "Connection: close", *more, "", ""]).encode("latin-1")


@pytest.mark.parametrize(
    "path",
    [
        "/../../etc/passwd",
        "/static/../gateway.py",
        "/static/%2e%2e/gateway.py",
        "/static/%2e%2e%2fgateway.py",
        "/static/..%5cgateway.py",
        "/static/%252e%252e/gateway.py",
        "/static//etc/passwd",
        "/static/enter.js%00.css",
        "/static/%00",
        "/%0d%0aSet-Cookie:x",
        "/view/../../etc/passwd",
        "/ws/../check/download",
        "//evil.test/",
    ],
)
def test_no_path_leads_outside(gateway: Running, path: str) -> None:
    reply = raw(gateway.port, get(path))
    assert reply.split()[1] in (b"400", b"404"), reply[:200]
    assert b"Set-Cookie" not in reply
    assert b"root:" not in reply
    assert b"class Gateway" not in reply


@pytest.mark.parametrize(
    ("request_bytes", "status"),
    [
        (get("/", "X-Long: " + "a" * 17_000), (b"431", b"400")),
        (get("/", *[f"X-{number}: {'a' * 200}" for number in range(90)]), (b"431", b"400")),
        (get("/" + "a" * 17_000), (b"431", b"400")),
        (get("/?" + "a" * 17_000), (b"431", b"400")),
        (get("/", host="evil.test"), (b"400",)),
        (get("/", "Host: 127.0.0.1"), (b"400",)),
        (b"GET / HTTP/1.1\r\nConnection: close\r\n\r\n", (b"400",)),
        (b"GET / HTTP/1.0\r\n\r\n", (b"400",)),
        (b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + b"a" * 100 + b"\r\n\r\n", (b"400",)),
        (b"GET /\x00 HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n", (b"400",)),
        (get("/", "Content-Length: 5", "Transfer-Encoding: chunked"), (b"400", b"200")),
        (get("/", "Content-Length: -1"), (b"400",)),
        (get("/", "Content-Length: 1", "Content-Length: 2"), (b"400",)),
        (get("http://evil.test/"), (b"400", b"404")),
        (b"CONNECT evil.test:443 HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n", (b"400", b"404", b"405")),
    ],
)
def test_strange_requests_get_an_error_or_only_our_own_page(
    gateway: Running, request_bytes: bytes, status: tuple[bytes, ...]
) -> None:
    reply = raw(gateway.port, request_bytes)
    assert reply.split()[1] in status, reply[:200]


def test_large_bodies_are_refused_before_they_arrive(gateway: Running) -> None:
    before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    declared = raw(gateway.port, post("/enter", b"", gateway.address, length=10**10))
    assert declared.split()[1] == b"413"
    head = post("/enter", b"", gateway.address).replace(b"Content-Length: 0", b"Transfer-Encoding: chunked")
    chunked = raw(gateway.port, head + (b"10000\r\n" + b"a" * 65536 + b"\r\n") * 1000)
    assert chunked == b"" or chunked.split()[1] == b"401"
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb < 150_000  # the 64 MB here are ours


@pytest.mark.parametrize(
    "beginning",
    [
        b"",
        b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Slow: ",
        b"POST /enter HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 1000\r\n\r\n",
        get("/").replace(b"Connection: close\r\n", b"") + b"GET / HT",
    ],
)
def test_requests_that_never_end_are_disconnected_although_they_trickle(hasty: Running, beginning: bytes) -> None:
    with socket.create_connection(("127.0.0.1", hasty.port), timeout=30) as slow:
        is_over = threading.Event()

        def trickle() -> None:
            with contextlib.suppress(OSError):
                slow.sendall(beginning)
                while not is_over.wait(0.05) and beginning:
                    slow.sendall(b"a")

        sender = threading.Thread(target=trickle)
        sender.start()
        with contextlib.suppress(OSError):
            while slow.recv(65536):
                pass
        is_over.set()
        sender.join(20)
        with connected(hasty, "good") as other:
            assert says(other, PRESS) == b"GuiUpdateMessage"


def test_the_time_limit_of_requests_is_not_one_of_websockets(hasty: Running) -> None:
    hasty.forget()
    with connected(hasty, "good") as patient:
        assert says(patient, PRESS) == b"GuiUpdateMessage"
        assert raw(hasty.port, b"GET / HTTP/1.1\r\nX-Slow: ") == b"", "now the time is over"
        assert says(patient, PRESS) == b"GuiUpdateMessage"
    assert len(hasty.viser.received) == 1


def test_a_hundred_idle_connections_do_not_keep_others_out(gateway: Running) -> None:
    with contextlib.ExitStack() as stack:
        for _ in range(100):
            idle = stack.enter_context(socket.create_connection(("127.0.0.1", gateway.port), timeout=30))
            idle.sendall(b"GET / HTTP/1.1\r\nX: ")
        with connected(gateway, "good") as other:
            assert says(other, PRESS) == b"GuiUpdateMessage"


@pytest.mark.parametrize(
    "headers",
    [
        {"Cookie": ""},
        {"Cookie": "personal_session=guess"},
        {"Origin": "http://evil.test"},
        {"Origin": "http://127.0.0.1:1"},
        {"Host": "evil.test"},
    ],
)
def test_a_websocket_of_somebody_else_is_refused(gateway: Running, headers: dict[str, str]) -> None:
    url, own = enter(gateway.address, "good")
    answer = upgrade(gateway, url, {**own, **headers})
    assert answer.split()[1] == b"403"
    assert gateway.viser.received == {}


def test_the_ticket_of_another_participant_is_refused(gateway: Running) -> None:
    url, _ = enter(gateway.address, "good")
    _, of_another = enter(gateway.address, "fine")
    assert upgrade(gateway, url, of_another).split()[1] == b"403"
    unknown = upgrade(gateway, url[:-3] + "abc", of_another)
    assert unknown.split(b"\r\n\r\n")[1] == upgrade(gateway, url, of_another).split(b"\r\n\r\n")[1], "says nothing more"


def upgrade(gateway: Running, url: str, headers: dict[str, str]) -> bytes:
    """The answer to a websocket's request, as it comes."""
    path = "/" + url.split("/", 3)[3]
    names = {"Host": gateway.address[7:], **headers}
    lines = [f"GET {path} HTTP/1.1", *[f"{name}: {value}" for name, value in names.items()]]
    lines += ["Upgrade: websocket", "Connection: Upgrade", "Sec-WebSocket-Version: 13"]
    lines += ["Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==", "", ""]
    return raw(gateway.port, "\r\n".join(lines).encode())


def test_no_token_body_or_address_is_logged(
    gateway: Running, capfd: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG, "websockets.client")
    raw(gateway.port, post("/enter", b'{"token":"canary-token"}', gateway.address))
    raw(gateway.port, b"canary-line\r\n\r\n")
    raw(gateway.port, get("/canary-path", "User-Agent: canary-agent"))
    with connected(gateway, "good") as bad:
        bad.send("canary-message")
        assert closed_code(bad) == 1008
    out, error = capfd.readouterr()
    logged = "".join(
        record.getMessage() for record in caplog.records if not record.name.startswith("websockets.client")
    )
    for text in (out, error, logged, str(gateway.told)):
        assert "canary" not in text
        assert "127.0.0.1" not in text
