"""Logs an episode: a running one a few steps at a time, a finished one all at once.

A walk is a `Walker` and its rows, one per moment. The viewer's entities are the same in both cases. The points of a POG
answer are logged here too.
"""

import math
from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from sim.frames import T_world_camera, forward_from_yaw
from sim.plan_view.storey import StoreyMap, storeys_of
from sim.tasks.run_files import Answer, Step
from sim.types import Camera, Pose
from sim.walk.navigation_map import NavigationMap

from . import paths
from .read import log_record_steps
from .scene import LIFT, MAP_TRAIL, MAP_WHOLE, POINT, ROBOT
from .traces import Rgb, Trace, dimmed, rgba_u32, times

UNDER_TRAIL = np.array([0.0, 0.04, 0.0])
"""The line of the whole way lies this much lower than the trail (metres), so that the trail covers it."""
WHOLE, TRAIL, FRAME = -0.7, -2.0, -3.0
"""Radii of paths and of a picture's frame; negative = points of the screen, visible in homes of any size."""
HEADING = 0.6
"""Length of the robot's arrow on the map, metres."""
RAY = 1.5
"""Length of the last piece of a person's ray that the map shows, metres: the eye is often far outside."""
ANSWER_STEP = 1
"""Step at which a POG answer appears."""
DEPTH_FACTOR = 4
"""Depth is stored for every n-th row and column of the picture, n being this number."""
DEPTH_PER_METRE = 1000.0
DEEPEST = 10.0
"""Depth from which everything gets the last colour, metres; rooms are smaller."""
BLOCKED_RGB: Rgb = (255, 80, 40)
BLOCKED = -3.5
"""Radius of the marks where a wall stopped the robot, points of the screen."""
FOUND_MARKS, OUTCOMES = "found_marks", "outcomes"
"""Entities below a run of a home sequence: its marks at each FOUND, and a line of the log at each search's end."""
CENTRE_DISTANCE, GOAL_DISTANCE = "centre_distance", "goal_distance"
"""Plotted below a run: metres to the nearest target's centre, and the walk to the nearest place where STOP succeeds."""
SEEN_M2 = "seen_m2"
"""Plotted if there is no goal: square metres of free floor seen so far, all storeys together."""
_UP = np.array([0.0, LIFT, 0.0])


@dataclass(frozen=True, slots=True)
class Walker:
    """The person or agent whose steps are logged."""

    label: str
    """Names the run's entities, as in `Trace`."""
    title: str
    rgb: Rgb
    camera: Camera
    is_timed: bool
    """Whether its steps measure seconds, as people's do."""
    is_episode: bool = True
    """Whether it has a goal and a run file, whose lines are logged for `read_rrd`."""
    marks_collisions: bool = True
    """Whether marks show where a wall stopped it; beside other runs they would hide too much."""
    search_rgbs: tuple[Rgb, ...] = ()
    """Colours of the ways of a home sequence's searches; () in episodes, whose way has the run's colour."""

    @property
    def trails(self) -> list[tuple[str, Rgb]]:
        """Name below the run, and colour, of each way that grows with the time cursor."""
        found = [(trail_name(search), rgb) for search, rgb in enumerate(self.search_rgbs)]
        return found or [(trail_name(None), self.rgb)]

    def entity(self, *parts: str) -> str:
        """Entity of this run."""
        return paths.run_path(self.label, *parts)


@dataclass(frozen=True, slots=True)
class Row:
    """One moment of an episode."""

    number: int
    """Actions taken so far, 0 at the start."""
    pose: Pose
    storey: int
    """Index of the storey the robot stands on."""
    path_m: float
    """Metres walked so far."""
    step: Step | None = None
    """The action that led here; None at the start."""
    before: Pose | None = None
    """Pose at the moment before."""
    storey_before: int | None = None
    search: int | None = None
    """The search of a home sequence to which it belongs; None in episodes."""
    together: int | None = None
    """Its place on the timeline on which all runs begin a search at once; None in episodes."""
    ending: str = ""
    """Why the episode ended here, if that is known and it did not end with STOP."""
    jpeg: Future[bytes] | None = None
    """The picture, perhaps still being encoded; None if pictures are logged apart (`log_pictures`), or not at all."""
    depth_mm: Future[NDArray[np.uint16]] | None = None
    """(H / DEPTH_FACTOR, W / DEPTH_FACTOR) millimetres, 0 = no return; encoded like the picture."""


