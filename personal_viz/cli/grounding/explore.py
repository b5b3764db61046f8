"""Verb `explore`: explores homes into a folder, and shows their figures and the growth of coverage over steps."""

import io
import json as json_module
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from operator import attrgetter
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from tyro.conf import arg

from grounding.agents.exploration_jobs import ExploreJob, invented_name, run_job
from grounding.agents.explore import Exploration
from recordings.paths import ExplorationKey
from sim.episodes.dataset import PersonalDataset
from sim.errors import PersonalVizError
from sim.files import write_whole
from sim.homes.kind import common_kind
from sim.tasks.provenance import evidence_config, make_run_info
from sim.tasks.run_files import RunInfo
from sim.tasks.shards import shard_from_text
from sim.tasks.workers import RayCluster, run_jobs
from sim.types import Camera, SceneKind

from ...progress import counted
from ..options import Address, Evidence, Jobs, Json, On, Scenes, ScenesDir, Shard, WithPixels, workers_of
from ..output import print_json, print_table, recorded
from ..refusals import check_options

_PLOT, _SUMMARY = "coverage.png", "explore.json"


@dataclass
class Explore:
    """Explore homes with a frontier policy; write the explorations, their figures, and coverage over steps."""

    dataset: Annotated[Path | None, arg(help="Folder of episodes whose homes are explored; or give --homes.")] = None
    evidence: Evidence = ()
    homes: Annotated[int | None, arg(help="Number of invented homes, from the seeds 0, 1, ...")] = None
    scene: Scenes = ()
    scenes_dir: ScenesDir = None
    storeys: Annotated[Literal["start", "all"], arg(help="start: the storey with the most floor; all: each one.")] = (
        "start"
    )
    seed: Annotated[int, arg(help="Seed of the start places.")] = 0
    max_steps: Annotated[int, arg(help="Most actions per storey; most homes need fewer.")] = 2500
    width: Annotated[
        int,
        arg(
            help="Width of the robot's pictures, pixels; smaller pictures are quicker and have the same field of view."
        ),
    ] = 640
    height: Annotated[int, arg(help="Height of the robot's pictures, pixels.")] = 480
    jobs: Jobs = 1
    on: On = "processes"
    address: Address = None
    shard: Shard = None
    out: Annotated[Path, arg(help="Folder of the explorations.")] = Path("runs/explore")
    json: Json = False
    rerun: Annotated[
        str | None,
        arg(
            help="Show explorations live, stored ones again: FILE.rrd, a folder (one file per exploration), "
            "rerun+http://HOST:PORT/proxy, or spawn."
        ),
    ] = None
    with_pixels: WithPixels = False

    def run(self) -> int:
        check_options(self)
        if (self.dataset is None) == (self.homes is None):
            raise PersonalVizError(
                "explore: found both or none of --dataset and --homes; expected one. Give one of them."
            )
        workers = workers_of(self.on, jobs=self.jobs, address=self.address)
        if self.rerun is not None and isinstance(workers, RayCluster):
            raise PersonalVizError(
                f"--rerun is {self.rerun!r} beside --on ray; expected one of them, because explorations are shown by "
                "this machine's processes. Leave one out; the same command with --rerun shows stored ones afterwards."
            )
        shard = shard_from_text(self.shard)
        names, kind = self._homes()
        own = shard.homes(dict.fromkeys(names, 1))
        todo = self._jobs([name for name in names if name in own])
        with watching(self.rerun, todo, with_pixels=self.with_pixels) as watched:
            found: list[Exploration] = []
            with counted("explore", len(todo)) as progress:
                kept = "finished explorations are kept"
                for made in run_jobs(run_job, watched, processes=workers, kept=kept, name_of=attrgetter("scene")):
                    found += made
                    progress.add()
        found.sort(key=lambda item: (item.scene, item.storey_y))
        info = self._info(kind)
        document = document_of(found, info=info, out=self.out)
        title = f"{len(found)} storeys of {len(todo)} {kind} homes"
        if shard.of == 1:  # other shards would write the same files
            write_whole(self.out / _PLOT, coverage_png(found, title=title, label=info.scene_label))
            write_whole(self.out / _SUMMARY, json_module.dumps(document, indent=2) + "\n")
        if self.json:
            print_json(document)
            return 0
        _print_report(found, document)
        if shard.of == 1:
            print(f"Written to {self.out}; coverage over steps: {self.out / _PLOT}")
        else:
            print(f"Written to {self.out}; when all {shard.of} shards are, give the command without --shard.")
        return 0

    def _homes(self) -> tuple[list[str], SceneKind]:
        """Names of the homes, and their kind."""
        if self.dataset is None:
            assert self.homes is not None
            if self.scene or self.scenes_dir is not None:
                raise PersonalVizError(
                    "explore: found --scene or --scenes-dir beside --homes; expected neither: invented homes are "
                    "numbered from 0. Leave them out, or give --dataset."
                )
            return [invented_name(number) for number in range(self.homes)], "invented"
        episodes = PersonalDataset(self.dataset, evidence=self.evidence)
        names = sorted(set(self.scene) or {name for _, name in episodes.files})
        for name in names:
            episodes.require_scene(name)
        return names, common_kind(episodes, names, self.scenes_dir)

    def _jobs(self, names: Sequence[str]) -> list[ExploreJob]:
        """One job per home."""
        camera = Camera(self.width, self.height)
        return [
            ExploreJob(
                name,
                seed=self.seed,
                max_steps=self.max_steps,
                camera=camera,
                storeys=self.storeys,
                out=self.out,
                dataset_root=self.dataset,
                evidence=self.evidence,
                scenes_dir=self.scenes_dir,
            )
            for name in names
        ]

    def _info(self, kind: SceneKind) -> RunInfo:
        """The facts that `run.json` would hold about these explorations."""
        episodes = PersonalDataset(self.dataset, evidence=self.evidence) if self.dataset else None
        return make_run_info(
            "explore",
            who="frontier",
            who_kind="agent",
            scene_kind=kind,
            dataset_digest=episodes.digest() if episodes else "",
            seed=self.seed,
            config={
                "max_steps": self.max_steps,
                "storeys": self.storeys,
                "homes": self.homes,
                **(evidence_config(episodes) if episodes else {}),
            },
        )


