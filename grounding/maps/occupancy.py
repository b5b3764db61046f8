"""Free, blocked and unknown cells of a storey's floor, from depth pictures; exploration and maps build on it.

Depth + pose -> hits per cell (occupancy_kernels.py) -> votes over views -> cells.
"""

import numpy as np
from numpy.typing import NDArray

from sim.tasks.observers import FREE, OCCUPIED, UNKNOWN
from sim.types import AGENT_HEIGHT, AGENT_RADIUS, Camera, GridSpec

from .occupancy_kernels import mark, vote, without_mixed

SIZE, CELL = 50.0, 0.05
"""Side of the mapped square, outside of which nothing is mapped, and of its cells, metres."""
MAX_DEPTH = 5.0
"""Largest planar depth that a sensor of ObjectNav-HM3D returns, metres."""
FLOOR_LOW, FLOOR_HIGH = -0.2, 0.2
"""Points between these heights (metres) are floor: homes are uneven, and the robot climbs 0.2 m. Lower is a hole or a
stair down, higher an obstacle."""
OBSTACLE_TOP = AGENT_HEIGHT + 0.05
"""Points higher above the floor (metres) do not block the robot."""
_COMPARED = 1 / 320
"""Distance between pixels that are compared at edges of depth, as a share of the picture's width."""
_STANDING_VOTES = -12
_CELL_OF_VOTES = np.full(256, FREE, np.uint8)
"""Indexed by the votes as a byte: positive votes are 1-127, negative ones 128-255."""
_CELL_OF_VOTES[:128] = OCCUPIED
_CELL_OF_VOTES[0] = UNKNOWN


