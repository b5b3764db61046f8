"""Makes the README's pictures from the running program: `make screenshots`, on the invented home, nothing staged."""

import tempfile
from pathlib import Path

from playwright.sync_api import BrowserContext, expect

from sim.episodes.dataset import PersonalDataset
from sim.scenes.sources import open_scene
from sim.types import Split

from .browser import open_chromium
from .commands.recordings import replay
from .commands.runs import run
from .screenshots_homes import picture_homes
from .screenshots_rerun import screenshot_rrd
from .screenshots_sim import picture_simulator
from .served import served_demo

PICTURES = Path(__file__).parent / "pictures"
SPLIT: Split = "easy"
"""The split whose first episode is replayed."""


def main() -> None:
    """Writes study-pan.png, study-pog.png, simulator.png, replay.png and the homes' into `personal_viz/pictures`."""
    PICTURES.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="personal-pictures-") as folder:
        with served_demo(Path(folder) / "demo") as study, open_chromium() as browser:
            _picture_pan(browser, study.links["pan"])
            _picture_pog(browser, study.links["pog"])
        _picture_simulator(Path(folder))
        _picture_replay(Path(folder))
    picture_homes(PICTURES)
    print(f"Written to {PICTURES}")


def _picture_pan(browser: BrowserContext, link: str) -> None:
    """The PAN screen after some steps."""
    page = browser.new_page()
    page.goto(link)
    page.get_by_role("button", name="Start").click()
    expect(page.get_by_text("Step 0 of 500")).to_be_visible(timeout=60_000)
    for number, key in enumerate(("d", "a", "w", "w", "w"), start=1):
        page.keyboard.press(key, delay=60)  # sessions drop presses within 50 ms of the last one
        expect(page.get_by_text(f"Step {number} of 500")).to_be_visible()
    expect(page.get_by_alt_text("What the robot sees")).to_have_attribute("data-step", "5")
    page.screenshot(path=PICTURES / "study-pan.png")


def _picture_pog(browser: BrowserContext, link: str) -> None:
    """The POG screen with a mark in the middle of the home."""
    page = browser.new_page()
    page.goto(link)
    page.get_by_role("button", name="Start").click()
    expect(page.get_by_text("Click the object to mark it")).to_be_visible(timeout=60_000)
    page.wait_for_timeout(3000)  # the home is drawn some time after it has arrived; nothing in the page tells when
    canvas = page.locator("canvas").last.bounding_box()
    assert canvas is not None
    page.mouse.click(canvas["x"] + canvas["width"] * 0.45, canvas["y"] + canvas["height"] * 0.33)
    expect(page.get_by_text("Click again to move your mark")).to_be_visible()
    page.wait_for_timeout(2000)
    page.screenshot(path=PICTURES / "study-pog.png")


def _picture_simulator(folder: Path) -> None:
    """One view and the map of a long way."""
    dataset = PersonalDataset(folder / "demo" / "dataset")
    episode = next(dataset.episodes(splits=("hard",)))
    picture_simulator(open_scene(dataset, episode.key.scene), episode, PICTURES / "simulator.png")


def _picture_replay(folder: Path) -> None:
    """Two agents of one episode side by side in Rerun's web viewer."""
    dataset = folder / "demo" / "dataset"
    key = next(PersonalDataset(dataset).episodes(splits=(SPLIT,))).key
    for agent in ("shortest-path", "random"):
        run(
            agent=agent,
            dataset=dataset,
            out=folder / "runs",
            scenes_dir=None,
            scene=(key.scene,),
            split=(key.split,),
            limit=1,
            seed=1,
            jobs=1,
            run_id=agent,
        )
    rrd = folder / "pair.rrd"
    runs = (folder / "runs" / "shortest-path", folder / "runs" / "random")
    replay(runs=runs, out=rrd, dataset=dataset, scenes_dir=None, episode=str(key), with_pixels=False)
    screenshot_rrd(rrd, PICTURES / "replay.png", at_end=True)


if __name__ == "__main__":
    main()
