"""Pictures of a recording as Rerun's web viewer shows it, without a display."""

import io
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image

from recordings.viewer.web import serve_file
from sim.errors import RecordingError

from ..browser import open_chromium

if TYPE_CHECKING:
    from playwright.sync_api import Page

_WAIT_S = 180.0
"""Longest wait for a page that comes to rest."""
_POLL_MS = 1000


def screenshot_rrd(rrd: Path, png: Path, *, at_end: bool = False, size: tuple[int, int] = (1600, 900)) -> Path:
    """Opens a recording in the web viewer and writes a picture of it once it no longer changes.

    Args:
        rrd: The recording; its own blueprint is used.
        png: The picture to write.
        at_end: Whether the time cursor stands at the end (whole trails, the goal) or at the start.
        size: (width, height) of the window in pixels.

    Returns:
        `png`.

    Raises:
        RecordingError: The recording is missing, or the viewer showed no finished picture in time.
        MissingDependencyError: Playwright or Chromium is not installed.
    """
    if not rrd.is_file():
        raise RecordingError(f"{rrd}: found no file; expected a recording. Write one with personal-viz replay.")
    with serve_file(rrd) as site, open_chromium(width=size[0], height=size[1]) as browser:
        page = browser.new_page()
        page.set_default_timeout(1e3 * _WAIT_S)
        page.goto(f"{site.of_file(rrd.name)}&renderer=webgl")
        picture = picture_at_rest(page)
        if at_end:
            page.keyboard.press("Control+Shift+ArrowRight")  # the viewer's key for the end of the timeline
            picture = picture_at_rest(page, unlike=picture)
    png.write_bytes(picture)
    return png


def picture_at_rest(page: "Page", *, unlike: bytes = b"") -> bytes:
    """The first screenshot that shows more than a loading page and equals the one before it.

    Args:
        page: A page that still changes.
        unlike: The page before the last key press, which does not count.

    Raises:
        RecordingError: There is no such picture in time.
    """
    last, deadline_s = b"", time.monotonic() + _WAIT_S
    while time.monotonic() < deadline_s:
        page.wait_for_timeout(_POLL_MS)
        picture = page.screenshot()
        if picture == last and picture != unlike and _shows_something(picture):
            return picture
        last = picture
    raise RecordingError(
        f"{page.url}: found no finished picture within {_WAIT_S:g} s; expected one. Free the machine, or look at it in "
        "a browser."
    )


def _shows_something(png: bytes) -> bool:
    """Whether a picture has more colours than a loading page (a spinner and a line of text)."""
    rgb = np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))
    return len(np.unique(rgb[::4, ::4].reshape(-1, 3), axis=0)) > 100
