"""The gateway's routes: admission, sessions, cookies and headers."""

from pathlib import Path

import pytest
from starlette.websockets import WebSocketDisconnect

from personal_viz.study_app.gateway.admission import DeviceProfile
from personal_viz.study_app.gateway.app import SESSION_COOKIE
from personal_viz.study_app.gateway.options import ServeOptions
from personal_viz.study_app.page_script import page_version

from .gateways import Site, site

ORIGIN = {"origin": "http://127.0.0.1"}
DEVICE = {"webgl2": True, "width": 1283, "height": 760, "dpr": 1.1, "touch": False}
PUBLIC = ServeOptions(bind="0.0.0.0", public=True, hosts=("study.example.org",), proxy="10.0.0.9")


def closed_with(at: Site, url: str, headers: dict[str, str]) -> int:
    """The code with which a websocket is refused."""
    with pytest.raises(WebSocketDisconnect) as refused, at.client.websocket_connect(url, headers=headers):
        pass
    return refused.value.code


def ticket_in(reply) -> str:
    """The ticket id that a reply to `/enter` holds."""
    assert reply.status_code == 200
    return ticket_of(reply.json()["view"])


def ticket_of(view: str) -> str:
    """The ticket id in the address of a view."""
    return view.partition("/ws/")[2].partition("/")[0]


def test_a_known_token_becomes_a_session_and_a_view(tmp_path: Path) -> None:
    at = site(tmp_path)
    reply = at.client.post("/enter", json={"token": "good", "device": DEVICE}, headers=ORIGIN)
    ticket = at.tickets.find(ticket_in(reply))
    assert ticket.code == "p01"
    assert ticket.admits(reply.cookies.get(SESSION_COOKIE, path=f"/ws/{ticket_in(reply)}"))
    assert not ticket.admits("")
    assert ticket.profile == DeviceProfile(webgl2=True, width=1300, height=800, dpr=1.0, touch=False)
    assert "HttpOnly" in reply.headers["set-cookie"]
    assert "SameSite=strict" in reply.headers["set-cookie"]
    assert "Secure" not in reply.headers["set-cookie"], "a browser would not send it over http"
    assert reply.json()["view"].startswith("/view/?websocket=ws://127.0.0.1/ws/")


def test_behind_tls_the_cookie_is_secure_and_the_websocket_too(tmp_path: Path) -> None:
    at = site(tmp_path, options=PUBLIC)
    public = {"host": "study.example.org", "origin": "https://study.example.org"}
    reply = at.client.post("/enter", json={"token": "good"}, headers=public)
    assert "Secure" in reply.headers["set-cookie"]
    assert reply.json()["view"].startswith("/view/?websocket=wss://study.example.org/ws/")
    assert reply.headers["strict-transport-security"] == "max-age=86400"
    insecure = {**public, "origin": "http://study.example.org"}
    assert at.client.post("/enter", json={"token": "good"}, headers=insecure).status_code == 403
    assert "strict-transport-security" not in at.client.get("/").headers, "loopback has no TLS"


@pytest.mark.parametrize(
    "body",
    [
        b'{"token":"bad"}',
        b"{}",
        b"",
        b"[1]",
        b"\xff",
        b'{"token":1}',
        b'{"token":"good","device":{"webgl2":"yes"}}',
        b'{"token":"good","device":' + b'{"a":' * 700 + b"1" + b"}" * 701,
        b'{"token":' + b'"' + b"a" * 5000 + b'"}',
    ],
)
def test_anything_else_is_refused_with_the_same_words(tmp_path: Path, body: bytes) -> None:
    reply = site(tmp_path).client.post("/enter", content=body, headers=ORIGIN)
    assert (reply.status_code, reply.text) == (401, "unknown token")


def test_a_token_with_half_a_letter_is_refused_not_an_error(tmp_path: Path) -> None:
    body = b'{"token":"\\ud800"}'
    assert site(tmp_path).client.post("/enter", content=body, headers=ORIGIN).status_code == 401


@pytest.mark.parametrize(
    "origin", ["http://evil.test", "http://127.0.0.1:81", "https://127.0.0.1", "null", "http://[", "", None]
)
def test_foreign_origins_are_refused(tmp_path: Path, origin: str | None) -> None:
    headers = {} if origin is None else {"origin": origin}
    at = site(tmp_path, recruit="link")
    assert at.client.post("/enter", json={"token": "good"}, headers=headers).status_code == 403
    assert at.client.post("/join", json={}, headers=headers).status_code == 403
    assert at.people.claimed == {}


