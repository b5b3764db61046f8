"""Verbs of studies with people, from planning to serving: demo, study."""

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal, get_args

from tyro.conf import Positional, arg, subcommand

from ..options_shared import Clutter, Dataset, Limit, Rerun, ScenesDir, Splits, WithPixels
from .options_records import StudyCheckDb, StudyExclude, StudyExport, StudyImportCheck, StudyReport, StudyVerify

BotKind = Literal["shortest", "random", "slow", "impatient", "disconnecting"]


@dataclass
class Demo:
    """Invent a home, serve a study on it, and print two personal links."""

    out: Path = Path("runs/demo")
    seed: int = 5
    port: Annotated[str, arg(help="Also from the environment variable PORT; 0 takes a free one.")] = field(
        default_factory=lambda: os.environ.get("PORT", "8080")
    )

    def work(self) -> int:
        from .folder import demo

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
        from ...study_app.study_files import init

        values = vars(self)
        return init(folder=values.pop("study"), **values)


@dataclass
class StudyPlanVerb:
    """Draw the episodes, assign them to people, freeze the study; --power says beforehand how precise it will be."""

    study: Positional[Path | None] = None
    dataset: Annotated[Path | None, arg(help="Folder of the PersONAL episodes; not needed for --power.")] = None
    scenes_dir: ScenesDir = None
    pilot: Annotated[bool, arg(help="May be served without an ethics id; all its records say so.")] = False
    power: Annotated[bool, arg(help="Only simulate: width of intervals, power, and designs that do better.")] = False
    people: Annotated[int, arg(help="--power without a study: people in all.")] = 25
    episodes: Annotated[int, arg(help="--power without a study: episodes of each split.")] = 50
    raters: Annotated[int, arg(help="--power without a study: people per episode and condition.")] = 5
    conditions: Annotated[int, arg(help="--power without a study: such as 2, without and with memory.")] = 1
    base_rate: Annotated[float, arg(help="--power: success rate of people.")] = 0.65
    gap: Annotated[float, arg(help="--power: by which an agent is worse.")] = 0.15
    split_gap: Annotated[float, arg(help="--power: between two splits.")] = 0.10
    memory_gap: Annotated[float, arg(help="--power: by which people are better with memory.")] = 0.10
    person_sd: Annotated[tuple[float, ...], arg(help="--power: spreads of people (logit), a table each.")] = (0.3, 0.9)
    episode_sd: Annotated[float, arg(help="--power: spread of episodes (logit).")] = 1.3
    simulations: Annotated[int, arg(help="--power: studies drawn per number.")] = 150
    seed: Annotated[int, arg(help="--power: of the draws.")] = 0
    json: bool = False

    def work(self) -> int:
        if self.power:
            from .power import power

            return power(
                study=self.study,
                people=self.people,
                episodes=self.episodes,
                raters=self.raters,
                conditions=self.conditions,
                base_rate=self.base_rate,
                gap=self.gap,
                split_gap=self.split_gap,
                memory_gap=self.memory_gap,
                person_sd=self.person_sd,
                episode_sd=self.episode_sd,
                simulations=self.simulations,
                seed=self.seed,
                json=self.json,
            )
        from ...study_app.study_files import plan

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
    max_people: Annotated[int, arg(help="Participants connected at once.")] = 200
    per_address: Annotated[int, arg(help="Connections from one address; loopback and the proxy are not limited.")] = 64
    dashboard_port: Annotated[int, arg(help="Of the researcher's page, on this machine only; 0 takes a free one.")] = 0

    def work(self) -> int:
        from .folder import serve

        return serve(**vars(self))


@dataclass
class StudyWithdraw:
    """Withdraw a participant who asked you to; what was done is deleted if the study file says so."""

    study: Positional[Path]
    participant: str

    def work(self) -> int:
        from .folder import withdraw

        return withdraw(study=self.study, participant=self.participant)


@dataclass
class StudyPurgeIds:
    """Delete the ids of a recruiting platform that were kept for paying people."""

    study: Positional[Path]

    def work(self) -> int:
        from .purge_ids import purge_ids

        return purge_ids(study=self.study)


@dataclass
class StudyStatus:
    """Who is where, stuck or finished; never how well somebody does. Works while the study is served."""

    study: Positional[Path]
    json: bool = False
    watch: Annotated[bool, arg(help="Stay, and show changes.")] = False

    def work(self) -> int:
        from .status import status

        return status(study=self.study, json=self.json, watch=self.watch)


@dataclass
class StudyDoctor:
    """Check a deployment from outside: TLS, websocket, Origin, Host, cookies, clock, bandwidth."""

    url: str
    link: Annotated[str | None, arg(help="A personal link, to try the whole way in.")] = None
    insecure_ca: Annotated[Path | None, arg(help="Certificate to trust besides the system's (PEM).")] = None
    http_port: Annotated[int | None, arg(help="Where plain http is expected to lead to https; 80 by default.")] = None
    json: bool = False

    def work(self) -> int:
        from .doctor import doctor

        return doctor(**vars(self))


@dataclass
class StudyEthics:
    """Write templates: protocol, information sheet, consent, instructions, data flow, estimate, preregistration."""

    study: Positional[Path]
    out: Path = Path("runs/ethics")

    def work(self) -> int:
        from .ethics import ethics

        return ethics(study=self.study, out=self.out)


@dataclass
class StudyBots:
    """Simulated participants through the real gateway: how fast it answers, and whether anything was lost."""

    study: Positional[Path | None] = None
    """A planned study, of which a copy is served; an invented one without."""
    dataset: Annotated[Path | None, arg(help="Of the study.")] = None
    scenes_dir: ScenesDir = None
    participants: int = 10
    seconds: float = 60.0
    rate: Annotated[float, arg(help="Actions per second of each.")] = 2.0
    task: Annotated[
        Literal["pan", "pog", "both"] | None, arg(help="Whom bots stand for; otherwise all of the study, or PAN.")
    ] = None
    kinds: Annotated[tuple[BotKind, ...], arg(help="How they behave, dealt out in turns.")] = get_args(BotKind)
    seed: int = 0
    url: Annotated[str | None, arg(help="Of a server on a pilot study: its records will hold the bots.")] = None
    json: bool = False

    def work(self) -> int:
        from .bots import bots

        return bots(**vars(self))


@dataclass
class Study:
    """Studies with people."""

    verb: (
        Annotated[StudyInit, subcommand("init")]
        | Annotated[StudyPlanVerb, subcommand("plan")]
        | Annotated[StudyEthics, subcommand("ethics")]
        | Annotated[StudyServe, subcommand("serve")]
        | Annotated[StudyStatus, subcommand("status")]
        | Annotated[StudyDoctor, subcommand("doctor")]
        | Annotated[StudyBots, subcommand("bots")]
        | Annotated[StudyWithdraw, subcommand("withdraw")]
        | Annotated[StudyPurgeIds, subcommand("purge-ids")]
        | Annotated[StudyExclude, subcommand("exclude")]
        | Annotated[StudyCheckDb, subcommand("check-db")]
        | Annotated[StudyVerify, subcommand("verify")]
        | Annotated[StudyExport, subcommand("export")]
        | Annotated[StudyImportCheck, subcommand("import-check")]
        | Annotated[StudyReport, subcommand("report")]
    )

    def work(self) -> int:
        return self.verb.work()
