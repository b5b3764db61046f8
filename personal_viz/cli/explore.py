"""Verb `explore`: explorations of homes into a folder, their figures, and how coverage grows over steps."""

import io
import json as json_module
import multiprocessing
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.progress import Progress
from rich.table import Table

from grounding.agents.exploration_jobs import ExploreJob, Storeys, invented_name, run_job
from grounding.agents.explore import Exploration
from personal_viz.printed import Console
from sim.episodes.dataset import PersonalDataset
from sim.errors import PersonalVizError
from sim.files import write_whole
from sim.homes.kind import common_kind
from sim.tasks.provenance import make_run_info
from sim.tasks.run_files import RunInfo
from sim.types import Camera, SceneKind

from ..study_app.checked_options import check_options

_PLOT, _SUMMARY = "coverage.png", "explore.json"


def explore(
    *,
    dataset: Path | None,
    homes: int | None,
    scene: tuple[str, ...],
    scenes_dir: Path | None,
    storeys: Storeys,
    seed: int,
    max_steps: int,
    width: int,
    height: int,
    jobs: int,
    out: Path,
    json: bool,
    rerun: str | None = None,
    with_pixels: bool = False,
) -> int:
    """Explores the homes of a dataset, or invented ones, into `out`; a second call goes on where the first stopped.

    Raises:
        PersonalVizError: Bad options, dataset or folder; or a home cannot be explored.
    """
    check_options(run_id=None, jobs=jobs, seed=seed)
    _check(dataset, homes, width=width, height=height, max_steps=max_steps)
    names, kind = _homes(dataset, homes, scene, scenes_dir)
    camera = Camera(width, height)
    todo = [
        ExploreJob(
            name,
            seed=seed,
            max_steps=max_steps,
            camera=camera,
            storeys=storeys,
            out=out,
            dataset_root=dataset,
            scenes_dir=scenes_dir,
        )
        for name in names
    ]
    with watching(rerun, todo, with_pixels=with_pixels) as watched:
        found = _with_progress(watched, processes=jobs)
    found.sort(key=lambda item: (item.scene, item.storey_y))
    info = make_run_info(
        "explore",
        who="frontier",
        who_kind="agent",
        scene_kind=kind,
        dataset_digest=PersonalDataset(dataset).digest() if dataset else "",
        seed=seed,
        config={"max_steps": max_steps, "storeys": storeys, "homes": homes},
    )
    document = document_of(found, info=info, out=out)
    write_whole(
        out / _PLOT,
        coverage_png(found, title=f"{len(found)} storeys of {len(todo)} {kind} homes", label=info.scene_label),
    )
    write_whole(out / _SUMMARY, json_module.dumps(document, indent=2) + "\n")
    if json:
        print(json_module.dumps(document, indent=2))
    else:
        _print_table(found, document)
        print(f"Written to {out}; coverage over steps: {out / _PLOT}")
    return 0


def _check(dataset: Path | None, homes: int | None, *, width: int, height: int, max_steps: int) -> None:
    """Refuses what no exploration can be made with."""
    if homes is not None and homes < 1:
        raise PersonalVizError(
            f"--homes is {homes}; expected a whole number from 1. Give so many homes, or --dataset instead."
        )
    if (dataset is None) == (homes is None):
        raise PersonalVizError("explore: found both or none of --dataset and --homes; expected one. Give one of them.")
    if min(width, height, max_steps) < 1:
        raise PersonalVizError(
            f"explore: --width {width}, --height {height}, --max-steps {max_steps}; expected whole numbers from 1. "
            "Leave them out for the defaults."
        )


