"""Log an episode that is still running, some steps at a time, with the entities that `log_run` gives whole runs."""

from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from sim.frames import forward_from_yaw
from sim.tasks.run_files import Step
from sim.types import Camera, Pose

from . import paths
from .log_maps import HEADING, ROBOT, StoreyMap
from .log_maps import TRAIL as MAP_TRAIL
from .log_maps import WHOLE as MAP_WHOLE
from .log_record import log_record_steps
from .log_run import LIFT, TRAIL, UNDER_TRAIL, WHOLE, Rgb, dimmed, rgba_u32

DEPTH_FACTOR = 4
"""Depth is stored with this many times fewer rows and columns than the picture."""
DEPTH_PER_METRE = 1000.0
DEEPEST = 10.0
"""What is farther gets the last colour, metres; rooms are smaller."""
BLOCKED_RGB: Rgb = (255, 80, 40)
BLOCKED = -3.5
"""Radius of the marks where a wall stopped the robot, points of the screen."""
SEEN_M2 = "seen_m2"
"""Plotted where there is no goal: square metres of free floor seen so far, all storeys together."""
_UP = np.array([0.0, LIFT, 0.0])


@dataclass(frozen=True, slots=True)
class Walker:
    """Whose steps are logged."""

    label: str
    """Names the run's entities, as in `log_run.Trace`."""
    title: str
    rgb: Rgb
    camera: Camera
    is_timed: bool
    """Whether its steps measure seconds, as people's do."""
    is_episode: bool = True
    """Whether it has a goal and a run file: distances are then plotted, and its lines kept for `read_rrd`."""

    def entity(self, *parts: str) -> str:
        """Entity of this run."""
        return paths.run_path(self.label, *parts)


@dataclass(frozen=True, slots=True)
class Row:
    """One moment of a running episode."""

    number: int
    """Actions taken so far, 0 at the start."""
    pose: Pose
    T_world_camera: NDArray[np.float64]
    storey: int
    """Index of the storey the robot stands on."""
    path_m: float
    """Metres walked so far."""
    step: Step | None = None
    """The action that led here; None at the start."""
    before: Pose | None = None
    """Pose at the moment before."""
    storey_before: int | None = None
    jpeg: Future[bytes] | None = None
    """The picture, which may still be encoded."""
    depth_mm: Future[NDArray[np.uint16]] | None = None
    """(H / DEPTH_FACTOR, W / DEPTH_FACTOR) millimetres, 0 = no return; follows the picture."""


