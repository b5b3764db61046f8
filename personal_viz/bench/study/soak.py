"""Minutes with bots that come and go, press too fast or too slowly: does the server hold more and more (test 21)?"""

import http.client
import json
import time
from collections.abc import Callable
from pathlib import Path
from urllib.parse import urlsplit

from pydantic import BaseModel, ConfigDict

from ...bots.site import make_bot_study
from ...bots.walker import BotKind
from .crowd import crowd
from .processes import Held, held_by
from .records import key_tally, missing_steps
from .server import Server

_SETTLE_S = 30.0
"""Longest wait until the server has noticed that somebody left."""
_WARM_UP_S = 10.0
"""Everybody acts for so long before the first look: thread pools grow with their first work."""

_MOMENTS = 10


class SoakSettings(BaseModel):
    """How long, and with whom."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    seconds: float = 600.0
    bots: int = 20
    kinds: tuple[BotKind, ...] = ("disconnecting", "impatient", "slow", "random")
    rate: float = 2.0
    seed: int = 13


class SoakFigures(BaseModel):
    """What the server held when everybody was there for the first time, at the end, and when all had left."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    participants: int
    seconds: float
    actions: int
    connections: int
    """All that the bots opened."""
    lost: int
    duplicated: int
    at_start: Held | None
    """Everybody is there; None where there is no /proc."""
    at_end: Held | None
    """Everybody is there, at the end."""
    at_leave: Held | None
    """Everybody has left."""
    fds_growth: int | None
    """From start to end."""
    threads_growth: int | None
    clients_growth: int | None
    """Connections of viser."""
    rss_growth_mb: float | None
    """From start to end; the first trials of everybody are among it."""
    rss_growth_second_half_mb: float | None
    """What of it came in the second half: near 0 unless something leaks."""
    rss_mb: tuple[float, ...]
    """At ten moments, evenly spread."""
    peak_mb: float | None
    clients_left: int | None
    """Connections of viser when everybody has left."""
    leases_left: int
    """Participants whom the server believes to be there when everybody has left."""
    problems: tuple[str, ...]


def measure_soak(
    settings: SoakSettings, *, folder: Path, dataset: Path, progress: Callable[[str], None]
) -> SoakFigures:
    """Everybody comes, acts, drops connections and comes back; then all leave.

    Args:
        settings: How long.
        folder: An empty one.
        dataset: Of one invented home.
        progress: Told what is done now.

    Raises:
        StudyError: The study cannot be served, or bots do not find back.
    """
    make_bot_study(folder, participants=settings.bots, seed=settings.seed, dataset=dataset)
    with Server(folder / "study", dataset) as server:
        site = server.start()
        kinds, codes = settings.kinds, list(site.links)[: settings.bots]
        with crowd(site, codes, kinds=kinds, rate=settings.rate, seed=settings.seed) as bots:
            bots.arrive()
            bots.begin()
            time.sleep(min(_WARM_UP_S, settings.seconds / 3))  # the bots act; nothing else is waited for
            bots.halt()
            at_start, began_s = _settled(server, settings.bots), time.perf_counter()
            progress(f"soak: {settings.bots} bots act for {settings.seconds:g} s")
            bots.begin()
            rss_mb = _watched(server, settings.seconds)
            bots.halt()
            at_end, seconds = _settled(server, settings.bots), time.perf_counter() - began_s
        at_leave = _settled(server, 0)
        leases_left = _people_here(server.dashboard)
        keys, missing = key_tally(site.folder, bots.bots), missing_steps(site.folder, bots.bots)
    return SoakFigures(
        participants=settings.bots,
        seconds=seconds,
        actions=keys.sent,
        connections=sum(log.num_connections for log in bots.logs),
        lost=keys.lost + len(missing),
        duplicated=keys.duplicated,
        at_start=at_start,
        at_end=at_end,
        at_leave=at_leave,
        fds_growth=None if at_start is None or at_end is None else at_end.fds - at_start.fds,
        threads_growth=None if at_start is None or at_end is None else at_end.threads - at_start.threads,
        clients_growth=None if at_start is None or at_end is None else at_end.clients - at_start.clients,
        rss_growth_mb=None if at_start is None or at_end is None else at_end.rss_mb - at_start.rss_mb,
        rss_growth_second_half_mb=rss_mb[-1] - rss_mb[_MOMENTS // 2 - 1] if rss_mb else None,
        rss_mb=rss_mb,
        peak_mb=None if at_end is None else at_end.peak_mb,
        clients_left=None if at_leave is None else at_leave.clients,
        leases_left=leases_left,
        problems=(*bots.problems, *missing),
    )


def _watched(server: Server, seconds: float) -> tuple[float, ...]:
    """Resident memory at moments of the time in which the bots act; () where there is no /proc."""
    found = []
    for _ in range(_MOMENTS):
        time.sleep(seconds / _MOMENTS)  # the bots act; nothing else is waited for
        found.append(held_by(server.pid))
    return tuple(held.rss_mb for held in found if held is not None)


def _settled(server: Server, people: int) -> Held | None:
    """What is held when the server has as many connections as people are there, or does not come to that in time."""
    deadline_s = time.perf_counter() + _SETTLE_S
    while True:
        held = held_by(server.pid)
        if held is None or time.perf_counter() > deadline_s:
            return held
        if held.clients == people and _people_here(server.dashboard) == people:
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
