"""Pictures of home sequences: a person's pages, runs beside each other in Rerun, and `browse`."""

from pathlib import Path

from playwright.sync_api import expect

from human_study.design.study import StudyPog
from sim.authoring.generation import invent_dataset
from sim.episodes.sequence_files import SequenceSet
from sim.sequences.searches import sequence_key

from ..browse.app import browser_app
from ..browse.library import open_library
from ..browser import open_chromium
from ..study_app.page_script import STATIC
from .rerun_page import picture_at_rest, screenshot_rrd
from .steps import PICTURES, WAIT_MS, make_set, point, press, run_agent, served_study, walk, work
from .study_pages import small_jpeg


def picture_sequences(folder: Path) -> None:
    """The second search of a home sequence, with its message: a picture of the documentation, and two of `static`."""
    choices = {"task": ("pan", "pog"), "flow": ("instructions",), "pog": StudyPog(conditions=("map_open",))}
    with served_study(folder, num_sequences=1, **choices) as study, open_chromium() as browser:
        page = browser.new_page()
        page.goto(study.link("pan"))
        press(page, "Start")
        walk(page, "aa")
        for _ in range(2):
            page.keyboard.press("Enter", delay=60)
        expect(page.locator("[data-search='1']")).to_be_visible()
        walk(page)
        page.mouse.move(5, 795)
        page.wait_for_timeout(1000)  # colours of buttons fade
        picture = page.screenshot(path=PICTURES / "study-sequence.png", timeout=WAIT_MS)
        (STATIC / "how-pan-messages.jpg").write_bytes(small_jpeg(picture))
        page.close()
        page = browser.new_page()
        page.goto(study.link("pog"))
        press(page, "Start")
        point(page)
        press(page, "Confirm the mark")
        expect(page.locator("[data-search='1']")).to_be_visible()
        point(page, 0.45, 0.33)
        page.mouse.move(5, 795)
        page.wait_for_timeout(1000)
        (STATIC / "how-pog-messages.jpg").write_bytes(small_jpeg(page.screenshot(timeout=WAIT_MS)))


def picture_told(folder: Path) -> None:
    """Two agents in one sequence, with and without its messages: in Rerun, and in `browse`."""
    dataset = folder / "homes"
    invent_dataset(dataset, name="PictureHome", seed=7)
    told = make_set(dataset, folder / "set", count=1)
    set_of = ["--sequences", str(told)]
    runs = (
        run_agent("shortest-path", dataset, folder / "hears", *set_of),
        run_agent("shortest-path", dataset, folder / "deaf", *set_of, "--ignore-messages"),
    )
    key, rrd = sequence_key(next(SequenceSet(told).sequences())), folder / "told.rrd"
    data = ["--dataset", str(dataset), *set_of]
    work("replay", *data, "--episode", str(key), "--runs", *map(str, runs), "--out", str(rrd))
    screenshot_rrd(rrd, PICTURES / "sequence-replay.png", at_end=True)
    with (
        browser_app(open_library(dataset, sequences=told)) as address,
        open_chromium(width=1750, height=1200) as browser,
    ):
        page = browser.new_page()
        page.goto(address)
        page.locator(".history .row[data-click]", has_text="changed").first.click()
        expect(page.locator(".history .row.here[data-click]")).to_contain_text("changed")
        (PICTURES / "sequence-browse.png").write_bytes(picture_at_rest(page))
