"""`annotate` in real Chromium: objects are clicked or drawn, described, saved, undone; a killed server keeps them."""

import contextlib
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import BrowserContext, Page, expect

from personal_viz.annotate.app import Annotator, Workplace
from personal_viz.annotate.refine_app import Edition, Refinement, Refiner
from personal_viz.browse.app import loopback_app
from personal_viz.view.shown import open_shown
from sim.authoring.annotations import annotation_path, fold, read_edits
from sim.authoring.refinement import asked_objects, read_opinions
from sim.episodes.dataset import PersonalDataset

from .annotating import annotated, describe, field, opened

pytestmark = pytest.mark.browser
SINK = 4
"""Number of the sink of the home Small."""
FREE_XZ = (2.0, 7.0)
"""A place on its floor that can be seen from above."""


@pytest.fixture
def address(small_home_root: Path, tmp_path: Path) -> Iterator[str]:
    """The home Small with semantics."""
    place = Workplace(open_shown(small_home_root / "scenes" / "Small.glb"), tmp_path, who="ada")
    with loopback_app(lambda client: Annotator(client, place)) as address:
        yield address


def click_canvas(page: Page, right: float, down: float) -> None:
    """Clicks the 3-D view at shares of its width and height."""
    box = page.locator("canvas").first.bounding_box()
    assert box is not None
    page.mouse.click(box["x"] + right * box["width"], box["y"] + down * box["height"])


def test_an_object_is_clicked_described_saved_undone_and_seen_by_others(
    address: str, browser: BrowserContext, tmp_path: Path
) -> None:
    page, other = opened(browser, address), opened(browser, address)
    page.bring_to_front()
    expect(page.locator(".rows .row")).to_have_count(57)
    field(page, "Search").fill("sink")
    expect(page.locator(".count")).to_contain_text("of 57 objects")
    page.locator(f'[data-click="object {SINK}"]').click()
    expect(page.locator(".grid img")).to_have_count(4)
    page.keyboard.press("Escape")
    expect(page.locator(".grid img")).to_have_count(0)
    click_canvas(page, 0.5, 0.5)  # the camera still looks at it
    expect(field(page, "Category")).to_have_value("sink")
    describe(page, "black sink under the mirror", "bathroom")
    path = annotation_path(tmp_path, "Small")
    assert fold(read_edits(path))[SINK].captions == ("black sink under the mirror",)
    expect(page.locator(".row.here .tag")).to_have_text("complete")
    expect(other.locator(f'[data-click="object {SINK}"]')).to_contain_text("black sink under the mirror")
    page.keyboard.press("u")
    expect(page.locator(".notice")).to_contain_text(f"Took back the last edit of object {SINK}")
    expect(field(page, "Caption 1")).to_have_value("")
    assert fold(read_edits(path)) == {}
    assert len(read_edits(path)) == 2


def test_a_box_is_drawn_where_the_scan_has_no_semantics(
    small_home_root: Path, browser: BrowserContext, tmp_path: Path
) -> None:
    for name in ("Small.glb", "Small.stage_config.json"):
        shutil.copy(small_home_root / "scenes" / name, tmp_path)
    place = Workplace(open_shown(tmp_path / "Small.glb"), tmp_path / "out")
    floor = place.shown.hit(0, (FREE_XZ[0], 2.0, FREE_XZ[1]), (0.0, -1.0, 0.0))
    assert floor is not None
    x, y, z = floor
    with annotated(place, browser) as shown:
        page = shown.page
        expect(page.locator(".count")).to_contain_text("0 objects")
        field(page, "Your name").fill("bo")
        shown.draw_box((x - 0.3, y, z - 0.2), (x + 0.3, y, z + 0.2))
        expect(page.locator(".row.here .tag")).to_have_text("unsaved")
        shown.drag_up((x, y + 0.83, z), 0.4)
        expect(field(page, "Height (m)")).to_have_value(re.compile(r"1\.(1[5-9]|2[0-5]?)"))
        expect(field(page, "Bottom (m)")).to_have_value("0.03")
        field(page, "Category").fill("ch")
        page.locator("[data-click^='category chair']").first.click()
        expect(field(page, "Category")).to_have_value("chair")
        describe(page, "wooden chair by the wall", "hall")
        (item,) = fold(read_edits(place.path)).values()
        assert item.box is not None
        assert (item.category, item.room) == ("chair", "hall")
        assert item.box.size == pytest.approx((0.6, 1.2, 0.4), abs=0.05)
        assert item.box.centre[1] - item.box.size[1] / 2 == pytest.approx(y + 0.03, abs=0.005)
        assert read_edits(place.path)[0].who == "bo"
        field(page, "Height (m)").fill("0.5")
        expect(page.locator(".row.here .tag")).to_have_text("unsaved")
        page.get_by_role("button", name="Save").click()
        expect(page.locator(".row.here .tag")).to_have_text("complete")
        (item,) = fold(read_edits(place.path)).values()
        assert item.box is not None
        assert item.box.size[1] == 0.5
        page.get_by_role("button", name="Undo").click()
        expect(field(page, "Height (m)")).not_to_have_value("0.5")
        page.get_by_role("button", name="Undo").click()
        expect(page.locator(".count")).to_contain_text("0 objects")