@pytest.mark.parametrize("host", ["evil.test", "[", "127.0.0.1.evil.test", "evil#127.0.0.1", "evil@127.0.0.1", ""])
def test_foreign_hosts_are_refused(tmp_path: Path, host: str) -> None:
    at = site(tmp_path)
    assert at.client.get("/", headers={"host": host}).status_code == 400
    assert at.client.get("/", headers={"host": "LocalHost:8080"}).status_code == 200


def test_a_newer_ticket_revokes_the_older_one_and_its_page_asks_for_the_link(tmp_path: Path) -> None:
    at = site(tmp_path)
    old, new = (at.client.post("/enter", json={"token": "good"}, headers=ORIGIN).json()["view"] for _ in range(2))
    assert at.tickets.find(ticket_of(old)) is None
    assert at.tickets.find(ticket_of(new)) is not None
    assert b"enter.js" in at.client.get(old).content
    assert b"viser" in at.client.get(new).content.lower()


def test_two_participants_in_one_browser_keep_their_sessions(tmp_path: Path) -> None:
    at = site(tmp_path)
    paths = {
        at.client.post("/enter", json={"token": token}, headers=ORIGIN).headers["set-cookie"].split("Path=/ws/")[1]
        for token in ("good", "fine")
    }
    assert len(paths) == 2


def test_ten_wrong_tokens_a_minute_are_answered_for_each_address_and_a_right_one_always(tmp_path: Path) -> None:
    at = site(tmp_path, options=PUBLIC, peer="10.0.0.9")

    def tries(token: str, address: str) -> int:
        headers = {**ORIGIN, "x-forwarded-for": f"203.0.113.200, {address}"}
        return at.client.post("/enter", json={"token": token}, headers=headers).status_code

    assert [tries(f"guess{number}", "192.0.2.1") for number in range(12)] == [401] * 10 + [429] * 2
    assert tries("good", "192.0.2.1") == 200, "others may be behind the guesser's router"
    assert tries("guess", "192.0.2.1") == 429
    assert tries("good", "192.0.2.2") == 200
    assert [tries("good", "192.0.2.3") for _ in range(30)] == [200] * 30, "a person who knows the token does not guess"


def test_the_open_link_gives_places_until_the_study_is_full_and_other_studies_have_no_such_page(tmp_path: Path) -> None:
    at = site(tmp_path, recruit="link")
    assert b"enter.js" in at.client.get("/join").content
    replies = [at.client.post("/join", json={}, headers=ORIGIN).json() for _ in range(4)]
    assert replies == [{"token": "good"}, {"token": "fine"}, {"token": "nice"}, {"full": True, "code": "FULL-1"}]
    at = site(tmp_path)
    assert at.client.get("/join").status_code == 404
    assert at.client.post("/join", json={}, headers=ORIGIN).status_code == 404


def test_prolific_parameters_bring_the_same_person_to_the_same_place(tmp_path: Path) -> None:
    at = site(tmp_path, recruit="prolific")
    query = "/join?PROLIFIC_PID=5f1e<script>&STUDY_ID=1"
    page = at.client.get(query)
    assert "5f1e" not in page.text
    assert at.client.post("/join", json={}, headers=ORIGIN).status_code == 400
    tokens = [
        at.client.post("/join", json={"PROLIFIC_PID": person}, headers=ORIGIN).json()["token"]
        for person in ("aaaa1111", "bbbb2222", "aaaa1111")
    ]
    assert tokens == ["good", "fine", "good"]
    assert not any("aaaa1111" in str(known) for known in at.people.claimed.values())


@pytest.mark.parametrize("person", ["abc", "x" * 65, "../../etc", "<b>bold</b>", "a b c d", "=1+1aaa", 12345678, "\n"])
def test_ids_of_another_shape_are_refused(tmp_path: Path, person: object) -> None:
    at = site(tmp_path, recruit="prolific")
    assert at.client.post("/join", json={"PROLIFIC_PID": person}, headers=ORIGIN).status_code == 400
    assert at.people.claimed == {}


