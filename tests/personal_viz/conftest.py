"""A running study on an invented home, and a browser to take part in it."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import BrowserContext, expect

from personal_viz.browser import find_chromium, open_chromium
from personal_viz.served import ServedStudy, served_demo


@pytest.fixture
def served(tmp_path: Path) -> Iterator[ServedStudy]:
    """The demo, ended with Ctrl-C after the test."""
    with served_demo(tmp_path / "demo") as study:
        yield study


@pytest.fixture
def browser() -> Iterator[BrowserContext]:
    """A headless Chromium; a missing one is a failure in CI and a skip elsewhere."""
    if find_chromium() is None:
        if os.environ.get("CI") == "true":
            pytest.fail("found no Chromium; CI must run the browser tests")
        pytest.skip("found no Chromium or Chrome; install one to run the browser tests")
    with open_chromium() as context:
        context.set_default_timeout(60_000)
        expect.set_options(timeout=30_000)
        yield context
