"""In real Chromium: the open link, a worker that dies, a study that is served again, and the page that stays open."""

import os
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from playwright.sync_api import BrowserContext, Page, expect

from human_study.events import Act
from human_study.records import read_study
from sim.episodes.generation import invent_dataset

from .flow_steps import HOLD_MS
from .gateways import running, wait_until

pytestmark = pytest.mark.browser


def children(pid: int) -> list[int]:
    """Processes that a process has started."""
    return [int(child) for path in Path(f"/proc/{pid}/task").glob("*/children") for child in path.read_text().split()]


def free_port() -> int:
    """A port that nobody listens on now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def hear_ctrl_c() -> None:
    """Signals as at a terminal, also where the test's own shell ignores them."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


@contextmanager
def served_at(port: int, folder: Path) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """`study serve` on a small home with one worker, and its PAN link; ended by SIGTERM with the block."""
    command = [sys.executable, "-m", "personal_viz", "study", "serve", "--dataset", str(folder / "data")]
    command += ["--scene", "Small", "--out", str(folder / "study"), "--port", str(port), "--workers", "1"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, preexec_fn=hear_ctrl_c)
    try:
        assert process.stdout is not None
        link = ""
        for line in process.stdout:
            found = re.search(r"PAN\s+p\d+\s+(http://\S+)", line)
            link = found.group(1) if found else link
            if "Everything is written to" in line:
                break
        assert link
        yield process, link
    finally:
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=60)
    assert process.returncode == 0


def num_steps(folder: Path) -> int:
    """Steps that are stored of the participant who walks."""
    with read_study(folder / "study") as reader:
        reader.check()
        trials = [trial for code in reader.codes() for trial in reader.trials(code) if trial.trial_id is not None]
        return sum(isinstance(stored.event, Act) for trial in trials for stored in reader.events(trial.trial_id or ""))


def walks_on(page: Page, folder: Path) -> None:
    """Presses until one more step is stored; a press into a lost line is lost, and the page shows what is stored."""
    before = num_steps(folder)

    def is_further() -> bool:
        page.keyboard.press("a", delay=HOLD_MS)
        page.wait_for_timeout(2000)
        return num_steps(folder) > before

    wait_until(is_further, patience_s=150)
    wait_until(lambda: page.get_by_text(f"Step {num_steps(folder)} of 500").count() == 1)


def begins(page: Page, link: str) -> None:
    """Opens the link and starts the first trial."""
    page.goto(link)
    page.get_by_role("button", name="Start").click()
    expect(page.get_by_text("Step 0 of 500")).to_be_visible()


def test_a_page_goes_on_after_its_worker_died(tmp_path: Path, browser: BrowserContext) -> None:
    invent_dataset(tmp_path / "data", name="Small", seed=3)
    page = browser.new_page()
    with served_at(free_port(), tmp_path) as (process, link):
        begins(page, link)
        (worker,) = children(process.pid)
        os.kill(worker, signal.SIGKILL)
        wait_until(lambda: children(process.pid) not in ([], [worker]))
        walks_on(page, tmp_path)


def test_a_page_goes_on_after_the_study_was_served_again(tmp_path: Path, browser: BrowserContext) -> None:
    invent_dataset(tmp_path / "data", name="Small", seed=3)
    port, page = free_port(), browser.new_page()
    with served_at(port, tmp_path) as (_, link):
        begins(page, link)
    with served_at(port, tmp_path):
        walks_on(page, tmp_path)


def test_the_open_link_leads_to_a_place_and_the_same_person_back_to_it(tmp_path: Path, browser: BrowserContext) -> None:
    with running(tmp_path, recruit="link") as gateway:
        for answer in (None, "Yes: go on where I stopped", "No: I begin anew"):
            page = browser.new_page()
            page.goto(f"{gateway.address}/join")
            if answer is not None:
                page.get_by_role("button", name=answer).click()
            page.wait_for_url("**/view/**")
            page.close()
            assert set(gateway.people.claimed) == ({"p01", "p02"} if answer and answer.startswith("No") else {"p01"})


def test_a_full_study_says_so_and_shows_the_code(tmp_path: Path, browser: BrowserContext) -> None:
    with running(tmp_path, recruit="prolific") as gateway:
        gateway.people.claimed.update({"p01": "a", "p02": "b", "p03": "c"})
        page = browser.new_page()
        page.goto(f"{gateway.address}/join?PROLIFIC_PID=5f1e0c9a7b3d&STUDY_ID=64aa&SESSION_ID=77bb")
        expect(page.get_by_text("The study is full")).to_be_visible()
        expect(page.get_by_text("You will be paid")).to_be_visible()
        expect(page.get_by_text("FULL-1")).to_be_visible()


@pytest.mark.parametrize(
    ("path", "text"),
    [
        ("/#wrong", "This link is not known"),
        ("/", "This page needs your personal link"),
        ("/join", "This link is incomplete"),
        ("/join?PROLIFIC_PID=%3Cimg%20src%3Dx%20onerror%3Dalert(1)%3E", "This link is incomplete"),
    ],
)
def test_a_link_that_is_not_whole_is_explained(tmp_path: Path, browser: BrowserContext, path: str, text: str) -> None:
    with running(tmp_path, recruit="prolific") as gateway:
        page = browser.new_page()
        problems: list[str] = []
        page.on("pageerror", lambda error: problems.append(str(error)))
        page.on("dialog", lambda dialog: problems.append(dialog.message))
        page.goto(gateway.address + path)
        expect(page.get_by_text(text)).to_be_visible()
        assert problems == []


def test_the_profile_of_the_device_is_coarse(tmp_path: Path, browser: BrowserContext) -> None:
    with running(tmp_path) as gateway:
        page = browser.new_page()
        page.goto(f"{gateway.address}/#good")
        page.wait_for_url("**/view/**")
        profile = gateway.tickets.client_profile("p01")
        assert profile == {"webgl2": True, "width": 1300, "height": 800, "dpr": 1.0, "touch": False}
