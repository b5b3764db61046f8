"""A recording of one green picture, and a browser that watches until Rerun's web viewer shows it."""

import io
import os

import numpy as np
import pytest
import rerun as rr
import rerun.blueprint as rrb
from PIL import Image

from personal_viz.browser import find_chromium, open_chromium

GREEN = (0, 200, 80)


def log_green(stream: rr.RecordingStream) -> None:
    """Logs one green picture that fills the window."""
    stream.log("picture", rr.Image(np.full((40, 60, 3), GREEN, np.uint8)), static=True)
    view = rrb.Spatial2DView(origin="/picture")
    stream.send_blueprint(rrb.Blueprint(view, auto_views=False, collapse_panels=True))


def watched_picture(
    address: str, wanted: tuple[int, int, int], *, link: str | None = None
) -> tuple[set[str], set[str]]:
    """Shows an address in Chromium until a third of it has the colour; fails if the viewer prints debug lines.

    Args:
        address: The viewer's page, or one that leads to it.
        wanted: The colour.
        link: Selector of links on the page, the first of which is clicked; what it opens is watched.

    Returns:
        (hosts of all requests that left the page, hosts that its policy refused)
    """
    if find_chromium() is None:
        if os.environ.get("CI") == "true":
            pytest.fail("found no Chromium; CI must run the browser tests")
        pytest.skip("found no Chromium or Chrome; install one to run the browser tests")
    asked: set[str] = set()
    refused: set[str] = set()
    said: list[str] = []
    with open_chromium(width=800, height=500) as browser:
        browser.set_default_timeout(120_000)
        browser.on("console", lambda message: said.append(message.type))
        browser.on("request", lambda request: asked.add(request.url.split("/")[2]))
        browser.add_init_script(
            "window.refused = []; addEventListener('securitypolicyviolation', e => refused.push(e.blockedURI))"
        )
        browser.new_page().goto(address)
        if link is not None:
            browser.pages[0].locator(link).first.click()
        for _ in range(240):
            page = browser.pages[-1]  # a link may open a page of its own
            page.wait_for_timeout(500)
            pixels = np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("RGB")).astype(int)
            if (np.abs(pixels - wanted).max(axis=-1) <= 6).mean() > 1 / 3:
                assert "debug" not in said
                refused |= {uri.split("/")[2] for uri in page.evaluate("window.refused") if "//" in uri}
                return asked, refused
    raise AssertionError(f"{address} never showed the picture")
