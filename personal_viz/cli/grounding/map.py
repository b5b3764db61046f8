"""Verb `map`: makes a map file from a robot's recorded frames, and reports which frames it used."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from tyro.conf import arg

from grounding.encoders.by_name import is_model, make_image_encoder, require_no_model_options
from grounding.encoders.protocol import DenseEncoder, ModelOptions
from grounding.maps.files import MapSource, save_memory
from grounding.maps.grid_map import GridMapBuilder, MapBuilder
from grounding.maps.home_map import HomeMemory, ObjectMap, StoreyMemory
from grounding.maps.object_map import ObjectMapBuilder
from grounding.maps.storeys import ViewOptions, floors_of_frames
from grounding.perception.segment_depth import DepthRegions
from grounding.perception.segments import Segmenter
from grounding.robot.frames import FrameCounts, RobotFrames, read_robot_frames
from personal_viz.printed import Console
from sim.errors import PersonalVizError
from sim.frames import CameraAxes
from sim.plugins import build_plugin
from sim.tasks.observers import FREE, OCCUPIED

from ...progress import counted
from ..options import Json, ModelAutocast, ModelBatch, ModelDevice
from ..output import print_json
from ..refusals import require_suffix

_FLOOR_FRAMES = 40
"""Number of frames, spread over the recording, from which the floors are found."""


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
        CameraAxes,
        arg(help="Camera axes of the poses. opencv: z ahead, y down; opengl: -z ahead, y up; flu: x ahead, z up."),
    ] = "opencv"
    depth_per_metre: Annotated[
        float | None, arg(help="Depth units: 1000 = mm, 5000 = TUM; what the intrinsics file says, else 1000.")
    ] = None
    mount_height: Annotated[
        float | None, arg(help="Height of the camera above the floor, metres; found from the depth by default.")
    ] = None
    max_depth: Annotated[float, arg(help="Farther returns are not mapped, metres.")] = 5.0
    scene: Annotated[str | None, arg(help="Name of the place; the folder's by default.")] = None
    device: ModelDevice = "cpu"
    autocast: ModelAutocast = "off"
    batch: ModelBatch = 8
    json: Json = False

    def run(self) -> int:
        require_suffix("--out", self.out, ".npz")
        for option, value in (
            ("--batch", self.batch),
            ("--max-depth", self.max_depth),
            ("--depth-per-metre", self.depth_per_metre),
        ):
            if value is not None and not value > 0:
                raise PersonalVizError(f"{option} is {value}; expected more than 0. Leave it out for the default.")
        recording, counts = read_robot_frames(
            self.frames, up=self.up, camera_axes=self.camera_axes, depth_per_metre=self.depth_per_metre
        )
        floors = _floors(self.frames, recording, self.mount_height)
        options = ModelOptions(device=self.device, autocast=self.autocast, batch_size=self.batch)
        eye = load_encoder(self.encoder, options)
        frame = f"robot, {self.up} up in its poses, turned to y up"
        views = ViewOptions(floors=floors, max_depth=self.max_depth, frame=frame, batch=self.batch)
        builder: MapBuilder
        if self.layout == "grid":
            builder = GridMapBuilder(eye, cell=self.cell, features=self.features, views=views)
        else:
            builder = ObjectMapBuilder(eye, load_segmenter(self.segmenter, floors), views=views)
        memory = _built(builder, recording, counts)
        source = MapSource(scene=self.scene or self.frames.resolve().name, kind="robot", builder=builder.name)
        save_memory(self.out, memory, source)
        document = _document(memory, counts, self.layout, builder.name, self.out)
        if self.json:
            print_json(document)
        else:
            _print(document)
        return 0


def load_encoder(name: str, options: ModelOptions) -> DenseEncoder:
    """A real model by family, or a user's own as `package.module:factory`.

    Raises:
        AgentError: No encoder has this name, or it cannot be built.
    """
    if not is_model(name):
        unbatched = replace(options, batch_size=ModelOptions().batch_size)  # builders use it too
        require_no_model_options(f"--encoder {name}", unbatched)
    return make_image_encoder(name, options=options)


def load_segmenter(name: str, floors: tuple[float, ...]) -> Segmenter:
    """`depth`, or a user's own as `package.module:factory`.

    Raises:
        AgentError: No segmenter has this name, or it cannot be built.
    """
    if name == "depth":
        return DepthRegions(floors=floors)
    return build_plugin(name, option="--segmenter", methods=("segment",))


def _floors(folder: Path, recording: RobotFrames, mount_height: float | None) -> tuple[float, ...]:
    some = recording.some(_FLOOR_FRAMES)
    if not some:
        raise PersonalVizError(f"{folder}: no picture can be read; expected whole PNG or JPEG files. Copy them again.")
    return floors_of_frames(some, mount_height=mount_height)


def _built(builder: MapBuilder, recording: RobotFrames, counts: FrameCounts) -> HomeMemory:
    """The map of all usable frames; reports progress, and anything odd about the frames."""
    with counted("frames", len(recording)) as progress:
        for frame in recording:
            builder.add(frame)
            progress.add()
    if counts.warning:
        Console(stderr=True).print(f"Warning: {counts.warning}.", style="yellow", soft_wrap=True)
    return builder.finish()


def _document(memory: HomeMemory, counts: FrameCounts, layout: str, builder: str, out: Path) -> dict[str, Any]:
    """The document that `--json` prints."""
    first = memory.storeys[0].memory
    return {
        "frames": {"found": counts.num_found, "used": memory.num_frames, "skipped": dict(counts.by_reason)},
        "warning": counts.warning,
        "layout": layout,
        "builder": builder,
        "cell": None if isinstance(first, ObjectMap) else first.grid.cell,
        "encoder": first.encoder,
        "dim": first.dim,
        "frame": memory.frame,
        "storeys": [_storey(storey) for storey in memory.storeys],
        "written": str(out),
    }


def _storey(storey: StoreyMemory) -> dict[str, float | int]:
    known = storey.occupancy.cells
    area = storey.occupancy.grid.cell**2
    memory = storey.memory
    stored = {"objects": len(memory.objects)} if isinstance(memory, ObjectMap) else {"cells": len(memory.rows)}
    return {
        "floor_y": round(storey.floor_y, 3) + 0.0,  # no -0.0
        **stored,
        "free_m2": round(float((known == FREE).sum() * area), 1),
        "blocked_m2": round(float((known == OCCUPIED).sum() * area), 1),
    }


def _print(document: dict[str, Any]) -> None:
    frames, space = document["frames"], f"{document['encoder']} ({document['dim']}-d)"
    print(f"{frames['used']} of {frames['found']} frames used, {document['builder']}, encoder {space}")
    for reason, number in frames["skipped"].items():
        print(f"  skipped, {reason}: {number}")
    for storey in document["storeys"]:
        stored = next(f"{storey[name]} {name}" for name in ("objects", "cells") if name in storey)
        print(f"  storey at {storey['floor_y']} m: {stored}, {storey['free_m2']} m2 free")
    print(f"Written to {document['written']}")
