"""Verb `map`: a robot's recorded frames into a map file, and what of them was used."""

import json as json_module
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from rich.progress import track

from grounding.encoders.by_name import make_image_encoder, require_no_model_options
from grounding.encoders.protocol import MODEL_FAMILIES, Autocast, DenseEncoder, Device, ModelOptions
from grounding.maps.files import MapSource, save_memory
from grounding.maps.grid_map import FeatureSource, GridMapBuilder, MapBuilder
from grounding.maps.home_map import HomeMemory, ObjectMap, StoreyMemory
from grounding.maps.object_map import ObjectMapBuilder
from grounding.maps.storeys import floors_of_frames
from grounding.perception.segments import Segmenter
from grounding.robot.frames import FrameCounts, RobotFrames, read_robot_frames
from personal_viz.printed import Console
from sim.errors import AgentError, PersonalVizError
from sim.frames import CameraAxes
from sim.scans.up_axis import Up
from sim.tasks.agents import build_plugin
from sim.tasks.observers import FREE, OCCUPIED

_FLOOR_FRAMES = 40
"""So many frames, spread over the recording, tell where the floors are."""


def map_frames(
    *,
    frames: Path,
    up: Up,
    encoder: str,
    out: Path,
    layout: Literal["grid", "objects"],
    cell: float,
    features: FeatureSource,
    segmenter: str,
    camera_axes: CameraAxes,
    depth_per_metre: float | None,
    mount_height: float | None,
    max_depth: float,
    scene: str | None,
    device: Device,
    autocast: Autocast,
    batch: int,
    json: bool,
) -> int:
    """Maps a recording into `out` and prints the counts.

    Raises:
        PersonalVizError: Bad options, files or plug-ins; or no frame can be used.
    """
    if out.suffix != ".npz":
        raise PersonalVizError(f"--out is {str(out)!r}; expected a file that ends in .npz. Give another name.")
    for option, value in (("--batch", batch), ("--max-depth", max_depth), ("--depth-per-metre", depth_per_metre)):
        if value is not None and not value > 0:
            raise PersonalVizError(f"{option} is {value}; expected more than 0. Leave it out for the default.")
    recording, counts = read_robot_frames(frames, up=up, camera_axes=camera_axes, depth_per_metre=depth_per_metre)
    floors = _floors(frames, recording, mount_height)
    options = ModelOptions(device=device, autocast=autocast, batch_size=batch)
    eye = load_encoder(encoder, options)
    common: dict[str, Any] = {
        "floors": floors,
        "max_depth": max_depth,
        "frame": f"robot, {up} up in its poses, turned to y up",
        "batch": batch,
    }
    builder: MapBuilder
    if layout == "grid":
        builder = GridMapBuilder(eye, cell=cell, features=features, **common)
    else:
        builder = ObjectMapBuilder(eye, load_segmenter(segmenter, floors), **common)
    memory = _built(builder, recording, counts)
    source = MapSource(scene=scene or frames.resolve().name, kind="robot", builder=builder.name)
    save_memory(out, memory, source)
    if json:
        print(json_module.dumps(_document(memory, counts, layout, builder, out), indent=2))
    else:
        _print(memory, counts, builder, out)
    return 0


def load_encoder(name: str, options: ModelOptions) -> DenseEncoder:
    """A real model by family, or a user's own as `package.module:factory`.

    Raises:
        AgentError: There is none of this name, or it cannot be built.
    """
    if ":" not in name or name.partition(":")[0] in MODEL_FAMILIES:
        return make_image_encoder(name, options=options)
    unbatched = replace(options, batch_size=ModelOptions().batch_size)  # the builder's too, whatever the encoder
    require_no_model_options(f"--encoder {name}", unbatched)
    return _plug_in("--encoder", name, ("encode_texts", "encode_images"))


def load_segmenter(name: str, floors: tuple[float, ...]) -> Segmenter:
    """`depth`, or a user's own as `package.module:factory`.

    Raises:
        AgentError: There is none of this name, or it cannot be built.
    """
    if name == "depth":
        from grounding.perception.segment_depth import DepthRegions

        return DepthRegions(floors=floors)
    return _plug_in("--segmenter", name, ("segment",))


def _plug_in(option: str, name: str, methods: tuple[str, ...]) -> Any:
    if not name.partition(":")[2]:
        raise AgentError(f"{option} is {name!r}; expected your own as package.module:factory. See --help for others.")
    made = build_plugin(name)
    for method in methods:
        if not callable(getattr(made, method, None)):
            raise AgentError(
                f"{name}: found no method {method}(); expected one, as {option} needs. Correct the plug-in."
            )
    return made


def _floors(folder: Path, recording: RobotFrames, mount_height: float | None) -> tuple[float, ...]:
    some = recording.some(_FLOOR_FRAMES)
    if not some:
        raise PersonalVizError(f"{folder}: no picture can be read; expected whole PNG or JPEG files. Copy them again.")
    return floors_of_frames(some, mount_height=mount_height)


def _built(builder: MapBuilder, recording: RobotFrames, counts: FrameCounts) -> HomeMemory:
    console = Console(stderr=True)
    for frame in track(
        recording, "Mapping", total=len(recording), console=console, disable=not sys.stderr.isatty(), transient=True
    ):
        builder.add(frame)
    if counts.warning:
        console.print(f"Warning: {counts.warning}.", style="yellow", soft_wrap=True)
    return builder.finish()


def _document(
    memory: HomeMemory, counts: FrameCounts, layout: str, builder: MapBuilder, out: Path
) -> dict[str, object]:
    first = memory.storeys[0].memory
    return {
        "frames": {"found": counts.num_found, "used": memory.num_frames, "skipped": dict(counts.by_reason)},
        "warning": counts.warning,
        "layout": layout,
        "builder": builder.name,
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


def _print(memory: HomeMemory, counts: FrameCounts, builder: MapBuilder, out: Path) -> None:
    print(f"{memory.num_frames} of {counts.num_found} frames used, {builder.name}, encoder {_space(memory)}")
    for reason, number in counts.by_reason.items():
        print(f"  skipped, {reason}: {number}")
    for storey in memory.storeys:
        found = _storey(storey)
        stored = f"{found['objects']} objects" if "objects" in found else f"{found['cells']} cells"
        print(f"  storey at {found['floor_y']} m: {stored}, {found['free_m2']} m2 free")
    print(f"Written to {out}")


def _space(memory: HomeMemory) -> str:
    first = memory.storeys[0].memory
    return f"{first.encoder} ({first.dim}-d)"
