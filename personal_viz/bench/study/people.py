"""Many people at once: more than the cores can show pictures to, and still no key may be lost (test 5)."""

import os
import time
from collections.abc import Callable
from pathlib import Path

from pydantic import BaseModel, ConfigDict

from ...bots.log import BotLog, Press
from ...bots.run import quantile
from ...bots.site import cpu_seconds, make_bot_study
from ...bots.walker import BotKind
from .crowd import crowd
from .processes import held_by
from .records import key_tally, missing_steps
from .server import Server


class PeopleSettings(BaseModel):
    """How many."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    bots: int = 200
    seconds: float = 60.0
    rate: float = 4.0
    """Keys per second that each is asked for; they press on when a picture is late."""
    kinds: tuple[BotKind, ...] = ("random",)
    seed: int = 17


class PeopleFigures(BaseModel):
    """What became of their keys, and what the server needed. Times are taken at the bots, without a browser."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    participants: int
    seconds: float
    actions: int
    """Keys that were sent."""
    actions_per_s: float
    frames: int
    """Pictures received."""
    lost: int
    """Keys and steps that were acknowledged, or came before such ones, and are not on disk."""
    duplicated: int
    cut_off: int
    """Keys that were on their way when everybody left."""
    untimed: int
    """Keys that are stored without the page's own time, because the server was too late."""
    ack_p50_ms: float | None
    """From sending a key to the step counter that follows its commit; the keys on which the bot waited."""
    ack_p95_ms: float | None
    key_to_frame_p50_ms: float | None
    key_to_frame_p95_ms: float | None
    server_cpu_ms_per_action: float
    rss_before_mb: float | None
    """Resident memory of serving process and workers before anybody came; None where there is no /proc."""
    rss_after_mb: float | None
    """When all had acted and left."""
    peak_mb: float | None
    """Sum of the largest resident memory of each process."""
    peak_mb_per_person: float | None
    """What the peak is above the memory before, per participant."""
    load_before: float
    """The machine's load average when all were in."""
    problems: tuple[str, ...]


def measure_people(
    settings: PeopleSettings, *, folder: Path, dataset: Path, progress: Callable[[str], None]
) -> PeopleFigures:
    """All come in, then all press keys.

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
        site = server.start()
        before = held_by(server.pid)
        progress(f"{settings.bots} bots come in")
        with crowd(site, list(site.links), kinds=settings.kinds, rate=settings.rate, seed=settings.seed) as bots:
            bots.arrive()
            progress(f"all are in; they act for {settings.seconds:g} s")
            load_before, cpu_s, began_s = os.getloadavg()[0], cpu_seconds(server.pid), time.perf_counter()
            bots.begin()
            time.sleep(settings.seconds)
            bots.halt()
            seconds = time.perf_counter() - began_s
        cpu_s, after = cpu_seconds(server.pid) - cpu_s, held_by(server.pid)
        progress("comparing with the records")
        keys, missing = key_tally(site.folder, bots.bots), missing_steps(site.folder, bots.bots)
    acks = _times_ms(bots.logs, lambda press: press.counted_s)
    shown = _times_ms(bots.logs, lambda press: press.shown_s)
    return PeopleFigures(
        participants=settings.bots,
        seconds=seconds,
        actions=keys.sent,
        actions_per_s=keys.sent / seconds,
        frames=sum(log.num_frames for log in bots.logs),
        lost=keys.lost + len(missing),
        duplicated=keys.duplicated,
        cut_off=keys.cut_off,
        untimed=keys.untimed,
        ack_p50_ms=quantile(acks, 0.5),
        ack_p95_ms=quantile(acks, 0.95),
        key_to_frame_p50_ms=quantile(shown, 0.5),
        key_to_frame_p95_ms=quantile(shown, 0.95),
        server_cpu_ms_per_action=1e3 * cpu_s / max(1, keys.sent),
        rss_before_mb=None if before is None else before.rss_mb,
        rss_after_mb=None if after is None else after.rss_mb,
        peak_mb=None if after is None else after.peak_mb,
        peak_mb_per_person=None if before is None or after is None else (after.peak_mb - before.rss_mb) / settings.bots,
        load_before=load_before,
        problems=(*bots.problems, *missing),
    )


def _times_ms(logs: list[BotLog], moment: Callable[[Press], float | None]) -> list[float]:
    found = []
    for log in logs:
        for press in log.presses:
            at_s = moment(press)
            if at_s is not None:
                found.append(1e3 * (at_s - press.sent_s))
    return found
