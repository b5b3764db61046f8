"""What a study costs its participants: how long a key takes until it is on disk and until its picture is seen."""

import os
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict

from human_study.study import load_study
from sim.errors import MissingDependencyError
from sim.world.raycast import own_cores

from ..bots import BotKind
from ..bots_run import BotFigures, quantile, run_bots
from ..bots_site import Site, make_bot_study, served
from .study_browser import PACE_S, key_to_image_ms, walking
from .study_delay import delayed
from .study_store import store_acks_ms

LIMITS = {
    "alone_p50_ms": 60.0,
    "key_to_image_p50_ms": 100.0,
    "key_to_image_p95_ms": 200.0,
    "delayed_p50_over_round_trip_ms": 60.0,
    "store_ack_p95_ms": 50.0,
    "ack_p95_ms": 50.0,
    "lost": 0.0,
    "duplicated": 0.0,
}
"""Most that the figures may be (the issue's targets)."""
_SEED = 5


class StudySettings(BaseModel):
    """How much is measured."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    keys: int = 60
    """Pressed in the browser in each case."""
    together: int = 10
    """Participants who act at once in the second case, the one in the browser among them."""
    round_trip_ms: float = 80.0
    """Injected in the third case, half of it each way."""
    bots: int = 50
    bot_seconds: float = 300.0
    bot_kinds: tuple[BotKind, ...] = ("random", "shortest")
    rate: float = 2.0
    """Actions per second of each bot."""
    store_seconds: float = 10.0


FULL = StudySettings()
QUICK = StudySettings(keys=15, bot_seconds=20.0, store_seconds=3.0)


class StudyFigures(BaseModel):
    """What `bench study --json` prints."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    benchmark: Literal["study"] = "study"
    settings: StudySettings
    participants: int
    """Bots of the load case, of which `ack_*`, `lost` and `duplicated` are."""
    ack_p50_ms: float | None
    """Load case, at the bot: from sending a key to the step counter that follows the commit."""
    ack_p95_ms: float | None
    key_to_image_p50_ms: float | None
    """Real Chromium, `together` participants acting at once: from keydown until the new picture is drawn. None = there
    is no Chromium or no Playwright, as in the other figures of the browser."""
    key_to_image_p95_ms: float | None
    lost: int
    """Keys of the load case that were sent and are not in the database."""
    duplicated: int
    """Keys of the load case that are in the database more than once."""
    alone_p50_ms: float | None
    """As `key_to_image_p50_ms`, with nobody else in the study."""
    alone_p95_ms: float | None
    delayed_p50_ms: float | None
    """As `alone_p50_ms`, over a line with `round_trip_ms`."""
    delayed_p95_ms: float | None
    delayed_p50_over_round_trip_ms: float | None
    store_ack_p50_ms: float
    """The store alone, for as many people as there are bots: from handing over a key and its step until they are on
    disk."""
    store_ack_p95_ms: float
    load: BotFigures
    """All figures of the load case."""
    cores: int
    load_before: float
    """The machine's load average before anything was measured."""
    created_utc: str