def test_a_full_disk_is_a_pause_for_the_newcomer_and_a_message_for_the_researcher(tmp_path: Path) -> None:
    at = site(tmp_path, recruit="link")
    at.people.is_full = True
    assert at.client.post("/join", json={}, headers=ORIGIN).status_code == 503
    assert at.told == ["study.db: the disk is full; expected space. Free some."]


def test_pages_carry_the_security_headers(tmp_path: Path) -> None:
    at = site(tmp_path)
    view = at.client.post("/enter", json={"token": "good"}, headers=ORIGIN).json()["view"]
    for path in ("/", view, "/static/enter.js", "/nothing", "/check/download"):
        headers = at.client.get(path).headers
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["referrer-policy"] == "no-referrer"
        assert headers["x-frame-options"] == "DENY"
        assert headers["cache-control"] == "no-store"
        assert headers["cross-origin-opener-policy"] == "same-origin"
        assert "frame-ancestors 'none'" in headers["content-security-policy"]
        assert "server" not in headers
    assert "unsafe-inline" not in at.client.get("/").headers["content-security-policy"]


@pytest.mark.parametrize("path", ["/admin", "/dashboard", "/status", "/api/status", "/study.db", "/keys.json", "/docs"])
def test_admin_pages_and_files_are_not_reachable(tmp_path: Path, path: str) -> None:
    assert site(tmp_path).client.get(path).status_code == 404


@pytest.mark.parametrize("method", ["PUT", "DELETE", "PATCH", "OPTIONS", "TRACE", "POST"])
def test_pages_are_only_read(tmp_path: Path, method: str) -> None:
    assert site(tmp_path).client.request(method, "/").status_code == 405


@pytest.mark.parametrize(
    ("ticket", "cookie", "origin"),
    [
        ("other", "own", "own"),
        ("own", "other", "own"),
        ("own", "none", "own"),
        ("fine", "own", "own"),
        ("own", "own", "http://evil.test"),
        ("own", "own", None),
    ],
)
def test_the_websocket_opens_only_with_its_own_ticket_cookie_and_origin(
    tmp_path: Path, ticket: str, cookie: str, origin: str | None
) -> None:
    at = site(tmp_path)
    session_id, ticket_id = at.tickets.issue("p01")
    _, of_another = at.tickets.issue("p02")
    cookies = {"own": session_id, "other": "x"}
    headers = {"cookie": f"{SESSION_COOKIE}={cookies[cookie]}"} if cookie in cookies else {}
    if origin:
        headers["origin"] = "http://127.0.0.1" if origin == "own" else origin
    url = f"ws://127.0.0.1/ws/{ {'own': ticket_id, 'fine': of_another}.get(ticket, 'x') }"
    assert closed_with(at, url, headers) == 1008


@pytest.mark.parametrize(
    ("is_revoked", "version", "code"),
    [
        pytest.param(True, "", 1008, id="a revoked ticket opens nothing"),
        pytest.param(False, f"/{page_version()}", 1013, id="a worker that is gone asks for a later try"),
    ],
)
def test_a_websocket_that_leads_nowhere_is_closed(tmp_path: Path, is_revoked: bool, version: str, code: int) -> None:
    at = site(tmp_path)
    session_id, ticket_id = at.tickets.issue("p01")
    if is_revoked:
        at.tickets.revoke("p01")
    headers = {"cookie": f"{SESSION_COOKIE}={session_id}", **ORIGIN}
    assert closed_with(at, f"ws://127.0.0.1/ws/{ticket_id}{version}", headers) == code


def test_downloads_for_the_doctor_say_whether_the_proxy_names_its_client_and_are_limited(tmp_path: Path) -> None:
    at = site(tmp_path, options=PUBLIC, peer="10.0.0.9")
    public = {"host": "study.example.org"}
    reply = at.client.get("/check/download", headers={**public, "x-forwarded-for": "192.0.2.1"})
    assert len(reply.content) == 256 * 1024
    assert reply.headers["x-study-proxy"] == "named"
    flags = reply.headers["set-cookie"]
    assert all(flag in flags for flag in ("Secure", "HttpOnly", "SameSite=strict", "Path=/check/"))
    silent = [at.client.get("/check/download", headers=public) for _ in range(11)]
    assert silent[0].headers["x-study-proxy"] == "silent"
    assert [reply.status_code for reply in silent] == [200] * 10 + [429]
    assert site(tmp_path).client.get("/check/download").headers["x-study-proxy"] == "none"
