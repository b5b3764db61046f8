"""A headless Chromium for screenshots and browser tests; participants use their own browser, not this."""

import contextlib
import shutil
from collections.abc import Iterator
from typing import TYPE_CHECKING

from sim.errors import MissingDependencyError

if TYPE_CHECKING:
    from playwright.sync_api import Browser, BrowserContext

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    # without a GPU, pages are composited on the processor: 34 frames a second instead of 2 on a busy machine
    "--disable-gpu-compositing",
    # no request of a page may leave this machine (Rerun's viewer would send usage data)
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
)


def find_chromium() -> str | None:
    """Path of an installed Chromium or Chrome, None if there is none."""
    return next((path for name in NAMES if (path := shutil.which(name))), None)


@contextlib.contextmanager
def launch_chromium() -> Iterator["Browser"]:
    """A browser that ends with the block; each of its contexts has a profile of its own, empty at first.

    Raises:
        MissingDependencyError: Playwright or Chromium is not installed.
    """
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        raise MissingDependencyError(
            "playwright: found no such package; expected it for a headless browser. "
            "Install it: pip install personal-viz[test]"
        ) from None
    path = find_chromium()
    if path is None:
        raise MissingDependencyError(
            f"found no browser; expected one of {', '.join(NAMES)}. Install it: apt-get install -y chromium"
        )
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=path,
            headless=False,  # the flag --headless=new is the full browser without a window
            args=list(FLAGS),
        )
        try:
            yield browser
        finally:
            browser.close()


@contextlib.contextmanager
def open_chromium(*, width: int = 1280, height: int = 800) -> Iterator["BrowserContext"]:
    """A browser with an empty profile that ends with the block.

    Raises:
        MissingDependencyError: Playwright or Chromium is not installed.
    """
    with launch_chromium() as browser:
        yield browser.new_context(viewport={"width": width, "height": height})
