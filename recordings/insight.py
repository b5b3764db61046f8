"""Logs an agent's knowledge and plan (`sim.tasks.observers.Insight`) at the stream's present time: pictures and points.

It only converts frames: an insight is in the agent's start frame, the recording in the world and in map pixels.
"""

from dataclasses import dataclass

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from sim.errors import AgentError
from sim.plan_view.storey import StoreyMap
from sim.tasks.observers import UNKNOWN, Detection, Insight

from . import paths
from .episode import Walker
from .maps import Resampler, occupancy_png, similarity_png
from .scene import LIFT, POINT
from .traces import Rgb

FRONTIER_RGB: Rgb = (90, 200, 255)
CANDIDATE_RGB: Rgb = (255, 190, 60)
CHOSEN_RGB: Rgb = (255, 90, 200)
DETECTION_RGB: Rgb = (120, 255, 120)
FRONTIER, CHOSEN = -3.5, -6.0
"""Radii; negative = points of the screen."""
OCCUPANCY, SIMILARITY = "occupancy", "similarity"
BOXES = "detections"
_POINTS: dict[str, tuple[Rgb, float]] = {
    "frontiers": (FRONTIER_RGB, FRONTIER),
    "candidates": (CANDIDATE_RGB, POINT),
    "chosen": (CHOSEN_RGB, CHOSEN),
    "found": (DETECTION_RGB, POINT),
}
"""Colour and radius of the points shown in the home and on the map, by name of their entity."""


@dataclass(frozen=True, slots=True)
class Place:
    """Where an agent is when it explains itself."""

    T_world_start: NDArray[np.float64]
    """(4, 4) takes its insight's points into the world."""
    floor_y: float
    """Height of its feet, metres: frontiers have no height."""
    storey: StoreyMap
    """The map it stands on."""
    resampler: Resampler
    """Carries grids of this episode onto this map."""


@dataclass(frozen=True, slots=True)
class Marks:
    """Points of one kind with their labels."""

    points: NDArray[np.float64]
    """(N, 3) world metres."""
    labels: list[str]
    """(N,), or empty = no text."""


def require_fits(insight: Insight) -> None:
    """Refuses an insight whose parts do not fit together.

    Raises:
        AgentError: Grids without a place or of another shape, points that are not (N, 2) or (N, 3), or too few scores.
    """
    problem = _problem(insight)
    if problem:
        raise AgentError(f"insight(): {problem} (sim.tasks.observers.Insight). Correct the agent.")


def log_insight_styles(stream: rr.RecordingStream, label: str, storey: StoreyMap) -> None:
    """Logs the colours and widths that `log_insight` uses, for one map."""
    for name, (rgb, radius) in _POINTS.items():
        in_home = rr.Points3D.from_fields(colors=[rgb], radii=[radius])
        stream.log(paths.run_path(label, name), in_home, static=True)
        on_map = rr.Points2D.from_fields(colors=[rgb], radii=[radius], draw_order=45.0)
        stream.log(paths.run_path(label, "map", storey.name, name), on_map, static=True)


def log_insight(
    stream: rr.RecordingStream, walker: Walker, insight: Insight, place: Place, *, shown: frozenset[str]
) -> frozenset[str]:
    """Logs the points, boxes and words of an insight whose parts fit together (`require_fits`).

    Returns the names of the parts that are not empty; the next call gets them as `shown`, so that parts which are empty
    by then are removed from view.
    """
    marks = marks_of(insight, place)
    present = {name for name, some in marks.items() if len(some.points)} | ({BOXES} if insight.detections else set())
    for name in marks.keys() & (present | shown):
        some = marks[name]
        in_home = rr.Points3D(some.points + np.array([0.0, LIFT, 0.0]), labels=some.labels)
        stream.log(walker.entity(name), in_home)
        on_map = rr.Points2D(place.storey.pixels(some.points), labels=some.labels)
        stream.log(walker.entity("map", place.storey.name, name), on_map)
    if BOXES in present | shown:
        log_boxes(stream, walker.label, insight.detections)
    if insight.note:
        stream.log(walker.entity("note"), rr.TextLog(f"because: {insight.note}", color=CHOSEN_RGB))
    return frozenset(present)


