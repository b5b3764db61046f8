"""Verbs of studies with people: demo, study."""

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg, subcommand

from sim.types import SuccessRule

from .cli_options import Clutter, Dataset, Limit, Rerun, ScenesDir, Splits, WithPixels


@dataclass
class Demo:
    """Invent a home, serve a study on it, and print two personal links."""

    out: Path = Path("runs/demo")
    seed: int = 5
    port: Annotated[str, arg(help="Also from the environment variable PORT; 0 takes a free one.")] = field(
        default_factory=lambda: os.environ.get("PORT", "8080")
    )

    def work(self) -> int:
        from .commands.study import demo

        return demo(out=self.out, seed=self.seed, port=self.port)


@dataclass
class StudyServe:
    """Serve a study on one scene's episodes and print a personal link per participant."""

    dataset: Dataset
    scene: str
    scenes_dir: ScenesDir = None
    out: Annotated[Path | None, arg(help="Study folder; runs/study-<scene> by default. An existing one goes on.")] = (
        None
    )
    split: Splits = ()
    limit: Limit = None
    seed: int = 0
    actions: Literal["paper4", "paper6"] = "paper4"
    port: int = 8080
    clutter: Clutter = 0
    rerun: Rerun = None
    with_pixels: WithPixels = False

    def work(self) -> int:
        from .commands.study import serve

        return serve(**vars(self))


@dataclass
class StudyExport:
    """Write the finished trials of a study as run folders for metrics and replay."""

    study: Positional[Path]
    out: Path = Path("runs")

    def work(self) -> int:
        from .commands.study import export

        return export(study=self.study, out=self.out)


@dataclass
class StudyCheckDb:
    """Check the study's database: integrity and hash chains."""

    study: Positional[Path]

    def work(self) -> int:
        from .commands.study import check_db

        return check_db(study=self.study)


@dataclass
class StudyVerify:
    """Do every finished trial again, step by step, and compare with what is stored."""

    study: Positional[Path]
    dataset: Dataset
    scenes_dir: ScenesDir = None

    def work(self) -> int:
        from .commands.study import verify

        return verify(study=self.study, dataset=self.dataset, scenes_dir=self.scenes_dir)


@dataclass
class StudyReport:
    """Tables and pictures of people and agents on the same episodes, every number with its interval."""

    runs: Positional[tuple[Path, ...]]
    """Run folders of people (study export) and of agents, or folders that hold them."""
    out: Annotated[Path, arg(help="Folder for report.md, report.csv, report.tex, report.json and the pictures.")] = (
        Path("runs/report")
    )
    rule: SuccessRule = "paper"
    json: bool = False

    def work(self) -> int:
        from .commands.report import report

        return report(runs=self.runs, out=self.out, rule=self.rule, json=self.json)


@dataclass
class Study:
    """Studies with people."""

    verb: (
        Annotated[StudyServe, subcommand("serve")]
        | Annotated[StudyExport, subcommand("export")]
        | Annotated[StudyVerify, subcommand("verify")]
        | Annotated[StudyCheckDb, subcommand("check-db")]
        | Annotated[StudyReport, subcommand("report")]
    )

    def work(self) -> int:
        return self.verb.work()
