"""The gateway: who is let in, and which of a browser's messages reach viser."""

import math

import msgspec
import pytest
from starlette.testclient import TestClient
from starlette.websockets import WebSocketDisconnect

from personal_viz.gateway import SESSION_COOKIE, Gateway, RateLimit, Tickets, allowed_kind

ORIGIN = {"origin": "http://127.0.0.1"}


def client_and_tickets() -> tuple[TestClient, Tickets]:
    """A gateway that knows one token; its worker's port is closed."""
    tickets = Tickets()
    app = Gateway({"good": "p01"}.get, 9, tickets=tickets, hosts=frozenset({"127.0.0.1"})).app()
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


def test_broken_hosts_and_origins_are_refused_not_errors() -> None:
    client, _ = client_and_tickets()
    assert client.get("/", headers={"host": "["}).status_code == 400
    assert client.post("/enter", json={"token": "good"}, headers={"origin": "http://["}).status_code == 403


def test_a_newer_ticket_revokes_the_older_one_and_its_page_asks_for_the_link() -> None:
    client, tickets = client_and_tickets()
    old = client.post("/enter", json={"token": "good"}, headers=ORIGIN).json()["view"]
    new = client.post("/enter", json={"token": "good"}, headers=ORIGIN).json()["view"]
    assert tickets.find(old.rsplit("/", 1)[1]) is None
    assert tickets.find(new.rsplit("/", 1)[1]) is not None
    assert b"personal link" in client.get(old).content


def test_two_participants_in_one_browser_keep_their_sessions() -> None:
    client, _ = client_and_tickets()
    paths = {client.post("/enter", json={"token": "good"}, headers=ORIGIN).headers["set-cookie"] for _ in range(2)}
    assert len({path.split("Path=")[1] for path in paths}) == 2
    assert all("Path=/ws/" in path for path in paths)


def test_messages_over_the_rate_are_dropped_and_allowed_again_later() -> None:
    limit = RateLimit(20.0, 40)
    assert sum(limit.allows(100.0) for _ in range(100)) == 40
    assert sum(limit.allows(101.0) for _ in range(100)) == 20


def test_pages_carry_the_security_headers() -> None:
    client, _ = client_and_tickets()
    view = client.post("/enter", json={"token": "good"}, headers=ORIGIN).json()["view"]
    assert b"viser" in client.get(view).content.lower()
    for path in ("/", view, "/static/enter.js"):
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
        assert allowed_kind(pack({"type": kind, "position": [1.0, 2.0, 3.0], "updates": {"value": True}})) == kind


@pytest.mark.parametrize(
    "data",
    [
        pack({"type": "ShareUrlRequest"}),
        pack({"type": "FileTransferStartUpload"}),
        pack({"no": "type"}),
        pack([1, 2]),
        pack({"type": "GuiUpdateMessage", "uuid": "x", "updates": {"update_cb": []}}),
        pack({"type": "GuiUpdateMessage", "uuid": "x", "updates": {"value": 1, "is_button": False}}),
        pack({"type": "ViewerCameraMessage", "position": [math.nan, 0, 0]}),
        pack({"type": "ViewerCameraMessage", "deep": {"a": [math.inf]}}),
        pack({"type": "ViewerCameraMessage", "big": "x" * 70_000}),
        b"\xc1",
        b"",
        b"\x91" * 50_000,
    ],
)
def test_tunnels_uploads_nan_large_and_broken_messages_do_not(data: bytes) -> None:
    assert allowed_kind(data) is None
