"""A program is killed, ended and started again while people are online: nothing acknowledged is lost, all go on."""

import json
import os
import re
import signal
from pathlib import Path

import psutil
import pytest
from playwright.sync_api import BrowserContext, Page, expect

from personal_viz.study_app.operator.served import free_port

from .flow_steps import acts, progress, see_step, start, take_step
from .flow_studies import PlannedStudy, children, served
from .gateways import wait_until

pytestmark = [pytest.mark.browser, pytest.mark.slow]
CODE = "p01"
"""The participant who walks."""


def dashboard(program: PlannedStudy) -> str:
    """The link for the researcher."""
    link = re.search(r"for you only: (http://\S+)", program.said)
    return link.group(1)


def test_an_open_page_goes_on_after_the_program_was_killed_and_after_it_was_ended(
    quick_folder: Path, browser: BrowserContext
) -> None:
    folder, port, page, watch = quick_folder, free_port(), browser.new_page(), browser.new_page()
    row = watch.get_by_role("row").filter(has_text=CODE)
    with served(folder, folder.parent / "dataset", port=port) as first:
        start(page, first.links[CODE])
        see_step(page, 0)
        take_step(page, 1)
        take_step(page, 2, "w")
        watch.goto(dashboard(first))
        expect(row).to_contain_text("open")
        expect(row).to_contain_text("trial 1 of")
        workers = children(first.process.pid)
        os.kill(first.process.pid, signal.SIGKILL)  # as the system does when memory runs out, with nothing tidied up
        first.process.wait(timeout=30)
    assert len(workers) == 1
    wait_until(lambda: not any(psutil.pid_exists(worker) for worker in workers))
    assert len(acts(folder, CODE)) == 2
    before = progress(folder, CODE)
    assert (before.is_in_trial, before.num_reconnects) == (True, 0)
    expect(watch.get_by_text("The study does not answer")).to_be_visible()

    with served(folder, folder.parent / "dataset", port=port, ended_by=signal.SIGTERM) as second:
        assert second.links == first.links
        require_new_link(watch, dashboard(second), dashboard(first).partition("#")[2])
        expect(row).to_contain_text("trial 1 of")
        page.bring_to_front()
        wait_until(lambda: progress(folder, CODE).num_reconnects)  # the page comes back by itself
        expect(page.get_by_alt_text("What the robot sees")).to_have_attribute("data-step", "2", timeout=60_000)
        after = progress(folder, CODE)
        assert (after.place, after.num_abandoned, after.num_technical) == ("trial", 0, 0)
        take_step(page, 3, "d")

    with served(folder, folder.parent / "dataset", port=port):
        reconnects = progress(folder, CODE).num_reconnects
        wait_until(lambda: progress(folder, CODE).num_reconnects > reconnects)
        see_step(page, 3)
        take_step(page, 4)
    stored = acts(folder, CODE)
    assert [act.action.value for act in stored] == ["left", "forward", "right", "left"]
    assert stored[2].position == stored[1].position, "it stands where it stood when the program was killed"
    require_secrets_of_the_owner_only(folder)


def require_secrets_of_the_owner_only(folder: Path) -> None:
    """Others cannot read the personal links, and the database does not hold them."""
    secrets = json.loads((folder / "secrets.json").read_text())
    assert (folder / "secrets.json").stat().st_mode & 0o077 == 0
    database = (folder / "study.db").read_bytes()
    assert not any(token.encode() in database for token in secrets["tokens"].values())


def require_new_link(watch: Page, link: str, old_token: str) -> None:
    """The token from before the restart opens nothing; the new one opens the page."""
    watch.goto("about:blank")
    watch.goto(link.partition("#")[0] + "#" + old_token)
    expect(watch.get_by_text("This page needs the link that the terminal shows")).to_be_visible()
    expect(watch.locator("#page")).to_be_hidden()
    watch.goto("about:blank")
    watch.goto(link)
    expect(watch.get_by_role("heading", name="Participants")).to_be_visible()
