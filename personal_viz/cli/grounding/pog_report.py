"""Verb `pog-report`: grounding runs as the paper's table, with intervals, curves and a gallery of failures."""

from __future__ import annotations

import json as json_module
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

from sim.errors import PersonalVizError, RunFileError

from ..options import Json

if TYPE_CHECKING:
    from sim.tasks.run_files import Run

    from ...pog_report.gallery import Gallery


@dataclass
class PogReport:
    """Write grounding runs as the paper's POG table, with intervals, curves and a gallery of failures."""

    runs: Annotated[Positional[tuple[Path, ...]], arg(help="Run folders of ground and of people, or folders of some.")]
    out: Annotated[Path, arg(help="Folder of index.html, index.md, tables and figures.")]
    dataset: Annotated[
        tuple[Path, ...], arg(help="Folders of episodes: shows failures of the runs on them, with the episodes' texts.")
    ] = ()
    failures: Annotated[int, arg(help="So many failures of each method are drawn.")] = 8
    seed: Annotated[int, arg(help="Of the bootstrap and of the sample of failures.")] = 0
    json: Json = False

    def work(self) -> int:
        from grounding.report.table import pog_report as numbers_of
        from sim.tasks.metrics import read_runs, run_folders

        from ...pog_report.files import document, report_files
        from ...study_app.checked_options import check_options

        check_options(run_id=None, seed=self.seed)
        if self.failures < 0:
            raise PersonalVizError(f"--failures is {self.failures}; expected 0 or more. Leave it out for the default.")
        found = [run for run in read_runs(self.runs) if run.answers]
        if not found:
            raise RunFileError("runs: found no POG answers; expected run folders of personal-viz ground. Give those.")
        report = numbers_of(found, seed=self.seed)
        beside = [folder.resolve().parent for folder in run_folders(self.runs)]
        gallery = _gallery(found, self.dataset, beside=beside, per_method=self.failures, seed=self.seed)
        _write(self.out, report_files(report, gallery))
        if self.json:
            print(json_module.dumps(document(report, gallery), indent=2))
        else:
            rows = sum(len(table.rows) for table in report.tables)
            shown = "" if gallery is None else f", {len(gallery.drawn)} failures drawn"
            print(
                f"{len(report.tables)} tables, {rows} rows{shown}. Written to {self.out}: "
                f"open {self.out / 'index.html'}"
            )
            if gallery is None:
                print("Failures are left out; --dataset DIR shows those of the runs on it.")
        return 0


def _gallery(
    runs: Sequence[Run], datasets: Sequence[Path], *, beside: Sequence[Path], per_method: int, seed: int
) -> Gallery | None:
    """The failures of the agents' runs on these datasets; None when none is given."""
    from sim.episodes.dataset import PersonalDataset

    from ...pog_report.gallery import Gallery, failure_gallery

    if not datasets:
        return None
    parts = []
    for path in datasets:
        episodes = PersonalDataset(path)
        on_it = [run for run in runs if run.info.dataset_digest == episodes.digest()]
        if not on_it:
            found = ", ".join(sorted({run.info.dataset_digest[:12] for run in runs}))
            raise RunFileError(
                f"--dataset {path}: has digest {episodes.digest()[:12]}, the runs have {found}; expected the episode "
                "files of a run. Give the dataset on which the runs were made."
            )
        parts.append(failure_gallery(on_it, episodes, beside=beside, per_method=per_method, seed=seed))
    return Gallery(
        tuple(count for part in parts for count in part.counts), tuple(item for part in parts for item in part.drawn)
    )


def _write(out: Path, files: dict[str, str | bytes]) -> None:
    """All files; drawn failures and figures of an earlier report that are not among them go."""
    from sim.files import write_whole

    try:
        out.mkdir(parents=True, exist_ok=True)
        for pattern in ("failure-*.svg", "over-*.*", "distance-*.*", "methods-*.*"):
            for old in out.glob(pattern):
                if old.name not in files:
                    old.unlink()
        for name, content in files.items():
            write_whole(out / name, content)
    except OSError as error:
        raise PersonalVizError(
            f"--out: {str(out)!r} cannot be written ({error.strerror}); expected a folder, or a place for one. "
            "Choose another."
        ) from None
