"""A study in peace: bots who walk for minutes, and a real browser alone, beside bots, and far away."""

import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

from pydantic import BaseModel, ConfigDict

from human_study.design.study import load_study
from sim.errors import MissingDependencyError

from ...bots.records import BotKind
from ...bots.run import quantile, run_bots
from ...bots.site import Site, make_bot_study
from ..harness import Progress, Values
from .browser import PACE_S, key_to_image_ms, walking
from .delay import delayed
from .server import Server


class LoadSettings(BaseModel):
    """How many act for how long."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    bots: int = 50
    seconds: float = 300.0
    kinds: tuple[BotKind, ...] = ("random", "shortest")
    rate: float = 2.0
    """Keys per second of each."""
    seed: int = 5


class BrowserSettings(BaseModel):
    """How much is pressed in the browser."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    keys: int = 60
    """In each case."""
    together: int = 10
    """Participants who act at once in the second case, the one in the browser among them."""
    rate: float = 2.0
    """Keys per second of the others."""
    round_trip_ms: float = 80.0
    """Injected in the third case, half of it each way."""
    seed: int = 6


def measure_load(settings: LoadSettings, *, folder: Path, dataset: Path, progress: Progress) -> Values:
    """Bots who walk: `BotFigures`.

    Args:
        settings: How many.
        folder: An empty one.
        dataset: Of one invented home.
        progress: Told what is done now.

    Raises:
        StudyError: The study cannot be served, or a bot is not let in.
    """
    make_bot_study(folder, participants=settings.bots, seed=settings.seed, dataset=dataset)
    with Server(folder / "study", dataset) as server:
        figures = run_bots(
            server.start(),
            participants=settings.bots,
            seconds=settings.seconds,
            rate=settings.rate,
            kinds=settings.kinds,
            seed=settings.seed,
            progress=progress,
        )
    return figures.model_dump()


def measure_browser(settings: BrowserSettings, *, folder: Path, dataset: Path, progress: Progress) -> Values:
    """Real Chromium: from keydown until the new picture is drawn; each case has a participant of its own.

    Arguments as `measure_load`'s.

    Returns:
        `alone_..._ms`, nobody else is in the study; `key_to_image_..._ms`, `together` participants act at once;
        `delayed_..._ms`, alone, over a line with `round_trip_ms`. None = not one key had its picture in time. Empty
        where there is no browser.

    Raises:
        StudyError: The study cannot be served, or a bot is not let in.
    """
    make_bot_study(folder, participants=settings.together + 2, seed=settings.seed, dataset=dataset)
    with Server(folder / "study", dataset) as server:
        return _measured(server.start(), settings, progress)


def _measured(site: Site, settings: BrowserSettings, progress: Progress) -> Values:
    config, codes = load_study(site.folder), list(site.links)
    others = Site(site.folder, site.dataset, None, tuple(one for one in site.everybody if one.code in codes[3:]), None)
    try:
        progress("Chromium, alone")
        with walking(site.links[codes[0]], config) as page:
            alone = key_to_image_ms(page, num_keys=settings.keys)
        progress(f"Chromium, over a line with a round trip of {settings.round_trip_ms:g} ms")
        with (
            delayed(site.links[codes[1]], one_way_s=settings.round_trip_ms / 2e3) as link,
            walking(link, config) as page,
        ):
            late = key_to_image_ms(page, num_keys=settings.keys)
        progress(f"Chromium and {settings.together - 1} bots")
        with walking(site.links[codes[2]], config) as page, _acting_beside(others, settings):
            together = key_to_image_ms(page, num_keys=settings.keys)
    except MissingDependencyError as error:
        progress(f"No figures of a browser: {error}")
        return {}
    late_p50 = quantile(late, 0.5)
    return {
        "alone_p50_ms": quantile(alone, 0.5),
        "alone_p95_ms": quantile(alone, 0.95),
        "key_to_image_p50_ms": quantile(together, 0.5),
        "key_to_image_p95_ms": quantile(together, 0.95),
        "delayed_p50_ms": late_p50,
        "delayed_p95_ms": quantile(late, 0.95),
        "delayed_p50_over_round_trip_ms": None if late_p50 is None else late_p50 - settings.round_trip_ms,
    }


@contextmanager
def _acting_beside(site: Site, settings: BrowserSettings) -> Iterator[None]:
    """Bots that act during the block, which begins when all are in."""
    are_in = threading.Event()
    seconds = 10.0 + 1.2 * PACE_S * settings.keys
    with ThreadPoolExecutor(1) as thread:
        acting = thread.submit(
            run_bots,
            site,
            participants=settings.together - 1,
            seconds=seconds,
            rate=settings.rate,
            kinds=("random",),
            seed=settings.seed,
            on_acting=are_in.set,
        )
        acting.add_done_callback(lambda _: are_in.set())
        are_in.wait()
        yield
        acting.result()
