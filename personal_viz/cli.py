"""The command line: one dataclass per verb, parsed by tyro; each worker is imported only after parsing."""

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro
from tyro.conf import Positional, arg, subcommand

from sim.types import ClutterLevel, Split, SuccessRule

Dataset = Annotated[Path, arg(help="Folder with easy/, medium/, hard/ (data/split in the authors' repository).")]
ScenesDir = Annotated[
    Path | None, arg(help="Folder below which <Scene>.glb files lie; without it, homes are rebuilt from the episodes.")
]
Json = Annotated[bool, arg(help="Print one JSON document instead of tables.")]
Scenes = Annotated[tuple[str, ...], arg(help="Scene names; all by default.")]
Splits = Annotated[tuple[Split, ...], arg(help="Splits; all by default.")]
Limit = Annotated[int | None, arg(help="At most this many episodes per split, in dataset order.")]
Clutter = Annotated[
    ClutterLevel, arg(help="How much furniture and small things without a caption stand in homes without a scan.")
]
RunId = Annotated[str | None, arg(help="Folder name below --out; made from the options by default.")]


@dataclass
class Validate:
    """Check every episode file; exit code 1 only when something is unusable."""

    dataset: Dataset
    json: Json = False

    def work(self) -> int:
        from .commands.episodes import validate

        return validate(dataset=self.dataset, json=self.json)


@dataclass
class Stats:
    """Rebuild the paper's two statistics tables from the files."""

    dataset: Dataset
    json: Json = False

    def work(self) -> int:
        from .commands.episodes import stats

        return stats(dataset=self.dataset, json=self.json)


@dataclass
class Invent:
    """Invent homes with their own PersONAL-format episodes."""

    out: Path
    homes: int = 1
    seed: int = 0

    def work(self) -> int:
        from .commands.invent import invent

        return invent(homes=self.homes, seed=self.seed, out=self.out)


@dataclass
class Homes:
    """Report how well homes without a scan serve their episodes: paths, view points, what can be told apart."""

    dataset: Dataset
    scene: Scenes = ()
    json: Json = False
    out: Annotated[Path | None, arg(help="Folder for the homes' plans, to be corrected by hand.")] = None
    jobs: Annotated[int, arg(help="Worker processes, one scene each.")] = 1
    folds: Annotated[bool, arg(help="Recover each home from two splits alone as well (held-out figures).")] = True

    def work(self) -> int:
        from .commands.homes import homes

        return homes(**vars(self))


@dataclass
class ContactSheet:
    """Draw one picture of a home: plans, views of rooms, and one of each category of objects."""

    scene: Positional[Annotated[str | None, arg(help="Scene name; left out with --invent.")]] = None
    out: Annotated[Path, arg(help="A PNG file.")] = Path("runs/contact-sheet.png")
    dataset: Annotated[Path | None, arg(help="Folder of the episodes.")] = None
    scenes_dir: ScenesDir = None
    invent: Annotated[int | None, arg(help="Seed of an invented home, instead of SCENE and --dataset.")] = None
    clutter: Clutter = 0
    crops: Annotated[
        Path | None, arg(help="Folder for 256 x 256 crops without labels and their key, to let people name them.")
    ] = None

    def work(self) -> int:
        from .commands.contact_sheet import contact_sheet

        return contact_sheet(**vars(self))


@dataclass
class Run:
    """Run an agent over PAN episodes."""

    dataset: Dataset
    agent: Annotated[str, arg(help="random, shortest-path (knows the goal), or your own as package.module:factory.")]
    out: Path = Path("runs")
    scenes_dir: ScenesDir = None
    scene: Scenes = ()
    split: Splits = ()
    limit: Limit = None
    seed: int = 0
    jobs: Annotated[int, arg(help="Worker processes; results do not depend on it.")] = 1
    run_id: RunId = None
    clutter: Clutter = 0

    def work(self) -> int:
        from .commands.runs import run

        return run(**vars(self))


