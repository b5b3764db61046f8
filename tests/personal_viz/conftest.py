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

from personal_viz.browser import find_chromium, open_chromium


@dataclass(frozen=True)
class ServedStudy:
    """A study that `personal-viz demo` serves."""

    folder: Path
    dataset: Path
    links: dict[str, str]
    """Task to personal link."""
    process: subprocess.Popen


def start_demo(out: Path, *, seed: int = 7) -> ServedStudy:
    """Starts the demo and reads what it prints until it serves."""
    command = [sys.executable, "-m", "personal_viz", "demo", "--out", str(out), "--port", "0", "--seed", str(seed)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, start_new_session=True)
    assert process.stdout is not None
    lines = []
    for line in process.stdout:
        lines.append(line)
        if "Everything is written to" in line:
            break
    links = dict(re.findall(r"(PAN|POG)\s+p\d+\s+(http://\S+)", "".join(lines)))
    assert set(links) == {"PAN", "POG"}, lines
    return ServedStudy(out / "study", out / "dataset", {task.lower(): link for task, link in links.items()}, process)


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
        yield context
