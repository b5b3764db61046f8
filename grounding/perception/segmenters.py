"""The pixels of a detected thing: the simulator's ids, or what hangs together in depth inside the box.

Both keep the contract of `protocol.Segmenter`, which gets a detection; those of segments.py cut whole views.
"""

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from sim.tasks.observers import Detection
from sim.types import Frame

from ..maps.storeys import points_at
from .boxes import boxes_of_ids, overlap, pixels_in_box
from .oracle_perception import ids_of
from .segment_depth import depth_jump

_SAME_BOX = 0.3
"""Least overlap of a detection with the box of an instance for its pixels to be meant; faults jitter boxes."""
_FLOOR = 0.05
"""Pixels up to this height above the robot's feet show the floor, metres."""
_MIDDLE = 0.5
"""Share of the box's sides, around its centre, in which the thing is looked for."""


class DepthRegion:
    """The largest surface in the middle of the box that has no jump in depth, without the floor under the robot.

    No weights and no colours: a thing that touches another one, or a wall, takes that part of it along which is inside
    the box. A thing as flat as the floor, such as a rug, keeps its pixels.
    """

    name = "depth region"

    def mask(self, frame: Frame, detection: Detection) -> NDArray[np.bool_]:
        """(H, W) the thing's pixels, none outside its box; empty where the middle of the box has no depth."""
        found = np.zeros(frame.depth_m.shape, bool)
        rows, cols = pixels_in_box(detection.box, found.shape)
        depth = frame.depth_m[rows, cols]
        if not depth.size:
            return found
        is_above = _above_floor(frame, rows, cols)
        middle = _middle(depth.shape)
        is_thing = is_above if (is_above & middle).any() else depth > 0
        found[rows, cols] = _largest_region(depth, is_thing, middle)
        return found


class IdRegion:
    """The pixels of the instance whose box fits the detection best. Ground truth.

    A detection that fits no instance, as false ones do, gets its depth region: it must lead somewhere.
    """

    name = "oracle-perception instance ids"

    def mask(self, frame: Frame, detection: Detection) -> NDArray[np.bool_]:
        """(H, W) the instance's pixels inside the box; raises AgentError where the frame has no instance ids."""
        ids = ids_of(frame)
        fits = {number: overlap(box, detection.box) for number, box in boxes_of_ids(ids).items()}
        best = max(fits, key=lambda number: fits[number], default=0)
        if fits.get(best, 0.0) < _SAME_BOX:
            return DepthRegion().mask(frame, detection)
        found = np.zeros(ids.shape, bool)
        place = pixels_in_box(detection.box, ids.shape)
        found[place] = ids[place] == best
        return found


def _above_floor(frame: Frame, rows: slice, cols: slice) -> NDArray[np.bool_]:
    """(h, w) pixels with depth that are not on the floor on which the robot stands."""
    row, col = np.mgrid[rows, cols]
    heights = points_at(frame, np.column_stack([row.ravel(), col.ravel()]))[:, 1].reshape(row.shape)
    feet = frame.T_world_camera[1, 3] - frame.camera.mount_height
    with np.errstate(invalid="ignore"):
        return heights > feet + _FLOOR


def _middle(shape: tuple[int, int]) -> NDArray[np.bool_]:
    """(h, w) the middle of a box of h x w pixels; at least one pixel."""
    inside = np.zeros(shape, bool)
    places = [slice(int(side * (1 - _MIDDLE) / 2), side - int(side * (1 - _MIDDLE) / 2)) for side in shape]
    inside[places[0], places[1]] = True
    return inside


def _largest_region(
    depth: NDArray[np.float32], is_thing: NDArray[np.bool_], middle: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """(h, w) the region with the most pixels in the middle; neighbours belong together unless depth jumps."""
    height, width = depth.shape
    # pixels and the joints between them on a grid of twice the size: a joint is open where depth does not jump
    grid = np.zeros((2 * height - 1, 2 * width - 1), bool)
    grid[::2, ::2] = is_thing
    jump = depth_jump(depth)
    for axis, joints in ((0, grid[1::2, ::2]), (1, grid[::2, 1::2])):
        near = np.abs(np.diff(depth, axis=axis)) <= np.minimum(_first(jump, axis), _last(jump, axis))
        joints[:] = near & _first(is_thing, axis) & _last(is_thing, axis)
    regions: NDArray[np.int32] = ndimage.label(grid)[0]  # type: ignore[index]  # scipy's stubs know the other form only
    labels = regions[::2, ::2]
    counts = np.bincount(labels[middle], minlength=1)
    counts[0] = 0
    return (labels == counts.argmax()) & (labels > 0)


def _first(values: NDArray, axis: int) -> NDArray:
    """All but the last row or column."""
    return values[:-1] if axis == 0 else values[:, :-1]


def _last(values: NDArray, axis: int) -> NDArray:
    """All but the first row or column."""
    return values[1:] if axis == 0 else values[:, 1:]
