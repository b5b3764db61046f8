"""In real Chromium: the program is updated, or its worker hangs, while a page is open. The page says so, or goes on."""

import json
import os
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import BrowserContext, Locator, Page, expect

from human_study.events import Act
from human_study.records import read_study
from human_study.study import StudyBreaks, StudyPractice

from .flow_steps import HOLD_MS, see_step, start
from .flow_studies import hear_ctrl_c, plan_small
from .gateways import running, wait_until

pytestmark = [pytest.mark.browser, pytest.mark.slow]
LONG_MS = 90_000


@contextmanager
def serving(folder: Path, port: int, **choices: Any) -> Iterator[tuple[subprocess.Popen[str], str, list[str]]]:
    """A planned study served with these choices: the program, p01's link, and its lines of standard error."""
    command = [sys.executable, "-m", "tests.personal_viz.serve_with", str(folder), str(folder.parent / "dataset")]
    errors = folder.parent / "errors.txt"
    with errors.open("w") as written:
        process = subprocess.Popen(
            [*command, str(port), json.dumps(choices)],
            stdout=subprocess.PIPE,
            stderr=written,
            text=True,
            preexec_fn=hear_ctrl_c,
        )
    told: list[str] = []
    try:
        assert process.stdout is not None
        link = ""
        for line in process.stdout:
            found = re.search(r"PAN\s+p01\s+(http://\S+)", line)
            link = found.group(1) if found else link
            if "Everything is written to" in line:
                break
        assert link, errors.read_text()
        yield process, link, told
    finally:
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=60)
        told += errors.read_text().splitlines()
    assert process.returncode == 0


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A planned study of one page, then trials."""
    return plan_small(
        tmp_path, flow=("instructions",), practice=StudyPractice(pan=0, pog=0), breaks=StudyBreaks(every=None)
    )


def free_port() -> int:
    """A port that nobody listens on now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def num_steps(folder: Path) -> int:
    """Steps of p01 that are stored; the chains are whole."""
    with read_study(folder) as reader:
        reader.check()
        trial_id = reader.trials("p01")[0].trial_id or ""
        return sum(isinstance(stored.event, Act) for stored in reader.events(trial_id))


def step(page: Page, number: int) -> None:
    """Turns left, which is this step."""
    page.keyboard.press("a", delay=HOLD_MS)
    see_step(page, number)


def notice(page: Page) -> Locator:
    """What says that the program was updated."""
    return page.get_by_role("alertdialog", name="The study's program was updated.")


def test_a_page_of_before_an_upgrade_says_so_and_loads_itself_again(folder: Path, browser: BrowserContext) -> None:
    port, page, loaded = free_port(), browser.new_page(), []
    page.on("request", lambda request: loaded.append(request.url) if request.is_navigation_request() else None)
    with serving(folder, port, page_version="first") as (_, link, _):
        start(page, link)
        see_step(page, 0)
        step(page, 1)
    with serving(folder, port, page_version="second"):
        loaded.clear()
        expect(notice(page)).to_be_visible(timeout=LONG_MS)
        expect(notice(page)).to_contain_text("Nothing that you did is lost.")
        expect(notice(page)).to_contain_text("This page is loaded again in a moment.")
        expect(page.get_by_role("button", name="Load the page again")).to_be_focused()
        page.wait_for_url("**/second")  # loaded by itself
        see_step(page, 1)
        expect(notice(page)).to_be_hidden()
        step(page, 2)
        assert [url.rpartition("/")[2] for url in loaded] == ["first", "second"], "once, and sent on to its own version"
    assert num_steps(folder) == 2


def test_the_button_and_its_key_load_the_page_again(folder: Path, browser: BrowserContext) -> None:
    port, page = free_port(), browser.new_page()
    with serving(folder, port, page_version="first") as (_, link, _):
        start(page, link)
        see_step(page, 0)
        step(page, 1)
        page.get_by_role("button", name="Keys", exact=True).click()  # somebody chooses keys: not by itself then
    with serving(folder, port, page_version="second"):
        expect(notice(page)).to_be_visible(timeout=LONG_MS)
        expect(notice(page)).not_to_contain_text("in a moment")
        page.keyboard.press("Escape")
        page.keyboard.press("a", delay=HOLD_MS)
        expect(notice(page)).to_be_visible()
        button = page.get_by_role("button", name="Load the page again")
        page.keyboard.press("Tab")
        page.keyboard.press("Shift+Tab")
        expect(button).to_be_focused()
        page.keyboard.press("Enter")
        page.wait_for_url("**/second")
        see_step(page, 1)
        step(page, 2)
    assert num_steps(folder) == 2


def test_a_page_that_stays_as_old_as_it_was_is_not_loaded_for_ever(tmp_path: Path, browser: BrowserContext) -> None:
    with running(tmp_path) as gateway:
        page, loaded = browser.new_page(), []
        page.clock.install()
        page.goto(f"{gateway.address}/#good")
        page.wait_for_url("**/view/**")
        page.on("request", lambda request: loaded.append(request.url) if request.is_navigation_request() else None)
        page.route("**/page-version", lambda route: route.fulfill(body="another", content_type="text/plain"))
        page.clock.run_for(12_000)
        expect(notice(page)).to_contain_text("in a moment")
        with page.expect_event("load"):
            page.clock.run_for(8_000)
        assert len(loaded) == 1
        for _ in range(3):
            page.clock.run_for(60_000)
            expect(notice(page)).to_be_visible()
        expect(notice(page)).not_to_contain_text("in a moment")
        assert len(loaded) == 1
        with page.expect_event("load"):
            page.get_by_role("button", name="Load the page again").click()


@pytest.mark.parametrize(
    ("status", "body"), [(502, "a proxy's words"), (200, "<html>a proxy's page</html>"), (404, "none"), (200, "")]
)
def test_other_answers_than_a_version_are_not_taken_for_an_update(
    tmp_path: Path, browser: BrowserContext, status: int, body: str
) -> None:
    with running(tmp_path) as gateway:
        page = browser.new_page()
        page.route("**/page-version", lambda route: route.fulfill(status=status, body=body))
        page.clock.install()
        page.goto(f"{gateway.address}/#good")
        page.wait_for_url("**/view/**")
        with page.expect_response("**/page-version"):
            page.clock.run_for(12_000)
        with page.expect_response("**/page-version"):
            page.clock.run_for(3_000)
        assert notice(page).count() == 0


def children(pid: int) -> list[int]:
    """Processes that a process has started."""
    return [int(child) for path in Path(f"/proc/{pid}/task").glob("*/children") for child in path.read_text().split()]


def test_a_page_goes_on_after_its_worker_hung(folder: Path, browser: BrowserContext) -> None:
    page = browser.new_page()
    with serving(folder, free_port(), patience_s=10, every_s=0.2) as (process, link, told):
        start(page, link)
        see_step(page, 0)
        step(page, 1)
        (worker,) = children(process.pid)
        os.kill(worker, signal.SIGSTOP)
        wait_until(lambda: worker not in children(process.pid), patience_s=120)
        wait_until(lambda: len(children(process.pid)) == 1)

        def is_further() -> bool:
            page.keyboard.press("a", delay=HOLD_MS)
            page.wait_for_timeout(2000)  # a press into a lost line is lost: a person presses again
            return num_steps(folder) > 1

        wait_until(is_further, patience_s=150)
    assert num_steps(folder) >= 2
    line = "viser worker 1 has not answered for 10 s and was killed; it is started again."
    assert sum(line in text for text in told) == 1
