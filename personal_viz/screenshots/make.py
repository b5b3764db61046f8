"""Makes the README's pictures from the running program: `make screenshots`, on the invented home, nothing staged."""

import tempfile
from pathlib import Path

from playwright.sync_api import BrowserContext, expect

from sim.episodes.dataset import PersonalDataset
from sim.homes.open_home import open_scene
from sim.tasks.run_files import read_run

from ..browser import open_chromium
from ..study_app.operator.served import ServedStudy, served_demo
from .browse import picture_browser
from .grounding import picture_grounding
from .homes import picture_homes
from .recordings import KEYS, first_walk, picture_recordings, run_agent
from .simulator import picture_simulator
from .study import picture_study_pages

PICTURES = Path(__file__).parents[2] / "docs" / "pictures"
SHOWN_STEP = 5
"""Of the PAN screen's picture."""


def main() -> None:
    """Writes pictures of studies, simulator, recordings, grounding, homes and `browse` into `docs/pictures`."""
    PICTURES.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="personal-pictures-") as folder:
        dataset = Path(folder) / "demo" / "dataset"
        with served_demo(Path(folder) / "demo") as study, open_chromium() as browser:
            _picture_pan(browser, study, dataset=dataset, runs=Path(folder) / "way")
            _picture_pog(browser, study.links["pog"])
        with open_chromium() as browser:
            picture_study_pages(browser, Path(folder) / "planned", PICTURES)
        _picture_simulator(dataset)
        picture_recordings(PICTURES, study.folder, dataset=dataset, folder=Path(folder))
        picture_grounding(PICTURES, Path(folder) / "grounding")
    picture_homes(PICTURES)
    picture_browser(PICTURES)
    print(f"Written to {PICTURES}")


def _picture_pan(browser: BrowserContext, study: ServedStudy, *, dataset: Path, runs: Path) -> None:
    """The PAN screen after some steps; then the script walks on to the goal, whose way an agent knows, and stops."""
    way = run_agent("shortest-path", key=first_walk(study.folder), dataset=dataset, runs=runs, name="way")
    keys = ["d", "a", *(KEYS[step.action] for step in read_run(way).episodes[0].steps[:-1])]
    page = browser.new_page()
    page.goto(study.links["pan"])
    page.get_by_role("button", name="Start").click()
    expect(page.get_by_alt_text("What the robot sees")).to_have_attribute("data-step", "0", timeout=60_000)
    for number, key in enumerate(keys, start=1):
        page.keyboard.press(key, delay=60)  # sessions drop presses within 50 ms of the last one
        expect(page.get_by_alt_text("What the robot sees")).to_have_attribute("data-step", str(number))
        if number == SHOWN_STEP:
            page.screenshot(path=PICTURES / "study-pan.png")
    page.keyboard.press("Enter", delay=60)
    page.keyboard.press("Enter", delay=60)
    expect(page.get_by_text("Saved")).to_be_visible()


def _picture_pog(browser: BrowserContext, link: str) -> None:
    """The POG screen with a mark in the middle of the home."""
    page = browser.new_page()
    page.goto(link)
    page.get_by_role("button", name="Start").click()
    expect(page.get_by_text("Click the middle of the object")).to_be_visible(timeout=60_000)
    page.wait_for_timeout(3000)  # the home is drawn some time after it has arrived; nothing in the page tells when
    canvas = page.locator("canvas").last.bounding_box()
    assert canvas is not None
    page.mouse.click(canvas["x"] + canvas["width"] * 0.45, canvas["y"] + canvas["height"] * 0.33)
    expect(page.get_by_text("Click again to move your mark")).to_be_visible()
    page.wait_for_timeout(2000)
    page.screenshot(path=PICTURES / "study-pog.png")


def _picture_simulator(dataset: Path) -> None:
    """One view and the map of a long way."""
    episodes = PersonalDataset(dataset)
    episode = next(episodes.episodes(splits=("hard",)))
    picture_simulator(open_scene(episodes, episode.key.scene), episode, PICTURES / "simulator.png")


if __name__ == "__main__":
    main()
