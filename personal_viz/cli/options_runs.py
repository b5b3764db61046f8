"""Verbs that make runs, read them in and tabulate them: run, import, metrics, check-habitat, bench."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from sim.frames import CameraAxes, PoseFrame
from sim.types import RULE_NOTES, SuccessRule

from .options_shared import (
    Clutter,
    Dataset,
    Json,
    Limit,
    Rerun,
    RunId,
    SampleSeed,
    Scenes,
    ScenesDir,
    Splits,
    WithPixels,
)

StudyPart = Literal["store", "load", "browser", "kills", "people", "big-home", "restart", "soak"]


@dataclass
class Run:
    """Run an agent over PAN episodes."""

    dataset: Dataset
    agent: Annotated[
        str, arg(help="random, random-frontier, shortest-path (knows the goal), or your own as package.module:factory.")
    ]
    out: Path = Path("runs")
    scenes_dir: ScenesDir = None
    scene: Scenes = ()
    split: Splits = ()
    limit: Limit = None
    sample_seed: SampleSeed = 0
    seed: int = 0
    jobs: Annotated[int, arg(help="Worker processes; results do not depend on it.")] = 1
    run_id: RunId = None
    clutter: Clutter = 0
    episode: Annotated[str | None, arg(help="SPLIT/SCENE/ID: this episode only, instead of --scene and --split.")] = (
        None
    )
    rerun: Rerun = None
    with_pixels: WithPixels = False
    rule: Annotated[
        SuccessRule | None,
        arg(help="shortest-path only: the success rule it walks for, by default paper; habitat = to a view point."),
    ] = None

    def work(self) -> int:
        from .runs import run

        return run(**vars(self))


@dataclass
class Import:
    """Read runs of another simulator, check every step and compute all distances.

    Files of recordings/habitat_writer.py say themselves how to read them. Pose lists (CSV, TUM, JSON, npz) need
    --frame, and whatever else is not plain from them: nothing is guessed.
    """

    files: Annotated[Positional[tuple[Path, ...]], arg(help="Steps files (.jsonl), or .csv, .tsv, .tum, .json, .npz.")]
    dataset: Dataset
    who: Annotated[str, arg(help="Row name in tables.")]
    scenes_dir: ScenesDir = None
    out: Path = Path("runs")
    run_id: RunId = None
    frame: Annotated[
        PoseFrame | None,
        arg(
            help="Frame of pose lists: world = Habitat, y up, -z ahead; zup = HM3D's files, world (x, -z, y); "
            "ros = world (-z, -x, y), as OneMap logs; start, start-ros = world, ros from the start pose; "
            "gps = (forward, right) and compass."
        ),
    ] = None
    quaternion: Annotated[
        Literal["xyzw", "wxyz"] | None, arg(help="Order of quaternions whose parts the file does not name.")
    ] = None
    poses: Annotated[
        Literal["body", "camera"], arg(help="Poses of the robot's feet, or of the camera 0.88 m above them.")
    ] = "body"
    camera_axes: Annotated[
        CameraAxes | None, arg(help="opencv: z ahead, y down; opengl: -z ahead, y up (Habitat); flu: x ahead, z up.")
    ] = None
    columns: Annotated[
        str | None, arg(help="Names of CSV columns in their order, such as x,y,z,yaw; - leaves a column out.")
    ] = None
    rows: Annotated[
        Literal["after-action", "before-action"] | None,
        arg(help="Whether a row's pose is after or before its action, where every row has one."),
    ] = None
    stopped: Annotated[
        Literal["yes", "no"] | None, arg(help="Whether the runs ended with STOP, where files do not say.")
    ] = None
    allow_sliding: Annotated[bool, arg(help="The robot slid along walls, where files do not say.")] = False
    episode: Annotated[str | None, arg(help="SPLIT/SCENE/ID of the file, where neither it nor its name says.")] = None
    rounding: Annotated[float, arg(help="Metres by which positions are rounded, up to 0.01.")] = 0.001
    motion: Annotated[
        Literal["paper", "free"],
        arg(help="free: the robot had other actions; only --max-move, --max-turn-deg and the floor are checked."),
    ] = "paper"
    max_move: Annotated[float | None, arg(help="Metres from row to row at most, for --motion free.")] = None
    max_turn_deg: Annotated[float | None, arg(help="Degrees from row to row at most, for --motion free.")] = None
    max_steps: Annotated[int, arg(help="Step budget that the robot had, for --motion free.")] = 500

    def work(self) -> int:
        from .import_runs import import_files

        return import_files(**vars(self))


@dataclass
class Metrics:
    """SR, SPL and DTG (PAN) or SR and top-3 (POG) per split, in the paper's layout."""

    runs: Positional[tuple[Path, ...]]
    rule: Annotated[SuccessRule, arg(help=f"What counts as success in PAN: {'; '.join(RULE_NOTES.values())}.")] = (
        "paper"
    )
    json: Json = False

    def work(self) -> int:
        from .runs import metrics

        return metrics(**vars(self))


@dataclass
class CheckHabitat:
    """Compare navigation, pictures and measures with the answers of a real Habitat, stored in a folder."""

    golden: Annotated[Path, arg(help="Folder as docs/simulator.md describes; write one on your own scans.")]
    json: Json = False

    def work(self) -> int:
        from .check_habitat import check_habitat

        return check_habitat(golden=self.golden, json=self.json)


@dataclass
class Bench:
    """Measure speed on this machine; each figure stands beside its reference measured in the same run."""

    what: Positional[Literal["sim", "recordings", "study", "grounding"]]
    out: Annotated[Path, arg(help="Folder of the table, the plot and the JSON file.")] = Path("runs/bench")
    quick: Annotated[bool, arg(help="Fewer and smaller scenes, at most 50 s; study: some minutes.")] = False
    parts: Annotated[tuple[StudyPart, ...], arg(help="study: only these, by default all, which takes an hour.")] = ()
    json: Json = False

    def work(self) -> int:
        from .bench import bench_grounding, bench_recordings, bench_sim, bench_study, require_no_parts

        if self.what == "study":
            return bench_study(out=self.out, quick=self.quick, parts=self.parts, json=self.json)
        require_no_parts(self.what, self.parts)
        bench = {"sim": bench_sim, "recordings": bench_recordings, "grounding": bench_grounding}[self.what]
        return bench(out=self.out, quick=self.quick, json=self.json)
