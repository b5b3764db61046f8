"""Verb `pog-report`: grounding runs as the paper's table, with intervals, curves and a gallery of failures."""

import json as json_module
from collections.abc import Sequence
from pathlib import Path

from grounding.report.table import pog_report as numbers_of
from sim.episodes.dataset import PersonalDataset
from sim.errors import PersonalVizError, RunFileError
from sim.files import write_whole
from sim.tasks.metrics import read_runs, run_folders
from sim.tasks.run_files import Run

from ..pog_report.files import document, report_files
from ..pog_report.gallery import Gallery, failure_gallery
from ..study_app.checked_options import check_options


def pog_report(
    *,
    runs: Sequence[Path],
    out: Path,
    dataset: Sequence[Path] = (),
    failures: int = 8,
    seed: int = 0,
    json: bool = False,
) -> int:
    """Writes the report of the runs into a folder; the same runs give the same bytes.

    Args:
        runs: Run folders of `personal-viz ground` and of people (`study export`), or folders that hold some.
        out: Where the files go; files of an earlier report there are replaced.
        dataset: Folders of episodes, for failures of the runs on them; the others' are left out.
        failures: So many of each method are drawn, at most.
        seed: Of the bootstrap and of the sample of failures.
        json: Print the report as JSON instead of where it is.

    Returns:
        0; problems are raised as one-line errors.

    Raises:
        RunFileError: A folder holds no run, a run is damaged, unscored or of other episodes than `dataset`.
        PersonalVizError: `out` cannot be written, or a map cannot be made again.
    """
    check_options(run_id=None, seed=seed)
    if failures < 0:
        raise PersonalVizError(f"--failures is {failures}; expected 0 or more. Leave it out for the default.")
    found = [run for run in read_runs(runs) if run.answers]
    if not found:
        raise RunFileError("runs: found no POG answers; expected run folders of personal-viz ground. Give those.")
    report = numbers_of(found, seed=seed)
    beside = [folder.resolve().parent for folder in run_folders(runs)]
    gallery = _gallery(found, dataset, beside=beside, per_method=failures, seed=seed)
    _write(out, report_files(report, gallery))
    if json:
        print(json_module.dumps(document(report, gallery), indent=2))
    else:
        rows = sum(len(table.rows) for table in report.tables)
        shown = "" if gallery is None else f", {len(gallery.drawn)} failures drawn"
        print(f"{len(report.tables)} tables, {rows} rows{shown}. Written to {out}: open {out / 'index.html'}")
        if gallery is None:
            print("Failures are left out; --dataset DIR shows those of the runs on it.")
    return 0


def _gallery(
    runs: Sequence[Run], datasets: Sequence[Path], *, beside: Sequence[Path], per_method: int, seed: int
) -> Gallery | None:
    """The failures of the agents' runs on these datasets; None when none is given."""
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
