"""The whole program is killed while people are online and started again: who was where, nothing acknowledged lost."""

import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest
from playwright.sync_api import BrowserContext, Page, expect

from human_study.events import Act
from human_study.progress import study_progress
from human_study.progress_people import PersonProgress
from human_study.records import read_study
from sim.episodes.generation import invent_dataset

from .flow_steps import HOLD_MS
from .gateways import wait_until

pytestmark = [pytest.mark.browser, pytest.mark.slow]


@dataclass
class Program:
    """A running `study serve`."""

    process: subprocess.Popen[str]
    link: str
    """Of the participant who walks."""
    dashboard: str

    def kill(self) -> None:
        """As the system does when memory runs out, with nothing tidied up."""
        os.kill(self.process.pid, signal.SIGKILL)
        self.process.wait(timeout=30)


@contextmanager
def serving(folder: Path, port: int) -> Iterator[Program]:
    """A small home, served by one worker until the end of the block, or until it is killed."""
    command = [sys.executable, "-m", "personal_viz", "study", "serve", "--dataset", str(folder / "data")]
    command += ["--scene", "Small", "--out", str(folder / "study"), "--port", str(port), "--workers", "1"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, preexec_fn=hear_ctrl_c)
    try:
        assert process.stdout is not None
        text = ""
        for line in process.stdout:
            text += line
            if "Everything is written to" in line:
                break
        link = re.search(r"PAN\s+p\d+\s+(http://\S+)", text)
        page = re.search(r"for you only: (http://\S+)", text)
        assert link is not None
        assert page is not None
        yield Program(process, link.group(1), page.group(1))
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
            process.communicate(timeout=60)


def hear_ctrl_c() -> None:
    """Signals as at a terminal, also where the test's own shell ignores them."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


def free_port() -> int:
    """A port that nobody listens on now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def walker(folder: Path) -> PersonProgress:
    """How far the participant is who walks, as `study status` reads it."""
    with read_study(folder / "study") as reader:
        return study_progress(reader, now_ns=time.time_ns()).people[1]


def num_steps(folder: Path) -> int:
    """Steps of the walk that are stored; the chains are whole."""
    with read_study(folder / "study") as reader:
        reader.check()
        trial = reader.trials("p02")[0]
        return sum(isinstance(line.event, Act) for line in reader.events(trial.trial_id or ""))


def step(page: Page, number: int) -> None:
    """Turns left, which is this step."""
    page.keyboard.press("a", delay=HOLD_MS)
    expect(page.get_by_text(f"Step {number} of 500")).to_be_visible()


def test_a_killed_program_goes_on_where_people_were(tmp_path: Path, browser: BrowserContext) -> None:
    invent_dataset(tmp_path / "data", name="Small", seed=3)
    port, page, watch = free_port(), browser.new_page(), browser.new_page()
    row = watch.get_by_role("row").filter(has_text="p02")
    with serving(tmp_path, port) as program:
        page.goto(program.link)
        page.get_by_role("button", name="Start").click()
        expect(page.get_by_text("Step 0 of 500")).to_be_visible()
        for number in (1, 2):
            step(page, number)
        watch.goto(program.dashboard)
        expect(row).to_contain_text("open")
        expect(row).to_contain_text("trial 1 of")
        old_token = program.dashboard.partition("#")[2]
        program.kill()
    assert num_steps(tmp_path) == 2
    before = walker(tmp_path)
    assert (before.is_in_trial, before.num_reconnects) == (True, 0)
    expect(watch.get_by_text("The study does not answer")).to_be_visible()

    with serving(tmp_path, port) as program:
        require_new_link(watch, program.dashboard, old_token)
        expect(row).to_contain_text("trial 1 of")
        page.bring_to_front()
        wait_until(lambda: walker(tmp_path).num_reconnects)  # the page comes back by itself
        expect(page.get_by_alt_text("What the robot sees")).to_have_attribute("data-step", "2", timeout=60_000)
        after = walker(tmp_path)
        assert (after.place, after.num_abandoned, after.num_technical) == ("trial", 0, 0)
    assert num_steps(tmp_path) == 2
    assert program.process.returncode == 0


def require_new_link(watch: Page, link: str, old_token: str) -> None:
    """The token of before the restart opens nothing, the new one does."""
    watch.goto("about:blank")
    watch.goto(link.partition("#")[0] + "#" + old_token)
    expect(watch.get_by_text("This page needs the link that the terminal shows")).to_be_visible()
    expect(watch.locator("#page")).to_be_hidden()
    watch.goto("about:blank")
    watch.goto(link)
    expect(watch.get_by_role("heading", name="Who is where")).to_be_visible()
