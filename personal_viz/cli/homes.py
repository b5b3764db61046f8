"""Verb `homes`: how well homes serve their episodes, per scene and in total."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel
from tyro.conf import arg

from personal_viz.bench.harness import empty_cache
from personal_viz.bench.homes.playability import (
    HomeFacts,
    HomesReport,
    build_home,
    measure_home,
    report_of,
)
from sim.episodes.dataset import PersonalDataset
from sim.errors import DatasetError, PersonalVizError
from sim.homes.kind import scene_terms
from sim.homes.plan import save_plan
from sim.tasks.workers import run_jobs
from sim.words.english import how_many

from ..progress import counted
from .options import Dataset, Evidence, Json, Scenes, ScenesDir
from .output import print_table
from .refusals import check_options

_MIN_WIDTH = 205
"""Columns that the table needs; narrower terminals wrap it, but files and pipes do not."""
_COLUMNS = (
    ("episodes", "episodes"), ("playable", "playable"), ("ratio_median", "median\nratio"), ("ratio_p95", "p95"),
    ("within_5", "within\n5 %"), ("within_10", "within\n10 %"), ("heldout_split_within_10", "held out\n10 %"),
    ("heldout_n", "of n"), ("viewpoints_ok", "view\npoints"), ("guessed_area", "guessed\narea"),
    ("findable", "findable"), ("phantom", "phantom"), ("mesh_over_map", "mesh /\nmap"), ("floating", "floating"),
    ("area_m2", "m2"), ("storeys", "storeys"), ("build_s", "build\ns"),
    ("triangles", "triangles"), ("glb_mb", "GLB\nMB"),
)  # fmt: skip
_SHARES = frozenset({
    "playable", "within_5", "within_10", "heldout_split_within_10", "viewpoints_ok", "guessed_area", "findable",
    "phantom", "floating",
    "starts_on_floor",
})  # fmt: skip
_OTHER_COLUMNS = (
    ("episodes", "episodes"), ("playable", "playable"), ("ratio_median", "median ratio"), ("within_5", "within 5 %"),
    ("within_10", "within 10 %"), ("starts_on_floor", "starts on floor"),
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class _HomeJob:
    """Everything that a worker process needs to measure one home."""

    dataset_root: Path
    evidence: tuple[Path, ...]
    scenes_dir: Path | None
    test_on: Path | None
    scene: str
    out: Path | None
    folds: bool


@dataclass
class Homes:
    """Report how well homes serve their episodes: paths, view points, what can be told apart, picture and walk."""

    dataset: Dataset
    evidence: Evidence = ()
    scenes_dir: ScenesDir = None
    test_on: Annotated[
        Path | None, arg(help="Another edition, not used to make the homes: reports how they serve its episodes.")
    ] = None
    scene: Scenes = ()
    json: Json = False
    out: Annotated[Path | None, arg(help="Folder for the homes' plans, to be corrected by hand.")] = None
    jobs: Annotated[int, arg(help="Worker processes, one scene each.")] = 1
    folds: Annotated[bool, arg(help="Recover each home from two splits alone as well (held-out figures).")] = True

    def run(self) -> int:
        check_options(self)
        if self.out is not None and self.scenes_dir is not None:
            raise PersonalVizError("--out: found it with --scenes-dir; expected one of them, since scans have no plan.")
        episodes = PersonalDataset(self.dataset, evidence=self.evidence)
        for name in self.scene:
            episodes.require_scene(name)
        names = list(dict.fromkeys(self.scene or episodes.scenes))
        if self.test_on is not None:
            _require_unseen(self.test_on, episodes, names)
        work = [
            _HomeJob(self.dataset, self.evidence, self.scenes_dir, self.test_on, name, self.out, self.folds)
            for name in names
        ]
        facts: list[HomeFacts] = []
        with counted("homes", len(work)) as progress:
            for found in run_jobs(_measure, work, processes=self.jobs):
                facts.append(found)
                progress.add()
        report = report_of(sorted(facts, key=lambda home: names.index(home.name)))
        if self.json:
            print(report.model_dump_json(indent=2))
        else:
            _print_report(report)
            if self.test_on is not None:
                _print_other(report, self.test_on)
        if self.out is not None:
            print(
                f"Plans written to {self.out}. To correct a home by hand, edit its plan and put it at "
                f"{self.dataset}/scenes/<scene>.plan.json: every verb uses it from then on.",
                file=sys.stderr if self.json else sys.stdout,
            )
        return 0


def _require_unseen(test_on: Path, dataset: PersonalDataset, scenes: Sequence[str]) -> None:
    """Raises DatasetError if `--test-on` names an edition that the homes are made from, or one without their scenes."""
    if test_on.resolve() in {edition.root.resolve() for edition in (dataset, *dataset.evidence)}:
        raise DatasetError(
            f"--test-on {test_on}: is an edition that the homes are made from; expected another one. Take it out of "
            "--dataset and --evidence, or leave --test-on out."
        )
    if not set(scenes) & set(PersonalDataset(test_on).scenes):
        raise DatasetError(f"--test-on {test_on}: holds none of the scenes; expected {scenes[0]} or another of them.")


def _measure(job: _HomeJob) -> HomeFacts:
    dataset = PersonalDataset(job.dataset_root, evidence=job.evidence)
    with empty_cache():
        home = build_home(dataset, job.scene, scenes_dir=job.scenes_dir)
    if job.out is not None and home.plan is not None:
        save_plan(home.plan, job.out / f"{job.scene}.plan.json")
    test_on = None if job.test_on is None else PersonalDataset(job.test_on)
    return measure_home(dataset, home, folds=job.folds, test_on=test_on)


def _print_report(report: HomesReport) -> None:
    rows = [(name, *_cells(figures, _COLUMNS)) for name, figures in report.scenes.items()]
    total = ("total", *_cells(report.total, _COLUMNS)) if len(rows) > 1 else ()
    heads = ("scene", *(head for _, head in _COLUMNS))
    print_table("How homes serve their episodes", heads, rows, total=total, width=_MIN_WIDTH)
    for label in report.labels:
        print(f"{label}.")
    for terms in {scene_terms(figures.scene_kind) for figures in report.scenes.values()} - {""}:
        print(terms)
    print(
        "Ratios: our path length over the recorded one. Held out: recovered from two splits, episodes of the third. "
        "View points: standable and see their object. GLB: the whole home as one file. "
        "Phantom: forwards that collide although the picture shows nothing in reach. Mesh / map: floor on which a body "
        "fits as drawn, over the map's. Floating: objects more than 10 cm from everything."
    )
    for source in report.total.sources:
        print(
            f"From {source.folder}: {how_many(source.starts, 'start')}, {how_many(source.view_points, 'view point')}, "
            f"{how_many(source.objects, 'object')}{_left_out_text(source.left_out)}."
        )
    if report.total.storeys_missing_hint:
        print(f"Storeys that no record tells of: {', '.join(report.total.storeys_missing_hint)}.")
    missed = {key: why for figures in report.scenes.values() for key, why in figures.why_not_findable.items()}
    if missed:
        print(f"{len(missed)} episodes whose target looks like another object (--json lists all):")
        for key, why in list(missed.items())[:10]:
            print(f"  {key}: {why}")


def _left_out_text(names: Sequence[str]) -> str:
    """Words on objects that contradict an earlier edition; empty without one."""
    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
    return f"; left out, because they are elsewhere or have another name: {', '.join(names[:3])}{more}" if names else ""


def _print_other(report: HomesReport, test_on: Path) -> None:
    found = {name: figures.other for name, figures in report.scenes.items()}
    rows = [(name, *_cells(other, _OTHER_COLUMNS)) for name, other in found.items() if other is not None]
    other = report.total.other
    total = ("total", *_cells(other, _OTHER_COLUMNS)) if other is not None and len(rows) > 1 else ()
    heads = ("scene", *(head for _, head in _OTHER_COLUMNS))
    print_table("Episodes of another edition", heads, rows, total=total)
    print(
        f"These homes are made without {test_on}; episodes that --dataset or --evidence hold too are left out. "
        "Playable: a path leads from the start to a view point. Starts on floor: within 25 cm of our floor, on its "
        "storey."
    )


def _cells(figures: BaseModel, columns: Sequence[tuple[str, str]]) -> list[str]:
    values = figures.model_dump()
    return [_cell(key, values.get(key)) for key, _ in columns]


def _cell(key: str, value: float | int | None) -> str:
    if value is None:
        return "-"
    if key in _SHARES:
        return f"{value:.1%}"
    return f"{value:,}" if isinstance(value, int) else f"{value:.3f}" if key.startswith("ratio") else f"{value:.1f}"
