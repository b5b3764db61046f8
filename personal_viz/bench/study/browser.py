"""From a key to its picture on the screen, in a real Chromium: measured inside the page, with the page's own clock."""

import contextlib
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from ...bots.flow import right_answers
from ...browser import open_chromium

if TYPE_CHECKING:
    from playwright.sync_api import Page

from human_study.design.study import StudyConfig

WALK = ("w", "w", "a", "w", "d", "w", "w", "d", "w", "a")
"""Keys that are pressed in turns: forward, left, right."""
HOLD_MS = 60
"""How long a key is held."""
PACE_S = 0.5
"""From one press to the next, or longer when the picture takes longer."""
ANSWER_S = 20.0
_SCRIPT = """
(() => {
  if (window.benchKeys) return;
  const state = window.benchKeys = { down: null, ms: [] };
  const stepOf = () => {
    const image = document.querySelector('img[data-step]');
    return image ? Number(image.dataset.step) : null;
  };
  window.addEventListener('keydown', (event) => {
    if (event.isTrusted && !event.repeat) state.down = { at: event.timeStamp, step: stepOf() };
  }, true);
  const look = () => {
    const down = state.down, image = document.querySelector('img[data-step]');
    if (!down || down.step === null || !image || Number(image.dataset.step) !== down.step + 1) return;
    state.down = null;
    image.decode().catch(() => {}).then(() => requestAnimationFrame(() => {
      const channel = new MessageChannel();  // its message comes after the frame has been drawn
      channel.port1.onmessage = () => state.ms.push(performance.now() - down.at);
      channel.port2.postMessage(0);
    }));
  };
  new MutationObserver(look).observe(document, { childList: true, subtree: true, attributes: true });
})()
"""
"""Runs before the page's own scripts, whose key listener lets no other listener behind it hear of keys."""
_ONWARD = ("I agree and take part", "I have read this", "Next", "Begin", "Begin to practise", "Start", "Continue")


@contextmanager
def walking(link: str, config: StudyConfig) -> Iterator["Page"]:
    """A participant in Chromium who has answered all pages and stands at the start of the first trial.

    Args:
        link: Personal link of a PAN participant.
        config: The study, whose quiz has to be answered.

    Raises:
        MissingDependencyError: There is no Chromium or no Playwright.
    """
    with open_chromium() as browser:
        browser.set_default_timeout(60_000)
        page = browser.new_page()
        page.add_init_script(_SCRIPT)
        page.goto(link)
        _answer_pages(page, right_answers(config))
        yield page


def key_to_image_ms(page: "Page", *, num_keys: int, warm_ups: int = 5) -> list[float]:
    """Milliseconds from each keydown until the page has drawn the picture that follows it.

    Args:
        page: Of `walking`.
        num_keys: That count; those whose picture did not come within 20 s are left out.
        warm_ups: Presses before, which do not.
    """
    times = []
    for number in range(warm_ups + num_keys):
        began_s = time.perf_counter()
        times.append(_press(page, WALK[number % len(WALK)]))
        time.sleep(max(0.0, PACE_S - (time.perf_counter() - began_s)))
    return [ms for ms in times[warm_ups:] if ms is not None]


def _press(page: "Page", key: str) -> float | None:
    """One key; None when no picture came of it in time."""
    count = page.evaluate("window.benchKeys.ms.length")
    page.keyboard.press(key, delay=HOLD_MS)
    deadline_s = time.perf_counter() + ANSWER_S
    while time.perf_counter() < deadline_s:
        times = page.evaluate("window.benchKeys.ms")
        if len(times) > count:
            return float(times[-1])
        page.wait_for_timeout(20)
    return None


def _answer_pages(page: "Page", answers: frozenset[str]) -> None:
    """Presses what leads on until the robot's picture is there."""
    from playwright.sync_api import Error as PlaywrightError

    image = page.locator("img[data-step]")
    labels: Sequence[str] = (*answers, *_ONWARD)
    buttons = page.get_by_role("button")
    buttons.first.wait_for()
    deadline_s = time.perf_counter() + 120
    while image.count() == 0 and time.perf_counter() < deadline_s:
        if page.get_by_text("Please press the key W").count():
            page.keyboard.press("w", delay=HOLD_MS)
        names = [name.strip() for name in buttons.all_inner_texts()]
        found = next((label for label in labels if label in names), None)
        if found is not None:
            with contextlib.suppress(PlaywrightError):  # the page may have gone on meanwhile
                page.get_by_role("button", name=found, exact=True).first.click(timeout=3_000)
        page.wait_for_timeout(150)
    image.wait_for()
