"""What a person does on the page of `annotate`: keys, fields, clicks at places of the scan, a drag of an arrow."""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import viser
from playwright.sync_api import BrowserContext, Locator, Page, expect
from viser.transforms import SO3

from personal_viz.annotate.app import Annotator, Workplace
from personal_viz.browse.app import loopback_app
from personal_viz.view.shown import Point

from .gateways import wait_until

ARROW_MIDDLE_PIXELS = 50
"""An arrow is twice as long."""


@dataclass(frozen=True, slots=True)
class AnnotatePage:
    """A browser's page, and the server's side of it, which knows the camera."""

    page: Page
    client: viser.ClientHandle

    def pixel_of(self, place: Point) -> tuple[float, float]:
        """Where the page shows a place."""
        camera, box = self.client.camera, self.page.locator("canvas").first.bounding_box()
        assert box is not None
        R_world_camera = SO3(np.asarray(camera.wxyz)).as_matrix()
        right, down, ahead = R_world_camera.T @ (np.asarray(place) - np.asarray(camera.position))
        focal = box["height"] / 2 / np.tan(camera.fov / 2)
        return (
            box["x"] + box["width"] / 2 + focal * right / ahead,
            box["y"] + box["height"] / 2 + focal * down / ahead,
        )

    def is_framed(self) -> bool:
        """Whether the server has heard of the window's shape and framed the scan in it; the panel docks late."""
        box, camera = self.page.locator("canvas").first.bounding_box(), self.client.camera
        return box is not None and abs(camera.aspect - box["width"] / box["height"]) < 0.01

    def draw_box(self, first: Point, second: Point) -> None:
        """Begins a new box by two clicks."""
        self.page.get_by_role("button", name="New box").click()
        expect(self.page.locator(".notice")).to_contain_text("Click one corner")
        self.page.mouse.click(*self.pixel_of(first))
        expect(self.page.locator(".notice")).to_contain_text("opposite corner")
        self.page.mouse.click(*self.pixel_of(second))
        expect(self.page.locator(".notice")).to_contain_text("Drag the arrows")
        expect(self.page.locator(".grid img, .bw p.warn").first).to_be_visible()  # the arrows are there before them

    def drag_up(self, handle: Point, metres: float) -> None:
        """Drags the arrow that stands up from a place, by a point near its middle."""
        x, y, z = handle
        base, there = self.pixel_of(handle), self.pixel_of((x, y + metres, z))
        up = metres * ARROW_MIDDLE_PIXELS / np.hypot(there[0] - base[0], there[1] - base[1])
        self.page.mouse.move(*self.pixel_of((x, y + up, z)))
        self.page.mouse.down()
        self.page.mouse.move(*self.pixel_of((x, y + up + metres, z)), steps=8)
        self.page.mouse.up()


@contextlib.contextmanager
def annotated(place: Workplace, browser: BrowserContext) -> Iterator[AnnotatePage]:
    """The page of one annotator, whose server ends with the block."""
    clients: list[viser.ClientHandle] = []

    def welcome(client: viser.ClientHandle) -> Annotator:
        clients.append(client)
        return Annotator(client, place)

    with loopback_app(welcome) as address:
        shown = AnnotatePage(opened(browser, address), clients[0])
        wait_until(shown.is_framed)
        yield shown


def opened(browser: BrowserContext, address: str) -> Page:
    """A new page on which the scan is there."""
    page = browser.new_page()
    page.goto(f"{address}?fixedDpr=0.1")  # Chromium draws without a graphics card here
    expect(page.get_by_text("Click an object, or draw a new box")).to_be_visible(timeout=120_000)
    return page


def field(page: Page, label: str) -> Locator:
    """The text field with a label; viser does not join the two."""
    return page.locator(f"xpath=//label[normalize-space()='{label}']/following::input[1]")


def describe(page: Page, caption: str, room: str) -> None:
    """Types by keys alone, and saves."""
    page.keyboard.press("e")
    page.keyboard.type(caption)
    expect(page.locator(".row.here")).to_contain_text(caption)  # viser sends what is typed 50 ms later
    page.keyboard.press("Escape")
    page.keyboard.press("r")
    page.keyboard.type(room)
    page.keyboard.press("Enter")
    expect(page.locator(".notice")).to_contain_text("Saved object")
