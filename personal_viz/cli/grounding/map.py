"""Verb `map`: makes a map file from a robot's recorded frames, and reports which frames it used."""

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from tyro.conf import arg

from grounding.encoders.by_name import is_model, make_image_encoder, require_no_model_options
from grounding.encoders.protocol import DenseEncoder, ModelOptions
from grounding.encoders.resumed import ResumedEncoder
from grounding.maps.files import MapSource, save_memory
from grounding.maps.grid_map import GridMapBuilder, MapBuilder, NoFeatures
from grounding.maps.header import RecordingSource, matrix_of
from grounding.maps.home_map import HomeMemory, ObjectMap, StoreyMemory
from grounding.maps.object_map import ObjectMapBuilder
from grounding.maps.storeys import ViewOptions, floors_of_frames
from grounding.perception.segment_depth import DepthRegions
from grounding.perception.segments import ViewSegmenter
from grounding.robot.frames import RobotFrames, read_robot_frames
from grounding.robot.poses import pose_of_quat
from grounding.robot.recording import FrameCounts
from grounding.robot.ros_bag import ROLES
from grounding.types import NO_FEATURES
from personal_viz.printed import Console
from sim.errors import PersonalVizError
from sim.files import write_whole
from sim.frames import CameraAxes
from sim.plugins import build_plugin, plugin_digest
from sim.tasks.observers import FREE, OCCUPIED
from sim.tasks.shards import Shard, shard_from_text
from sim.types import Frame

from ...progress import Counted, counted
from ..options import Json, ModelAutocast, ModelBatch, ModelDevice
from ..output import print_json
from ..refusals import require_folder, require_suffix, writing

_FLOOR_FRAMES = 40
"""Number of frames, spread over the recording, from which the floors are found."""


