"""The researcher's page: it needs a token, shows places but never outcomes, and participants cannot reach it."""

import json
import re
import socket
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import pytest
from playwright.sync_api import BrowserContext, expect
from starlette.testclient import TestClient

from human_study.journey import has_reached
from human_study.store.store import StudyStore
from personal_viz.study_app.gateway.app import STATIC
from personal_viz.study_app.gateway.lease_keeper import LeaseKeeper
from personal_viz.study_app.gateway.workers import Worker, WorkerPool
from personal_viz.study_app.operator.dashboard import LOOK_EVERY_S, PAGE, Dashboard, dashboard, serving_of
from personal_viz.study_app.operator.progress_view import Serving, ShownStudy, ShownWorker
from personal_viz.study_app.worker_door import WorkerDoor
from sim.errors import StudyError
from tests.human_study.finished import study_with_trials
from tests.human_study.small_world import CANARY
from tests.human_study.stores import begin_next, do_next

from .busy_studies import SERVING, busy_study
from .gateways import site

PORT = 4321
ORIGIN = f"http://127.0.0.1:{PORT}"


def client_of(page: Dashboard) -> TestClient:
    """A browser at the page's address."""
    return TestClient(page.app(PORT), base_url=ORIGIN)


@contextmanager
def let_in(folder: Path, serving: Serving = SERVING) -> Iterator[TestClient]:
    """A browser that has shown the token."""
    page = Dashboard(folder, serving=lambda: serving)
    client = client_of(page)
    assert client.post("/enter", content=page.token, headers={"Origin": ORIGIN}).status_code == 204
    yield client


