"""OneMap's consensus filter: detections become the target only where the map agrees with them.

Detections, masks, cells of pixels, hot cells -> `Target` -> the agent walks there.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from grounding.maps.storeys import points_at
from grounding.perception.protocol import Detector, Segmenter
from sim.tasks.observers import Detection
from sim.types import Frame

REPLACE_GAIN = 1.1
"""Another detection becomes the target only with a score this many times greater (OneMap's code)."""


class Target(NamedTuple):
    """The detection that the agent believes."""

    rc: tuple[int, int]
    """The hot cell of the detection that is nearest to the mean of its hot cells."""
    score: float
    """The greatest similarity of the detection's cells, plus 1."""
    depth: float
    """Least depth of a pixel in a hot cell, metres."""


def placed_detections(
    frame: Frame, detector: Detector, segmenter: Segmenter
) -> list[tuple[Detection, NDArray[np.bool_]]]:
    """The detections in a view, each with the place of its nearest point (the frame's map), and their masks (H, W)."""
    found = []
    for detection in detector.detect(frame):
        mask = segmenter.mask(frame, detection) & (frame.depth_m > 0) & np.isfinite(frame.depth_m)
        position = None
        if mask.any():
            pixel = np.array(np.unravel_index(np.where(mask, frame.depth_m, np.inf).argmin(), mask.shape))
            x, y, z = points_at(frame, pixel[None])[0].tolist()
            position = (x, y, z)
        found.append((Detection(detection.label, detection.box, detection.score, position), mask))
    return found


def believed(
    mask: NDArray[np.bool_],
    depth_m: NDArray[np.float32],
    cells: NDArray[np.int32],
    *,
    is_hot: NDArray[np.bool_],
    similarity: NDArray[np.float32],
) -> Target | None:
    """The target that a detection gives; None if none of its cells is hot.

    Args:
        mask: (H, W) its pixels.
        depth_m: (H, W) planar metres.
        cells: (H, W) cell index of each pixel, -1 = none.
        is_hot: (rows, cols) of the whole grid.
        similarity: (rows, cols) of the whole grid.
    """
    pixels = mask & (cells >= 0)
    own, depth = cells[pixels], depth_m[pixels]
    hot = is_hot.ravel()[own]
    if not hot.any():
        return None
    rc = np.column_stack(np.divmod(np.unique(own[hot]), is_hot.shape[1]))
    row, col = rc[np.hypot(*(rc - rc.mean(axis=0)).T).argmin()].tolist()
    return Target((row, col), float(similarity.ravel()[own].max()) + 1, float(depth[hot].min()))


def replaced(target: Target | None, found: list[Target], is_hot: NDArray[np.bool_]) -> Target | None:
    """The target from now on: kept while its cell is hot, unless a detection scores REPLACE_GAIN times as much.

    The order of the detections does not matter.
    """
    if target is not None and not is_hot[target.rc]:
        target = None
    best = min(found, key=lambda each: (-each.score, each.depth, each.rc), default=None)
    if best is None or (target is not None and best.score < REPLACE_GAIN * target.score):
        return target
    return best
