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
class StudyInit:
    """Write a study file, consent and instructions for you to read and change."""

    study: Positional[Path]
    dataset: Dataset
    name: Annotated[str | None, arg(help="Public name of the study; that of the folder by default.")] = None
    task: Annotated[tuple[Literal["pan", "pog"], ...], arg(help="Both: each participant does one of them.")] = ("pan",)
    design: Literal["house-once", "crossed"] = "house-once"
    per_split: Annotated[int, arg(help="Episodes of each split.")] = 50
    seed: int = 0

    def work(self) -> int:
        from .commands.study_files import init

        values = vars(self)
        return init(folder=values.pop("study"), **values)


@dataclass
class StudyPlanVerb:
    """Draw the episodes, assign them to people, and freeze the study."""

    study: Positional[Path]
    dataset: Dataset
    scenes_dir: ScenesDir = None
    pilot: Annotated[bool, arg(help="May be served without an ethics id; all its records say so.")] = False

    def work(self) -> int:
        from .commands.study_files import plan

        return plan(folder=self.study, dataset=self.dataset, scenes_dir=self.scenes_dir, pilot=self.pilot)


@dataclass
class StudyServe:
    """Serve a planned study, or try one home's episodes with --scene; prints a personal link per participant."""

    dataset: Dataset
    study: Positional[Path | None] = None
    """Folder that `study plan` has planned."""
    scene: Annotated[str | None, arg(help="Without a study: one POG and one PAN participant on this home.")] = None
    scenes_dir: ScenesDir = None
    out: Annotated[Path | None, arg(help="With --scene: the folder; runs/study-<scene> by default.")] = None
    split: Splits = ()
    limit: Limit = None
    seed: int = 0
    actions: Literal["paper4", "paper6"] = "paper4"
    clutter: Clutter = 0
    rerun: Rerun = None
    with_pixels: WithPixels = False
    port: int = 8080
    bind: Annotated[str, arg(help="Address to listen on; beyond loopback only with --public.")] = "127.0.0.1"
    public: Annotated[bool, arg(help="People come from other machines; needs TLS or a proxy that does it.")] = False
    host: Annotated[tuple[str, ...], arg(help="Names under which browsers reach the study.")] = ()
    tls_cert: Path | None = None
    tls_key: Path | None = None
    proxy: Annotated[str | None, arg(help="Address of the reverse proxy that does TLS.")] = None
    i_have_rights: Annotated[bool, arg(help="The scans' licence allows sending them to participants.")] = False
    pilot: Annotated[bool, arg(help="Serve without an ethics id; the records say so for ever.")] = False
    workers: Annotated[int | None, arg(help="viser processes; one per core, at most four.")] = None

    def work(self) -> int:
        from .commands.study import serve

        return serve(**vars(self))


@dataclass
class StudyWithdraw:
    """Withdraw a participant who asked you to; what was done is deleted if the study file says so."""

    study: Positional[Path]
    participant: str

    def work(self) -> int:
        from .commands.study import withdraw

        return withdraw(study=self.study, participant=self.participant)


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
        Annotated[StudyInit, subcommand("init")]
        | Annotated[StudyPlanVerb, subcommand("plan")]
        | Annotated[StudyServe, subcommand("serve")]
        | Annotated[StudyWithdraw, subcommand("withdraw")]
        | Annotated[StudyExport, subcommand("export")]
        | Annotated[StudyVerify, subcommand("verify")]
        | Annotated[StudyCheckDb, subcommand("check-db")]
        | Annotated[StudyReport, subcommand("report")]
    )

    def work(self) -> int:
        return self.verb.work()
