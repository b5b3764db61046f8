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
from sim.tasks.runner import AgentJob, open_job, run_agent
from sim.tasks.workers import Workers

from .harness import Findings, Plan, Progress, empty_cache

AGENT = MakesPlugin("grounding.agents.random_frontier:random_frontier")
PLAN = Plan(
    units={"jobs1_eps_per_s": "1/s", "jobs2": "1/s", "ray2": "1/s", "cores_2": "h", "cores_16": "h", "cores_64": "h"}
)
EPISODES = 2000
"""About as many episodes as the release has."""
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
    """Episodes per second of random-frontier in invented homes, which were opened before."""
    number = settings.homes * settings.episodes
    values: dict[str, Any] = {}
    with empty_cache() as folder:
        progress("homes ...")
        jobs = [_job(folder, seed, settings.episodes) for seed in range(settings.homes)]
        for job in jobs:
            open_job(job)  # compiles loops and fills the cache
        cases: dict[str, Workers] = {"jobs1_eps_per_s": 1, "jobs2": 2, "ray2": RayCluster("local")}
        for name, workers in cases.items():
            progress(f"{name} ...")
            values[name] = number / _seconds(jobs, workers, folder / name)
    values["hours"] = {f"cores_{cores}": EPISODES / (values["jobs2"] * cores / 2) / 3600 for cores in CORES}
    return Findings(
        values,
        notes=(
            f"random-frontier, {settings.episodes} episodes in each of {settings.homes} invented homes; opening homes "
            "and starting two workers count; one process draws with both cores, each of two with one",
            f"hours.cores_N of {EPISODES} episodes is computed from jobs2, as if N cores did N / 2 times as much",
        ),
    )


def _job(folder: Path, seed: int, episodes: int) -> AgentJob:
    """The first episodes of an invented home of its own dataset."""
    root, name = folder / f"home{seed}", f"Bench{seed}"
    invent_dataset(root, name=name, seed=seed)
    keys = tuple(episode.key for episode in PersonalDataset(root).episodes())[:episodes]
    return AgentJob(root, name, keys, scenes_dir=None, agent=AGENT, seed=0)


def _seconds(jobs: Sequence[AgentJob], workers: Workers, out: Path) -> float:
    """Elapsed seconds of a run from nothing, as `personal-viz run` makes it."""
    info = make_run_info("scale", who="scale", who_kind="agent", scene_kind="invented", dataset_digest="", seed=0)
    began_s = time.perf_counter()
    run_agent(jobs, RunWriter(out, info), processes=workers)
    return time.perf_counter() - began_s
