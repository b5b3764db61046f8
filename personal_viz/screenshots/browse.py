"""The README's picture of `personal-viz browse`, on an invented home with runs of its own. Part of screenshots."""

import tempfile
from pathlib import Path

from playwright.sync_api import BrowserContext, Page, expect

from sim.authoring.generation import dataset_files, write_files

from ..browse.app import browser_app
from ..browse.library import open_library
from ..browser import open_chromium
from ..cli.run import Run

PICTURE = "browse.png"
_SEED = 7
_EPISODES_PER_SPLIT = 8
_SIZE = (1750, 1200)
_AT_STEP = 12
"""Of the run that the picture walks along."""
_POLL_MS = 1000


def picture_browser(folder: Path) -> None:
    """Writes browse.png: an episode with two runs, one of its objects under the mouse."""
    with tempfile.TemporaryDirectory(prefix="personal-browse-") as made:
        dataset, runs = Path(made) / "data", Path(made) / "runs"
        write_files(dataset, dataset_files(f"Invented{_SEED}", seed=_SEED, episodes_per_split=_EPISODES_PER_SPLIT))
        for agent in ("shortest-path", "random"):
            Run(
                agent=agent,
                dataset=dataset,
                out=runs,
                scenes_dir=None,
                scene=(),
                split=("medium",),
                limit=3,
                seed=3,
                jobs=1,
                run_id=agent,
            ).work()
        library = open_library(dataset, runs=(runs / "shortest-path", runs / "random"))
        with browser_app(library) as address, open_chromium(width=_SIZE[0], height=_SIZE[1]) as browser:
            _take(browser, address, folder / PICTURE)


def _take(browser: BrowserContext, address: str, path: Path) -> None:
    expect.set_options(timeout=120_000)
    page = browser.new_page()
    page.goto(address)
    expect(page.locator(".bw.home")).to_contain_text("invented home")
    page.locator(".rows .row", has_text="runs").first.click()
    picture = page.get_by_alt_text("What the robot saw")
    expect(picture).to_have_attribute("data-step", "0")
    page.get_by_role("slider").focus()
    for _ in range(_AT_STEP):
        page.keyboard.press("ArrowRight")
    expect(picture).to_have_attribute("data-step", str(_AT_STEP))
    page.locator(".og .node.object.linked").first.hover()
    path.write_bytes(_at_rest(page))


def _at_rest(page: Page) -> bytes:
    """The first screenshot that equals the one before it: homes are drawn some time after they have arrived."""
    last, picture = b"", page.screenshot()
    while picture != last:
        page.wait_for_timeout(_POLL_MS)
        last, picture = picture, page.screenshot()
    return picture
