"""Minutes with bots that come and go, press too fast or too slowly: does the server hold more and more?"""

import http.client
import json
import time
from pathlib import Path
from urllib.parse import urlsplit

from pydantic import BaseModel, ConfigDict

from ...bots.records import BotKind, count_bots
from ..harness import Progress, Values
from .crowd import staffed
from .records import missing_steps
from .server import Server, held_by

_SETTLE_S = 30.0
"""Longest wait until the server has noticed that somebody left."""
_WARM_UP_S = 10.0
"""How long everybody acts before the first look: thread pools grow with their first work."""
_MOMENTS = 10
"""When memory is looked at, evenly spread."""


class SoakSettings(BaseModel):
    """How long, and with whom."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    seconds: float = 600.0
    bots: int = 20
    kinds: tuple[BotKind, ...] = ("disconnecting", "impatient", "slow", "random")
    rate: float = 2.0
    seed: int = 13


def measure_soak(settings: SoakSettings, *, folder: Path, dataset: Path, progress: Progress) -> Values:
    """Everybody comes, acts, drops connections and comes back; then all leave.

    Args:
        settings: How long.
        folder: An empty one.
        dataset: Of one invented home.
        progress: Told what is done now.

    Returns:
        What the server holds (`held_by`) `at_start`, when everybody was there for the first time, `at_end`, and
        `at_leave`, when all had left; `..._growth` from start to end, of `clients` those of viser; of memory also
        `rss_growth_second_half_mb`, near 0 unless something leaks (the first trials of everybody are among the first
        half); `connections`, all that the bots opened; `clients_left`, and `leases_left`, participants whom the server
        believes to be there when everybody has left.

    Raises:
        StudyError: The study cannot be served, or bots do not find back.
    """
    crew = {"kinds": settings.kinds, "rate": settings.rate, "seed": settings.seed}
    with staffed(folder, dataset, bots=settings.bots, **crew) as (server, site, bots):
        bots.arrive()
        bots.begin()
        time.sleep(min(_WARM_UP_S, settings.seconds / 3))  # the bots act; nothing else is waited for
        bots.halt()
        at_start, began_s = _settled(server, settings.bots), time.perf_counter()
        progress(f"soak: {settings.bots} bots act for {settings.seconds:g} s")
        bots.begin()
        rss_mb = []
        for _ in range(_MOMENTS):
            time.sleep(settings.seconds / _MOMENTS)
            rss_mb.append(held_by(server.pid)["rss_mb"])
        bots.halt()
        at_end, seconds = _settled(server, settings.bots), time.perf_counter() - began_s
        bots.leave()
        at_leave = _settled(server, 0)
        leases_left = _people_here(server.dashboard)
        keys, missing = count_bots(site.folder, bots.logs), missing_steps(site.folder, bots.bots)
    growth = {f"{name}_growth": at_end[name] - at_start[name] for name in ("fds", "threads", "clients")}
    return {
        "participants": settings.bots,
        "seconds": seconds,
        "actions": keys.sent,
        "connections": sum(log.num_connections for log in bots.logs),
        "lost": len(keys.lost) + len(missing),
        "duplicated": keys.duplicated,
        **growth,
        "rss_growth_mb": at_end["rss_mb"] - at_start["rss_mb"],
        "rss_growth_second_half_mb": rss_mb[-1] - rss_mb[_MOMENTS // 2 - 1],
        "peak_mb": at_end["peak_mb"],
        "clients_left": at_leave["clients"],
        "leases_left": leases_left,
        "at_start": at_start,
        "at_end": at_end,
        "at_leave": at_leave,
        "problems": (*bots.problems, *keys.lost, *missing),
    }


def _settled(server: Server, people: int) -> dict[str, float]:
    """What is held when the server has as many connections as people are there, or does not come to that in time."""
    deadline_s = time.perf_counter() + _SETTLE_S
    while True:
        held = held_by(server.pid)
        is_settled = held["clients"] == people and _people_here(server.dashboard) == people
        if is_settled or time.perf_counter() > deadline_s:
            return held
        time.sleep(0.5)


def _people_here(dashboard: str) -> int:
    """Participants who are there, as the researcher's page says: those whose leases do not run."""
    parts = urlsplit(dashboard)
    origin = f"{parts.scheme}://{parts.netloc}"
    connection = http.client.HTTPConnection(parts.netloc, timeout=30)
    connection.request("POST", "/enter", body=parts.fragment, headers={"Origin": origin})
    reply = connection.getresponse()
    reply.read()
    cookie = (reply.getheader("Set-Cookie") or "").partition(";")[0]
    connection.request("GET", "/progress", headers={"Cookie": cookie})
    people = json.loads(connection.getresponse().read())["people"]
    connection.close()
    return sum(bool(person["here"]) for person in people)