@contextmanager
def watching(rerun: str | None, jobs: list[ExploreJob], *, with_pixels: bool) -> Iterator[list[ExploreJob]]:
    """Yields the jobs with the viewer of the option `--rerun`: live, or repeated if their files exist already.

    Raises:
        RecordingError: A single file cannot hold all these explorations, or no viewer answers.
    """
    if rerun is None:
        yield jobs
        return
    from recordings.explorations import ObserveExplorations

    per_home = 2 if jobs[0].storeys == "all" else 1  # how many is not known yet: 2 means several
    keys = [ExplorationKey(job.scene, storey, job.seed) for job in jobs for storey in range(per_home)]
    with recorded(rerun, keys, said_to=sys.stderr) as sink:
        yield [replace(job, watch=ObserveExplorations(sink, with_pixels=with_pixels)) for job in jobs]


def document_of(found: Sequence[Exploration], *, info: RunInfo, out: Path) -> dict:
    """The document that `--json` prints: a row per exploration, means and extremes, and the facts of `run.json`."""
    rows = [
        {
            "scene": item.scene,
            "scene_digest": item.scene_digest,
            "storey_y": round(item.storey_y, 2),
            "area_m2": item.area_m2,
            "steps": len(item.steps),
            "coverage": item.coverage[-1],
            "doors_passed": item.doors_passed,
            "num_doors": item.num_doors,
            "rooms_missed": item.rooms_missed,
            "stop_reason": item.stop_reason,
            "collisions": sum(step.collided for step in item.steps),
        }
        for item in found
    ]
    steps, coverage = [len(item.steps) for item in found], [item.coverage[-1] for item in found]
    missed = [item.rooms_missed for item in found if item.rooms_missed is not None]
    camera = found[0].camera
    return {
        "edition": info.edition or None,
        "scene_kind": info.scene_kind,
        "scene_label": info.scene_label,
        "camera": {"width": camera.width, "height": camera.height, "hfov_deg": camera.hfov_deg},
        "seed": found[0].seed,
        "n": len(found),
        "homes": rows,
        "coverage": {"mean": round(sum(coverage) / len(coverage), 4), "min": min(coverage)},
        "steps": {"mean": round(sum(steps) / len(steps), 1), "max": max(steps)},
        "rooms_missed": sum(len(rooms) for rooms in missed) if missed else None,
        "policy": found[0].policy,
        "dataset_digest": info.dataset_digest or None,
        "config": info.config,
        "versions": info.versions,
        "git_commit": info.git_commit,
        "created_utc": info.created_utc,
        "out": str(out),
    }


def coverage_png(found: Sequence[Exploration], *, title: str, label: str) -> bytes:
    """A PNG picture of coverage over steps: a thin line per exploration, a thick one for their mean."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 4.8), dpi=120, layout="constrained")
    axes = figure.subplots()
    longest = max(len(item.coverage) for item in found)
    curves = np.array([np.pad(item.coverage, (0, longest - len(item.coverage)), mode="edge") for item in found]) * 100
    for item in found:
        axes.plot(np.array(item.coverage) * 100, color="#8fb3d9", linewidth=0.8)
    axes.plot(curves.mean(axis=0), color="#1f5fa8", linewidth=2.2, label="mean")
    axes.axhline(95, color="#b5472f", linewidth=0.8, linestyle="--", label="95 %")
    axes.set_xlabel("steps")
    axes.set_ylabel("floor seen, % of what a 5 m sensor could see")
    axes.set_ylim(0, 101)
    axes.set_xlim(0, longest)
    axes.grid(alpha=0.3)
    axes.legend(loc="lower right", frameon=False)
    axes.set_title("\n".join([title, *([label] if label else [])]), fontsize=11 if not label else 9)
    file = io.BytesIO()
    figure.savefig(file, format="png", metadata={"Description": label} if label else None)
    return file.getvalue()


def _print_report(found: Sequence[Exploration], document: dict) -> None:
    rows = []
    for item in found:
        doors = "-" if item.doors_passed is None else f"{item.doors_passed}/{item.num_doors}"
        missed = "-" if item.rooms_missed is None else ", ".join(item.rooms_missed) or "none"
        cells = (f"{item.storey_y:.2f}", f"{item.area_m2:.0f}", str(len(item.steps)), f"{100 * item.coverage[-1]:.1f}")
        rows.append((item.scene, *cells, doors, missed, item.stop_reason))
    camera, texts = document["camera"], ("rooms missed", "stopped")
    title = f"Explorations, {document['scene_kind']} homes, camera {camera['width']} x {camera['height']}"
    print_table(title, ("Home", "storey m", "m2", "steps", "coverage %", "doors", *texts), rows, texts=texts)
    if document["scene_label"]:
        print(f"{document['scene_label']}.")
    coverage, steps = document["coverage"], document["steps"]
    print(
        f"Mean coverage {100 * coverage['mean']:.1f} %, least {100 * coverage['min']:.1f} %; mean {steps['mean']:.0f} "
        f"steps, most {steps['max']}"
    )
