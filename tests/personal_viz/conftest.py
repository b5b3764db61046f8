"""A running study on an invented home, and a browser to take part in it."""

import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from playwright.sync_api import expect

from personal_viz.browser import find_chromium, open_chromium


@dataclass(frozen=True)
class ServedStudy:
    """A study that `personal-viz demo` serves."""

    folder: Path
    links: dict[str, str]
    """Task to personal link."""
    process: subprocess.Popen

    @property
    def dataset(self) -> Path:
        """Episodes of the demo."""
        return self.folder.parent / "dataset"


def start_study(folder: Path, *command: str) -> ServedStudy:
    """Starts a serving command with `--out folder` on a free port and reads what it prints until it serves."""
    program = [sys.executable, "-m", "personal_viz", *command, "--out", str(folder), "--port", "0"]
    process = subprocess.Popen(program, stdout=subprocess.PIPE, text=True, start_new_session=True)
    assert process.stdout is not None
    lines = []
    for line in process.stdout:
        lines.append(line)
        if "Everything is written to" in line:
            break
    links = dict(re.findall(r"(PAN|POG)\s+p\d+\s+(http://\S+)", "".join(lines)))
    assert set(links) == {"PAN", "POG"}, lines
    return ServedStudy(folder, {task.lower(): link for task, link in links.items()}, process)


def start_demo(out: Path) -> ServedStudy:
    """The demo; its study is in `out/study`, its episodes in `out/dataset`."""
    study = start_study(out, "demo", "--seed", "7")
    return ServedStudy(out / "study", study.links, study.process)


def end_with_ctrl_c(process: subprocess.Popen) -> int:
    """Exit code after one Ctrl-C."""
    process.send_signal(signal.SIGINT)
    return process.wait(timeout=30)


@pytest.fixture
def served(tmp_path: Path) -> Iterator[ServedStudy]:
    """The demo, ended with Ctrl-C after the test."""
    study = start_demo(tmp_path / "demo")
    try:
        yield study
    finally:
        if study.process.poll() is None:
            assert end_with_ctrl_c(study.process) == 0


@pytest.fixture
def browser() -> Iterator:
    """A headless Chromium; a missing one is a failure in CI and a skip elsewhere."""
    if find_chromium() is None:
        if os.environ.get("CI") == "true":
            pytest.fail("found no Chromium; CI must run the browser tests")
        pytest.skip("found no Chromium or Chrome; install one to run the browser tests")
    with open_chromium() as context:
        context.set_default_timeout(60_000)
        expect.set_options(timeout=30_000)
        yield context
