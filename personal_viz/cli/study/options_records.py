"""Verbs of a study's records: check, verify, exclude, export, report."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from sim.types import SuccessRule

from ..options_shared import Dataset, ScenesDir


@dataclass
class StudyCheckDb:
    """Check the study's database: integrity and hash chains; an older one is brought up to date first."""

    study: Positional[Path]

    def work(self) -> int:
        from .folder import check_db

        return check_db(study=self.study)


@dataclass
class StudyVerify:
    """Do every finished trial again, step by step, and compare with what is stored; the result is stored too."""

    study: Positional[Path]
    dataset: Dataset
    scenes_dir: ScenesDir = None
    jobs: Annotated[int, arg(help="Worker processes, each with homes of its own.")] = 1
    store: Annotated[bool, arg(help="Write the result into the study, unless it is being served.")] = True

    def work(self) -> int:
        from .verify import verify

        return verify(**vars(self))


@dataclass
class StudyExclude:
    """Leave a trial or a participant out of the figures by a rule; nothing is deleted, and --undo takes it back."""

    study: Positional[Path]
    rule: Annotated[str, arg(help="Id of the rule; those written down before data are in preregistration.md.")]
    trial: Annotated[str | None, arg(help="p03/12: participant and place in the order.")] = None
    participant: str | None = None
    reason: Annotated[str | None, arg(help="Why it applies here; published, so name nobody.")] = None
    undo: bool = False

    def work(self) -> int:
        from .exclude import exclude

        return exclude(**vars(self))


@dataclass
class StudyExport:
    """Write a study's records as run folders for metrics and replay, and as Parquet, CSV and JSONL tables."""

    study: Positional[Path]
    out: Annotated[Path | None, arg(help="New or empty folder; exports/ in the study by default.")] = None

    def work(self) -> int:
        from .export import export

        return export(study=self.study, out=self.out)


@dataclass
class StudyImportCheck:
    """Read an export back: hashes, and every outcome computed once more from the exported events."""

    export: Positional[Path]
    dataset: Dataset
    scenes_dir: ScenesDir = None

    def work(self) -> int:
        from .export import import_check

        return import_check(export=self.export, dataset=self.dataset, scenes_dir=self.scenes_dir)


@dataclass
class StudyReport:
    """Tables and pictures of people and agents on the same episodes, every number with its interval."""

    runs: Positional[tuple[Path, ...]]
    """Study folders, exports, run folders of people and of agents, or folders that hold them."""
    out: Annotated[Path, arg(help="Folder for the report in all its forms.")] = Path("runs/report")
    rule: Annotated[SuccessRule | None, arg(help="Of success; the study's own by default, paper without one.")] = None
    dataset: Annotated[
        Path | None, arg(help="For floors under overlays, chosen objects, and dataset_weighted totals.")
    ] = None
    scenes_dir: ScenesDir = None
    overlays: Annotated[bool, arg(help="Draw the ways and clicks of all episodes, not of a few.")] = False
    json: bool = False

    def work(self) -> int:
        from .report import report

        return report(**vars(self))