@dataclass
class Map:
    """Make a map file of a robot's or phone's posed colour and depth pictures.

    A folder holds color/*.jpg|png, depth/*.png (16 bit, mm), *.npy or *.tiff (float, metres), poses/*.txt (4 x 4,
    camera to world) or a trajectory (poses.txt, trajectory.txt: time tx ty tz qx qy qz qw), and intrinsics.json or
    intrinsics.txt. The layouts of ScanNet, Replica, TUM, 7-Scenes, Stray Scanner and Record3D, and ROS bags, are known
    too. Frames without a valid pose are skipped and counted. A run that was interrupted continues.
    """

    frames: Annotated[Path, arg(help="The recording: a folder, a .r3d file, or a .bag, .mcap or .db3 file.")]
    encoder: Annotated[
        str,
        arg(
            help="clip:, siglip:, blip2-itc256:, blip2-hidden768: and a model id or folder; package.module:factory; "
            "or none for geometry alone."
        ),
    ]
    out: Annotated[Path, arg(help="The map, FILE.npz; FILE.npz.encoded/ keeps what is encoded until it is written.")]
    up: Annotated[
        str,
        arg(
            help="Which way is up in the poses' frame: x, -x, y, -y, z, -z, or a direction x,y,z; auto: as the "
            "recording says, or found from its depth and poses."
        ),
    ] = "auto"
    layout: Annotated[Literal["grid", "objects"], arg(help="A vector per cell, or per thing.")] = "grid"
    cell: Annotated[float, arg(help="Side of a cell, metres: 1, or 1 divided by a whole number, such as 0.25.")] = 1.0
    features: Annotated[
        Literal["patches", "images"], arg(help="What is encoded: patches, or whole pictures for every cell in view.")
    ] = "patches"
    segmenter: Annotated[
        str, arg(help="What finds things for --layout objects: depth (no weights), or package.module:factory.")
    ] = "depth"
    mesh: Annotated[
        Path | None,
        arg(help="Also writes the recording's surfaces as FILE.glb, which view, annotate and studies open."),
    ] = None
    every: Annotated[int, arg(help="Takes every n-th usable frame.")] = 1
    camera_axes: Annotated[
        CameraAxes | None,
        arg(
            help="Camera axes of a folder's poses. opencv, the default: z ahead, y down; opengl: -z ahead, y up; "
            "flu: x ahead, z up."
        ),
    ] = None
    depth_per_metre: Annotated[
        float | None,
        arg(help="Depth units: 1000 = mm, 5000 = TUM; as the recording says, else 1 for floats and 1000 for integers."),
    ] = None
    topics: Annotated[
        tuple[str, ...],
        arg(help="Topics of a ROS bag, where its names are ambiguous: colour=/a depth=/b info=/c odom=/d."),
    ] = ()
    base_to_camera: Annotated[
        str | None,
        arg(help="Where the camera is on the robot, x,y,z,qx,qy,qz,qw (z ahead, y down), if a ROS bag's tf lacks it."),
    ] = None
    mount_height: Annotated[
        float | None, arg(help="Height of the camera above the floor, metres; found from the depth by default.")
    ] = None
    max_depth: Annotated[float, arg(help="Farther returns are not mapped, metres.")] = 5.0
    scene: Annotated[str | None, arg(help="Name of the place; the recording's by default.")] = None
    shard: Annotated[
        str | None,
        arg(
            help="i/N: only encodes the i-th of N parts of the pictures, for job arrays. When all N are done, the same "
            "command without it writes the map."
        ),
    ] = None
    device: ModelDevice = "cpu"
    autocast: ModelAutocast = "off"
    batch: ModelBatch = 8
    json: Json = False

    def run(self) -> int:
        shard = self._require_options()
        recording, counts = read_robot_frames(
            self.frames,
            up=self.up,
            camera_axes=self.camera_axes,
            depth_per_metre=self.depth_per_metre,
            topics=topics_of(self.topics),
            T_base_camera=None if self.base_to_camera is None else T_base_camera_of(self.base_to_camera),
            every=self.every,
            colour=self.encoder != NO_FEATURES or self.mesh is not None,
        )
        floors = _floors(self.frames, recording, self.mount_height)
        eye = load_encoder(self.encoder, ModelOptions(self.device, self.batch, self.autocast))
        resumed = self._resumed(eye, shard)
        up = [round(float(number), 4) + 0.0 for number in recording.up.up]
        frame = f"robot, {up} up in its poses, turned to y up"
        views = ViewOptions(floors=floors, max_depth=self.max_depth, frame=frame, batch=self.batch)
        builder: MapBuilder
        if self.layout == "grid":
            builder = GridMapBuilder(resumed or eye, cell=self.cell, features=self.features, views=views)
        else:
            builder = ObjectMapBuilder(resumed or eye, load_segmenter(self.segmenter, floors), views=views)
        start = time.monotonic()
        memory = _built(builder, recording, counts)
        if resumed and shard.of > 1:
            return self._report_shard(shard, resumed)
        if not memory.num_frames:
            raise PersonalVizError(
                f"{self.frames}: none of {counts.num_found} pictures can be used: {dict(counts.by_reason)}; expected "
                "colour pictures with depth. Copy them again, or convert them to PNG or JPEG."
            )
        per_s = memory.num_frames / max(time.monotonic() - start, 1e-9)
        name = self.scene or (self.frames.stem if self.frames.is_file() else self.frames.resolve().name)
        save_memory(self.out, memory, self._source(name, builder.name, recording))
        document = {
            "up": up,
            "up_confidence": round(recording.up.confidence, 4),
            "floor_y": round(memory.storeys[0].floor_y, 3) + 0.0,  # no -0.0
            "frames": memory.num_frames,
            "frames_per_s": round(per_s, 2),
            "things": _num_things(memory),
            "frames_found": counts.num_found,
            "frames_skipped": dict(counts.by_reason),
            "every": self.every,
            "continued": resumed.num_kept if resumed else 0,
            **_document(memory, counts.warning, self.layout, builder.name, self.out),
        }
        if self.mesh is not None:
            document["mesh"] = self._write_mesh(self.mesh, recording)
        if resumed:
            resumed.remove()
        if self.json:
            print_json(document)
        else:
            _print(document)
        return 0

    def _report_shard(self, shard: Shard, encoded: ResumedEncoder) -> int:
        document = {"shard": str(shard), "encoded": encoded.num_encoded, "continued": encoded.num_kept}
        if self.json:
            print_json(document)
        else:
            print(
                f"Shard {shard}: {encoded.num_encoded} pictures encoded, {encoded.num_kept} were already. When all "
                f"{shard.of} are, give the command without --shard."
            )
        return 0

    def _write_mesh(self, path: Path, recording: RobotFrames) -> dict[str, Any]:
        """Writes the fused surfaces of all frames; returns the file and its number of triangles."""
        from grounding.robot.fused_mesh import fused_mesh
        from sim.copies.glb_writer import glb_from_mesh

        with counted("mesh", len(recording)) as progress:
            mesh = fused_mesh(_counting(recording, progress), max_depth=self.max_depth)
        with writing(path, "--mesh"):
            path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(path, glb_from_mesh(mesh, srgb_colours=True))  # as scanners write them and we read them
        return {"written": str(path), "triangles": len(mesh.faces)}

    def _source(self, name: str, builder: str, recording: RobotFrames) -> MapSource:
        """What the file keeps about its making, so that `ask` finds encoder and pictures again."""
        source = RecordingSource(
            path=str(self.frames.resolve()),
            T_map_recording=matrix_of(recording.T_map_recording),
            camera_axes=self.camera_axes,
            depth_per_metre=self.depth_per_metre,
            topics=topics_of(self.topics),
            T_base_camera=None if self.base_to_camera is None else matrix_of(T_base_camera_of(self.base_to_camera)),
            every=self.every,
        )
        encoder = "" if self.encoder == NO_FEATURES else self.encoder
        return MapSource(scene=name, kind="robot", builder=builder, encoder=encoder, recording=source)

    def _require_options(self) -> Shard:
        """Refuses options that do not fit; returns the shard."""
        require_suffix("--out", self.out, ".npz")
        if self.mesh is not None:
            require_suffix("--mesh", self.mesh, ".glb")
            require_folder(self.mesh.parent, "--mesh")
        for option, value in (
            ("--batch", self.batch),
            ("--every", self.every),
            ("--max-depth", self.max_depth),
            ("--depth-per-metre", self.depth_per_metre),
        ):
            if value is not None and not value > 0:
                raise PersonalVizError(f"{option} is {value}; expected more than 0. Leave it out for the default.")
        if self.encoder == NO_FEATURES and self.layout == "objects":
            raise PersonalVizError(
                "--encoder is 'none' with --layout objects, whose things are told apart by features; expected a model, "
                "or --layout grid. Leave --layout out."
            )
        return shard_from_text(self.shard)

    def _resumed(self, eye: DenseEncoder, shard: Shard) -> ResumedEncoder | None:
        """The encoder that continues an interrupted run; None without features, or without patches to keep."""
        if self.encoder == NO_FEATURES or not hasattr(eye, "encode_patches"):
            if shard.of > 1:
                raise PersonalVizError(
                    f"--shard is {self.shard!r} with --encoder {self.encoder!r}; expected one with encode_patches, "
                    "whose work is kept and can be shared. Leave --shard out."
                )
            return None
        code = "" if is_model(self.encoder) else plugin_digest(self.encoder)
        folder = self.out.with_name(self.out.name + ".encoded")
        return ResumedEncoder(
            eye, folder, settings=f"{self.encoder}\0{self.autocast}\0{self.device}\0{code}", shard=shard
        )


