"""Verb `pog-report`: grounding runs as the paper's table, with intervals, curves and a gallery of failures."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from grounding.report.table import pog_report as numbers_of
from sim.episodes.dataset import PersonalDataset
from sim.errors import RunFileError
from sim.tasks.run_files import Run
from sim.tasks.run_folders import read_runs, run_folders
from sim.words.english import how_many

from ...pog_report.gallery import Gallery, failure_gallery
from ..options import Evidence, Json
from ..output import print_json, write_report
from ..refusals import check_options, require_same_dataset


@dataclass
class PogReport:
    """Write grounding runs as the paper's POG table, with intervals, curves and a gallery of failures."""

    runs: Annotated[Positional[tuple[Path, ...]], arg(help="Run folders of ground and of people, or folders of some.")]
    out: Annotated[Path, arg(help="Folder of index.html, index.md, tables and figures.")]
    dataset: Annotated[
        tuple[Path, ...], arg(help="Folders of episodes: shows failures of the runs on them, with the episodes' texts.")
    ] = ()
    evidence: Evidence = ()
    failures: Annotated[int, arg(help="How many failures of each method are drawn.")] = 8
    seed: Annotated[int, arg(help="Seed of the bootstrap and of the sample of failures.")] = 0
    json: Json = False

    def run(self) -> int:
        from ...pog_report.files import document, report_files

        check_options(self)
        found = [run for run in read_runs(self.runs) if run.answers]
        if not found:
            raise RunFileError("runs: found no POG answers; expected run folders of personal-viz ground. Give those.")
        report = numbers_of(found, seed=self.seed)
        gallery = self._gallery(found)
        drawings = ("failure-*.svg", "over-*.*", "distance-*.*", "methods-*.*")
        write_report(self.out, report_files(report, gallery), earlier=drawings)
        if self.json:
            print_json(document(report, gallery))
        else:
            rows = sum(len(table.rows) for table in report.tables)
            shown = "" if gallery is None else f", {how_many(len(gallery.drawn), 'failure')} drawn"
            print(
                f"{how_many(len(report.tables), 'table')}, {how_many(rows, 'row')}{shown}. Written to {self.out}: "
                f"open {self.out / 'index.html'}"
            )
            if gallery is None:
                print("Failures are left out; --dataset DIR shows those of the runs on it.")
        return 0

    def _gallery(self, runs: Sequence[Run]) -> Gallery | None:
        """The failures of the agents' runs on the datasets; None if no dataset is given."""
        beside = [folder.resolve().parent for folder in run_folders(self.runs)]
        parts = []
        for path in self.dataset:
            episodes = PersonalDataset(path, evidence=self.evidence)
            on_it = [run for run in runs if run.info.dataset_digest == episodes.digest()]
            if not on_it:
                require_same_dataset(episodes, {run.info.dataset_digest for run in runs}, whose="the runs'")
            parts.append(failure_gallery(on_it, episodes, beside=beside, per_method=self.failures, seed=self.seed))
        counts = tuple(count for part in parts for count in part.counts)
        return Gallery(counts, tuple(item for part in parts for item in part.drawn)) if parts else None
