"""One Chromium and one served study per pytest process, shared by its tests; each test has a profile and a person.

A browser test takes `browser` (a context with an empty profile) and, where it needs a running program that it neither
ends nor starts again, one of the shared studies:

- `quick_study`: one page ("Start"), then two trials of PAN or POG. The usual choice.
- `full_study`: device check, consent, instructions, quiz, practice, breaks, how sure, completion code.

Each test takes part as somebody new: `code = quick_study.newcomer("pan")`, then `page.goto(quick_study.links[code])`.
Their records: `flow_steps.record(quick_study, code)` and `events(quick_study, code, order_no)`. Tests that
need no gateway and no store use `stage.staged`; those that kill or restart a program serve their own
(`flow_studies.served`), on homes from `invented.invented_dataset`, which are made once per run.
"""

import asyncio
import contextlib
import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import BrowserContext, expect

from human_study.design.study import StudyBreaks, StudyDesign, StudyPog, StudyPractice
from personal_viz.browser import find_chromium, launch_chromium
from sim.cache import cache_dir

from ..built_once import built_once
from .flow_studies import PlannedStudy, plan_small
from .flow_studies import served as served_planned

Profiles = Callable[..., contextlib.AbstractContextManager[BrowserContext]]
"""Opens an empty profile until the end of a block; takes the arguments of Playwright's `new_context`."""
NUM_PEOPLE = 40
"""Number of participants of each task in a shared study."""


@pytest.fixture(scope="session")
def chromium() -> Iterator[Profiles]:
    """Opens profiles in one headless Chromium; a missing Chromium fails the test in CI and skips it elsewhere."""
    if find_chromium() is None:
        if os.environ.get("CI") == "true":
            pytest.fail("found no Chromium; CI must run the browser tests")
        pytest.skip("found no Chromium or Chrome; install one to run the browser tests")
    with launch_chromium() as launched:
        loop = asyncio.get_running_loop()  # Playwright's: between its tests, others must be able to run their own
        asyncio._set_running_loop(None)

        @contextlib.contextmanager
        def profile(**choices: Any) -> Iterator[BrowserContext]:
            before = asyncio._get_running_loop()
            asyncio._set_running_loop(loop)
            context = launched.new_context(**{"viewport": {"width": 1280, "height": 800}, **choices})
            context.set_default_timeout(60_000)
            expect.set_options(timeout=30_000)
            try:
                yield context
            finally:
                context.close()
                asyncio._set_running_loop(before)

        yield profile
        asyncio._set_running_loop(loop)


@pytest.fixture
def browser(chromium: Profiles) -> Iterator[BrowserContext]:
    """A profile of its own, without cookies, in the shared Chromium."""
    with chromium() as context:
        yield context


@pytest.fixture(scope="session")
def quick_study(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PlannedStudy]:
    """Participants of PAN and of POG who see one page before their two trials; shared, so take part as a `newcomer`."""
    root = _copied_quick_study(tmp_path_factory.mktemp("quick"))
    with served_planned(root / "study", root / "dataset") as study:
        yield study


@pytest.fixture
def quick_folder(tmp_path: Path) -> Path:
    """A planned quick study for a test that serves it itself and may kill it; its dataset lies beside it."""
    return _copied_quick_study(tmp_path) / "study"


@pytest.fixture(scope="session")
def full_study(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PlannedStudy]:
    """Participants of PAN and of POG who see all pages, a practice trial and two more; shared, so be a `newcomer`."""
    root = _copied_study(tmp_path_factory.mktemp("full"), "full", confidence=True)
    with served_planned(root / "study", root / "dataset") as study:
        yield study


def _copied_quick_study(root: Path) -> Path:
    choices = {"practice": StudyPractice(pan=0, pog=0), "breaks": StudyBreaks(every=None)}
    return _copied_study(root, "quick", flow=("instructions",), **choices)


def _copied_study(root: Path, name: str, **choices: Any) -> Path:
    """A study for many people with its dataset, planned once per run, copied to `root`."""

    def build(folder: Path) -> None:
        design = StudyDesign(kind="crossed", raters_per_episode=NUM_PEOPLE)
        plan_small(folder, task=("pan", "pog"), pog=StudyPog(conditions=("map_open",)), design=design, **choices)

    shutil.copytree(built_once(cache_dir().parent, f"{name}-study", build), root, dirs_exist_ok=True)
    return root


@pytest.fixture(scope="session")
def small_root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset of small homes with captions, only read."""
    from ..grounding.small_homes import write_small_dataset

    folder = tmp_path_factory.mktemp("small")
    write_small_dataset(folder)
    return folder