def topics_of(words: tuple[str, ...]) -> dict[str, str]:
    """The topics of a ROS bag by role, from words such as `depth=/camera/depth/image_raw`.

    Raises:
        PersonalVizError: A word has another form, or a role is named twice.
    """
    topics: dict[str, str] = {}
    for word in words:
        role, _, topic = word.partition("=")
        if role not in ROLES or not topic or role in topics:
            raise PersonalVizError(
                f"--topics is {word!r}; expected {', '.join(f'{role}=/topic' for role in ROLES)}, each at most once. "
                "Correct it."
            )
        topics[role] = topic
    return topics


def T_base_camera_of(text: str) -> NDArray[np.float64]:
    """(4, 4) camera on the robot, from `x,y,z,qx,qy,qz,qw`.

    Raises:
        PersonalVizError: It is no pose.
    """
    try:
        numbers = [float(word) for word in text.replace(",", " ").split()]
    except ValueError:
        numbers = []
    pose = pose_of_quat(numbers) if len(numbers) == 7 else "pose not readable"
    if isinstance(pose, str):
        raise PersonalVizError(
            f"--base-to-camera is {text!r} ({pose}); expected x,y,z,qx,qy,qz,qw with a quaternion of length 1. Correct "
            "it, or use the transform that tf2_echo prints for base_link and the camera's optical frame."
        )
    return pose


