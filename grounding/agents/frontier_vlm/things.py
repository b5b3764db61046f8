"""The things that the detector found for the goal text, put together from the views that show them.

Detections, masks, depth -> points of each view -> `Thing` with its middle, score and best crop -> the judge's choices.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from grounding.maps.storeys import points_at
from sim.tasks.observers import Detection
from sim.types import Frame

_MOST_PIXELS = 400
"""Pixels of one mask that give points, evenly drawn from it."""
_TAIL = 5.0
"""Percent of a view's points that are left out at each end of each axis: masks take in what is behind the thing."""
_VOXEL = 0.05
"""Points of one thing are kept once in each cube of this side, metres."""
_SAME = 0.15
"""A view shows a known thing if the middle of its points lies in that thing's box, or the other way round, with this
much around the boxes, metres."""
_AROUND = 0.4
"""Margin of a crop, as a share of the box's longer side, so that the thing's surroundings can be seen."""
_LEAST_SIDE = 96
"""Sides of a crop in pixels, where the picture has as many."""


@dataclass(frozen=True, slots=True)
class Thing:
    """Something that fits the goal text. Frame: start."""

    number: int
    """Its own for the whole episode, from 0."""
    label: str
    centre: tuple[float, float, float]
    """Middle of the box around all its points, metres."""
    score: float
    """Mean of its detections' scores."""
    num_views: int
    crop: NDArray[np.uint8]
    """(h, w, 3) the part of the picture that shows most of it."""

    @property
    def xz(self) -> tuple[float, float]:
        """Its place on the floor plan, metres."""
        return self.centre[0], self.centre[2]


@dataclass(slots=True)
class _Views:
    """What is known of a thing."""

    label: str
    points: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))
    scores: list[float] = field(default_factory=list[float])
    crop: NDArray[np.uint8] = field(default_factory=lambda: np.zeros((1, 1, 3), np.uint8))
    pixels: int = 0
    """Pixels of the thing in the crop."""

    @property
    def box(self) -> NDArray[np.float64]:
        """(2, 3) lowest and highest corner."""
        return np.array([self.points.min(axis=0), self.points.max(axis=0)])


class SeenThings:
    """All things seen in an episode. Frame: start."""

    def __init__(self) -> None:
        """Starts empty."""
        self._views: list[_Views] = []

    def see(self, frame: Frame, found: Sequence[tuple[Detection, NDArray[np.bool_]]]) -> tuple[Detection, ...]:
        """Adds one view's detections with their masks (H, W).

        Returns:
            All of them in a fixed order; those with points have the place of their thing's middle.
        """
        placed = []
        for detection, mask in sorted(found, key=lambda each: (each[0].box, each[0].score, each[0].label)):
            points = _points(frame, mask)
            position = None
            if len(points):
                number = self._number_of(points, detection.label)
                self._add(number, points, detection, frame.rgb, int(mask.sum()))
                position = self._thing(number).centre
            placed.append(Detection(detection.label, detection.box, detection.score, position))
        return tuple(placed)

    def all(self) -> list[Thing]:
        """The things in the order in which they were first seen."""
        return [self._thing(number) for number in range(len(self._views))]

    def _number_of(self, points: NDArray[np.float64], label: str) -> int:
        """The number of the nearest thing that these points (N, 3) show, or that of a new one."""
        own = np.array([points.min(axis=0), points.max(axis=0)])
        middle, best = own.mean(axis=0), (np.inf, len(self._views))
        for number, known in enumerate(self._views):
            box = known.box
            there = box.mean(axis=0)
            if _holds(box, middle) or _holds(own, there):
                best = min(best, (float(np.linalg.norm(middle - there)), number))
        if best[1] == len(self._views):
            self._views.append(_Views(label))
        return best[1]

    def _add(
        self, number: int, points: NDArray[np.float64], detection: Detection, rgb: NDArray[np.uint8], pixels: int
    ) -> None:
        known = self._views[number]
        both = np.concatenate([known.points, points])
        _, first = np.unique(np.floor(both / _VOXEL), axis=0, return_index=True)
        known.points = both[np.sort(first)]
        known.scores.append(detection.score)
        if pixels > known.pixels:
            known.pixels, known.crop = pixels, crop_around(rgb, detection.box)

    def _thing(self, number: int) -> Thing:
        known = self._views[number]
        x, y, z = known.box.mean(axis=0).tolist()
        score = float(np.mean(known.scores))
        return Thing(number, known.label, (x, y, z), score, len(known.scores), known.crop)


def crop_around(rgb: NDArray[np.uint8], box: tuple[float, float, float, float]) -> NDArray[np.uint8]:
    """(h, w, 3) a copy of the picture's part around a box (left, top, right, bottom), with a margin."""
    left, top, right, bottom = box
    margin = _AROUND * max(right - left, bottom - top)
    spans = []
    for low, high, most in ((top, bottom, rgb.shape[0]), (left, right, rgb.shape[1])):
        half = max((high - low) / 2 + margin, _LEAST_SIDE / 2)
        first = int(max(0, min((low + high) / 2 - half, most - 2 * half)))
        spans.append(slice(first, int(min(most, np.ceil(first + 2 * half)))))
    return rgb[tuple(spans)].copy()


def _points(frame: Frame, mask: NDArray[np.bool_]) -> NDArray[np.float64]:
    """(N, 3) points of the pixels with depth, without the outermost ones; none if there are fewer than three."""
    pixels = np.argwhere(mask & (frame.depth_m > 0) & np.isfinite(frame.depth_m))
    if len(pixels) < 3:
        return np.zeros((0, 3))
    chosen = np.linspace(0, len(pixels) - 1, min(len(pixels), _MOST_PIXELS)).astype(int)
    points = points_at(frame, pixels[chosen])
    low, high = np.percentile(points, [_TAIL, 100 - _TAIL], axis=0)
    kept = ((points >= low) & (points <= high)).all(axis=1)
    return points[kept] if kept.any() else points


def _holds(box: NDArray[np.float64], point: NDArray[np.float64]) -> bool:
    """Whether a box (2, 3), grown by _SAME, holds a point (3,)."""
    return bool(((point >= box[0] - _SAME) & (point <= box[1] + _SAME)).all())
