"""Verbs that show runs and read them in and out: replay, compare, browse, export."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from .options_shared import Clutter, Dataset, Scenes, ScenesDir, WithPixels

OpenIt = Annotated[bool, arg(help="Open it in a viewer on this machine, until Ctrl-C or until the viewer is closed.")]


@dataclass
class Replay:
    """Write one Rerun recording with any number of runs of one episode."""

    dataset: Dataset
    runs: Annotated[tuple[Path, ...], arg(help="Run folders of people, agents, grounders and imports.")]
    out: Annotated[Path, arg(help="An .rrd file.")]
    scenes_dir: ScenesDir = None
    episode: Annotated[str | None, arg(help="SPLIT/SCENE/ID; needed when the runs share several episodes.")] = None
    with_pixels: WithPixels = False
    open: OpenIt = False

    def work(self) -> int:
        from .recordings import replay

        return replay(**vars(self))


@dataclass
class Compare:
    """Write a page with one row per episode of all runs, each with its recording and its contact sheet."""

    runs: Positional[tuple[Path, ...]]
    dataset: Dataset
    out: Annotated[Path, arg(help="Folder of index.html, index.md, recordings and contact sheets.")]
    scenes_dir: ScenesDir = None
    with_pixels: WithPixels = False
    picture_width: Annotated[int, arg(help="Width of what robots saw in the recordings, in pixels; 0 = none.")] = 320
    jobs: Annotated[int, arg(help="Worker processes, one scene each.")] = 1
    open: OpenIt = False

    def work(self) -> int:
        from .compare import compare

        return compare(**vars(self))


@dataclass
class Browse:
    """Walk through episodes, homes, owners and runs in the browser; for researchers, it shows the truth."""

    dataset: Dataset
    runs: Annotated[tuple[Path, ...], arg(help="Run folders to show beside the episodes.")] = ()
    scenes_dir: ScenesDir = None
    scene: Scenes = ()
    clutter: Clutter = 0
    port: Annotated[int, arg(help="0 takes a free one.")] = 8090

    def work(self) -> int:
        from .browse import browse

        return browse(**vars(self))


@dataclass
class Export:
    """Write runs in other formats: JSONL as ours, TUM trajectories, or an episode folder that Minari opens."""

    runs: Annotated[Positional[tuple[Path, ...]], arg(help="Run folders, or recordings (.rrd) of ours.")]
    out: Annotated[Path, arg(help="Folder.")]
    format: Literal["jsonl", "tum", "minari"] = "jsonl"

    def work(self) -> int:
        from .export import export

        return export(**vars(self))
