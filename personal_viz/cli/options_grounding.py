"""Verbs of grounding beside `ground`: explore, pog-report, map, show-exploration, show-map."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from sim.frames import CameraAxes

from .options_shared import Json, ModelAutocast, ModelBatch, ModelDevice, Scenes, ScenesDir, WithPixels


@dataclass
class Explore:
    """Explore homes with a frontier policy; write the explorations, their figures, and coverage over steps."""

    dataset: Annotated[Path | None, arg(help="Folder of episodes whose homes are explored; or give --homes.")] = None
    homes: Annotated[int | None, arg(help="So many invented homes, from the seeds 0, 1, ...")] = None
    scene: Scenes = ()
    scenes_dir: ScenesDir = None
    storeys: Annotated[Literal["start", "all"], arg(help="start: the storey with the most floor; all: each one.")] = (
        "start"
    )
    seed: Annotated[int, arg(help="Of the starts.")] = 0
    max_steps: Annotated[int, arg(help="Most actions per storey; most homes need fewer.")] = 2500
    width: Annotated[
        int, arg(help="Of the robot's pictures; smaller ones are quicker, with the same field of view.")
    ] = 640
    height: Annotated[int, arg(help="Of the robot's pictures, pixels, as the width.")] = 480
    jobs: Annotated[int, arg(help="Worker processes; results do not depend on it.")] = 1
    out: Annotated[Path, arg(help="Folder of the explorations.")] = Path("runs/explore")
    json: Json = False
    rerun: Annotated[
        str | None,
        arg(
            help="Show explorations live, stored ones again: FILE.rrd, a folder (one file per exploration), "
            "rerun+http://HOST:PORT/proxy, or spawn."
        ),
    ] = None
    with_pixels: WithPixels = False

    def work(self) -> int:
        from .explore import explore

        return explore(**vars(self))


@dataclass
class PogReport:
    """Write grounding runs as the paper's POG table, with intervals, curves and a gallery of failures."""

    runs: Annotated[Positional[tuple[Path, ...]], arg(help="Run folders of ground and of people, or folders of some.")]
    out: Annotated[Path, arg(help="Folder of index.html, index.md, tables and figures.")]
    dataset: Annotated[
        tuple[Path, ...], arg(help="Folders of episodes: shows failures of the runs on them, with the episodes' texts.")
    ] = ()
    failures: Annotated[int, arg(help="So many failures of each method are drawn.")] = 8
    seed: Annotated[int, arg(help="Of the bootstrap and of the sample of failures.")] = 0
    json: Json = False

    def work(self) -> int:
        from .pog_report import pog_report

        return pog_report(**vars(self))


@dataclass
class ShowExploration:
    """Walk a stored exploration again and write it as a Rerun recording: views, map growing, frontiers, way."""

    file: Annotated[Positional[Path], arg(help="An exploration, FILE.json.")]
    out: Annotated[Path, arg(help="An .rrd file.")]
    dataset: Annotated[Path | None, arg(help="Folder of the home's episodes; homes of explore --homes need none.")] = (
        None
    )
    scenes_dir: ScenesDir = None
    with_pixels: WithPixels = False
    open: Annotated[bool, arg(help="Open it in a viewer on this machine, until Ctrl-C or until it is closed.")] = False

    def work(self) -> int:
        from .show_exploration import show_exploration

        return show_exploration(**vars(self))


@dataclass
class ShowMap:
    """Write a map file as a Rerun recording: free space, features, evidence, objects, in its home."""

    file: Annotated[Positional[Path], arg(help="A map, FILE.npz.")]
    out: Annotated[Path, arg(help="An .rrd file.")]
    dataset: Annotated[Path | None, arg(help="Folder of the episodes; without it the map is shown alone.")] = None
    scenes_dir: ScenesDir = None
    with_pixels: WithPixels = False
    open: Annotated[bool, arg(help="Open it in a viewer on this machine, until Ctrl-C or until it is closed.")] = False

    def work(self) -> int:
        from .show_map import show_map

        return show_map(**vars(self))


@dataclass
class Map:
    """Make a map file of a robot's posed colour and depth pictures.

    The folder holds color/*.jpg|png, depth/*.png (16 bit, mm), poses/*.txt (4 x 4, camera to world) or a trajectory
    (poses.txt, trajectory.txt: time tx ty tz qx qy qz qw), and intrinsics.json or intrinsics.txt; the layouts of
    ScanNet, Replica, TUM and 7-Scenes are known too. Frames without a valid pose are skipped and counted.
    """

    frames: Annotated[Path, arg(help="Folder of the recording.")]
    up: Annotated[Literal["z", "y"], arg(help="Which axis of the poses' frame points up.")]
    encoder: Annotated[
        str,
        arg(
            help="clip:, siglip:, blip2-itc256:, blip2-hidden768: and a model id or folder; or package.module:factory."
        ),
    ]
    out: Annotated[Path, arg(help="The map, FILE.npz.")]
    layout: Annotated[Literal["grid", "objects"], arg(help="A vector per cell, or per thing.")] = "grid"
    cell: Annotated[float, arg(help="Side of a cell, metres: 1, or 1 divided by a whole number, such as 0.25.")] = 1.0
    features: Annotated[
        Literal["patches", "images"], arg(help="What is encoded: patches, or whole pictures for every cell in view.")
    ] = "patches"
    segmenter: Annotated[
        str, arg(help="What finds things for --layout objects: depth (no weights), or package.module:factory.")
    ] = "depth"
    camera_axes: Annotated[
        CameraAxes, arg(help="Of the poses. opencv: z ahead, y down; opengl: -z ahead, y up; flu: x ahead, z up.")
    ] = "opencv"
    depth_per_metre: Annotated[
        float | None, arg(help="Depth units: 1000 = mm, 5000 = TUM; what the intrinsics file says, else 1000.")
    ] = None
    mount_height: Annotated[
        float | None, arg(help="Of the camera above the floor, metres; found from the depth by default.")
    ] = None
    max_depth: Annotated[float, arg(help="Farther returns are not mapped, metres.")] = 5.0
    scene: Annotated[str | None, arg(help="Name of the place; the folder's by default.")] = None
    device: ModelDevice = "cpu"
    autocast: ModelAutocast = "off"
    batch: ModelBatch = 8
    json: Json = False

    def work(self) -> int:
        from .map_frames import map_frames

        return map_frames(**vars(self))
