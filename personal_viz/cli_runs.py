"""Verbs that make runs, read them in and tabulate them: run, ground, import, metrics, check-habitat, bench."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from sim.types import SuccessRule

from .cli_options import Clutter, Dataset, Json, Limit, Rerun, RunId, Scenes, ScenesDir, Splits, WithPixels


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
    episode: Annotated[str | None, arg(help="SPLIT/SCENE/ID: this episode only, instead of --scene and --split.")] = (
        None
    )
    rerun: Rerun = None
    with_pixels: WithPixels = False

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

    what: Positional[Literal["sim", "recordings"]]
    out: Annotated[Path, arg(help="Folder of the table, the plot and the JSON file.")] = Path("runs/bench")
    quick: Annotated[bool, arg(help="Fewer and smaller scenes, at most 50 s.")] = False
    json: Json = False

    def work(self) -> int:
        from .commands.bench import bench_recordings, bench_sim

        bench = {"sim": bench_sim, "recordings": bench_recordings}[self.what]
        return bench(out=self.out, quick=self.quick, json=self.json)