@dataclass(frozen=True, slots=True)
class Walk:
    """A finished PAN run with T steps."""

    trace: Trace
    walker: Walker
    rows: tuple[Row, ...]
    """(T + 1,) the start and each step."""


def trail_name(search: int | None) -> str:
    """Name, below a run or its map, of the way of a search; None = of an episode."""
    return "trail" if search is None else f"trail/search_{search + 1}"


def next_row(
    before: Row | None,
    pose: Pose,
    storey: int,
    step: Step | None,
    *,
    ending: str = "",
    jpeg: Future[bytes] | None = None,
    depth_mm: Future[NDArray[np.uint16]] | None = None,
) -> Row:
    """The moment after `before`, which is None at the start; the arguments are fields of `Row`."""
    row = Row(0, pose, storey, 0.0, step, ending=ending, jpeg=jpeg, depth_mm=depth_mm)
    if before is None:
        return row
    walked = before.path_m + math.dist(pose.position, before.pose.position)
    return replace(row, number=before.number + 1, path_m=walked, before=before.pose, storey_before=before.storey)


def finished_walk(trace: Trace, camera: Camera, navigation: NavigationMap) -> Walk:
    """A PAN run as a walker and its rows; the camera has the size in which the run's pictures are shown."""
    run = trace.run
    assert not isinstance(run, Answer)
    is_timed = times(run) is not None
    walker = Walker(trace.label, trace.title, trace.rgb, camera, is_timed, marks_collisions=False)
    rows: list[Row] = []
    floors = storeys_of(trace.positions[:, 1], navigation).tolist()
    for pose, storey, step in zip(run.poses, floors, (None, *run.steps), strict=True):
        is_last = step is not None and len(rows) == len(run.steps)
        ending = run.end.reason if is_last and run.end.reason != "stop" else ""
        rows.append(next_row(rows[-1] if rows else None, pose, storey, step, ending=ending))
    return Walk(trace, walker, tuple(rows))