def log_boxes(stream: rr.RecordingStream, label: str, detections: tuple[Detection, ...]) -> None:
    """Logs the detections' boxes on the camera's picture."""
    boxes = np.array([found.box for found in detections], float).reshape(-1, 4)
    labels = [_scored(found.label, found.score) for found in detections]
    shown = rr.Boxes2D(
        array=boxes, array_format=rr.Box2DFormat.XYXY, labels=labels, colors=[DETECTION_RGB] * len(labels)
    )
    stream.log(paths.run_path(label, "camera", BOXES), shown)


def log_insight_maps(stream: rr.RecordingStream, label: str, insight: Insight, place: Place) -> None:
    """Logs the grids as pictures on the storey's map."""
    if insight.grid is None:
        return
    on_map = place.resampler.resampled
    pictures: list[tuple[str, bytes, float]] = []
    if insight.occupancy is not None:
        picture = occupancy_png(on_map(insight.occupancy, insight.grid, outside=UNKNOWN))
        pictures.append((OCCUPANCY, picture, 5.0))
    if insight.similarity is not None:
        picture = similarity_png(on_map(insight.similarity, insight.grid, outside=np.nan))
        pictures.append((SIMILARITY, picture, 6.0))
    for name, png, order in pictures:
        shown = rr.EncodedImage(contents=png, media_type="image/png", draw_order=order)
        stream.log(paths.run_path(label, "map", place.storey.name, name), shown)


def marks_of(insight: Insight, place: Place) -> dict[str, Marks]:
    """The insight's points in the world, by entity name."""
    frontiers = np.empty((0, 3)) if insight.frontiers is None else _on_floor(insight.frontiers, place)
    candidates = np.empty((0, 3)) if insight.candidates is None else _in_world(insight.candidates, place)
    ranks = [str(rank + 1) for rank in range(len(candidates))]
    if insight.candidate_scores:
        ranks = [_scored(rank, score) for rank, score in zip(ranks, insight.candidate_scores, strict=True)]
    placed = [(found, found.position) for found in insight.detections if found.position is not None]
    return {
        "frontiers": Marks(frontiers, []),
        "candidates": Marks(candidates, ranks),
        "chosen": Marks(_in_world(np.array([] if insight.goal is None else [insight.goal]), place), []),
        "found": Marks(
            _in_world(np.array([position for _, position in placed]), place),
            [_scored(found.label, found.score) for found, _ in placed],
        ),
    }


def _problem(insight: Insight) -> str:
    for name in (OCCUPANCY, SIMILARITY):
        values = getattr(insight, name)
        if values is None:
            continue
        if insight.grid is None:
            return f"found {name} without grid; expected both"
        if values.shape != tuple(insight.grid.shape):
            return f"{name} has shape {values.shape}; expected that of grid, {tuple(insight.grid.shape)}"
    for name, width in (("frontiers", 2), ("candidates", 3)):
        points = getattr(insight, name)
        if points is not None and np.asarray(points).shape[1:] != (width,):
            return f"{name} has shape {np.asarray(points).shape}; expected (N, {width})"
    scores, points = insight.candidate_scores, insight.candidates
    if scores and len(scores) != (0 if points is None else len(points)):
        return f"found {len(scores)} candidate_scores for {0 if points is None else len(points)} candidates"
    return ""


def _in_world(points_start: NDArray[np.float64], place: Place) -> NDArray[np.float64]:
    """(N, 3) points of the start frame in the world; (0, 3) if there are none."""
    points = np.asarray(points_start, float).reshape(-1, 3)
    return points @ place.T_world_start[:3, :3].T + place.T_world_start[:3, 3]


def _on_floor(xz_start: NDArray[np.float64], place: Place) -> NDArray[np.float64]:
    """(N, 3) world points of places (x, z) of the start frame, on the floor that the robot stands on."""
    xz = np.asarray(xz_start, float).reshape(-1, 2)
    points = _in_world(np.column_stack([xz[:, 0], np.zeros(len(xz)), xz[:, 1]]), place)
    points[:, 1] = place.floor_y
    return points


def _scored(label: str, score: float) -> str:
    return f"{label} {score:.2f}"
