"""Take a picture of a recording as Rerun's web viewer shows it, without a display: for the README, for developers."""

import io
import time
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from recordings.viewer.web import serve_file
from sim.errors import RecordingError

from ..browser import open_chromium

_POLL = 1.0
"""Seconds between two looks at the page."""


def screenshot_rrd(
    rrd: Path, png: Path, *, at_end: bool = False, size: tuple[int, int] = (1600, 900), timeout: float = 180.0
) -> Path:
    """Opens a recording in the web viewer and writes a picture of it once it no longer changes.

    Args:
        rrd: The recording; its own blueprint is used.
        png: The picture to write.
        at_end: Whether the time cursor stands at the end (whole trails, the goal) or at the start.
        size: (width, height) of the window in pixels.
        timeout: Seconds after which a viewer that shows nothing, or never comes to rest, is an error.

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
        page.set_default_timeout(timeout * 1000)
        page.goto(f"{site.of_file(rrd.name)}&renderer=webgl")
        picture = _picture_at_rest(page, timeout)
        if at_end and picture is not None:
            page.keyboard.press("Control+Shift+ArrowRight")  # the viewer's key for the end of the timeline
            picture = _picture_at_rest(page, timeout, other_than=picture)
    if picture is None:
        raise RecordingError(
            f"{rrd}: the viewer showed no finished picture in {timeout:.0f} s; expected one. "
            "Give more time, or open the file with: rerun FILE"
        )
    png.write_bytes(picture)
    return png


def _picture_at_rest(page: Any, timeout: float, *, other_than: bytes | None = None) -> bytes | None:
    """The first screenshot that shows something and equals the one before it, None when there is none in time.

    `other_than` is what the page showed before the last key press.
    """
    last: bytes | None = None
    until = time.monotonic() + timeout
    while time.monotonic() < until:
        page.wait_for_timeout(_POLL * 1000)
        picture = page.screenshot()
        if picture == last and picture != other_than and _shows_something(picture):
            return picture
        last = picture
    return None


def _shows_something(png: bytes) -> bool:
    """Whether a picture has more colours than a loading page (a spinner and a line of text)."""
    rgb = np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))
    return len(np.unique(rgb[::4, ::4].reshape(-1, 3), axis=0)) > 100