@pytest.fixture(scope="module")
def busy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a study in the middle of its collection."""
    folder = tmp_path_factory.mktemp("busy")
    busy_study(folder).close()
    return folder


def test_the_page_shows_nothing_without_the_token(busy: Path) -> None:
    page = Dashboard(busy)
    client = client_of(page)
    assert client.get("/progress").status_code == 401
    assert client.post("/enter", content="wrong", headers={"Origin": ORIGIN}).status_code == 401
    assert client.get("/progress").status_code == 401
    assert client.get("/progress", cookies={f"personal_dashboard_{PORT}": page.token}).status_code == 401
    for path in ("/", "/dashboard.js", "/dashboard.css"):
        reply = client.get(path)
        assert reply.status_code == 200
        assert page.token not in reply.text
        assert "p01" not in reply.text


def test_the_token_becomes_a_cookie_that_scripts_and_other_sites_cannot_use(busy: Path) -> None:
    page = Dashboard(busy)
    reply = client_of(page).post("/enter", content=page.token, headers={"Origin": ORIGIN})
    cookie = reply.headers["set-cookie"]
    assert page.token not in cookie
    assert all(part in cookie for part in ("HttpOnly", "SameSite=strict", "Path=/progress"))


def test_another_sites_page_and_another_host_name_are_refused(busy: Path) -> None:
    page = Dashboard(busy)
    client = client_of(page)
    for origin in ("http://evil.example", f"http://127.0.0.1:{PORT + 1}", "null"):
        assert client.post("/enter", content=page.token, headers={"Origin": origin}).status_code == 403
    assert client.post("/enter", content=page.token).status_code == 403
    for host in ("evil.example", "study.example.org"):
        assert client.get("/", headers={"Host": host}).status_code == 400


def test_guesses_are_limited_and_do_not_keep_out_the_right_token(busy: Path) -> None:
    page = Dashboard(busy)
    client = client_of(page)
    replies = [client.post("/enter", content=f"g{n}", headers={"Origin": ORIGIN}).status_code for n in range(12)]
    assert replies == [401] * 10 + [429] * 2
    assert client.post("/enter", content=page.token, headers={"Origin": ORIGIN}).status_code == 204


def test_pages_have_the_strict_headers_and_no_inline_script(busy: Path) -> None:
    reply = client_of(Dashboard(busy)).get("/")
    policy = reply.headers["content-security-policy"]
    assert policy == "default-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'self'"
    assert reply.headers["cache-control"] == "no-store"
    assert "<script>" not in reply.text
    assert " style=" not in reply.text
    assert "onclick" not in reply.text


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH"])
def test_nothing_but_entering_changes_anything(busy: Path, method: str) -> None:
    with let_in(busy) as client:
        assert client.request(method, "/progress", headers={"Origin": ORIGIN}).status_code == 405


def test_the_page_shows_the_place_of_everybody(busy: Path) -> None:
    with let_in(busy) as client:
        found = client.get("/progress").json()
    people = found["progress"]["people"]
    where = {
        one["code"]: (one["state"], words["where"], words["here"])
        for one, words in zip(people, found["people"], strict=True)
    }
    assert where["p01"] == ("active", "trial 3 of 4", True)
    assert where["p04"] == ("out", "withdrawn", False)
    assert where["p05"] == ("active", "consent", True)
    assert where["p06"][1] == "questions"
    assert found["progress"]["is_pilot"]
    assert found["workers"] == [
        {"number": 1, "state": "serving", "people": 3},
        {"number": 2, "state": "starting", "people": 0},
    ]
    progress = found["progress"]
    num_done = progress["num_done"]
    assert sum(one["num_done"] for one in progress["slots"]) == num_done == progress["timeline"][-1]["num_done"]


def test_no_outcome_is_on_the_page(tmp_path: Path) -> None:
    study_with_trials(tmp_path)
    with let_in(tmp_path, Serving()) as client:
        text = client.get("/progress").text
    assert set(json.loads(text)) == set(ShownStudy.__struct_fields__)
    names = set(re.findall(r'"(\w+)":', text))
    assert not {"success", "spl", "softspl", "distance", "dtg", "end_reason", "steps", "confidence"} & names
    assert all(f'"{word}"' not in text for word in ("stop", "click", "giveup", "timeout", "success", "spl"))
    assert CANARY not in text


def test_the_database_is_looked_at_once_for_many_pages(busy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [100.0]
    monkeypatch.setattr("personal_viz.study_app.operator.dashboard.time.monotonic", lambda: clock[0])
    with let_in(busy) as client:
        first = client.get("/progress").json()["progress"]["now_ns"]
        assert client.get("/progress").json()["progress"]["now_ns"] == first
        clock[0] += LOOK_EVERY_S
        assert client.get("/progress").json()["progress"]["now_ns"] > first


def test_a_study_that_cannot_be_read_is_reported_without_details(busy: Path, tmp_path: Path) -> None:
    with let_in(tmp_path) as client:
        reply = client.get("/progress")
    assert (reply.status_code, reply.text) == (503, "the study cannot be read now")


def test_a_taken_port_is_one_line(tmp_path: Path) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        with (
            pytest.raises(StudyError, match=f"port {port} .*expected a free one.*--dashboard-port"),
            dashboard(tmp_path, port),
        ):
            pass


def test_the_server_is_on_loopback_and_ends_with_the_block(busy: Path) -> None:
    with dashboard(busy) as url:
        address, _, token = url.partition("/#")
        assert address.startswith("http://127.0.0.1:")
        assert len(token) >= 22
        with urllib.request.urlopen(address, timeout=30) as reply:
            assert "PersONAL study" in reply.read().decode()
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(address, timeout=30)


def test_the_gateway_does_not_know_the_page(tmp_path: Path) -> None:
    assert not list(STATIC.rglob("dashboard*"))
    assert STATIC not in PAGE.parents
    for path in ("/dashboard", "/dashboard.js", "/progress", "/static/dashboard.html"):
        assert site(tmp_path).client.get(path).status_code == 404


def test_the_serving_process_tells_of_its_workers_and_open_pages(tmp_path: Path) -> None:
    with busy_study(tmp_path) as store:
        keeper = LeaseKeeper(store, tell=print)
        pool = WorkerPool.__new__(WorkerPool)
        pool.workers = [Worker(number) for number in (1, 2, 3)]
        for worker, code, door in zip(pool.workers, (None, None, 1), (WorkerDoor(9001, "s"), None, None), strict=True):
            worker.process, worker.door = SimpleNamespace(poll=lambda code=code: code), door
        pool.workers[0].codes["p01"] = 2
        with keeper.present("p01"):
            found = serving_of(pool, keeper)
    assert found.workers == (ShownWorker(1, "serving", 1), ShownWorker(2, "starting", 0), ShownWorker(3, "ended", 0))
    assert found.here == {"p01"}


@pytest.mark.browser
@pytest.mark.slow
def test_the_page_follows_the_study_without_reloading(tmp_path: Path, browser: BrowserContext) -> None:
    errors: list[str] = []
    with busy_study(tmp_path) as store, dashboard(tmp_path, serving=lambda: SERVING) as url:
        page = browser.new_page()
        page.on("console", lambda message: errors.append(message.text))
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.goto(url)
        expect(page.get_by_role("heading", name="kitchens-2026")).to_be_visible()
        assert "#" not in page.url, "the token stays out of sight"
        row = page.get_by_role("row").filter(has_text="p06")
        expect(row).to_contain_text("questions")
        page.evaluate("window.isSamePage = true")
        _go_on(store)
        expect(row).to_contain_text("trial 2 of 4")
        expect(page.locator("#others")).not_to_contain_text("p06")
        page.reload()
        expect(row).to_contain_text("trial 2 of 4")
    expect(page.get_by_text("The study does not answer")).to_be_visible()
    assert [text for text in errors if "ERR_CONNECTION_REFUSED" not in text] == []


def _go_on(store: StudyStore) -> None:
    store.enter_stage("p06", "quiz_passed")
    do_next(store, "p06")
    begin_next(store, "p06")
    assert has_reached(store.participant("p06").stages, "quiz_passed")