@dataclass
class Ground:
    """Ground POG episodes on a map."""

    dataset: Dataset
    method: Literal["random", "center", "qs", "rpg"]
    map: Literal["oracle"] = "oracle"
    encoder: Literal["hashed"] = "hashed"
    all_storeys: Annotated[bool, arg(help="Do not tell the target's storey.")] = False
    out: Path = Path("runs")
    scene: Scenes = ()
    split: Splits = ()
    limit: Limit = None
    seed: int = 0
    jobs: Annotated[int, arg(help="Worker processes; results do not depend on it.")] = 1
    run_id: RunId = None
    json: Json = False

    def work(self) -> int:
        from .commands.ground import ground

        return ground(**{**vars(self), "scene": self.scene or None, "split": self.split or None})


@dataclass
class Import:
    """Read runs of another simulator, written with recordings/habitat_writer.py, and compute all distances."""

    files: Positional[tuple[Path, ...]]
    dataset: Dataset
    who: Annotated[str, arg(help="Row name in tables.")]
    scenes_dir: ScenesDir = None
    out: Path = Path("runs")
    run_id: RunId = None

    def work(self) -> int:
        from .commands.import_runs import import_files

        return import_files(**vars(self))


@dataclass
class Metrics:
    """SR, SPL and DTG (PAN) or SR and top-3 (POG) per split, in the paper's layout."""

    runs: Positional[tuple[Path, ...]]
    rule: SuccessRule = "paper"
    json: Json = False

    def work(self) -> int:
        from .commands.runs import metrics

        return metrics(**vars(self))


@dataclass
class Replay:
    """Write one Rerun recording with any number of runs of one episode."""

    runs: Positional[tuple[Path, ...]]
    out: Path
    dataset: Dataset
    scenes_dir: ScenesDir = None
    episode: Annotated[str | None, arg(help="SPLIT/SCENE/ID; needed when the runs share several episodes.")] = None
    with_pixels: Annotated[
        bool, arg(help="Store pictures of licensed scans too; you must have the right to share them.")
    ] = False

    def work(self) -> int:
        from .commands.recordings import replay

        return replay(**vars(self))


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
class Study:
    """Studies with people."""

    verb: (
        Annotated[StudyServe, subcommand("serve")]
        | Annotated[StudyExport, subcommand("export")]
        | Annotated[StudyVerify, subcommand("verify")]
        | Annotated[StudyCheckDb, subcommand("check-db")]
    )

    def work(self) -> int:
        return self.verb.work()


@dataclass
class CheckHabitat:
    """Compare navigation, pictures and measures with the answers of a real Habitat, stored in a folder."""

    golden: Annotated[Path, arg(help="Folder as sim/README.md describes; write one on your own scans.")]
    json: Json = False

    def work(self) -> int:
        from .commands.check_habitat import check_habitat

        return check_habitat(golden=self.golden, json=self.json)


@dataclass
class Bench:
    """Measure speed on this machine; each figure stands beside its reference measured in the same run."""

    what: Positional[Literal["sim"]]
    out: Annotated[Path, arg(help="Folder of the table, the plot and the JSON file.")] = Path("runs/bench")
    quick: Annotated[bool, arg(help="Fewer and smaller scenes, at most 50 s.")] = False
    json: Json = False

    def work(self) -> int:
        from .commands.bench import bench_sim

        return bench_sim(out=self.out, quick=self.quick, json=self.json)


Verb = (
    Annotated[Demo, subcommand("demo")]
    | Annotated[Validate, subcommand("validate")]
    | Annotated[Stats, subcommand("stats")]
    | Annotated[Invent, subcommand("invent")]
    | Annotated[Homes, subcommand("homes")]
    | Annotated[ContactSheet, subcommand("contact-sheet")]
    | Annotated[Run, subcommand("run")]
    | Annotated[Ground, subcommand("ground")]
    | Annotated[Import, subcommand("import")]
    | Annotated[Metrics, subcommand("metrics")]
    | Annotated[Replay, subcommand("replay")]
    | Annotated[Study, subcommand("study")]
    | Annotated[CheckHabitat, subcommand("check-habitat")]
    | Annotated[Bench, subcommand("bench")]
)


def parse(arguments: list[str] | None = None) -> Verb:
    """The verb that the command line names.

    Raises:
        SystemExit: Usage error (2) or --help (0).
    """
    return tyro.cli(
        Verb,  # type: ignore[arg-type]
        prog="personal-viz",
        description="3-D visualization and human baselines for the PersONAL benchmark.",
        args=arguments,
        config=(tyro.conf.OmitArgPrefixes, tyro.conf.OmitSubcommandPrefixes),
    )
