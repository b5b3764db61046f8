"""Serves many people at once: a crowd for which the cores can render pictures, and one that is too large for them.

Even in the second case no key may be lost.
"""

import os
import time
from pathlib import Path

from ...bots.records import BotKind
from ...bots.run import Spent, figures_of, run_bots
from ...bots.site import cpu_seconds, make_bot_study
from ..harness import Progress, Values
from .crowd import CrewSettings, staffed
from .records import kept
from .server import Server, held_by


class LoadSettings(CrewSettings):
    """Number of bots, and how long they act."""

    bots: int = 50
    seconds: float = 300.0
    kinds: tuple[BotKind, ...] = ("random", "shortest")
    seed: int = 5

    @property
    def words(self) -> str:
        """What is done, for the report."""
        return (
            f"{self.bots} bots ({', '.join(self.kinds)}), {self.rate:g} keys a second each, for {self.seconds:g} s; "
            "random ones press on when a picture is late (these keys have no effect), the others wait."
        )


class PeopleSettings(CrewSettings):
    """Number of bots, which keep pressing keys when a picture is late."""

    bots: int = 200
    seconds: float = 60.0
    rate: float = 4.0
    seed: int = 17

    @property
    def words(self) -> str:
        """What is done, for the report."""
        return (
            f"{self.bots} bots, {self.rate:g} keys a second asked of each, for {self.seconds:g} s: more than two cores "
            "can show pictures to."
        )


def measure_load(settings: LoadSettings, *, folder: Path, dataset: Path, progress: Progress) -> Values:
    """Figures of bots that walk: those of `BotFigures`."""
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


def measure_people(settings: PeopleSettings, *, folder: Path, dataset: Path, progress: Progress) -> Values:
    """Lets all bots come in, then all press keys. Times are measured at the bots, without a browser.

    Returns:
        `actions` (keys sent), `frames` (pictures received); `lost`, keys and steps that were acknowledged, or came
        before acknowledged ones, and are not on disk; `cut_off`, keys on their way when everybody left; `untimed`, keys
        stored without the page's own time, because the server was too late; `ack_..._ms` from sending a key to the step
        counter that follows its commit, for keys on which the bot waited; `rss_before_mb` of the serving process and
        workers before anybody came, `rss_after_mb` when all had left, `peak_mb`, the sum of each one's peak, and
        `peak_mb_per_person`, its increase over the memory before per person; `load_before`, the load average when all
        were in.
    """
    with staffed(folder, dataset, settings) as (server, site, bots):
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
        found = kept(site.folder, bots)
    spent = Spent(elapsed_s=seconds, bots_cpu_s=0.0, server_cpu_s=cpu_s, load_before=load_before)
    figures = figures_of(bots.logs, found.keys, spent, kinds=settings.kinds, rate=settings.rate)
    return {
        "participants": settings.bots,
        "seconds": seconds,
        "actions": figures.actions,
        "actions_per_s": figures.actions_per_s,
        "frames": figures.frames,
        "lost": found.lost,
        "duplicated": figures.duplicated,
        "cut_off": figures.cut_off,
        "untimed": found.keys.untimed,
        "ack_p50_ms": figures.ack_p50_ms,
        "ack_p95_ms": figures.ack_p95_ms,
        "key_to_frame_p50_ms": figures.key_to_frame_p50_ms,
        "key_to_frame_p95_ms": figures.key_to_frame_p95_ms,
        "server_cpu_ms_per_action": figures.server_cpu_ms_per_action,
        "rss_before_mb": before["rss_mb"],
        "rss_after_mb": after["rss_mb"],
        "peak_mb": after["peak_mb"],
        "peak_mb_per_person": (after["peak_mb"] - before["rss_mb"]) / settings.bots,
        "load_before": load_before,
        "problems": found.problems,
    }
