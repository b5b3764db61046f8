"""Lines of sight from the robot's places to objects that must stay visible; new things may not cut too many of them."""

import math

import numpy as np
from numpy.typing import NDArray

from sim.compiled import njit
from sim.types import Camera, GridSpec

REACH = 3.7
"""Largest distance of a line of sight (metres; the largest distance to an object in the release is 3.6)."""
_STEP = 0.05
_MAX_PLACES = 600
"""Most standing places from which lines to one object are drawn."""
_KEPT = 0.6
"""Share of the lines of sight from one place to one object that must stay free."""


class Sights:
    """The lines that are still free; a line ends where it meets its object's box."""

    def __init__(
        self,
        boxes: NDArray[np.float64],
        places: NDArray[np.float64],
        is_open: NDArray[np.bool_],
        grid: GridSpec,
    ) -> None:
        """Draws lines from places (N, 3) of the feet to the middle of every box (K, 6) and towards its six sides,
        through open cells of the grid.
        """
        found = [_lines_to(box, places, is_open, grid) for box in boxes]
        self._lines = np.concatenate([np.zeros((0, 7)), *(lines for lines, _ in found)])
        pairs, first_pair = [np.zeros(0, np.int64)], 0
        for _, pair in found:
            pairs.append(pair + first_pair)
            first_pair += int(pair.max(initial=-1)) + 1
        self._pair = np.concatenate(pairs)
        self._bounds = np.cumsum([0, *(len(lines) for lines, _ in found)])
        self._centres = (boxes[:, :3] + boxes[:, 3:]) / 2
        self._left = np.bincount(self._pair, minlength=first_pair).astype(np.int64)
        self._least = np.ceil(_KEPT * self._left).astype(np.int64)
        self._is_cut = np.zeros(len(self._pair), bool)

    def cut(self, box: NDArray[np.float64]) -> bool:
        """Whether every place keeps its view of every object past a box (6,); if so, removes the lines that it cuts."""
        nearest = np.clip(self._centres[:, [0, 2]], box[[0, 2]], box[[3, 5]])
        near = np.hypot(*(nearest - self._centres[:, [0, 2]]).T) <= REACH
        met = [
            first + np.flatnonzero(_met(self._lines[first:last], self._is_cut[first:last], box))
            for first, last in zip(self._bounds[:-1][near], self._bounds[1:][near], strict=True)
        ]
        lines = np.concatenate([np.zeros(0, np.int64), *met])
        if not len(lines):
            return True
        lost = np.bincount(self._pair[lines], minlength=len(self._left))
        if (self._left - lost < self._least)[lost > 0].any():
            return False
        self._left -= lost
        self._is_cut[lines] = True
        return True


def _lines_to(
    box: NDArray[np.float64], places: NDArray[np.float64], is_open: NDArray[np.bool_], grid: GridSpec
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Lines (L, 7) to one object (eye, vector to a target, share up to the box), and the index (L,) of their places."""
    centre, half = (box[:3] + box[3:]) / 2, (box[3:] - box[:3]) / 2
    targets = centre + np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)]) * half * 0.7
    near = places[np.hypot(*(places[:, [0, 2]] - centre[[0, 2]]).T) <= REACH]
    near = near[:: max(1, -(-len(near) // _MAX_PLACES))]
    eyes = np.repeat(near + np.array([0.0, Camera().mount_height, 0.0]), len(targets), axis=0)
    ways = np.tile(targets, (len(near), 1)) - eyes
    ends = _ends(eyes, ways, box, is_open, np.array(grid.origin_xz), grid.cell)
    free = ends > 0
    _, pair = np.unique(np.repeat(np.arange(len(near)), len(targets))[free], return_inverse=True)
    return np.concatenate([eyes, ways, ends[:, None]], axis=1)[free], pair.astype(np.int64)


@njit(cache=True, nogil=True)
def _ends(eyes, ways, box, is_open, origin, cell):
    """Share (N,) of each line at which it reaches the box; 0 where a closed cell comes first."""
    ends = np.zeros(len(eyes))
    for i in range(len(eyes)):
        enter, _ = _span(eyes[i], ways[i], box)
        enter = min(max(enter, 0.0), 1.0)
        length = enter * math.sqrt(ways[i, 0] ** 2 + ways[i, 2] ** 2)
        steps = int(length / _STEP)
        is_free = True
        for step in range(steps - 1):  # the cells of a piece under the object may be closed
            share = enter * step / max(steps, 1)
            row = int((eyes[i, 2] + share * ways[i, 2] - origin[1]) / cell)
            col = int((eyes[i, 0] + share * ways[i, 0] - origin[0]) / cell)
            if not (0 <= row < is_open.shape[0] and 0 <= col < is_open.shape[1]) or not is_open[row, col]:
                is_free = False
                break
        if is_free:
            ends[i] = enter
    return ends


@njit(cache=True, nogil=True)
def _met(lines, is_cut, box):
    """Whether each line that is still free goes through the box before its end, (L,)."""
    met = np.zeros(len(lines), np.bool_)
    for i in range(len(lines)):
        if not is_cut[i]:
            enter, leave = _span(lines[i, :3], lines[i, 3:6], box)
            met[i] = enter < leave and leave > 0 and enter < lines[i, 6]
    return met


@njit(cache=True, nogil=True)
def _span(eye, way, box):
    """The two shares of a line between which it is inside a box; the first is larger if the line misses the box."""
    enter, leave = -np.inf, np.inf
    for axis in range(3):
        step = way[axis] if abs(way[axis]) > 1e-9 else 1e-9
        a, b = (box[axis] - eye[axis]) / step, (box[axis + 3] - eye[axis]) / step
        enter, leave = max(enter, min(a, b)), min(leave, max(a, b))
    return enter, leave
