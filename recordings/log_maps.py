"""Log top-down maps: one picture of free space per storey, and the runs' ways on it in the picture's pixels."""

import io
from dataclasses import dataclass

import numpy as np
import rerun as rr
from numpy.typing import NDArray
from PIL import Image

from sim.frames import forward_from_yaw
from sim.tasks.run_files import Answer, EpisodeRun
from sim.types import GridSpec
from sim.walk.navigation_map import NavigationMap
from sim.walk.storeys import storey_of

from . import paths
from .log_run import Trace, dimmed, indexes, set_answered

FREE_RGB, WALL_RGB = (236, 236, 232), (58, 60, 66)
MARGIN = 0.5
"""Metres of map shown around the free space."""
HEADING = 0.6
"""Length of the robot's arrow on the map, metres."""
RAY = 1.5
"""Length of the last piece of a person's ray that the map shows, metres: the eye is often far outside."""
WHOLE, TRAIL, ROBOT, POINT = -0.8, -2.0, -2.5, -5.0
"""Radii on the map; negative = points of the screen, so that they can be seen on maps of any size."""


@dataclass(frozen=True, slots=True)
class StoreyMap:
    """One storey from above, cropped to its free space."""

    index: int
    """Place in the scene's storey heights."""
    floor_y: float
    """Metres."""
    free: NDArray[np.bool_]
    """(rows, cols)."""
    grid: GridSpec

    @property
    def part(self) -> str:
        """Name of the storey's entities."""
        return paths.storey_part(self.index)

    @property
    def entity(self) -> str:
        """Entity of its picture."""
        return f"{paths.TOPDOWN}/{self.part}"

    def pixels(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Places (..., 2) in the picture, column first, of world points (..., 3)."""
        return (points[..., [0, 2]] - np.asarray(self.grid.origin_xz)) / self.grid.cell


def storey_map(navigation: NavigationMap, index: int) -> StoreyMap:
    """The map of one storey of a scene; the whole grid when nothing is free there."""
    floor_y = navigation.storey_heights[index]
    free, grid, _ = navigation.top_down(floor_y)
    return cropped_map(index, floor_y, free, grid, around=free)


def cropped_map(
    index: int, floor_y: float, free: NDArray[np.bool_], grid: GridSpec, *, around: NDArray[np.bool_]
) -> StoreyMap:
    """A storey whose picture ends `MARGIN` behind the cells `around` (rows, cols); the whole grid where none is set."""
    rows, cols = np.flatnonzero(around.any(axis=1)), np.flatnonzero(around.any(axis=0))
    if not len(rows):
        return StoreyMap(index, floor_y, free, grid)
    pad = round(MARGIN / grid.cell)
    top, bottom = max(0, rows[0] - pad), min(grid.shape[0], rows[-1] + 1 + pad)
    left, right = max(0, cols[0] - pad), min(grid.shape[1], cols[-1] + 1 + pad)
    origin = (float(grid.origin_xz[0] + left * grid.cell), float(grid.origin_xz[1] + top * grid.cell))
    cropped = free[top:bottom, left:right]
    return StoreyMap(index, floor_y, cropped, GridSpec(origin, grid.cell, cropped.shape))


def storeys_of(heights: NDArray[np.float64], navigation: NavigationMap) -> NDArray[np.int64]:
    """Index of the storey (N,) that points at each height (N,) belong to."""
    storeys = [(height, height) for height in navigation.storey_heights]
    return np.array([storey_of(float(y), storeys) for y in heights], np.int64)


def log_map_picture(stream: rr.RecordingStream, storey: StoreyMap) -> None:
    """Logs the picture of a storey's free space."""
    rgb = np.where(storey.free[..., None], np.array(FREE_RGB, np.uint8), np.array(WALL_RGB, np.uint8))
    buffer = io.BytesIO()
    Image.fromarray(rgb).save(buffer, "PNG")
    stream.log(storey.entity, rr.EncodedImage(contents=buffer.getvalue(), media_type="image/png"), static=True)


def log_run_on_map(
    stream: rr.RecordingStream, trace: Trace, storey: StoreyMap, *, on_storey: NDArray[np.bool_]
) -> None:
    """Logs a PAN run's way on one storey's map.

    Args:
        stream: The recording.
        trace: A PAN run with T steps.
        storey: The map.
        on_storey: (T + 1,) which poses stand on this storey; the others leave the map empty.
    """
    assert isinstance(trace.run, EpisodeRun)
    spots = storey.pixels(trace.positions)
    pieces = np.stack([spots[:-1], spots[1:]], axis=1)[on_storey[:-1] & on_storey[1:]]  # (S, 2, 2)
    whole = rr.LineStrips2D(list(pieces), colors=[dimmed(trace.rgb)], radii=WHOLE, draw_order=20.0)
    stream.log(paths.run_path(trace.label, "map", storey.part, "path"), whole, static=True)
    robot = paths.run_path(trace.label, "map", storey.part, "robot")
    style = rr.Arrows2D.from_fields(colors=[trace.rgb], radii=[ROBOT], draw_order=40.0)
    stream.log(robot, style, static=True)
    headings = np.array([forward_from_yaw(pose.yaw)[[0, 2]] for pose in trace.run.poses]) * HEADING / storey.grid.cell
    arrows = rr.Arrows2D.columns(vectors=headings[on_storey], origins=spots[on_storey])
    stream.send_columns(robot, indexes(trace.run), arrows.partition(on_storey.astype(int)))
    if not trace.run.steps:
        return
    trail = paths.run_path(trace.label, "map", storey.part, "trail")
    stream.log(trail, rr.LineStrips2D.from_fields(colors=[trace.rgb], radii=[TRAIL], draw_order=30.0), static=True)
    both = on_storey[:-1] & on_storey[1:]
    rows = rr.LineStrips2D.columns(strips=list(pieces)).partition(both.astype(int))
    stream.send_columns(trail, indexes(trace.run, first=1), rows)


def log_answer_on_map(
    stream: rr.RecordingStream, trace: Trace, storey: StoreyMap, *, on_storey: NDArray[np.bool_]
) -> None:
    """Logs those of a POG answer's K points that lie on this storey, and the end of a person's ray to the first.

    Args:
        stream: The recording.
        trace: A POG answer.
        storey: The map.
        on_storey: (K,) which points lie here.
    """
    assert isinstance(trace.run, Answer)
    spots = storey.pixels(trace.positions)
    ranks = [f"{trace.title} {rank + 1}" for rank in np.flatnonzero(on_storey)]
    set_answered(stream, trace.run)
    points = rr.Points2D(spots[on_storey], colors=[trace.rgb], radii=POINT, labels=ranks, draw_order=45.0)
    stream.log(paths.run_path(trace.label, "map", storey.part, "candidates"), points)
    if trace.run.ray is not None and on_storey[:1].any():
        back = storey.pixels(np.array(trace.run.ray.camera_position)) - spots[0]
        shown = back * min(1.0, RAY / storey.grid.cell / max(float(np.linalg.norm(back)), 1e-9))
        arrow = rr.Arrows2D(vectors=[-shown], origins=[spots[0] + shown], colors=[trace.rgb], radii=ROBOT)
        stream.log(paths.run_path(trace.label, "map", storey.part, "click_ray"), arrow)
    stream.reset_time()