def log_styles(stream: rr.RecordingStream, walker: Walker, *, with_depth: bool) -> None:
    """Logs the parts that do not change during the episode: the camera's shape, colours, widths."""
    camera, rgb = walker.camera, walker.rgb
    _log_pinhole(stream, walker.entity("camera"), camera.focal, (camera.width, camera.height), color=rgb)
    if with_depth:
        size = (camera.width // DEPTH_FACTOR, camera.height // DEPTH_FACTOR)
        _log_pinhole(stream, walker.entity("depth"), camera.focal / DEPTH_FACTOR, size, color=None)
        look = rr.DepthImage.from_fields(meter=DEPTH_PER_METRE, depth_range=[0.0, DEEPEST * DEPTH_PER_METRE])
        stream.log(walker.entity("depth"), look, static=True)
    for name, trail_rgb in walker.trails:
        look = rr.LineStrips3D.from_fields(colors=[trail_rgb], radii=[TRAIL])
        stream.log(walker.entity(name), look, static=True)
    if walker.marks_collisions:
        marks = rr.Points3D.from_fields(colors=[BLOCKED_RGB], radii=[BLOCKED])
        stream.log(walker.entity("collisions"), marks, static=True)


def log_map_styles(stream: rr.RecordingStream, walker: Walker, storey: StoreyMap) -> None:
    """Logs the colours and widths for one storey's map."""
    robot = rr.Arrows2D.from_fields(colors=[walker.rgb], radii=[ROBOT], draw_order=40.0)
    stream.log(walker.entity("map", storey.name, "robot"), robot, static=True)
    for name, trail_rgb in walker.trails:
        trail = rr.LineStrips2D.from_fields(colors=[trail_rgb], radii=[MAP_TRAIL], draw_order=30.0)
        stream.log(walker.entity("map", storey.name, name), trail, static=True)
    if walker.marks_collisions:
        marks = rr.Points2D.from_fields(colors=[BLOCKED_RGB], radii=[BLOCKED], draw_order=35.0)
        stream.log(walker.entity("map", storey.name, "collisions"), marks, static=True)


def log_plot_style(stream: rr.RecordingStream, walker: Walker, name: str, *, words: str, rgb: Rgb) -> None:
    """Logs the name, colour and line of a figure of `log_figures`."""
    stream.log(walker.entity(name), rr.SeriesLines(names=words, colors=[rgb], widths=2.0), static=True)


def log_rows(stream: rr.RecordingStream, walker: Walker, rows: Sequence[Row], maps: Sequence[StoreyMap]) -> None:
    """Logs rows (at least one) at their places on all timelines, as columns, since one Rerun call per row is slow."""
    _log_views(stream, walker, rows)
    for storey in maps:
        _log_on_map(stream, walker, rows, storey)
    taken = [row for row in rows if row.step is not None]
    if not taken:
        return
    for name, part in _by_trail(taken):
        columns = rr.LineStrips3D.columns(strips=_float32(_pieces(part) + _UP))
        stream.send_columns(walker.entity(name), indexes_of(walker, part), columns)
    at = indexes_of(walker, taken)
    texts = [_action_text(walker, row) for row in taken]
    colors = np.full(len(texts), rgba_u32(walker.rgb), np.uint32)
    columns = rr.TextLog.columns(text=texts, level=["INFO"] * len(texts), color=colors)
    stream.send_columns(walker.entity("actions"), at, columns)
    if walker.is_episode:
        log_record_steps(stream, walker.label, [row.step for row in taken if row.step is not None], times=at)
    if walker.marks_collisions and (blocked := _blocked(taken)):
        columns = rr.Points3D.columns(positions=_feet(blocked) + _UP)
        stream.send_columns(walker.entity("collisions"), indexes_of(walker, blocked), columns)


def log_figures(
    stream: rr.RecordingStream, walker: Walker, rows: Sequence[Row], name: str, values: NDArray[np.float64]
) -> None:
    """Logs one figure per row to plot; values that are not finite leave a gap."""
    columns = rr.Scalars.columns(scalars=np.where(np.isfinite(values), values, np.nan))
    stream.send_columns(walker.entity(name), indexes_of(walker, rows), columns)


def log_pictures(stream: rr.RecordingStream, walker: Walker, rows: Sequence[Row], jpegs: Sequence[bytes]) -> None:
    """Logs the robot's pictures at these rows, apart from the rows themselves."""
    columns = rr.EncodedImage.columns(blob=jpegs, media_type=["image/jpeg"] * len(jpegs))
    stream.send_columns(walker.entity("camera"), indexes_of(walker, rows), columns)


def log_whole_way(
    stream: rr.RecordingStream,
    walker: Walker,
    positions: NDArray[np.float64],
    floors: NDArray[np.int64],
    maps: Sequence[StoreyMap],
) -> None:
    """Logs the finished way, feet (T + 1, 3) and their storeys (T + 1,), as faint lines shown at all times."""
    lifted = positions + _UP - UNDER_TRAIL
    whole = rr.LineStrips3D([lifted], colors=[dimmed(walker.rgb)], radii=WHOLE)
    stream.log(walker.entity("path"), whole, static=True)
    for storey in maps:
        spots, here = storey.pixels(positions), floors == storey.index
        pieces = np.stack([spots[:-1], spots[1:]], axis=1)[here[:-1] & here[1:]]
        lines = rr.LineStrips2D(_float32(pieces), colors=[dimmed(walker.rgb)], radii=MAP_WHOLE, draw_order=20.0)
        stream.log(walker.entity("map", storey.name, "path"), lines, static=True)


def log_walk(stream: rr.RecordingStream, walk: Walk, maps: Sequence[StoreyMap]) -> None:
    """Logs a finished walk without its pictures."""
    walker, rows = walk.walker, walk.rows
    log_styles(stream, walker, with_depth=False)
    for storey in maps:
        log_map_styles(stream, walker, storey)
    log_rows(stream, walker, rows, maps)
    log_whole_way(stream, walker, _feet(rows), np.array([row.storey for row in rows]), maps)


def log_picture_note(stream: rr.RecordingStream, walker: Walker, name: str, text: str) -> None:
    """Logs a frame around the camera's picture with a text in it, at the stream's present time."""
    size = np.array([[walker.camera.width, walker.camera.height]], float)
    note = rr.Boxes2D(centers=size / 2, sizes=size, colors=[walker.rgb], radii=FRAME, labels=[text], draw_order=50.0)
    stream.log(walker.entity("camera", name), note)


def indexes_of(walker: Walker, rows: Sequence[Row]) -> list[rr.TimeColumn]:
    """The rows' places on the timelines."""
    columns = [
        rr.TimeColumn(paths.STEP, sequence=np.array([row.number for row in rows])),
        rr.TimeColumn(paths.PATH_M, duration=np.array([row.path_m for row in rows])),
    ]
    together = [row.together for row in rows if row.together is not None]
    if together:
        columns.append(rr.TimeColumn(paths.TOGETHER, sequence=np.array(together)))
    if walker.is_timed:
        columns.append(rr.TimeColumn(paths.TIME_S, duration=np.array([_t_s(row) for row in rows])))
    return columns


def set_moment(stream: rr.RecordingStream, walker: Walker, row: Row) -> None:
    """Sets all timelines to this row, for everything logged next."""
    stream.reset_time()
    stream.set_time(paths.STEP, sequence=row.number)
    stream.set_time(paths.PATH_M, duration=row.path_m)
    if row.together is not None:
        stream.set_time(paths.TOGETHER, sequence=row.together)
    if walker.is_timed:
        stream.set_time(paths.TIME_S, duration=_t_s(row))


def set_answered(stream: rr.RecordingStream, answer: Answer) -> None:
    """Sets the timelines to the moment of a POG answer."""
    stream.reset_time()
    stream.set_time(paths.STEP, sequence=ANSWER_STEP)
    if answer.t_s is not None:
        stream.set_time(paths.TIME_S, duration=answer.t_s)


def log_answer(stream: rr.RecordingStream, trace: Trace, maps: Sequence[StoreyMap], navigation: NavigationMap) -> None:
    """Logs a POG answer below `/runs/<label>`: its K ranked points, in the home and on the maps of their storeys.

    A person's answer also shows how they pointed at the first point; the map shows the end of that ray.
    """
    answer, points = trace.run, trace.positions
    assert isinstance(answer, Answer)
    set_answered(stream, answer)
    log_points(stream, trace, points, maps, navigation)
    if len(points) and answer.ray is not None:
        ray = rr.LineStrips3D([[answer.ray.camera_position, points[0]]], colors=[trace.rgb], radii=0.015)
        stream.log(paths.run_path(trace.label, "click_ray"), ray)
    text = f"{answer.reason}: {len(points)} points" if len(points) else f"{answer.reason}: no answer"
    stream.log(paths.run_path(trace.label, "actions"), rr.TextLog(f"{trace.title}: {text}", color=trace.rgb))
    floors = storeys_of(points[:, 1], navigation)
    for storey in maps:
        here, spots = floors == storey.index, storey.pixels(points)
        if answer.ray is not None and here[:1].any():
            back = storey.pixels(np.array(answer.ray.camera_position)) - spots[0]
            shown = back * min(1.0, RAY / storey.grid.cell / max(float(np.linalg.norm(back)), 1e-9))
            arrow = rr.Arrows2D(vectors=[-shown], origins=[spots[0] + shown], colors=[trace.rgb], radii=ROBOT)
            stream.log(paths.run_path(trace.label, "map", storey.name, "click_ray"), arrow)
    stream.reset_time()


def log_points(
    stream: rr.RecordingStream,
    trace: Trace,
    points: NDArray[np.float64],
    maps: Sequence[StoreyMap],
    navigation: NavigationMap,
    *,
    first: str = "",
) -> None:
    """Logs the ranked points (K, 3) of a POG answer at the stream's present time; the label of the first ends with
    `first`.
    """
    ranks = [f"{trace.title} {rank}{first if rank == 1 else ''}" for rank in range(1, len(points) + 1)]
    if len(points):
        spheres = rr.Points3D(points, colors=[trace.rgb], radii=0.08, labels=ranks)
        stream.log(paths.run_path(trace.label, "candidates"), spheres)
    floors = storeys_of(points[:, 1], navigation)
    for storey in maps:
        here, spots = floors == storey.index, storey.pixels(points)
        labels = [rank for rank, is_here in zip(ranks, here, strict=True) if is_here]
        flat = rr.Points2D(spots[here], colors=[trace.rgb], radii=POINT, labels=labels, draw_order=45.0)
        stream.log(paths.run_path(trace.label, "map", storey.name, "candidates"), flat)


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
    """Logs where the camera is and what it sees."""
    at = indexes_of(walker, rows)
    Ts = np.array([T_world_camera(row.pose, walker.camera) for row in rows])
    columns = list(rr.Transform3D.columns(translation=Ts[:, :3, 3], mat3x3=Ts[:, :3, :3]))
    jpegs = [row.jpeg.result() for row in rows if row.jpeg is not None]
    pictures = []
    if len(jpegs) == len(rows):
        pictures = list(rr.EncodedImage.columns(blob=jpegs, media_type=["image/jpeg"] * len(jpegs)))
    stream.send_columns(walker.entity("camera"), at, [*columns, *pictures])
    depths = [row.depth_mm.result() for row in rows if row.depth_mm is not None]
    if len(depths) == len(rows):
        height, width = depths[0].shape
        layout = rr.encodings.ImageFormat(width=width, height=height, channel_datatype=rr.ChannelDatatype.U16)
        more = rr.DepthImage.columns(buffer=[depth.tobytes() for depth in depths], format=[layout] * len(depths))
        stream.send_columns(walker.entity("depth"), at, [*columns, *more])


def _log_on_map(stream: rr.RecordingStream, walker: Walker, rows: Sequence[Row], storey: StoreyMap) -> None:
    """Logs where the robot is on one storey's map; rows on other storeys remove it from there."""
    here = [row for row in rows if row.storey == storey.index]
    headings = np.array([forward_from_yaw(row.pose.yaw)[[0, 2]] for row in here]).reshape(-1, 2)
    arrows = rr.Arrows2D.columns(vectors=headings * HEADING / storey.grid.cell, origins=storey.pixels(_feet(here)))
    counts = [int(row.storey == storey.index) for row in rows]
    stream.send_columns(walker.entity("map", storey.name, "robot"), indexes_of(walker, rows), arrows.partition(counts))
    taken = [row for row in rows if row.step is not None]
    for name, part in _by_trail(taken):
        walked = [row.storey == row.storey_before == storey.index for row in part]
        strips = _float32(storey.pixels(_pieces([row for row, is_here in zip(part, walked, strict=True) if is_here])))
        columns = rr.LineStrips2D.columns(strips=strips).partition([int(is_here) for is_here in walked])
        stream.send_columns(walker.entity("map", storey.name, name), indexes_of(walker, part), columns)
    if walker.marks_collisions and (blocked := _blocked(here)):
        columns = rr.Points2D.columns(positions=storey.pixels(_feet(blocked)))
        stream.send_columns(walker.entity("map", storey.name, "collisions"), indexes_of(walker, blocked), columns)


def _by_trail(rows: Sequence[Row]) -> list[tuple[str, list[Row]]]:
    """The rows of each way, with its name."""
    return [(trail_name(search), list(part)) for search, part in groupby(rows, key=lambda row: row.search)]


def _action_text(walker: Walker, row: Row) -> str:
    """One line of the action log."""
    assert row.step is not None
    blocked = " (blocked)" if row.step.collided else ""
    return f"{walker.title}: {row.step.action.value}{blocked}{f' - ended: {row.ending}' if row.ending else ''}"


def _blocked(rows: Sequence[Row]) -> list[Row]:
    return [row for row in rows if row.step is not None and row.step.collided]


def _feet(rows: Sequence[Row]) -> NDArray[np.float64]:
    """(N, 3) world points."""
    return np.array([row.pose.position for row in rows], float).reshape(-1, 3)


def _pieces(rows: Sequence[Row]) -> NDArray[np.float64]:
    """(N, 2, 3) world points of the way to each row; no row may be a start."""
    return np.array([(row.before.position, row.pose.position) for row in rows if row.before], float).reshape(-1, 2, 3)


def _float32(values: NDArray[np.float64]) -> NDArray[np.float32]:
    """The values as Rerun stores them: arrays are sent faster than lists."""
    return values.astype(np.float32)


def _t_s(row: Row) -> float:
    return row.step.t_s if row.step is not None else 0.0
