"""In real Chromium: the program is updated, or its worker hangs, while a page is open. The page says so, or goes on."""

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import BrowserContext, Locator, Page, expect

from personal_viz.study_app.operator.served import free_port, served

from .conftest import Profiles
from .flow_steps import HOLD_MS, acts, progress, see_step, start, take_step
from .flow_studies import children
from .gateways import running, wait_until

pytestmark = [pytest.mark.browser, pytest.mark.slow]
LONG_MS = 90_000


@contextmanager
def serving(
    folder: Path, port: int, **choices: Any
) -> Iterator[tuple[subprocess.Popen[str], dict[str, str], list[str]]]:
    """A planned study served with these choices: the program, links to PAN, and its lines of standard error."""
    command = [sys.executable, "-m", "tests.personal_viz.serve_with", str(folder), str(folder.parent / "dataset")]
    errors, told = folder.parent / "errors.txt", list[str]()
    with errors.open("w") as written, served([*command, str(port), json.dumps(choices)], stderr=written) as program:
        process, said = program.process, program.said
        links = dict(re.findall(r"PAN\s+(p\d+)\s+(http://\S+)", said))
        assert links, errors.read_text()
        yield process, links, told
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=60)
        told += errors.read_text().splitlines()
    assert process.returncode == 0


def notice(page: Page) -> Locator:
    """The notice that the program was updated."""
    return page.get_by_role("alertdialog", name="The study's program was updated.")


def test_a_page_from_before_an_upgrade_says_so_and_loads_itself_or_by_a_button(
    quick_folder: Path, browser: BrowserContext, chromium: Profiles
) -> None:
    folder, port, page, loaded = quick_folder, free_port(), browser.new_page(), list[str]()
    page.on("request", lambda request: loaded.append(request.url) if request.is_navigation_request() else None)
    with chromium() as other_profile:
        chooser = other_profile.new_page()
        with serving(folder, port, page_version="first") as (_, links, _):
            codes = list(links)[:2]
            for person, code in zip((page, chooser), codes, strict=True):
                start(person, links[code])
                see_step(person, 0)
                take_step(person, 1)
            chooser.get_by_role("button", name="Keys", exact=True).click()  # this page is not loaded by itself then
        with serving(folder, port, page_version="second"):
            loaded.clear()
            see_it_load_itself(page, loaded)
            load_it_by_the_button(chooser)
    assert [len(acts(folder, code)) for code in codes] == [2, 2]


def see_it_load_itself(page: Page, loaded: list[str]) -> None:
    """Sees the notice, the same trial in a page of the new version, and the second step; `loaded` grows."""
    expect(notice(page)).to_be_visible(timeout=LONG_MS)
    expect(notice(page)).to_contain_text("Nothing that you did is lost.")
    expect(notice(page)).to_contain_text("This page is loaded again in a moment.")
    expect(page.get_by_role("button", name="Load the page again")).to_be_focused()
    page.wait_for_url("**/second")
    see_step(page, 1)
    expect(notice(page)).to_be_hidden()
    take_step(page, 2)
    assert [url.rpartition("/")[2] for url in loaded] == ["first", "second"], "once, and sent on to its own version"


def load_it_by_the_button(page: Page) -> None:
    """Keys only move to the button of the notice, which loads the same trial; then comes the second step."""
    expect(notice(page)).to_be_visible(timeout=LONG_MS)
    expect(notice(page)).not_to_contain_text("in a moment")
    page.keyboard.press("Escape")
    page.keyboard.press("a", delay=HOLD_MS)
    expect(notice(page)).to_be_visible()
    page.keyboard.press("Tab")
    page.keyboard.press("Shift+Tab")
    expect(page.get_by_role("button", name="Load the page again")).to_be_focused()
    page.keyboard.press("Enter")
    page.wait_for_url("**/second")
    see_step(page, 1)
    take_step(page, 2)


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
def test_answers_that_are_no_version_do_not_count_as_an_update(
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


def test_a_page_goes_on_after_its_worker_died_and_after_it_hung(quick_folder: Path, browser: BrowserContext) -> None:
    folder, page = quick_folder, browser.new_page()
    with serving(folder, free_port(), patience_s=5, every_s=0.2) as (process, links, told):
        start(page, links["p01"])
        see_step(page, 0)
        take_step(page, 1)
        for number, harm in ((2, signal.SIGKILL), (3, signal.SIGSTOP)):
            (worker,), before = children(process.pid), progress(folder, "p01").num_reconnects
            os.kill(worker, harm)
            wait_until(lambda gone=worker: gone not in children(process.pid), patience_s=120)
            wait_until(lambda before=before: progress(folder, "p01").num_reconnects > before, patience_s=150)
            see_step(page, number - 1)
            take_step(page, number)
    assert len(acts(folder, "p01")) == 3
    assert sum("viser worker 1 ended; it is started again." in text for text in told) == 1
    line = "viser worker 1 has not answered for 5 s and was killed; it is started again."
    assert sum(line in text for text in told) == 1