class OccupancyMapper:
    """Grows a storey's occupancy grid from views; keeps no picture. The frame is that of the poses, y up."""

    def __init__(
        self,
        *,
        centre_xz: tuple[float, float] = (0.0, 0.0),
        floor_y: float = 0.0,
        max_depth: float = MAX_DEPTH,
    ) -> None:
        """Starts with every cell unknown.

        Args:
            centre_xz: Middle of the mapped square, metres; it lies on a corner between cells.
            floor_y: Height of the storey's floor, metres.
            max_depth: Planar metres; farther returns only say that nothing is nearer.
        """
        count = 2 * round(SIZE / CELL / 2)
        corner = (centre_xz[0] - count * CELL / 2, centre_xz[1] - count * CELL / 2)
        self.grid = GridSpec(corner, CELL, (count, count))
        """The grid of the cells."""
        self.floor_y = floor_y
        """Height of the storey's floor, metres."""
        self._max_depth = max_depth
        self._votes = np.zeros(self.grid.shape, np.int8)  # < 0 free, > 0 blocked, 0 unknown
        self._hits = np.zeros(self.grid.shape, np.uint8)
        self._box = (self.grid.shape[0], -1, self.grid.shape[1], -1)

    @property
    def cells(self) -> NDArray[np.uint8]:
        """(rows, cols) UNKNOWN, FREE or OCCUPIED of sim.tasks.observers; a copy."""
        return _CELL_OF_VOTES[self._votes.view(np.uint8)]

    def cells_of(self, part: tuple[slice, slice]) -> NDArray[np.uint8]:
        """`cells` in a part of the grid's rows and columns; a copy."""
        return _CELL_OF_VOTES[self._votes[part].view(np.uint8)]

    @property
    def known_box(self) -> tuple[int, int, int, int]:
        """First row, last row, first column, last column of a box around all known cells; last < first if none is."""
        return self._box

    @property
    def num_known(self) -> int:
        """The number of cells that are free or occupied."""
        r0, r1, c0, c1 = self._box
        return int(np.count_nonzero(self._votes[r0 : r1 + 1, c0 : c1 + 1]))

    @property
    def num_free(self) -> int:
        """The number of cells that are free."""
        r0, r1, c0, c1 = self._box
        return int(np.count_nonzero(self._votes[r0 : r1 + 1, c0 : c1 + 1] < 0))

    def _grow(self, r0: int, r1: int, c0: int, c1: int) -> None:
        """Extends the box of known cells to these rows and columns."""
        box = self._box
        self._box = (min(box[0], r0), max(box[1], r1), min(box[2], c0), max(box[3], c1))

    def cell_at(self, xz: tuple[float, float]) -> int:
        """UNKNOWN, FREE or OCCUPIED at a place; UNKNOWN outside the square."""
        row, col = self.grid.rc_from_xz(np.array(xz)).tolist()
        if not (0 <= row < self.grid.shape[0] and 0 <= col < self.grid.shape[1]):
            return UNKNOWN
        votes = int(self._votes[row, col])
        return FREE if votes < 0 else OCCUPIED if votes > 0 else UNKNOWN

    def add(self, depth_m: NDArray[np.float32], T_map_camera: NDArray[np.float64], camera: Camera) -> None:
        """Adds one view.

        A cell is free where the floor is seen, between neighbouring pixels too; blocked where at least two points are
        between FLOOR_HIGH and OBSTACLE_TOP above it, or where rays fall through the floor's height. Within one view
        blocked wins; across views votes decide, so the place of a removed thing is free after some clear views.

        Args:
            depth_m: (H, W) planar metres, 0 = no return, nan = not measured, which says nothing; negative = as far,
                but doubtful, which can show floor and blocks nothing.
            T_map_camera: (4, 4) pose of the camera (OpenCV axes).
        """
        assert depth_m.shape == (camera.height, camera.width), depth_m.shape
        x, y, z = T_map_camera[:3, 3]
        u, v = self.grid.uv_from_xz(np.array([x, z]))
        box = mark(
            np.ascontiguousarray(depth_m, np.float32),
            np.ascontiguousarray(T_map_camera[:3, :3], np.float64),
            float(u),
            float(v),
            float(y - self.floor_y),
            camera.lens,
            1.0 / self.grid.cell,
            (FLOOR_LOW, FLOOR_HIGH, OBSTACLE_TOP),
            self._max_depth,
            self._hits,
        )
        vote(self._hits, box, self._votes)
        self._grow(*box.tolist())

    def forget_free(self) -> None:
        """Makes free cells unknown again."""
        np.maximum(self._votes, 0, out=self._votes)

    def stand(self, xz: tuple[float, float], *, radius: float = AGENT_RADIUS) -> None:
        """Marks the footprint (metres) of a robot free, whatever the views say: the robot stands there."""
        cell, (x0, z0), (num_rows, num_cols) = self.grid.cell, self.grid.origin_xz, self.grid.shape
        reach = int(np.ceil(radius / cell)) + 1
        row, col = self.grid.rc_from_xz(np.array(xz)).tolist()
        rows = np.arange(max(row - reach, 0), min(row + reach + 1, num_rows))
        cols = np.arange(max(col - reach, 0), min(col + reach + 1, num_cols))
        x, z = x0 + (cols + 0.5) * cell, z0 + (rows + 0.5) * cell
        at_row, at_col = np.nonzero(np.hypot(x[None] - xz[0], z[:, None] - xz[1]) <= radius)
        if len(at_row):
            self._votes[rows[at_row], cols[at_col]] = _STANDING_VOTES
            left, right = int(cols[at_col.min()]), int(cols[at_col.max()])
            self._grow(int(rows[at_row[0]]), int(rows[at_row[-1]]), left, right)


def measured(depth_m: NDArray[np.float32]) -> NDArray[np.float32]:
    """Depth (H, W) of a real sensor for `OccupancyMapper.add`: nan = no return or a mixture of two surfaces at an edge.

    A simulated view needs no such care: there, no return is the sky, and edges are sharp.
    """
    step = max(1, round(depth_m.shape[1] * _COMPARED))
    return without_mixed(np.ascontiguousarray(depth_m, np.float32), step)
