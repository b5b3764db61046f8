"""Many people at once: more than the cores can show pictures to, and still no key may be lost."""

import os
import time
from collections.abc import Callable
from pathlib import Path

from pydantic import BaseModel, ConfigDict

from ...bots.records import BotKind, BotLog, Press, count_bots
from ...bots.run import quantile
from ...bots.site import cpu_seconds
from ..harness import Progress, Values
from .crowd import staffed
from .records import missing_steps
from .server import held_by


class PeopleSettings(BaseModel):
    """How many."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    bots: int = 200
    seconds: float = 60.0
    rate: float = 4.0
    """Keys per second that each is asked for; they press on when a picture is late."""
    kinds: tuple[BotKind, ...] = ("random",)
    seed: int = 17


def measure_people(settings: PeopleSettings, *, folder: Path, dataset: Path, progress: Progress) -> Values:
    """All come in, then all press keys. Times are taken at the bots, without a browser.

    Args:
        settings: How many.
        folder: An empty one.
        dataset: Of one invented home.
        progress: Told what is done now.

    Returns:
        `actions` (keys sent), `frames` (pictures received); `lost`, keys and steps that were acknowledged, or came
        before such ones, and are not on disk; `cut_off`, keys on their way when everybody left; `untimed`, stored
        without the page's own time, because the server was too late; `ack_..._ms` from sending a key to the step
        counter that follows its commit, of the keys on which the bot waited; `rss_before_mb` of serving process and
        workers before anybody came, `rss_after_mb` when all had left, `peak_mb` the sum of the largest of each, and
        `peak_mb_per_person` what that is above the memory before; `load_before`, the load average when all were in.

    Raises:
        StudyError: The study cannot be served, or a bot is not let in.
    """
    crew = {"kinds": settings.kinds, "rate": settings.rate, "seed": settings.seed}
    with staffed(folder, dataset, bots=settings.bots, **crew) as (server, site, bots):
        before = held_by(server.pid)
        progress(f"{settings.bots} bots come in")
        bots.arrive()
        progress(f"all are in; they act for {settings.seconds:g} s")
        load_before, cpu_s, began_s = os.getloadavg()[0], cpu_seconds(server.pid), time.perf_counter()
        bots.begin()
        time.sleep(settings.seconds)  # the measured time itself: the bots act
        bots.halt()
        seconds = time.perf_counter() - began_s
        bots.leave()
        cpu_s, after = cpu_seconds(server.pid) - cpu_s, held_by(server.pid)
        progress("comparing with the records")
        keys, missing = count_bots(site.folder, bots.logs), missing_steps(site.folder, bots.bots)
    acks = _times_ms(bots.logs, lambda press: press.counted_s)
    shown = _times_ms(bots.logs, lambda press: press.shown_s)
    return {
        "participants": settings.bots,
        "seconds": seconds,
        "actions": keys.sent,
        "actions_per_s": keys.sent / seconds,
        "frames": sum(log.num_frames for log in bots.logs),
        "lost": len(keys.lost) + len(missing),
        "duplicated": keys.duplicated,
        "cut_off": keys.cut_off,
        "untimed": keys.untimed,
        "ack_p50_ms": quantile(acks, 0.5),
        "ack_p95_ms": quantile(acks, 0.95),
        "key_to_frame_p50_ms": quantile(shown, 0.5),
        "key_to_frame_p95_ms": quantile(shown, 0.95),
        "server_cpu_ms_per_action": 1e3 * cpu_s / max(1, keys.sent),
        "rss_before_mb": before["rss_mb"],
        "rss_after_mb": after["rss_mb"],
        "peak_mb": after["peak_mb"],
        "peak_mb_per_person": (after["peak_mb"] - before["rss_mb"]) / settings.bots,
        "load_before": load_before,
        "problems": (*bots.problems, *keys.lost, *missing),
    }


def _times_ms(logs: list[BotLog], moment: Callable[[Press], float | None]) -> list[float]:
    found = []
    for log in logs:
        for press in log.presses:
            at_s = moment(press)
            if at_s is not None:
                found.append(1e3 * (at_s - press.sent_s))
    return found