def load_encoder(name: str, options: ModelOptions) -> DenseEncoder:
    """A real model by family, a user's own as `package.module:factory`, or `none` for geometry alone.

    Raises:
        AgentError: No encoder has this name, or it cannot be built.
    """
    if name == NO_FEATURES:
        require_no_model_options(f"--encoder {name}", replace(options, batch_size=ModelOptions().batch_size))
        return NoFeatures()
    if not is_model(name):
        unbatched = replace(options, batch_size=ModelOptions().batch_size)  # builders use it too
        require_no_model_options(f"--encoder {name}", unbatched)
    return make_image_encoder(name, options=options)


def load_segmenter(name: str, floors: tuple[float, ...]) -> ViewSegmenter:
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


def _counting(recording: RobotFrames, progress: Counted) -> Iterator[Frame]:
    """The frames; each is counted when the next one is asked for."""
    for frame in recording:
        yield frame
        progress.add()


def _built(builder: MapBuilder, recording: RobotFrames, counts: FrameCounts) -> HomeMemory:
    """The map of all usable frames; reports progress, and anything odd about the frames."""
    with counted("frames", len(recording)) as progress:
        for frame in _counting(recording, progress):
            builder.add(frame)
    if counts.warning:
        Console(stderr=True).print(f"Warning: {counts.warning}.", style="yellow", soft_wrap=True)
    return builder.finish()


def _num_things(memory: HomeMemory) -> int | None:
    """The number of things on a map of objects; None on grid maps, which hold none."""
    maps = [storey.memory for storey in memory.storeys]
    counts = [len(item.objects) for item in maps if isinstance(item, ObjectMap)]
    return sum(counts) if counts else None


def _document(memory: HomeMemory, warning: str, layout: str, builder: str, out: Path) -> dict[str, Any]:
    """What `--json` prints about the map itself."""
    first = memory.storeys[0].memory
    return {
        "warning": warning,
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
    space = f"{document['encoder']} ({document['dim']}-d)"
    every = f" (--every {document['every']})" if document["every"] > 1 else ""
    made = "geometry alone" if document["encoder"] == NO_FEATURES else f"{document['builder']}, encoder {space}"
    used = f"{document['frames']} of {document['frames_found']} frames used{every}"
    print(f"{used}, {made}, {document['frames_per_s']:.1f} frames/s")
    for reason, number in document["frames_skipped"].items():
        print(f"  skipped, {reason}: {number}")
    if document["continued"]:
        print(f"  encoded by earlier runs: {document['continued']}")
    x, y, z = document["up"]
    print(f"  up is ({x:g}, {y:g}, {z:g}) in the recording, confidence {document['up_confidence']:g}")
    for storey in document["storeys"]:
        stored = next(f"{storey[name]} {name}" for name in ("objects", "cells") if name in storey)
        print(f"  storey at {storey['floor_y']} m: {stored}, {storey['free_m2']} m2 free")
    print(f"Written to {document['written']}")
    if "mesh" in document:
        mesh = document["mesh"]
        print(f"{mesh['triangles']} triangles written to {mesh['written']}. Next: personal-viz view {mesh['written']}")
