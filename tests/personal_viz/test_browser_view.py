"""`view` in real Chromium: clicks measure, a participant's keys walk, storeys change, and a thing without floor."""

from collections.abc import Iterator
from pathlib import Path

import pytest
import trimesh
from playwright.sync_api import BrowserContext, Page, expect

from personal_viz.browse.app import loopback_app
from personal_viz.view.shown import open_shown
from personal_viz.view.visit import Visit

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def demo(demo_root: Path) -> Iterator[str]:
    """The address of the invented home Demo."""
    shown = open_shown(demo_root / "scenes" / "Demo.glb")
    with loopback_app(lambda client: Visit(client, shown)) as address:
        yield address


def opened(browser: BrowserContext, address: str) -> Page:
    page = browser.new_page()
    page.goto(f"{address}?fixedDpr=0.1")  # Chromium draws without a graphics card here
    expect(page.get_by_text("Click the scan to read a place")).to_be_visible(timeout=120_000)
    return page


def click_middle(page: Page, *, right: float = 0.0) -> None:
    """Clicks the canvas in its middle, or some share of its width to the right."""
    box = page.locator("canvas").first.bounding_box()
    assert box is not None
    page.mouse.click(box["x"] + (0.3 + right) * box["width"], box["y"] + 0.5 * box["height"])


def test_clicks_list_places_and_distances_and_keys_walk(demo: str, browser: BrowserContext) -> None:
    page = opened(browser, demo)
    robot = page.locator(".robot")
    expect(robot).to_contain_text("step 0")
    click_middle(page)
    expect(page.locator("table.points tr")).to_have_count(2)
    click_middle(page, right=0.1)
    expect(page.locator("table.points tr")).to_have_count(3)
    straight, planar = (
        float(text) for text in page.locator("table.points tr").last.locator("td").all_inner_texts()[4:6]
    )
    assert 0 < planar <= straight
    page.keyboard.press("a")
    expect(robot).to_contain_text("step 1: ")
    expect(robot).to_contain_text("turned 30°")
    page.keyboard.press("ArrowRight")
    expect(robot).to_contain_text("turned 0°")
    page.get_by_role("button", name="Clear the points").click()
    expect(page.get_by_text("Click the scan to read a place")).to_be_visible()
    below = robot.inner_text()
    page.get_by_role("button", name="Storey 2").click()
    expect(robot).to_contain_text("step 0")
    assert robot.inner_text() != below


def test_a_thing_without_floor_has_no_robot(tmp_path: Path, browser: BrowserContext) -> None:
    trimesh.creation.box(extents=(0.3, 0.5, 0.2)).export(tmp_path / "statue.glb")
    shown = open_shown(tmp_path / "statue.glb")
    with loopback_app(lambda client: Visit(client, shown)) as address:
        page = opened(browser, address)
        expect(page.get_by_text("It opens for looking and pointing only")).to_be_visible()
        expect(page.get_by_role("button", name="Forward")).to_have_count(0)
