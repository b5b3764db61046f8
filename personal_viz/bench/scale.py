"""Measures how the work of `run` grows with its workers: one process, two processes, and Ray on this machine."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sim.authoring.generation import invent_dataset
from sim.episodes.dataset import PersonalDataset
from sim.tasks.agent_makers import MakesPlugin
from sim.tasks.on_ray import RayCluster
from sim.tasks.provenance import make_run_info
from sim.tasks.run_writer import RunWriter
from sim.tasks.runner import BATCH, AgentJob, open_job, run_agent
from sim.tasks.workers import Workers

from .harness import Findings, Plan, Progress, empty_cache

AGENT = MakesPlugin("grounding.agents.random_frontier:random_frontier")
PLAN = Plan(
    units={"jobs1_eps_per_s": "1/s", "jobs2": "1/s", "ray2": "1/s", "cores_2": "h", "cores_16": "h", "cores_64": "h"}
)
EPISODES = 2000
"""Episodes of the release, in `HOMES` homes."""
HOMES = 31
CORES = (2, 16, 64)


@dataclass(frozen=True, slots=True)
class Settings:
    """How much is run."""

    homes: int
    episodes: int
    """Of each home."""


FULL = Settings(homes=4, episodes=6)
QUICK = Settings(homes=2, episodes=1)


def measure(settings: Settings, progress: Progress) -> Findings:
    """Episodes per second of random-frontier in invented homes, whose files are made before; workers start in it."""
    values: dict[str, Any] = {}
    with empty_cache() as folder:
        progress("one process ...")
        jobs = [_job(folder, seed, settings.episodes) for seed in range(settings.homes)]
        open_s, episode_s = _alone(jobs)
        number = settings.homes * settings.episodes
        values["jobs1_eps_per_s"] = number / (settings.homes * open_s + number * episode_s)
        cases: dict[str, Workers] = {"jobs2": 2, "ray2": RayCluster("local")}
        for name, workers in cases.items():
            progress(f"{name} ...")
            values[name] = number / _seconds(jobs, workers, folder / name)
    values |= {"open_home_s": open_s, "episode_s": episode_s, "hours": _hours(open_s, episode_s)}
    return Findings(
        values,
        notes=(
            f"random-frontier, {settings.episodes} episodes in each of {settings.homes} invented homes; the opening "
            "of homes counts, and the start of two workers does",
            f"hours.cores_N is computed: {EPISODES} episodes and {HOMES} homes with --jobs N, every home opened by "
            "each process that has a batch of it, all cores as fast as this one",
        ),
    )


def _job(folder: Path, seed: int, episodes: int) -> AgentJob:
    """The first episodes of an invented home of its own dataset."""
    root, name = folder / f"home{seed}", f"Bench{seed}"
    invent_dataset(root, name=name, seed=seed)
    keys = tuple(episode.key for episode in PersonalDataset(root).episodes())[:episodes]
    return AgentJob(root, name, keys, scenes_dir=None, agent=AGENT, seed=0)


def _alone(jobs: Sequence[AgentJob]) -> tuple[float, float]:
    """Mean seconds in this process to open a home that was opened once before, and for an episode in it."""
    open_s = episode_s = 0.0
    for job in jobs:
        open_job(job)  # compiles loops and fills the cache
        began_s = time.perf_counter()
        play = open_job(job)
        opened_s = time.perf_counter()
        for key in job.keys:
            play(key)
        open_s += opened_s - began_s
        episode_s += time.perf_counter() - opened_s
    return open_s / len(jobs), episode_s / sum(len(job.keys) for job in jobs)


def _seconds(jobs: Sequence[AgentJob], workers: Workers, out: Path) -> float:
    """Elapsed seconds of a run from nothing, as `personal-viz run` makes it."""
    info = make_run_info("scale", who="scale", who_kind="agent", scene_kind="invented", dataset_digest="", seed=0)
    began_s = time.perf_counter()
    run_agent(jobs, RunWriter(out, info), processes=workers)
    return time.perf_counter() - began_s


def _hours(open_s: float, episode_s: float) -> dict[str, float]:
    """Hours of the release with `--jobs N` on N cores: batches in rounds, a home opened at most once per process."""
    openings = {cores: min(EPISODES / BATCH, HOMES * min(cores, EPISODES / HOMES / BATCH)) for cores in CORES}
    return {f"cores_{cores}": (openings[cores] * open_s + EPISODES * episode_s) / cores / 3600 for cores in CORES}