def measure_study(settings: StudySettings, *, progress: Callable[[str], None]) -> StudyFigures:
    """Measures everything on one invented home.

    Args:
        settings: How much.
        progress: Told what is done now.

    Raises:
        StudyError: The study cannot be served.
    """
    load_before = os.getloadavg()[0]
    progress("the store alone")
    acks = store_acks_ms(participants=settings.bots, rate=settings.rate, seconds=settings.store_seconds)
    with tempfile.TemporaryDirectory(prefix="personal-bench-study-") as name:
        folder = Path(name)
        progress("making a study")
        dataset = make_bot_study(folder, participants=settings.bots + settings.together + 2, seed=_SEED)
        with served(folder / "study", dataset) as site:
            load = _load(site, settings, progress)
            alone, together, late = _in_browser(site, settings, progress)
    late_p50 = quantile(late, 0.5)
    return StudyFigures(
        settings=settings,
        participants=settings.bots,
        ack_p50_ms=load.ack_p50_ms,
        ack_p95_ms=load.ack_p95_ms,
        key_to_image_p50_ms=quantile(together, 0.5),
        key_to_image_p95_ms=quantile(together, 0.95),
        lost=load.lost,
        duplicated=load.duplicated,
        alone_p50_ms=quantile(alone, 0.5),
        alone_p95_ms=quantile(alone, 0.95),
        delayed_p50_ms=late_p50,
        delayed_p95_ms=quantile(late, 0.95),
        delayed_p50_over_round_trip_ms=None if late_p50 is None else late_p50 - settings.round_trip_ms,
        store_ack_p50_ms=float(np.quantile(acks, 0.5)),
        store_ack_p95_ms=float(np.quantile(acks, 0.95)),
        load=load,
        cores=own_cores(),
        load_before=load_before,
        created_utc=datetime.now(UTC).isoformat(timespec="seconds"),
    )


def figure_rows(figures: StudyFigures) -> list[tuple[str, ...]]:
    """Heads, then each figure with its target, where it has one."""
    values = {name: value for name, value in figures if isinstance(value, int | float) and name != "participants"}
    values |= {f"load: {name}": value for name, value in figures.load if isinstance(value, int | float)}
    rows = []
    for name, value in values.items():
        limit = LIMITS.get(name)
        verdict = "" if limit is None else "yes" if value <= limit else "no"
        rows.append((name, f"{value:.1f}", "" if limit is None else f"<= {limit:g}", verdict))
    missing = [(name, "-", f"<= {LIMITS[name]:g}", "not measured") for name in LIMITS if getattr(figures, name) is None]
    return [("figure", "found", "target", "met"), *rows, *missing]


def markdown(figures: StudyFigures) -> str:
    """The table, and what was measured."""
    heads, *rows = ("| " + " | ".join(row) + " |" for row in figure_rows(figures))
    used = figures.settings
    text = (
        f"{figures.created_utc}, {figures.cores} cores, load average {figures.load_before:.2f} before it began. A "
        "study on an invented home, served by its own gateway and workers; bots, browser and server share the cores. "
        f"Browser: {used.keys} keys, at most one each half second, from keydown until the new picture is drawn, "
        f"alone, with {used.together - 1} bots acting beside it, and over a line with a round trip of "
        f"{used.round_trip_ms:g} ms. Load: {used.bots} bots ({', '.join(used.bot_kinds)}), {used.rate:g} keys a second "
        f"each, for {used.bot_seconds:g} s; random ones press on when a picture is late (such keys are stored and have "
        "no effect), the others wait."
    )
    return "\n".join(["# Human study", "", text, "", heads, "|---|---|---|---|", *rows, ""])


def _load(site: Site, settings: StudySettings, progress: Callable[[str], None]) -> BotFigures:
    return run_bots(
        site,
        participants=settings.bots,
        seconds=settings.bot_seconds,
        rate=settings.rate,
        kinds=settings.bot_kinds,
        seed=_SEED,
        progress=progress,
    )


def _in_browser(
    site: Site, settings: StudySettings, progress: Callable[[str], None]
) -> tuple[Sequence[float], Sequence[float], Sequence[float]]:
    """Milliseconds from key to picture alone, together, and over a slow line; nothing where there is no browser.

    Each case has a participant of its own, behind those of the load case.
    """
    config = load_study(site.folder)
    codes = list(site.links)[settings.bots :]
    others = Site(site.folder, site.dataset, None, {code: site.links[code] for code in codes[3:]}, None)
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
        return (), (), ()
    return alone, together, late


@contextmanager
def _acting_beside(site: Site, settings: StudySettings) -> Iterator[None]:
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
            seed=_SEED + 1,
            on_acting=are_in.set,
        )
        acting.add_done_callback(lambda _: are_in.set())
        are_in.wait()
        yield
        acting.result()
