"""Verb `homes`: how well schematic and invented homes serve their episodes, per scene and in total."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import sys
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import arg

from sim.errors import PersonalVizError

from .options import Dataset, Json, Scenes

if TYPE_CHECKING:
    from personal_viz.bench.homes.playability import Figures, HomeFacts, HomeFigures, HomesReport

_MIN_WIDTH = 175
"""Columns that the table needs; narrower terminals wrap it, files and pipes do not."""
_COLUMNS = (
    ("episodes", "episodes"), ("playable", "playable"), ("ratio_median", "median\nratio"), ("ratio_p95", "p95"),
    ("within_5", "within\n5 %"), ("within_10", "within\n10 %"), ("heldout_split_within_10", "held out\n10 %"),
    ("heldout_n", "of n"), ("viewpoints_ok", "view\npoints"), ("guessed_area", "guessed\narea"),
    ("findable", "findable"), ("area_m2", "m2"), ("storeys", "storeys"), ("build_s", "build\ns"),
    ("triangles", "triangles"), ("glb_mb", "GLB\nMB"),
)  # fmt: skip
_SHARES = frozenset({
    "playable", "within_5", "within_10", "heldout_split_within_10", "viewpoints_ok", "guessed_area", "findable",
})  # fmt: skip


@dataclass(frozen=True, slots=True)
class _HomeJob:
    """All that a worker process needs to measure one home."""

    dataset_root: Path
    scene: str
    out: Path | None
    folds: bool


@dataclass
class Homes:
    """Report how well homes without a scan serve their episodes: paths, view points, what can be told apart."""

    dataset: Dataset
    scene: Scenes = ()
    json: Json = False
    out: Annotated[Path | None, arg(help="Folder for the homes' plans, to be corrected by hand.")] = None
    jobs: Annotated[int, arg(help="Worker processes, one scene each.")] = 1
    folds: Annotated[bool, arg(help="Recover each home from two splits alone as well (held-out figures).")] = True

    def work(self) -> int:
        from personal_viz.bench.homes.playability import report_of
        from sim.episodes.dataset import PersonalDataset

        from ..study_app.checked_options import check_options
        from .progress import counted

        check_options(run_id=None, jobs=self.jobs)
        episodes = PersonalDataset(self.dataset)
        for name in self.scene:
            episodes.require_scene(name)
        work = [
            _HomeJob(self.dataset, name, self.out, self.folds) for name in dict.fromkeys(self.scene or episodes.scenes)
        ]
        facts = []
        with counted("homes", len(work)) as progress:
            for found in _measured(work, jobs=self.jobs):
                facts.append(found)
                progress.add()
        report = report_of(facts)
        if self.json:
            print(report.model_dump_json(indent=2))
        else:
            _print_tables(report)
        if self.out is not None:
            print(
                f"Plans written to {self.out}. To correct a home by hand, edit its plan and put it at "
                f"{self.dataset}/scenes/<scene>.plan.json: every verb uses it from then on.",
                file=sys.stderr if self.json else sys.stdout,
            )
        return 0


def _measured(work: Sequence[_HomeJob], *, jobs: int) -> Iterator[HomeFacts]:
    """The facts of each home, in order."""
    from sim.tasks.workers import end_with_parent

    if jobs == 1 or len(work) == 1:
        yield from map(_measure, work)
        return
    # spawn: forked children of a process that has loaded numba can deadlock in its thread pool
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(min(jobs, len(work)), mp_context=context, initializer=end_with_parent)
    try:
        yield from pool.map(_measure, work)
    except BrokenProcessPool:
        raise PersonalVizError(
            f"--jobs {jobs}: a worker process was ended from outside; expected all to finish. Memory may have run "
            "out: run again with fewer --jobs."
        ) from None
    finally:
        pool.shutdown(cancel_futures=True)


def _measure(job: _HomeJob) -> HomeFacts:
    from personal_viz.bench.homes.playability import build_home, measure_home
    from sim.episodes.dataset import PersonalDataset
    from sim.homes.plan import save_plan

    dataset = PersonalDataset(job.dataset_root)
    with _empty_cache():
        home = build_home(dataset, job.scene)
    if job.out is not None:
        save_plan(home.plan, job.out / f"{job.scene}.plan.json")
    return measure_home(dataset, home, folds=job.folds)


@contextlib.contextmanager
def _empty_cache() -> Iterator[None]:
    """Nothing is found in the cache folder inside the block, so that build times are those of a first visit."""
    from sim.cache import VARIABLE

    was = os.environ.get(VARIABLE)
    with tempfile.TemporaryDirectory() as folder:
        os.environ[VARIABLE] = folder
        try:
            yield
        finally:
            del os.environ[VARIABLE]
            if was is not None:
                os.environ[VARIABLE] = was


def _print_tables(report: HomesReport) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    from personal_viz.printed import Console
    from sim.homes.kind import scene_terms

    console = Console(file=sys.stdout, width=max(_MIN_WIDTH, Console().width))
    table = Table(title="Homes without their scans", title_justify="left", box=SIMPLE_HEAD, padding=(0, 1))
    table.add_column("\nscene", no_wrap=True)
    for _, head in _COLUMNS:
        table.add_column(head if "\n" in head else f"\n{head}", justify="right", no_wrap=True)
    for name, figures in report.scenes.items():
        table.add_row(name, *_cells(figures))
    if len(report.scenes) > 1:
        table.add_section()
        table.add_row("total", *_cells(report.total), style="bold")
    console.print(table)
    for label in report.labels:
        print(f"{label}.")
    for terms in {scene_terms(figures.scene_kind) for figures in report.scenes.values()} - {""}:
        print(terms)
    print(
        "Ratios: our path length over the recorded one. Held out: recovered from two splits, episodes of the third. "
        "View points: standable and see their object. GLB: the whole home as one file."
    )
    missed = {key: why for figures in report.scenes.values() for key, why in figures.why_not_findable.items()}
    if missed:
        print(f"{len(missed)} episodes whose target cannot be told from its like (all of them with --json):")
        for key, why in list(missed.items())[:10]:
            print(f"  {key}: {why}")


def _cells(figures: Figures | HomeFigures) -> list[str]:
    values = figures.model_dump()
    return [_cell(key, values.get(key)) for key, _ in _COLUMNS]


def _cell(key: str, value: float | int | None) -> str:
    if value is None:
        return "-"
    if key in _SHARES:
        return f"{value:.1%}"
    return f"{value:,}" if isinstance(value, int) else f"{value:.3f}" if key.startswith("ratio") else f"{value:.1f}"
