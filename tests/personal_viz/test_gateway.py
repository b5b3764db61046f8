"""The gateway: who is let in, and which of a browser's messages reach viser."""

import math

import msgspec
import pytest
from starlette.testclient import TestClient
from starlette.websockets import WebSocketDisconnect

from personal_viz.gateway import SESSION_COOKIE, Tickets, is_allowed_message, make_gateway

ORIGIN = {"origin": "http://127.0.0.1"}


def client_and_tickets() -> tuple[TestClient, Tickets]:
    """A gateway that knows one token; its worker's port is closed."""
    tickets = Tickets()
    app = make_gateway({"good": "p01"}.get, lambda _: 9, tickets=tickets, hosts=frozenset({"127.0.0.1"}))
    return TestClient(app, base_url="http://127.0.0.1"), tickets


def test_a_known_token_becomes_a_session_and_a_view() -> None:
    client, tickets = client_and_tickets()
    reply = client.post("/enter", json={"token": "good"}, headers=ORIGIN)
    assert reply.status_code == 200
    ticket_id = reply.json()["view"].rsplit("/", 1)[1]
    ticket = tickets.find(ticket_id)
    assert ticket is not None
    assert ticket.code == "p01"
    assert reply.cookies[SESSION_COOKIE] == ticket.session_id
    assert "HttpOnly" in reply.headers["set-cookie"]
    assert "SameSite=strict" in reply.headers["set-cookie"]


@pytest.mark.parametrize(
    "body", [b'{"token":"bad"}', b"{}", b"[1]", b"\xff", b'{"token":' + b'"' + b"a" * 5000 + b'"}']
)
def test_anything_else_is_refused(body: bytes) -> None:
    client, _ = client_and_tickets()
    assert client.post("/enter", content=body, headers=ORIGIN).status_code == 401


def test_a_foreign_origin_and_a_foreign_host_are_refused() -> None:
    client, _ = client_and_tickets()
    assert client.post("/enter", json={"token": "good"}, headers={"origin": "http://evil.test"}).status_code == 403
    assert client.post("/enter", json={"token": "good"}).status_code == 403
    assert client.get("/", headers={"host": "evil.test"}).status_code == 400


def test_pages_carry_the_security_headers() -> None:
    client, _ = client_and_tickets()
    for path in ("/", "/view/", "/static/enter.js"):
        headers = client.get(path).headers
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["referrer-policy"] == "no-referrer"
        assert "frame-ancestors 'none'" in headers["content-security-policy"]
    assert "unsafe-inline" not in client.get("/").headers["content-security-policy"]


@pytest.mark.parametrize("path", ["/static/../gateway.py", "/static/%2e%2e/gateway.py", "/view/../../etc/passwd"])
def test_files_outside_the_static_folder_are_not_served(path: str) -> None:
    client, _ = client_and_tickets()
    assert client.get(path).status_code == 404


@pytest.mark.parametrize(
    ("ticket", "cookie", "origin"),
    [("other", "own", "own"), ("own", "other", "own"), ("own", "own", "http://evil.test"), ("own", "own", None)],
)
def test_the_websocket_opens_only_with_its_own_ticket_cookie_and_origin(ticket: str, cookie: str, origin) -> None:
    client, tickets = client_and_tickets()
    session_id, ticket_id = tickets.issue("p01")
    headers = {"cookie": f"{SESSION_COOKIE}={session_id if cookie == 'own' else 'x'}"}
    if origin:
        headers["origin"] = "http://127.0.0.1" if origin == "own" else origin
    url = f"ws://127.0.0.1/ws/{ticket_id if ticket == 'own' else 'x'}"
    with pytest.raises(WebSocketDisconnect) as refused, client.websocket_connect(url, headers=headers):
        pass
    assert refused.value.code == 1008


def test_a_worker_that_is_gone_closes_the_websocket_for_a_later_try() -> None:
    client, tickets = client_and_tickets()
    session_id, ticket_id = tickets.issue("p01")
    headers = {"cookie": f"{SESSION_COOKIE}={session_id}", **ORIGIN}
    url = f"ws://127.0.0.1/ws/{ticket_id}"
    with pytest.raises(WebSocketDisconnect) as refused, client.websocket_connect(url, headers=headers):
        pass
    assert refused.value.code == 1013


def pack(message: object) -> bytes:
    """As a browser sends it."""
    return msgspec.msgpack.encode(message)


def test_clicks_keys_buttons_and_camera_pass() -> None:
    for kind in ("ViewerCameraMessage", "ScenePointerMessage", "GuiUpdateMessage", "CommandTriggerMessage"):
        assert is_allowed_message(pack({"type": kind, "position": [1.0, 2.0, 3.0]}))


@pytest.mark.parametrize(
    "data",
    [
        pack({"type": "ShareUrlRequest"}),
        pack({"type": "FileTransferStartUpload"}),
        pack({"no": "type"}),
        pack([1, 2]),
        pack({"type": "ViewerCameraMessage", "position": [math.nan, 0, 0]}),
        pack({"type": "ViewerCameraMessage", "deep": {"a": [math.inf]}}),
        pack({"type": "ViewerCameraMessage", "big": "x" * 70_000}),
        b"\xc1",
        b"",
        b"\x91" * 50_000,
    ],
)
def test_tunnels_uploads_nan_large_and_broken_messages_do_not(data: bytes) -> None:
    assert not is_allowed_message(data)
