"""Makes the instructions' pictures of `static`: `python -m personal_viz.screenshots.instructions`, on an invented home.

From the running program: what participants see of a home before they walk in it, and where they point at it.
"""

import io
import tempfile
from collections.abc import Callable
from pathlib import Path

from PIL import Image
from playwright.sync_api import BrowserContext, Page, expect

from human_study.design.study import Condition, StudyMemory, StudyPog, StudyPractice

from ..browser import open_chromium
from ..study_app.page_script import STATIC
from .study import served_study

SIZE = (760, 475)
"""Pixels of a picture: it is shown inside a card."""
MAX_BYTES = 60_000
"""Of a picture: a page of the instructions holds up to three."""
PICTURES: dict[Condition, str] = {
    "none": "how-pan.jpg",
    "topdown": "how-topdown.jpg",
    "glb": "how-glb.jpg",
    "map_open": "how-pog.jpg",
    "map_first": "how-map-first.jpg",
    "map_2d": "how-map-2d.jpg",
}
"""File in `static` that shows a condition, as the templates of `human_study.texts` name it."""
_QUALITIES = range(86, 30, -4)
_PAIRS: tuple[tuple[Condition, Condition], ...] = (("none", "map_open"), ("topdown", "map_first"), ("glb", "map_2d"))
"""Conditions of PAN and POG that are served together."""
_WAIT_MS = 120_000


def main() -> None:
    """Writes the pictures of all conditions."""
    with tempfile.TemporaryDirectory(prefix="personal-how-") as folder, open_chromium() as browser:
        for name, data in instruction_pictures(browser, Path(folder)).items():
            (STATIC / name).write_bytes(data)
            print(f"{STATIC / name}: {len(data) / 1000:.0f} kB")


def instruction_pictures(browser: BrowserContext, folder: Path) -> dict[str, bytes]:
    """JPEG files by name.

    Args:
        browser: Shows the pages.
        folder: For studies and their episodes.
    """
    pictures = {}
    for pan, pog in _PAIRS:
        choices = {
            "task": ("pan", "pog"),
            "flow": ("instructions",),
            "memory": StudyMemory.model_validate({"arms": (pan,)}),
            "pog": StudyPog.model_validate({"conditions": (pog,)}),
            "practice": StudyPractice(pan=0, pog=0),
        }
        with served_study(folder / f"{pan}-{pog}", **choices) as links:
            pictures[PICTURES[pan]] = _picture(browser, links["pan"], _WAYS[pan])
            pictures[PICTURES[pog]] = _picture(browser, links["pog"], _WAYS[pog])
    return pictures


def small_jpeg(png: bytes) -> bytes:
    """A screenshot in the pictures' size, as good as MAX_BYTES allow."""
    picture = Image.open(io.BytesIO(png)).convert("RGB").resize(SIZE, Image.Resampling.LANCZOS)
    for quality in _QUALITIES:
        buffer = io.BytesIO()
        picture.save(buffer, "JPEG", quality=quality, optimize=True, progressive=True)
        if buffer.tell() <= MAX_BYTES:
            break
    return buffer.getvalue()


def _picture(browser: BrowserContext, link: str, go: Callable[[Page], None]) -> bytes:
    page = browser.new_page()
    page.goto(link)
    page.get_by_role("button", name="Start", exact=True).click(timeout=_WAIT_MS)
    go(page)
    page.mouse.move(5, 795)
    page.wait_for_timeout(1000)  # colours of buttons fade
    png = page.screenshot(timeout=_WAIT_MS)
    page.close()
    return small_jpeg(png)


def _walk(page: Page) -> None:
    """Turns round, to a view of the room."""
    picture = page.get_by_alt_text("What the robot sees")
    expect(picture).to_have_attribute("data-step", "0", timeout=_WAIT_MS)
    for number, key in enumerate("ddd", start=1):
        page.keyboard.press(key, delay=60)  # sessions drop presses within 50 ms of the last one
        expect(picture).to_have_attribute("data-step", str(number), timeout=_WAIT_MS)


def _see_map(page: Page) -> None:
    expect(page.get_by_text("Look at the home from above")).to_be_visible(timeout=_WAIT_MS)
    page.wait_for_timeout(1500)


def _see_home(page: Page) -> None:
    expect(page.get_by_text("Look around in the home")).to_be_visible(timeout=_WAIT_MS)
    page.wait_for_timeout(4000)  # the home is drawn some time after it has arrived; nothing in the page tells when


def _point(page: Page) -> None:
    """A mark on the floor of the hall, where nothing hides it."""
    expect(page.get_by_text("Click the middle of the object")).to_be_visible(timeout=_WAIT_MS)
    page.wait_for_timeout(4000)
    canvas = page.locator("canvas").last.bounding_box()
    assert canvas is not None
    page.mouse.click(canvas["x"] + canvas["width"] * 0.49, canvas["y"] + canvas["height"] * 0.62)
    expect(page.get_by_text("Click again to move your mark")).to_be_visible(timeout=_WAIT_MS)
    page.wait_for_timeout(2000)


_WAYS: dict[Condition, Callable[[Page], None]] = {
    "none": _walk,
    "topdown": _see_map,
    "glb": _see_home,
    "map_first": _see_home,
    "map_open": _point,
    "map_2d": _point,
}
"""What is done before the picture is taken."""

if __name__ == "__main__":
    main()
