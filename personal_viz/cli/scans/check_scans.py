"""Verb `check-scans`: whether scans on disk fit the episodes, before a study or a run relies on them."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from tyro.conf import arg

from personal_viz.scan_check.measures import ScanFigures, check_scan
from personal_viz.scan_check.page import HEADS, TEXT_HEADS, drawings_of, page_of, problems_of, table_lines
from sim.episodes.dataset import PersonalDataset
from sim.episodes.editions import edition_of
from sim.homes.kind import scene_labels
from sim.tasks.provenance import program_release
from sim.tasks.workers import run_jobs
from sim.words.english import how_many

from ...progress import counted
from ..options import Dataset, Json, Scenes
from ..output import print_json, print_table, say, write_report
from ..refusals import check_options, require_folder

_WIDTH = 175
"""Columns that the table needs."""
PAGE, FIGURES = "check-scans.html", "check-scans.json"
"""Names of the files below --out."""


@dataclass(frozen=True, slots=True)
class _ScanJob:
    """Everything that a worker process needs to check one scan."""

    dataset_root: Path
    scenes_dir: Path
    scene: str


@dataclass
class CheckScans:
    """Check scans against the episodes: objects, places, sights, path lengths; exit code 1 if one cannot be used."""

    dataset: Dataset
    scenes_dir: Annotated[Path, arg(help="Folder below which <Scene>.glb or <Scene>.basis.glb files lie.")]
    scene: Scenes = ()
    out: Annotated[Path, arg(help="Folder for the page and the figures.")] = Path("runs/check-scans")
    json: Json = False
    jobs: Annotated[int, arg(help="Worker processes, one scan each; a large scan takes some gigabytes.")] = 1

    def run(self) -> int:
        check_options(self)
        episodes = PersonalDataset(self.dataset)
        for name in self.scene:
            episodes.require_scene(name)
        names = list(dict.fromkeys(self.scene or episodes.scenes))
        work = [_ScanJob(self.dataset, self.scenes_dir, name) for name in names]
        require_folder(self.out)
        found: dict[str, tuple[ScanFigures, dict[str, str]]] = {}
        document: dict[str, Any] = {}
        with counted("scans", len(work)) as progress:
            for name, figures_of, drawn in run_jobs(
                _checked, work, processes=self.jobs, kept=f"see {self.out / FIGURES}"
            ):
                found[name] = (figures_of, drawn)
                document = self._written({name: found[name] for name in names if name in found}, episodes.digest())
                progress.add()
        figures = {name: found[name][0] for name in names}
        if self.json:
            print_json(document)
        else:
            print_table("Scans and episodes", HEADS, table_lines(figures), texts=TEXT_HEADS, width=_WIDTH)
            for label in scene_labels(one.kind for one in figures.values()):
                print(f"{label}.")
        for line in problems_of(figures):
            say(line)
        say(
            f"{document['usable']} of {how_many(len(names), 'scan')} can be used. {self.out / PAGE} draws the worst "
            f"cases; {self.out / FIGURES} holds figures, hashes and reasons only: please send it to the makers of this "
            "program."
        )
        return 1 if document["usable"] < len(names) else 0

    def _written(self, found: dict[str, tuple[ScanFigures, dict[str, str]]], digest: str) -> dict[str, Any]:
        """Writes the page and the figures of the scans that are checked so far; returns the figures."""
        figures = {name: figures for name, (figures, _) in found.items()}
        document = {
            "program": program_release(),
            "dataset_digest": digest,
            "edition": edition_of(digest),
            "usable": sum(not one.problem for one in figures.values()),
            "scenes": {name: one.model_dump() for name, one in figures.items()},
        }
        page = page_of(figures, {name: drawings for name, (_, drawings) in found.items() if drawings})
        write_report(self.out, {PAGE: page, FIGURES: json.dumps(document, indent=1) + "\n"}, earlier=())
        return document


def _checked(job: _ScanJob) -> tuple[str, ScanFigures, dict[str, str]]:
    checked = check_scan(PersonalDataset(job.dataset_root), job.scene, scenes_dir=job.scenes_dir)
    return job.scene, checked.figures, drawings_of(checked)
