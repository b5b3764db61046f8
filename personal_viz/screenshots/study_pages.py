"""Pictures of a study's pages: the flow, and what its instructions show of each condition."""

import io
import re
from collections.abc import Callable
from pathlib import Path

from PIL import Image
from playwright.sync_api import Page, expect

from human_study.design.study import Condition, StudyMemory, StudyPog, StudyPractice

from ..browser import open_chromium
from ..study_app.page_script import STATIC
from .steps import WAIT_MS, keep, point, press, see_home, see_map, served_study, walk

SIZE = (760, 475)
"""Pixels of a picture of the instructions: it is shown inside a card."""
MAX_BYTES = 60_000
"""Size of a picture of the instructions; a page holds up to three."""
_INSTRUCTIONS: dict[Condition, str] = {
    "none": "how-pan.jpg",
    "topdown": "how-topdown.jpg",
    "glb": "how-glb.jpg",
    "map_open": "how-pog.jpg",
    "map_first": "how-map-first.jpg",
    "map_2d": "how-map-2d.jpg",
}
"""File in `static` that shows a condition, as the templates of `human_study.texts` name it."""
_PAIRS: tuple[tuple[Condition, Condition], ...] = (("none", "map_open"), ("topdown", "map_first"), ("glb", "map_2d"))
"""Conditions of PAN and POG that are served together."""
_QUALITIES = range(86, 30, -4)


def picture_pages(folder: Path) -> None:
    """Consent, instructions and a question that was answered wrongly."""
    shown = StudyMemory(arms=("topdown",))
    with (
        served_study(folder, task=("pan",), memory=shown, practice=StudyPractice(pan=1)) as study,
        open_chromium() as browser,
    ):
        page = browser.new_page()
        page.goto(study.link("pan"))
        expect(page.get_by_text("Your window has room")).to_be_visible()
        page.keyboard.press("w", delay=60)
        press(page, "Continue")
        expect(page.get_by_role("button", name="I agree and take part")).to_be_visible()
        keep(page, "study-consent.png")
        press(page, "I agree and take part")
        press(page, "Next")
        expect(page.get_by_text("Page 2 of")).to_be_visible()
        keep(page, "study-instructions.png")
        while page.get_by_role("button", name="I have read this").count() == 0:
            count = page.get_by_text(re.compile(r"Page \d+ of \d+")).inner_text()
            press(page, "Next")
            expect(page.get_by_text(count, exact=True)).to_be_hidden()
        press(page, "I have read this")
        press(page, "Anywhere in the same room")
        expect(page.get_by_text("Not quite.")).to_be_visible()
        keep(page, "study-question.png")


def picture_instructions(folder: Path) -> None:
    """The home as participants see it before they walk in it, and as they point at it: pictures of `static`."""
    for pan, pog in _PAIRS:
        choices = {
            "task": ("pan", "pog"),
            "flow": ("instructions",),
            "memory": StudyMemory.model_validate({"arms": (pan,)}),
            "pog": StudyPog.model_validate({"conditions": (pog,)}),
        }
        with served_study(folder / f"{pan}-{pog}", **choices) as study, open_chromium() as browser:
            shown: tuple[tuple[Condition, str], ...] = ((pan, study.link("pan")), (pog, study.link("pog")))
            for condition, link in shown:
                page = browser.new_page()
                page.goto(link)
                press(page, "Start")
                _WAYS[condition](page)
                page.mouse.move(5, 795)
                page.wait_for_timeout(1000)  # colours of buttons fade
                (STATIC / _INSTRUCTIONS[condition]).write_bytes(small_jpeg(page.screenshot(timeout=WAIT_MS)))
                page.close()


def small_jpeg(png: bytes) -> bytes:
    """A screenshot in the instructions' size, as good as MAX_BYTES allow."""
    picture = Image.open(io.BytesIO(png)).convert("RGB").resize(SIZE, Image.Resampling.LANCZOS)
    for quality in _QUALITIES:
        buffer = io.BytesIO()
        picture.save(buffer, "JPEG", quality=quality, optimize=True, progressive=True)
        if buffer.tell() <= MAX_BYTES:
            break
    return buffer.getvalue()


_WAYS: dict[Condition, Callable[[Page], None]] = {
    "none": walk,
    "topdown": see_map,
    "glb": see_home,
    "map_first": see_home,
    "map_open": point,
    "map_2d": point,
}
"""Steps in the page before the picture of a condition is taken."""
