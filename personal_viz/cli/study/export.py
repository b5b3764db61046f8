"""Verb `study export`: writes a study's records as run folders and tables."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from human_study.export.manifest import read_manifest
from human_study.export.study_export import export_study
from human_study.export.survey import LEAST_IN_A_CELL, small_cells
from human_study.report.source import read_survey
from human_study.store.records import read_study
from sim.words.english import how_many

EXPORT_FOLDER = "exports"


@dataclass
class StudyExport:
    """Write a study's records as run folders for metrics and replay, and as Parquet, CSV and JSONL tables."""

    study: Positional[Path]
    out: Annotated[Path | None, arg(help="New or empty folder; exports/ in the study by default.")] = None

    def run(self) -> int:
        out = self.out
        if out is None:
            with read_study(self.study) as reader:
                out = self.study / EXPORT_FOLDER / reader.config.study
        folders = export_study(self.study, out)
        manifest = read_manifest(out)
        for folder in folders:
            print(f"Run of a participant: {folder}")
        num_trials = manifest.files["trials.jsonl"].num_rows or 0
        deleted = f", {how_many(manifest.num_deleted, 'person', 'people')} deleted" if manifest.num_deleted else ""
        print(
            f"Written to {out}: {how_many(len(folders), 'run folder')}, {how_many(num_trials, 'trial')} in trials.csv, "
            f"{len(manifest.left_out)} of them in no run (practice, attention, failures){deleted}; "
            "data_dictionary.md explains the columns"
        )
        rows = read_survey(out)
        if rows:
            print(
                "survey.csv holds answers of single people, who were told that these are not published: keep it apart."
            )
            if cells := small_cells(rows):
                print(f"Fewer than {LEAST_IN_A_CELL} people each, who may be recognised: {', '.join(cells)}")
        if any(name.startswith("comments.") for name in manifest.files):
            print("comments.csv holds what people wrote: read all of it before you publish the folder.")
        print("exclusions.csv holds your own words: read it before you publish the folder.")
        return 0
