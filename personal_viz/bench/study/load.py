"""Serves many people at once: a crowd for which the cores can render pictures, and one that is too large for them.

Even in the second case no key may be lost.
"""

from pathlib import Path

from ...bots.crowd import timed
from ...bots.figures import figures_of
from ...bots.records import BotKind, count_bots
from ..harness import Progress, Values, held_by
from .crew import CrewSettings, staffed


class LoadSettings(CrewSettings):
    """Number of bots, and how long they act."""

    bots: int = 50
    seconds: float = 300.0
    kinds: tuple[BotKind, ...] = ("random", "shortest")
    seed: int = 5

    @property
    def words(self) -> str:
        """A description of the work, for the report."""
        return (
            f"{self.bots} bots ({', '.join(self.kinds)}), each asked for {self.rate:g} keys a second, for "
            f"{self.seconds:g} s; random ones press on when a picture is late (these keys have no effect), the others "
            "wait."
        )


def measure_load(settings: LoadSettings, *, folder: Path, dataset: Path, progress: Progress) -> Values:
    """Lets all bots come in, then all press keys. Times are measured at the bots, without a browser.

    Returns:
        The fields of `BotFigures`; `untimed`, keys stored without the page's own time, because the server was too late;
        `rss_before_mb` of the serving process and workers before anybody came, `rss_after_mb` when all had left,
        `peak_mb`, the sum of each one's peak, and `peak_mb_per_person`, its increase over the memory before per person.
    """
    with staffed(folder, dataset, settings) as (server, site, bots):
        before = held_by(server.pid)
        progress(f"{settings.bots} bots come in")
        bots.arrive()
        progress(f"all are in; they act for {settings.seconds:g} s")
        spent = timed(bots, settings.seconds, server_pid=server.pid)
        after = held_by(server.pid)
        progress("comparing with the records")
        found = count_bots(site.folder, bots.logs)
    figures = figures_of(bots.logs, found, spent, kinds=settings.kinds, rate=settings.rate)
    return {
        **figures.model_dump(),
        "untimed": found.untimed,
        "rss_before_mb": before["rss_mb"],
        "rss_after_mb": after["rss_mb"],
        "peak_mb": after["peak_mb"],
        "peak_mb_per_person": (after["peak_mb"] - before["rss_mb"]) / settings.bots,
    }
