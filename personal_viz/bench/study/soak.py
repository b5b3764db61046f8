"""Measures whether the server's resources grow over minutes with bots that come and go, too fast or too slow."""

import json
import statistics
import threading
import time
from collections.abc import Sequence
from pathlib import Path

import psutil

from ...bots.forms import ask
from ...bots.records import BotKind, count_bots
from ...bots.server import Server
from ..harness import Progress, Values, held_by, resident_mb
from .crew import CrewSettings, staffed

_SETTLE_S = 30.0
"""Longest wait until the server has noticed that somebody left, seconds."""
_ASK_AGAIN_S = 0.5
"""Between two questions to the server whether somebody left, seconds."""
_WARM_UP_S = 10.0
"""Seconds for which everybody acts before the first measurement: thread pools grow with their first work."""
_SPANS = 10
"""The run's equal spans, minutes of a full run; each one's median memory counts."""
_LEVEL_SPAN = 3
"""The span after the third minute: memory should be level from here on."""
_SAMPLES = 10
"""Number of memory measurements in a span."""


class SoakSettings(CrewSettings):
    """Duration, and the bots."""

    seconds: float = 600.0
    bots: int = 20
    kinds: tuple[BotKind, ...] = ("disconnecting", "impatient", "slow", "random")
    seed: int = 13

    @property
    def words(self) -> str:
        """A description of the work, for the report."""
        return f"{self.bots} bots that come and go ({', '.join(self.kinds)}) for {self.seconds:g} s."


def measure_soak(settings: SoakSettings, *, folder: Path, dataset: Path, progress: Progress) -> Values:
    """Lets bots come, act, drop connections and come back; then all leave.

    Returns:
        The server's resources (`held_by`) `at_start`, when everybody was there for the first time, `at_end`, and
        `at_leave`, when all had left; `..._growth` from start to end, where `clients` are viser's; `connections`, all
        that the bots opened; `clients_left`, and `leases_left`, participants that the server counts as present after
        everybody has left; `gateway_drift_percent` and `workers_drift_percent`, the `drift_percent` of the serving
        process's memory and of all workers' together; `gateway_mb` and `workers_mb`, the medians in the last tenth.
    """
    with staffed(folder, dataset, settings) as (server, site, bots):
        bots.arrive()
        bots.begin()
        bots.halt(after_s=min(_WARM_UP_S, settings.seconds / 3))
        at_start, began_s = _settled(server, settings.bots), time.perf_counter()
        progress(f"soak: {settings.bots} bots act for {settings.seconds:g} s")
        bots.begin()
        spans = [_memory(server, settings.seconds / _SPANS) for _ in range(_SPANS)]
        bots.halt()
        at_end, seconds = _settled(server, settings.bots), time.perf_counter() - began_s
        bots.leave()
        at_leave = _settled(server, 0)
        leases_left = _people_here(server.dashboard)
        found = count_bots(site.folder, bots.logs)
    growth = {f"{name}_growth": at_end[name] - at_start[name] for name in ("fds", "threads", "clients")}
    last = spans[-1]
    return {
        "participants": settings.bots,
        "seconds": seconds,
        "actions": found.sent,
        "connections": sum(log.num_connections for log in bots.logs),
        "lost": len(found.lost),
        "duplicated": found.duplicated,
        **growth,
        "rss_growth_mb": at_end["rss_mb"] - at_start["rss_mb"],
        **{f"{name}_mb": last[name] for name in last},
        **{f"{name}_drift_percent": drift_percent([span[name] for span in spans]) for name in last},
        "peak_mb": at_end["peak_mb"],
        "clients_left": at_leave["clients"],
        "leases_left": leases_left,
        "at_start": at_start,
        "at_end": at_end,
        "at_leave": at_leave,
        "problems": (*bots.problems, *found.lost),
    }


def drift_percent(medians: Sequence[float]) -> float:
    """The largest change, up or down, of any later span's median from that of the span after the third.

    Args:
        medians: Of the run's tenths, in a full run its minutes.
    """
    level, *later = medians[_LEVEL_SPAN:]
    return 100 * max(abs(median / level - 1) for median in later)


def _memory(server: Server, seconds: float) -> dict[str, float]:
    """Median resident memory during a span of time, MB of 10^6 bytes: of the `gateway`, and of all `workers`."""
    samples = list[tuple[float, float]]()
    for _ in range(_SAMPLES):
        threading.Event().wait(seconds / _SAMPLES)  # between two measurements
        samples.append((resident_mb([psutil.Process(server.pid)]), resident_mb(server.workers)))
    gateway, workers = zip(*samples, strict=True)
    return {"gateway": statistics.median(gateway), "workers": statistics.median(workers)}


def _settled(server: Server, people: int) -> dict[str, float]:
    """The server's resources once it has as many connections as there are people, or after the longest wait."""
    deadline_s = time.perf_counter() + _SETTLE_S
    while True:
        held = held_by(server.pid)
        is_settled = held["clients"] == people and _people_here(server.dashboard) == people
        if is_settled or time.perf_counter() > deadline_s:
            return held
        threading.Event().wait(_ASK_AGAIN_S)


def _people_here(dashboard: str) -> int:
    """Number of participants that the researcher's page shows as present."""
    origin, _, token = dashboard.partition("/#")
    cookie = ask(origin, "/enter", body=token).cookie
    people = json.loads(ask(origin, "/progress", cookie=cookie).text)["people"]
    return sum(bool(person["here"]) for person in people)