def log_styles(stream: rr.RecordingStream, walker: Walker, *, with_depth: bool) -> None:
    """Logs what does not change while the episode runs: the camera's shape, colours, widths."""
    camera, rgb = walker.camera, walker.rgb
    _log_pinhole(stream, walker.entity("camera"), camera.focal, (camera.width, camera.height), color=rgb)
    if with_depth:
        size = (camera.width // DEPTH_FACTOR, camera.height // DEPTH_FACTOR)
        _log_pinhole(stream, walker.entity("depth"), camera.focal / DEPTH_FACTOR, size, color=None)
        look = rr.DepthImage.from_fields(meter=DEPTH_PER_METRE, depth_range=[0.0, DEEPEST * DEPTH_PER_METRE])
        stream.log(walker.entity("depth"), look, static=True)
    stream.log(walker.entity("trail"), rr.LineStrips3D.from_fields(colors=[rgb], radii=[TRAIL]), static=True)
    marks = rr.Points3D.from_fields(colors=[BLOCKED_RGB], radii=[BLOCKED])
    stream.log(walker.entity("collisions"), marks, static=True)
    lighter = tuple(255 - (255 - part) // 2 for part in rgb)
    plotted = [("centre_distance", "to its centre", rgb), ("goal_distance", "to walk", lighter)]
    for name, words, color in plotted if walker.is_episode else [(SEEN_M2, "free floor seen", rgb)]:
        style = rr.SeriesLines(names=words, colors=[color], widths=2.0)
        stream.log(walker.entity(name), style, static=True)


def log_map_styles(stream: rr.RecordingStream, walker: Walker, storey: StoreyMap) -> None:
    """The same for one storey's map."""
    robot = rr.Arrows2D.from_fields(colors=[walker.rgb], radii=[ROBOT], draw_order=40.0)
    stream.log(walker.entity("map", storey.part, "robot"), robot, static=True)
    trail = rr.LineStrips2D.from_fields(colors=[walker.rgb], radii=[MAP_TRAIL], draw_order=30.0)
    stream.log(walker.entity("map", storey.part, "trail"), trail, static=True)
    marks = rr.Points2D.from_fields(colors=[BLOCKED_RGB], radii=[BLOCKED], draw_order=35.0)
    stream.log(walker.entity("map", storey.part, "collisions"), marks, static=True)


def log_rows(stream: rr.RecordingStream, walker: Walker, rows: Sequence[Row], maps: Sequence[StoreyMap]) -> None:
    """Logs rows (at least one) at their places on all timelines: columns, since a call of Rerun's per row is slow."""
    _log_views(stream, walker, rows)
    for storey in maps:
        _log_on_map(stream, walker, rows, storey)
    taken = [row for row in rows if row.step is not None]
    if not taken:
        return
    times = indexes_of(walker, taken)
    stream.send_columns(
        walker.entity("trail"), times, rr.LineStrips3D.columns(strips=(_pieces(taken) + _UP).astype(np.float32))
    )
    texts = [action_text(walker, row) for row in taken]
    colors = np.full(len(texts), rgba_u32(walker.rgb), np.uint32)
    columns = rr.TextLog.columns(text=texts, level=["INFO"] * len(texts), color=colors)
    stream.send_columns(walker.entity("actions"), times, columns)
    if walker.is_episode:
        log_record_steps(stream, walker.label, [row.step for row in taken if row.step is not None], times=times)
    blocked = [row for row in taken if row.step is not None and row.step.collided]
    if blocked:
        spots = np.array([row.pose.position for row in blocked]) + _UP
        columns = rr.Points3D.columns(positions=spots)
        stream.send_columns(walker.entity("collisions"), indexes_of(walker, blocked), columns)


def log_figures(
    stream: rr.RecordingStream, walker: Walker, rows: Sequence[Row], name: str, values: NDArray[np.float64]
) -> None:
    """Logs one figure per row to plot; what is not finite leaves a gap."""
    columns = rr.Scalars.columns(scalars=np.where(np.isfinite(values), values, np.nan))
    stream.send_columns(walker.entity(name), indexes_of(walker, rows), columns)


def log_whole_way(
    stream: rr.RecordingStream,
    walker: Walker,
    poses: Sequence[Pose],
    floors: NDArray[np.int64],
    maps: Sequence[StoreyMap],
) -> None:
    """Logs the finished way (T + 1 poses, their storeys' indices) as faint lines that are shown at all times."""
    positions = np.array([pose.position for pose in poses])
    lifted = positions + _UP - UNDER_TRAIL
    whole = rr.LineStrips3D([lifted], colors=[dimmed(walker.rgb)], radii=WHOLE)
    stream.log(walker.entity("path"), whole, static=True)
    for storey in maps:
        spots, here = storey.pixels(positions), floors == storey.index
        pieces = np.stack([spots[:-1], spots[1:]], axis=1)[here[:-1] & here[1:]]
        lines = rr.LineStrips2D(
            pieces.astype(np.float32), colors=[dimmed(walker.rgb)], radii=MAP_WHOLE, draw_order=20.0
        )
        stream.log(walker.entity("map", storey.part, "path"), lines, static=True)


def indexes_of(walker: Walker, rows: Sequence[Row]) -> list[rr.TimeColumn]:
    """The rows' places on the timelines, as `log_run.indexes` gives those of a whole run."""
    columns = [
        rr.TimeColumn(paths.STEP, sequence=np.array([row.number for row in rows])),
        rr.TimeColumn(paths.PATH_M, duration=np.array([row.path_m for row in rows])),
    ]
    if walker.is_timed:
        columns.append(rr.TimeColumn(paths.TIME_S, duration=np.array([_t_s(row) for row in rows])))
    return columns


def set_moment(stream: rr.RecordingStream, walker: Walker, row: Row) -> None:
    """What is logged next appears at this row of all timelines."""
    stream.reset_time()
    stream.set_time(paths.STEP, sequence=row.number)
    stream.set_time(paths.PATH_M, duration=row.path_m)
    if walker.is_timed:
        stream.set_time(paths.TIME_S, duration=_t_s(row))


def action_text(walker: Walker, row: Row) -> str:
    """One line of the action log, as `log_run` writes it."""
    assert row.step is not None
    return f"{walker.title}: {row.step.action.value}{' (blocked)' if row.step.collided else ''}"


def _log_pinhole(
    stream: rr.RecordingStream, entity: str, focal: float, size: tuple[int, int], *, color: Rgb | None
) -> None:
    pinhole = rr.Pinhole(
        focal_length=focal,
        width=size[0],
        height=size[1],
        camera_xyz=rr.ViewCoordinates.RDF,
        image_plane_distance=0.5,
        color=color,
    )
    stream.log(entity, pinhole, static=True)


def _log_views(stream: rr.RecordingStream, walker: Walker, rows: Sequence[Row]) -> None:
    """Where the camera is, and what it sees."""
    times = indexes_of(walker, rows)
    Ts = np.array([row.T_world_camera for row in rows])
    columns = list(rr.Transform3D.columns(translation=Ts[:, :3, 3], mat3x3=Ts[:, :3, :3]))
    jpegs = [row.jpeg.result() for row in rows if row.jpeg is not None]
    pictures = []
    if len(jpegs) == len(rows):
        pictures = list(rr.EncodedImage.columns(blob=jpegs, media_type=["image/jpeg"] * len(jpegs)))
    stream.send_columns(walker.entity("camera"), times, [*columns, *pictures])
    depths = [row.depth_mm.result() for row in rows if row.depth_mm is not None]
    if len(depths) == len(rows):
        height, width = depths[0].shape
        layout = rr.encodings.ImageFormat(width=width, height=height, channel_datatype=rr.ChannelDatatype.U16)
        more = rr.DepthImage.columns(
            buffer=[depth.tobytes() for depth in depths],
            format=[layout] * len(depths),
        )
        stream.send_columns(walker.entity("depth"), times, [*columns, *more])


def _log_on_map(stream: rr.RecordingStream, walker: Walker, rows: Sequence[Row], storey: StoreyMap) -> None:
    """Where the robot is on one storey's map; rows on other storeys empty it."""
    here = [row for row in rows if row.storey == storey.index]
    spots = storey.pixels(np.array([row.pose.position for row in here]).reshape(-1, 3))
    headings = np.array([forward_from_yaw(row.pose.yaw)[[0, 2]] for row in here]).reshape(-1, 2)
    arrows = rr.Arrows2D.columns(vectors=headings * HEADING / storey.grid.cell, origins=spots)
    counts = [int(row.storey == storey.index) for row in rows]
    stream.send_columns(walker.entity("map", storey.part, "robot"), indexes_of(walker, rows), arrows.partition(counts))
    walked = [row for row in here if row.storey_before == storey.index]
    if walked:
        columns = rr.LineStrips2D.columns(strips=storey.pixels(_pieces(walked)).astype(np.float32))
        stream.send_columns(walker.entity("map", storey.part, "trail"), indexes_of(walker, walked), columns)
    blocked = [row for row in here if row.step is not None and row.step.collided]
    if blocked:
        columns = rr.Points2D.columns(positions=storey.pixels(np.array([row.pose.position for row in blocked])))
        stream.send_columns(walker.entity("map", storey.part, "collisions"), indexes_of(walker, blocked), columns)


def _pieces(rows: Sequence[Row]) -> NDArray[np.float64]:
    """(N, 2, 3) world points of the way to each row; none is a start. An array, not a list: Rerun is faster then."""
    return np.array([(row.before.position, row.pose.position) for row in rows if row.before is not None])


def _t_s(row: Row) -> float:
    return row.step.t_s if row.step is not None else 0.0
