"""Kills the serving process or a worker with kill -9 at random instants, again and again, while bots walk."""

import time
from pathlib import Path

import numpy as np

from human_study.export.verify import replayed
from human_study.store.records import read_study
from human_study.trial.events import Open
from sim.episodes.dataset import PersonalDataset
from sim.errors import StudyError
from sim.tasks.pan import PanEnv

from ...bots.crowd import Crowd
from ...bots.figures import quantile
from ...bots.records import BotKind, count_bots, missing_steps
from ...bots.server import Server
from ...study_app.gateway.workers import MOST_FAILURES
from ...study_app.home.trial_homes import open_trial_home
from ..harness import Progress, Values
from .crew import CrewSettings, resumed_elsewhere, staffed

_WITHIN_S = 0.3
"""Longest time from the awaited key to a kill, seconds."""


class KillSettings(CrewSettings):
    """Number of kills, and the bots."""

    kills: int = 200
    bots: int = 5
    kinds: tuple[BotKind, ...] = ("random", "impatient")
    rate: float = 3.0
    most_keys: int = 15
    """The number of acknowledged keys between two kills is drawn from 1 to this number."""
    seed: int = 11
    workers: int | None = None
    """Number of the server's workers; None = the usual number."""

    @property
    def words(self) -> str:
        """A description of the work, for the report."""
        return (
            f"kill -9 at {self.kills} random instants, of the serving process or of a worker, while {self.bots} bots "
            "walk."
        )


def measure_kills(settings: KillSettings, *, folder: Path, dataset: Path, progress: Progress) -> Values:
    """Repeatedly kills a process, serves again on the same folder, and checks the records.

    Returns:
        `gateway_kills`, the kills of the serving process, which is restarted (all others hit a worker), and
        `restart_p50_s` until it serves; `acked_keys` that were reported to a bot as on disk; `lost_after_kill`, keys
        and steps that were acknowledged but are not stored; `duplicated_after_kill`; `unknown_after_kill` (stored, but
        sent by no bot); `cut_off`, keys that were on their way at a kill; `chain_failures`, kills after which the
        database was damaged, as `study check-db` finds it; `resumes`, returns to a trial that could be compared with
        the records; `resumed_elsewhere`, returns that showed another step, and trials whose replay leads to another
        pose; `steps_done_again`, the replayed steps of all trials.
    """
    rng = np.random.default_rng(settings.seed)
    began_s = time.perf_counter()
    with staffed(folder, dataset, settings, workers=settings.workers) as (server, site, bots):
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
        found = count_bots(site.folder, bots.logs)
        lost = sorted(tally.lost | set(found.lost))
        resumes, other_steps = resumed_elsewhere(site.folder, bots.logs)
        steps, other_poses = poses_elsewhere(site.folder, dataset)
    return {
        "kills": settings.kills,
        "gateway_kills": len(tally.restarts_s),
        "seconds": time.perf_counter() - began_s,
        "restart_p50_s": quantile(tally.restarts_s, 0.5),
        "acked_keys": bots.num_acked,
        "lost_after_kill": len(lost),
        "duplicated_after_kill": found.duplicated,
        "unknown_after_kill": found.unknown,
        "cut_off": found.cut_off,
        "chain_failures": len(tally.damage),
        "resumes": resumes,
        "resumed_elsewhere": len(other_steps) + len(other_poses),
        "steps_done_again": steps,
        "problems": (*bots.problems, *lost, *tally.damage, *other_steps, *other_poses),
    }


class _Tally:
    """The kills, and the losses and damage found after them."""

    def __init__(self, server: Server, folder: Path) -> None:
        self._server, self._folder = server, folder
        self._workers_in_a_row = 0
        self.lost: set[str] = set()
        self.damage: list[str] = []
        self.restarts_s: list[float] = []

    def kill(self, bots: Crowd, rng: np.random.Generator) -> None:
        """Kills the serving process or a worker; returns when the study is served again.

        The server rightly gives up a worker that ends too often in a row; so the serving process is killed before that.
        """
        hits_worker = bool(rng.random() < 0.5) and self._workers_in_a_row < MOST_FAILURES - 2
        if hits_worker and self._server.kill_worker(int(rng.integers(1 << 16))):
            self._workers_in_a_row += 1
            self.look(bots)
            return
        self._workers_in_a_row = 0
        self._server.kill()
        began_s = time.perf_counter()
        self._server.begin()
        self.look(bots)
        self._server.until_ready()
        self.restarts_s.append(time.perf_counter() - began_s)

    def look(self, bots: Crowd) -> None:
        """Checks the records as they are now."""
        try:
            self.lost |= set(missing_steps(self._folder, bots.logs))
        except StudyError as error:
            self.damage.append(str(error))


def poses_elsewhere(folder: Path, dataset: Path) -> tuple[int, tuple[str, ...]]:
    """Number of replayed steps, and the trials in which a step leads to another pose than the stored one.

    Each trial is replayed from its start in one go: a session that resumed at another pose would not fit.
    """
    steps, wrong = 0, []
    episodes = PersonalDataset(dataset)
    with read_study(folder) as reader:
        homes = {scene.name: open_trial_home(episodes, scene, None) for scene in reader.plan.scenes}
        for code in reader.codes():
            for status in reader.trials(code):
                events = [line.event for line in reader.events(status.trial_id)] if status.trial_id else []
                if not any(isinstance(event, Open) for event in events):
                    continue
                home = homes[status.key.scene]
                env = PanEnv(home.episode(status.key).start, home.navigation, renderer=None)
                error_m, bad_step = replayed(events, env)
                steps += len(env.steps)
                if bad_step is not None or error_m > 0:
                    wrong.append(f"{code}, trial {status.order_no}: a step leads {error_m:g} m away from its record")
    return steps, tuple(wrong)
