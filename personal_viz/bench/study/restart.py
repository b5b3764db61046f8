"""Ends and restarts the study while people are online, and checks that they come back to where they were."""

import signal
import time
from pathlib import Path

import psutil

from ...bots.figures import quantile
from ...bots.records import BotKind, count_bots
from ..harness import Progress, Values
from .crew import CrewSettings, resumed_elsewhere, staffed


class RestartSettings(CrewSettings):
    """Number of restarts, and the bots."""

    restarts: int = 4
    """Number of restarts, by SIGTERM and SIGINT in turn."""
    bots: int = 20
    kinds: tuple[BotKind, ...] = ("random", "slow")
    acted_keys: int = 50
    """Number of acknowledged keys before each restart."""
    seed: int = 19

    @property
    def words(self) -> str:
        """A description of the work, for the report."""
        return f"{self.restarts} times, by SIGTERM and SIGINT in turns, {self.bots} bots online."


def measure_restarts(settings: RestartSettings, *, folder: Path, dataset: Path, progress: Progress) -> Values:
    """Ends the program as a host does, restarts it on the same folder and port, and waits for everybody.

    Returns:
        `drain_s`, the longest time from the signal until the serving process has ended, and `processes_left`, which
        were still there then; `start_s`, the median from the restart until it serves; `reconnect_s`, the longest from
        then until all bots stand in their trials; `lost`, keys and steps that were acknowledged and are not on disk;
        `resumes`, returns of bots that could be compared with the records, and `resumed_elsewhere`, returns that showed
        another step.
    """
    num_left = 0
    drains_s, starts_s, returns_s = list[float](), list[float](), list[float]()
    with staffed(folder, dataset, settings) as (server, site, bots):
        bots.arrive()
        bots.begin()
        for number in range(settings.restarts):
            end = (signal.SIGTERM, signal.SIGINT)[number % 2]
            progress(f"restart {number + 1} of {settings.restarts}, by {end.name}")
            bots.await_acks(settings.acted_keys)
            processes = [psutil.Process(server.pid), *server.workers]
            connections = [log.num_connections for log in bots.logs]
            drains_s.append(server.end(end))
            num_left += sum(one.is_running() and one.status() != psutil.STATUS_ZOMBIE for one in processes)
            began_s = time.perf_counter()
            server.start()
            served_s = time.perf_counter()
            bots.await_all_here(connections)
            starts_s.append(served_s - began_s)
            returns_s.append(time.perf_counter() - served_s)
        bots.await_acks(settings.bots)
        bots.leave()
        found = count_bots(site.folder, bots.logs)
        resumes, elsewhere = resumed_elsewhere(site.folder, bots.logs)
    return {
        "participants": settings.bots,
        "restarts": settings.restarts,
        "drain_s": max(drains_s),
        "processes_left": num_left,
        "start_s": quantile(starts_s, 0.5),
        "reconnect_s": max(returns_s),
        "lost": len(found.lost),
        "duplicated": found.duplicated,
        "resumes": resumes,
        "resumed_elsewhere": len(elsewhere),
        "problems": (*bots.problems, *found.lost, *elsewhere),
    }
