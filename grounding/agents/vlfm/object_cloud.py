"""VLFM's object cloud: the points of everything that was detected, and the one to walk to.

Detections, masks -> eroded masks -> points -> largest cluster -> `ObjectCloud` -> goal of the agent.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from sim.tasks.observers import Detection
from sim.types import Frame

from .density_clusters import density_clusters
from .value_map import NEAREST, RANGE

EROSION = 5
"""Pixels taken off each side of a mask, so that its points do not lie behind the thing (VLFM's code: 5 times 3 x 3)."""
MOST_POINTS = 5000
"""Points of one detection; more are drawn from (VLFM's code)."""
CLUSTER_REACH, CLUSTER_POINTS = 0.2, 100
"""DBSCAN's distance (metres) and least number of neighbours (VLFM's code)."""
TOO_NEAR = 1.0
"""A detection with a point this near to the camera (metres) is ignored (VLFM's code)."""
TOO_FAR = 0.95 * RANGE
"""Points beyond this planar depth (metres) are not trusted (VLFM's code)."""
OUTER_SHARE = 0.05
"""Masks wholly in a side third of the picture that touch this share of it are not trusted (VLFM's code)."""
RECHECK = RANGE / 2
"""What is not trusted is forgotten when the robot faces it within this distance, metres (VLFM's code)."""
SAME_GOAL, SAME_FAR_GOAL, FAR_GOAL = 0.1, 0.5, 2.0
"""A goal stays while the nearest point is within the first distance of it, or within the second if it is farther than
the third from the robot; metres (VLFM's code)."""
TRUSTED = 1.0
"""Mark of trusted points; the others of one view carry a number below it."""


class Seen(NamedTuple):
    """The points of one detection in one view."""

    points: NDArray[np.float64]
    """(N, 3) start frame, metres."""
    marks: NDArray[np.float64]
    """(N,) TRUSTED, or the number of this view's untrusted points."""


class ObjectCloud:
    """Points of the detections so far. Frame: start."""

    def __init__(self) -> None:
        """Starts empty."""
        self.points = np.zeros((0, 3))
        """(N, 3) metres."""
        self.marks = np.zeros(0)
        """(N,) TRUSTED, or the number of the view's untrusted points."""
        self.middles = np.zeros((0, 3))
        """(N, 3) the mean of the points that came with each point: the middle of what one view showed, metres."""
        self._goal: NDArray[np.float64] | None = None
        self._middle: NDArray[np.float64] | None = None

    def add(
        self, frame: Frame, found: Sequence[tuple[Detection, NDArray[np.bool_]]], *, rng: np.random.Generator
    ) -> list[Detection]:
        """Adds one view's detections with their masks (H, W); their order changes nothing.

        Returns:
            All of them in a fixed order; those that count have the place of their nearest point.
        """
        placed = []
        for detection, mask in sorted(found, key=lambda each: (each[0].box, each[0].score, each[0].label)):
            seen = points_of(frame, mask, rng=rng)
            position = None
            if seen is not None:
                self.points = np.concatenate([self.points, seen.points])
                self.marks = np.concatenate([self.marks, seen.marks])
                middle = np.broadcast_to(seen.points.mean(axis=0), seen.points.shape)
                self.middles = np.concatenate([self.middles, middle])
                away = np.linalg.norm(seen.points - frame.T_world_camera[:3, 3], axis=1)
                x, y, z = seen.points[away.argmin()].tolist()
                position = (x, y, z)
            placed.append(Detection(detection.label, detection.box, detection.score, position))
        return placed

    def retract(self, frame: Frame) -> None:
        """Forgets the untrusted points of each view of which one lies within RECHECK and in the picture's sector."""
        is_doubtful = self.marks != TRUSTED
        if not is_doubtful.any():
            return
        offsets, marks = self.points[is_doubtful] - frame.T_world_camera[:3, 3], self.marks[is_doubtful]
        right = frame.T_world_camera[[0, 2], 0]
        aside = offsets[:, [0, 2]] @ right
        forward = offsets[:, [0, 2]] @ np.array([right[1], -right[0]])
        half_fov = math.radians(frame.camera.hfov_deg) / 2
        is_faced = (np.linalg.norm(offsets, axis=1) <= RECHECK) & (np.abs(np.arctan2(aside, forward)) <= half_fov)
        gone = np.unique(marks[is_faced])
        if len(gone):
            kept = ~np.isin(self.marks, gone)
            self.points, self.marks, self.middles = self.points[kept], self.marks[kept], self.middles[kept]

    def goal(self, xz: tuple[float, float]) -> tuple[float, float, float] | None:
        """The middle of the thing to walk to from here; None without points.

        That is the thing with the nearest trusted point, or with the nearest one if none is trusted. The last answer is
        kept while the nearest point is about where it was.
        """
        if not len(self.points):
            self._goal = self._middle = None
            return None
        counts = self.marks == TRUSTED if (self.marks == TRUSTED).any() else np.ones(len(self.marks), bool)
        away = np.where(counts, np.hypot(self.points[:, 0] - xz[0], self.points[:, 2] - xz[1]), np.inf)
        index = int(away.argmin())
        nearest, last = self.points[index], self._goal
        moved = math.inf if last is None else math.hypot(nearest[0] - last[0], nearest[2] - last[2])
        if not (moved < SAME_GOAL or (moved < SAME_FAR_GOAL and away[index] > FAR_GOAL)):
            self._goal, self._middle = nearest, self.middles[index]
        assert self._middle is not None
        x, y, z = self._middle.tolist()
        return x, y, z

    def nearest(self, xz: tuple[float, float], *, most: int) -> NDArray[np.float64]:
        """(N, 3) up to so many points, trusted ones first, then nearest first."""
        away = np.hypot(self.points[:, 0] - xz[0], self.points[:, 2] - xz[1])
        return self.points[np.lexsort([away, self.marks != TRUSTED])[:most]]


def points_of(frame: Frame, mask: NDArray[np.bool_], *, rng: np.random.Generator) -> Seen | None:
    """The points of a detection's mask (H, W); None if it is too thin, too near, or has no dense cluster.

    Pixels without a return count as RANGE away.
    """
    pixels = np.argwhere(eroded(mask))
    if len(pixels) > MOST_POINTS:
        pixels = pixels[np.sort(rng.choice(len(pixels), MOST_POINTS, replace=False))]
    if len(pixels) < CLUSTER_POINTS:
        return None
    depth = frame.depth_m[pixels[:, 0], pixels[:, 1]]
    depth = np.where(depth > 0, np.clip(depth, NEAREST, RANGE), np.float32(RANGE))
    points = _points_at(frame, pixels, depth)
    labels = density_clusters(points, reach=CLUSTER_REACH, least=CLUSTER_POINTS)
    if labels.max() < 0:
        return None
    kept = labels == np.bincount(labels[labels >= 0]).argmax()
    points, depth = points[kept], depth[kept]
    if np.linalg.norm(points - frame.T_world_camera[:3, 3], axis=1).min() < TOO_NEAR:
        return None
    is_trusted = (depth <= TOO_FAR) & (not is_at_side(mask))
    return Seen(points, np.where(is_trusted, TRUSTED, rng.random()))


def eroded(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(H, W) the mask without EROSION pixels on each side; nothing is taken off at the picture's sides."""
    size = 2 * EROSION + 1
    found = np.zeros(mask.shape, bool)
    rows, cols = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return found
    part = np.s_[max(rows[0] - 1, 0) : rows[-1] + 2, max(cols[0] - 1, 0) : cols[-1] + 2]
    found[part] = ndimage.minimum_filter(mask[part].astype(np.uint8), size, mode="nearest")
    return found


def is_at_side(mask: NDArray[np.bool_]) -> bool:
    """Whether a mask (H, W) lies wholly in the left or right third of its picture and touches the outer 5 %."""
    cols = np.flatnonzero(mask.any(axis=0))
    if not len(cols):
        return False
    width, first, end = mask.shape[1], int(cols[0]), int(cols[-1]) + 1
    if end <= width // 3:
        return first <= int(OUTER_SHARE * width)
    return first >= 2 * (width // 3) and end >= int((1 - OUTER_SHARE) * width)


def _points_at(frame: Frame, pixels: NDArray[np.int64], depth: NDArray[np.float32]) -> NDArray[np.float64]:
    """(N, 3) start frame points of pixels (N, 2) at planar depths (N,), metres."""
    fx, fy, cx, cy = frame.camera.lens
    right, down = (pixels[:, 1] + 0.5 - cx) / fx, (pixels[:, 0] + 0.5 - cy) / fy
    points_camera = np.column_stack([right * depth, down * depth, depth])
    return points_camera @ frame.T_world_camera[:3, :3].T + frame.T_world_camera[:3, 3]