def test_a_killed_server_has_lost_nothing_that_it_called_saved(
    small_home_root: Path, browser: BrowserContext, tmp_path: Path
) -> None:
    scan = small_home_root / "scenes" / "Small.glb"
    command = [sys.executable, "-m", "personal_viz", "annotate", str(scan), "--out", str(tmp_path), "--who", "ada"]
    with subprocess.Popen([*command, "--port", "0"], stdout=subprocess.PIPE, text=True) as server:
        try:
            assert server.stdout is not None
            page = opened(browser, server.stdout.readline().split(": ")[1].strip())
            page.locator(f'[data-click="object {SINK}"]').click()
            expect(field(page, "Category")).to_have_value("sink")
            describe(page, "black sink under the mirror", "bathroom")
            page.keyboard.press("e")
            page.keyboard.type("never saved")
        finally:
            os.kill(server.pid, signal.SIGKILL)
    (edit,) = read_edits(annotation_path(tmp_path, "Small"))
    assert edit.after is not None
    assert edit.after.captions == ("black sink under the mirror",)
    place = Workplace(open_shown(scan), tmp_path)
    with loopback_app(lambda client: Annotator(client, place)) as address:
        page = opened(browser, address)
        expect(page.locator(f'[data-click="object {SINK}"]')).to_contain_text("black sink under the mirror")


@pytest.mark.slow
def test_captions_are_refined_by_keys_alone_and_a_third_person_chooses(
    small_home_root: Path, browser: BrowserContext, tmp_path: Path
) -> None:
    dataset = PersonalDataset(small_home_root)

    def served(who: str, *, adjudicates: bool = False) -> contextlib.AbstractContextManager[str]:
        edition = Edition(Refinement(dataset, tmp_path, who, ("Small",), is_adjudication=adjudicates))
        return loopback_app(lambda client: Refiner(client, edition))

    asked = asked_objects(dataset, "Small")
    first, second, third, *_ = asked
    for who, words in (("ada", "green thing"), ("bo", "red thing")):
        with served(who) as address:
            page = browser.new_page()
            page.goto(f"{address}?fixedDpr=0.1")
            expect(page.locator(".old")).to_have_text(asked[first].captions[0], timeout=120_000)
            expect(page.locator(".grid img").first).to_be_visible()
            expect(page.locator(".dim", has_text="From recorded view points")).to_be_visible()
            page.keyboard.press("e")
            page.keyboard.type(words)
            expect(page.locator(".row.here")).to_contain_text(words)
            page.keyboard.press("Enter")
            expect(page.locator(".notice", has_text=f"Saved object {first}")).to_contain_text("changed")
            expect(page.locator(".old")).to_have_text(asked[second].captions[0])
            page.keyboard.press("k")
            expect(page.locator(".notice", has_text=f"Saved object {second}")).to_contain_text("kept")
            page.keyboard.press("g")
            expect(page.locator(".notice", has_text=f"Saved object {third}")).to_contain_text("flagged")
            page.keyboard.press("u")
            expect(page.locator(".notice")).to_contain_text(f"Took back the last edit of object {third}")
            if who == "bo":
                agreement = page.locator(".agreement")
                expect(agreement).to_contain_text("ada and bo: 2 of 2 objects decided equally; 33 % of the words")
    with served("cy", adjudicates=True) as address:
        page = browser.new_page()
        page.goto(f"{address}?fixedDpr=0.1")
        expect(page.locator(".count")).to_contain_text("1 object", timeout=120_000)
        expect(page.locator("[data-click='choose 2']")).to_contain_text("red thing")
        page.keyboard.press("2")
        expect(page.locator(".notice")).to_contain_text(f"Saved object {first}")
    opinions = read_opinions(tmp_path, "Small", asked)
    accepted = opinions[first].accepted
    assert accepted is not None
    assert (accepted.captions, opinions[first].adjudicator) == (("red thing",), "cy")
    assert opinions[first].said["ada"].captions == ("green thing",)
    assert opinions[second].accepted == asked[second]
    assert opinions[third].accepted is None
