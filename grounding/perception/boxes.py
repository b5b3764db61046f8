"""Boxes in pictures: (left, top, right, bottom) in pixels, as `Detection.box` has them; a pixel is one unit wide.

Detectors make them, segmenters look inside them.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from sim.tasks.observers import Detection
from sim.types import Frame

Box = tuple[float, float, float, float]
LEAST_SIDE = 1.0
"""Boxes that are narrower or lower than this inside the picture are dropped, pixels."""


def detections_from_boxes(
    boxes: NDArray[np.floating], scores: NDArray[np.floating], frame: Frame, *, label: str
) -> list[Detection]:
    """Detections of boxes (N, 4) with scores (N,), best first; cut at the picture's edges, empty ones dropped."""
    found = []
    for index in np.argsort(-scores, kind="stable"):
        box = cut_box(boxes[index].tolist(), frame.depth_m.shape)
        if box is not None:
            found.append(Detection(label, box, min(1.0, max(0.0, float(scores[index])))))
    return found


def cut_box(box: Sequence[float], shape: tuple[int, ...]) -> Box | None:
    """The part of a box inside a picture of `shape` (H, W); None if less than a pixel's width or height is left."""
    height, width = shape[:2]
    left, right = (min(max(float(box[side]), 0.0), float(width)) for side in (0, 2))
    top, bottom = (min(max(float(box[side]), 0.0), float(height)) for side in (1, 3))
    if right - left < LEAST_SIDE or bottom - top < LEAST_SIDE:
        return None
    return left, top, right, bottom


def pixels_in_box(box: Sequence[float], shape: tuple[int, ...]) -> tuple[slice, slice]:
    """Rows and columns of the pixels that a box touches, inside a picture of `shape` (H, W)."""
    height, width = shape[:2]
    rows = slice(min(max(math.floor(box[1]), 0), height), min(max(math.ceil(box[3]), 0), height))
    cols = slice(min(max(math.floor(box[0]), 0), width), min(max(math.ceil(box[2]), 0), width))
    return rows, cols


def boxes_of_ids(ids: NDArray[np.int32]) -> dict[int, Box]:
    """The box of each id (H, W) above 0, in order of the ids."""
    places = ndimage.find_objects(np.maximum(ids, 0))
    return {
        number: (float(cols.start), float(rows.start), float(cols.stop), float(rows.stop))
        for number, place in enumerate(places, start=1)
        if place is not None
        for rows, cols in [place]
    }


def overlap(first: Sequence[float], second: Sequence[float]) -> float:
    """Intersection over union of two boxes, 0 to 1."""
    width = min(first[2], second[2]) - max(first[0], second[0])
    height = min(first[3], second[3]) - max(first[1], second[1])
    if width <= 0 or height <= 0:
        return 0.0
    areas = sum((box[2] - box[0]) * (box[3] - box[1]) for box in (first, second))
    return width * height / (areas - width * height)


def without_overlaps(boxes: NDArray[np.floating], scores: NDArray[np.floating], *, most: float) -> list[int]:
    """Indices of boxes (N, 4) to keep, best score (N,) first: none overlaps a better kept one by more than `most`."""
    kept: list[int] = []
    corners = boxes.tolist()
    for index in np.argsort(-scores, kind="stable").tolist():
        if all(overlap(corners[index], corners[other]) <= most for other in kept):
            kept.append(index)
    return kept


def corners_from_centres(boxes: NDArray[np.floating]) -> NDArray[np.float64]:
    """(N, 4) left, top, right, bottom of boxes (N, 4) given as centre and size."""
    centres, halves = np.asarray(boxes[:, :2], float), np.asarray(boxes[:, 2:], float) / 2
    return np.concatenate([centres - halves, centres + halves], axis=1)
