"""kill -9 of the serving process or of a worker, again and again at random instants, while bots walk."""

import time
from pathlib import Path

import numpy as np
from pydantic import BaseModel, ConfigDict

from sim.errors import StudyError

from ...bots.records import BotKind, count_bots
from ...bots.run import quantile
from ...study_app.gateway.workers import MOST_FAILURES
from ..harness import Progress, Values
from .crowd import Crowd, staffed
from .records import missing_steps, poses_elsewhere, resumed_elsewhere
from .server import Server

_WITHIN_S = 0.3
"""Longest time from the key that was waited for to a kill."""


class KillSettings(BaseModel):
    """How often, and with whom."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    kills: int = 200
    bots: int = 5
    kinds: tuple[BotKind, ...] = ("random", "impatient")
    rate: float = 3.0
    """Keys per second of each."""
    most_keys: int = 15
    """Acknowledged keys between two kills are drawn from 1 to this."""
    seed: int = 11
    workers: int | None = None
    """Of the server; None = as many as usual."""


def measure_kills(settings: KillSettings, *, folder: Path, dataset: Path, progress: Progress) -> Values:
    """Kills, serves again on the same folder, looks at the records; and so on.

    Args:
        settings: How often.
        folder: An empty one.
        dataset: Of one invented home.
        progress: Told what is done now.

    Returns:
        `gateway_kills`, those of the serving process, which is started again (all others hit a worker), and
        `restart_p50_s` until it serves; `acked_keys` of which a bot heard that they are on disk; `lost_after_kill`,
        keys and steps that were acknowledged and are not; `duplicated_after_kill`, `unknown_after_kill` (stored, sent
        by no bot); `cut_off`, keys that were on their way at a kill; `chain_failures`, kills after which the database
        was damaged, as `study check-db` finds it; `resumes`, ways back into a trial that could be compared with the
        records, and `resumed_elsewhere`, those that showed another step, and trials that, done again, lead to another
        pose; `steps_done_again` of all trials.

    Raises:
        StudyError: The study is not served again, or bots do not find back.
    """
    rng = np.random.default_rng(settings.seed)
    began_s = time.perf_counter()
    crew = {"kinds": settings.kinds, "rate": settings.rate, "seed": settings.seed, "workers": settings.workers}
    with staffed(folder, dataset, bots=settings.bots, **crew) as (server, site, bots):
        tally = _Tally(server, site.folder)
        bots.arrive()
        bots.begin()
        for number in range(settings.kills):
            progress(f"kill {number + 1} of {settings.kills}")
            bots.await_acks(int(rng.integers(1, settings.most_keys + 1)))
            time.sleep(float(rng.uniform(0, _WITHIN_S)))  # a random instant, not a wait
            tally.kill(bots, rng)
        bots.await_acks(settings.bots)
        bots.halt()
        tally.look(bots)
        bots.leave()
        progress("comparing with the records")
        keys = count_bots(site.folder, bots.logs)
        resumes, other_steps = resumed_elsewhere(site.folder, bots.bots)
        steps, other_poses = poses_elsewhere(site.folder, dataset)
    return {
        "kills": settings.kills,
        "gateway_kills": len(tally.restarts_s),
        "seconds": time.perf_counter() - began_s,
        "restart_p50_s": quantile(tally.restarts_s, 0.5),
        "acked_keys": bots.num_acked,
        "lost_after_kill": len(keys.lost) + len(tally.lost),
        "duplicated_after_kill": keys.duplicated,
        "unknown_after_kill": keys.unknown,
        "cut_off": keys.cut_off,
        "chain_failures": len(tally.damage),
        "resumes": resumes,
        "resumed_elsewhere": len(other_steps) + len(other_poses),
        "steps_done_again": steps,
        "problems": (*bots.problems, *keys.lost, *sorted(tally.lost), *tally.damage, *other_steps, *other_poses),
    }


class _Tally:
    """Kills, and what was found after them."""

    def __init__(self, server: Server, folder: Path) -> None:
        self._server, self._folder = server, folder
        self._workers_in_a_row = 0
        self.lost: set[str] = set()
        self.damage: list[str] = []
        self.restarts_s: list[float] = []

    def kill(self, bots: Crowd, rng: np.random.Generator) -> None:
        """One kill, of the serving process or of a worker; returns when the study is served again.

        A worker that ends too often in a row is given up, as it should be; so the serving process has its turn before.
        """
        hits_worker = bool(rng.random() < 0.5) and self._workers_in_a_row < MOST_FAILURES - 2
        if hits_worker and self._server.kill_worker(int(rng.integers(1 << 16))):
            self._workers_in_a_row += 1
            self.look(bots)
            return
        self._workers_in_a_row = 0
        self._server.study.kill()
        began_s = time.perf_counter()
        self._server.begin()
        self.look(bots)
        self._server.until_ready()
        self.restarts_s.append(time.perf_counter() - began_s)

    def look(self, bots: Crowd) -> None:
        """Looks at the records as they are now."""
        try:
            self.lost |= set(missing_steps(self._folder, bots.bots))
        except StudyError as error:
            self.damage.append(str(error))
