"""Times how long a key takes to show its picture in a real Chromium, inside the page and by the page's own clock.

Three cases: alone, beside bots, and far away, through a TCP proxy that forwards every byte with a delay.
"""

import asyncio
import contextlib
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from human_study.design.study import StudyConfig, load_study
from sim.errors import MissingDependencyError

from ...bots.crowd import background_loop
from ...bots.figures import quantiles_ms
from ...bots.forms import right_answers
from ...bots.server import Server
from ...bots.site import make_bot_study
from ...browser import open_chromium
from ..harness import Progress, Values
from .crew import CrewSettings

if TYPE_CHECKING:
    from playwright.sync_api import Page

WALK = ("w", "w", "a", "w", "d", "w", "w", "d", "w", "a")
"""Keys that are pressed in turn: forward, left, right."""
HOLD_MS = 60
"""How long a key is held, milliseconds."""
PACE_S = 0.5
"""Seconds from one press to the next; longer if the picture takes longer."""
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
"""Runs before the page's own scripts, whose key listener hides keys from all later listeners."""
_ONWARD = ("I agree and take part", "I have read this", "Next", "Begin", "Begin to practise", "Start", "Continue")
_CHUNK = 64 * 1024


class BrowserSettings(CrewSettings):
    """Number of keys pressed in the browser, and the bots beside it."""

    keys: int = 60
    """Number of keys in each case."""
    bots: int = 9
    """Number of bots that act at the same time as the browser in the second case."""
    round_trip_ms: float = 80.0
    """Round trip injected in the third case, half of it each way."""
    seed: int = 6

    @property
    def words(self) -> str:
        """A description of the work, for the report."""
        return (
            f"{self.keys} keys in Chromium, at most one each half second, from keydown until the new picture is drawn: "
            f"alone, with {self.bots} bots acting beside it, and over a line with a round trip of "
            f"{self.round_trip_ms:g} ms."
        )


def measure_browser(settings: BrowserSettings, *, folder: Path, dataset: Path, progress: Progress) -> Values:
    """Times from keydown until the new picture is drawn in a real Chromium; each case has its own participant.

    Returns:
        `alone_..._ms` with nobody else in the study; `key_to_image_..._ms` while `bots` act; `delayed_..._ms` alone,
        over a line with `round_trip_ms`. None = no key had its picture in time. Empty if there is no browser.
    """
    make_bot_study(folder, participants=settings.bots + 3, seed=settings.seed, dataset=dataset)
    with Server(folder / "study", dataset) as server:
        site = server.start()
        config, (first, second, third, *others) = load_study(site.folder), site.people(("pan",))
        try:
            progress("Chromium, alone")
            with walking(first.link, config) as page:
                alone = key_to_image_ms(page, num_keys=settings.keys)
            progress(f"Chromium, over a line with a round trip of {settings.round_trip_ms:g} ms")
            with (
                delayed(second.link, one_way_s=settings.round_trip_ms / 2e3) as link,
                walking(link, config) as page,
            ):
                late = key_to_image_ms(page, num_keys=settings.keys)
            progress(f"Chromium and {settings.bots} bots")
            with walking(third.link, config) as page, settings.crowd(site, others) as bots:
                bots.arrive()
                bots.begin()
                together = key_to_image_ms(page, num_keys=settings.keys)
        except MissingDependencyError as error:
            progress(f"No figures of a browser: {error}")
            return {}
    delayed_ms = quantiles_ms("delayed", late, 50, 95)
    late_ms = delayed_ms["delayed_p50_ms"]
    return {
        **quantiles_ms("alone", alone, 50, 95),
        **quantiles_ms("key_to_image", together, 50, 95),
        **delayed_ms,
        "delayed_p50_over_round_trip_ms": None if late_ms is None else late_ms - settings.round_trip_ms,
    }


@contextmanager
def walking(link: str, config: StudyConfig) -> Iterator["Page"]:
    """Yields the page of a participant in Chromium who has answered all pages and stands at the first trial's start.

    Args:
        link: Personal link of a PAN participant.
        config: The study, whose quiz must be answered.

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
        page: Page from `walking`.
        num_keys: Number of measured keys; keys whose picture did not come within 20 s are left out.
        warm_ups: Number of presses before, which are not measured.
    """
    times = []
    for number in range(warm_ups + num_keys):
        began_s = time.perf_counter()
        times.append(_press(page, WALK[number % len(WALK)]))
        time.sleep(max(0.0, PACE_S - (time.perf_counter() - began_s)))
    return [ms for ms in times[warm_ups:] if ms is not None]


@contextmanager
def delayed(link: str, *, one_way_s: float) -> Iterator[str]:
    """Yields the link through a proxy on loopback that delays both directions, until the end of the block."""
    parts = urlsplit(link)
    assert parts.port is not None, link

    async def join(near_in: asyncio.StreamReader, near_out: asyncio.StreamWriter) -> None:
        """Serves one connection from beginning to end."""
        far_in, far_out = await asyncio.open_connection("127.0.0.1", parts.port)
        with contextlib.suppress(OSError):  # one side hung up
            await asyncio.gather(_hand_on(near_in, far_out, one_way_s), _hand_on(far_in, near_out, one_way_s))
        for writer in (near_out, far_out):
            writer.close()

    with background_loop("delay") as loop:
        server = asyncio.run_coroutine_threadsafe(asyncio.start_server(join, "127.0.0.1", 0), loop).result()
        port = server.sockets[0].getsockname()[1]
        yield link.replace(f":{parts.port}", f":{port}", 1)
        loop.call_soon_threadsafe(server.close)


def _press(page: "Page", key: str) -> float | None:
    """Presses one key; returns the milliseconds until its picture, None if no picture came in time."""
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
    """Presses the buttons that lead on until the robot's picture appears."""
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


async def _hand_on(source: asyncio.StreamReader, target: asyncio.StreamWriter, one_way_s: float) -> None:
    """Forwards bytes in order, each `one_way_s` after it came; any number may be on the way."""
    loop = asyncio.get_running_loop()
    while data := await source.read(_CHUNK):
        loop.call_later(one_way_s, target.write, data)
    await asyncio.sleep(2 * one_way_s)  # everything on the way has arrived
    with contextlib.suppress(OSError, NotImplementedError):
        target.write_eof()
