"""Pictures of the pages around a study's trials: from the running program, on an invented home, nothing staged."""

import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from playwright.sync_api import BrowserContext, Page, expect

from human_study.design.study import (
    StudyChecks,
    StudyConfig,
    StudyDataset,
    StudyDesign,
    StudyEthics,
    StudyMemory,
    StudyPractice,
    save_study,
)
from sim.authoring.generation import invent_dataset
from sim.episodes.dataset import PersonalDataset
from sim.errors import StudyError
from sim.types import TaskKind

from ..bots.site import hear_ctrl_c
from ..study_app.study_files import plan_study

_HOME = "PictureHome"
_WAIT_MS = 120_000


def picture_study_pages(browser: BrowserContext, folder: Path, pictures: Path) -> None:
    """Writes `study-consent.png`, `study-instructions.png` and `study-question.png`.

    Args:
        browser: Shows the pages.
        folder: For the study and its episodes.
        pictures: Where the pictures go.
    """
    shown = StudyMemory(arms=("topdown",))
    with served_study(folder, task=("pan",), memory=shown, practice=StudyPractice(pan=1)) as links:
        page = browser.new_page()
        page.goto(links["pan"])
        expect(page.get_by_text("Your window has room")).to_be_visible(timeout=_WAIT_MS)
        page.keyboard.press("w", delay=60)
        _press(page, "Continue")
        expect(page.get_by_role("button", name="I agree and take part")).to_be_visible(timeout=_WAIT_MS)
        _picture(page, pictures / "study-consent.png")
        _press(page, "I agree and take part")
        _press(page, "Next")
        expect(page.get_by_text("Page 2 of")).to_be_visible(timeout=_WAIT_MS)
        _picture(page, pictures / "study-instructions.png")
        while page.get_by_role("button", name="I have read this").count() == 0:
            count = page.get_by_text(re.compile(r"Page \d+ of \d+")).inner_text()
            _press(page, "Next")
            expect(page.get_by_text(count, exact=True)).to_be_hidden(timeout=_WAIT_MS)
        _press(page, "I have read this")
        _press(page, "Anywhere in the same room")
        expect(page.get_by_text("Not quite.")).to_be_visible(timeout=_WAIT_MS)
        _picture(page, pictures / "study-question.png")
        page.close()


@contextmanager
def served_study(folder: Path, **choices: Any) -> Iterator[dict[TaskKind, str]]:
    """A personal link of each task of a pilot on one invented home, until the end of the block.

    Args:
        folder: For the study and its episodes.
        choices: Fields of StudyConfig.
    """
    dataset, study = folder / "dataset", folder / "study"
    invent_dataset(dataset, name=_HOME, seed=5)
    config = StudyConfig(
        study="picture-study",
        dataset=StudyDataset(
            sha256=PersonalDataset(dataset).digest(), splits={"easy": 4}, stratify="none", max_per_scene=None
        ),
        design=StudyDesign(kind="crossed", raters_per_episode=1),
        checks=StudyChecks(every=None),
        ethics=StudyEthics(institution="Example University", contact="study@example.org", duration_min=30),
        **choices,
    )
    save_study(study, config)
    plan_study(study, dataset, None, pilot=True)
    program = [sys.executable, "-m", "personal_viz", "study", "serve", str(study), "--dataset", str(dataset)]
    program += ["--port", "0", "--pilot", "--workers", "1"]
    process = subprocess.Popen(program, stdout=subprocess.PIPE, text=True, preexec_fn=hear_ctrl_c)
    assert process.stdout is not None
    try:
        links: dict[TaskKind, str] = {}
        for line in process.stdout:
            if found := re.search(r"(PAN|POG)\s+p\d+\s+(http://\S+)", line):
                links.setdefault("pan" if found[1] == "PAN" else "pog", found[2])
            if "Everything is written to" in line:
                break
        if not links:
            raise StudyError(f"{' '.join(program[2:])}: ended with {process.wait()}; expected a personal link.")
        yield links
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(timeout=60)


def _press(page: Page, name: str) -> None:
    page.get_by_role("button", name=name, exact=True).click(timeout=_WAIT_MS)


def _picture(page: Page, path: Path) -> None:
    page.mouse.move(5, 5)
    page.wait_for_timeout(500)  # colours of buttons fade
    page.screenshot(path=path)