@contextmanager
def watching(rerun: str | None, jobs: list[ExploreJob], *, with_pixels: bool) -> Iterator[list[ExploreJob]]:
    """The jobs, shown where the option `--rerun` says: live, or done again where their files are there already.

    Raises:
        RecordingError: The option is no place for so many explorations, or no viewer answers.
    """
    if rerun is None:
        yield jobs
        return
    from recordings.live import live_sink
    from recordings.paths import ExplorationKey
    from recordings.replay_exploration import ObserveExplorations

    per_home = 2 if jobs[0].storeys == "all" else 1  # how many storeys a home has is not known yet
    keys = [ExplorationKey(job.scene, storey, job.seed) for job in jobs for storey in range(per_home)]
    with live_sink(rerun, keys) as sink:
        yield [replace(job, watch=ObserveExplorations(sink, with_pixels=with_pixels)) for job in jobs]
        if sink.kind != "address":
            print(f"Recorded to {sink.where}; see it with: rerun {sink.where}", file=sys.stderr)


def _with_progress(jobs: Sequence[ExploreJob], *, processes: int) -> list[Exploration]:
    found: list[Exploration] = []
    with Progress(console=Console(stderr=True), disable=not sys.stderr.isatty()) as progress:
        bar = progress.add_task("explore", total=len(jobs))
        for made in _explored(jobs, processes=processes):
            found += made
            progress.update(bar, advance=1)
    return found


def _homes(
    dataset: Path | None, homes: int | None, scenes: tuple[str, ...], scenes_dir: Path | None
) -> tuple[list[str], SceneKind]:
    """Names of the homes, and their kind."""
    if dataset is None:
        assert homes is not None
        if scenes or scenes_dir is not None:
            raise PersonalVizError(
                "explore: found --scene or --scenes-dir beside --homes; expected neither: invented homes are numbered "
                "from 0. Leave them out, or give --dataset."
            )
        return [invented_name(number) for number in range(homes)], "invented"
    episodes = PersonalDataset(dataset)
    names = sorted(set(scenes) or {name for _, name in episodes.files})
    for name in names:
        episodes.require_scene(name)
    return names, common_kind(episodes, names, scenes_dir)


def _explored(jobs: Sequence[ExploreJob], *, processes: int) -> Iterator[tuple[Exploration, ...]]:
    """The explorations of each job, in the order in which they end."""
    if processes <= 1:
        yield from map(run_job, jobs)
        return
    context = multiprocessing.get_context("spawn")  # as sim/tasks/workers.py: forked thread pools can deadlock
    pool = ProcessPoolExecutor(min(processes, len(jobs)), mp_context=context)
    try:
        for future in as_completed([pool.submit(run_job, job) for job in jobs]):
            yield future.result()
    except BrokenProcessPool:
        raise PersonalVizError(
            f"--jobs {processes}: a worker process was ended from outside; expected all to finish. Memory may have run "
            "out: run again with fewer --jobs, finished explorations are kept."
        ) from None
    finally:
        pool.shutdown(cancel_futures=True)


def document_of(found: Sequence[Exploration], *, info: RunInfo, out: Path) -> dict:
    """What `--json` prints: a row per exploration, their means and extremes, and what `run.json` says of a run."""
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
    import numpy as np
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


def _print_table(found: Sequence[Exploration], document: dict) -> None:
    camera = document["camera"]
    table = Table(
        title=f"Explorations, {document['scene_kind']} homes, camera {camera['width']} x {camera['height']}",
        box=SIMPLE_HEAD,
    )
    for head in ("Home", "storey m", "m2", "steps", "coverage %", "doors", "rooms missed", "stopped"):
        table.add_column(head, justify="left" if head in ("Home", "rooms missed", "stopped") else "right")
    for item in found:
        doors = "-" if item.doors_passed is None else f"{item.doors_passed}/{item.num_doors}"
        missed = "-" if item.rooms_missed is None else ", ".join(item.rooms_missed) or "none"
        cells = (f"{item.storey_y:.2f}", f"{item.area_m2:.0f}", str(len(item.steps)), f"{100 * item.coverage[-1]:.1f}")
        table.add_row(item.scene, *cells, doors, missed, item.stop_reason)
    Console(file=sys.stdout).print(table)
    if document["scene_label"]:
        print(f"{document['scene_label']}.")
    coverage, steps = document["coverage"], document["steps"]
    print(
        f"Mean coverage {100 * coverage['mean']:.1f} %, least {100 * coverage['min']:.1f} %; mean {steps['mean']:.0f} "
        f"steps, most {steps['max']}"
    )
