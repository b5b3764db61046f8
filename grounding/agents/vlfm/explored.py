"""The area that VLFM has explored, and its frontiers: way-points in the middle of its open borders.

Depth, pose -> obstacles for ever, fog of war -> explored area -> `ExploredArea.frontiers` -> the agent's choice.
"""

import math

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from sim.compiled import njit
from sim.homes.images import widened
from sim.types import Camera, GridSpec

from .value_map import RANGE

OBSTACLE_LOW, OBSTACLE_HIGH = 0.15, 0.88
"""Points between these heights above the floor are obstacles, metres. VLFM's configuration begins at 0.61 and leaves
tables, beds and sofas to a learned controller; a planner on a grid has to see them here."""
OBSTACLE_REACH = 3
"""Cells around an obstacle that the robot's centre cannot enter: a square of 7 x 7 (VLFM's code)."""
BORDER_REACH = 2
"""Cells by which the explored area is widened before its border is read: a square of 5 x 5 (VLFM's code)."""
LEAST_ISLAND = 1.5
"""Unexplored islands smaller than this are painted explored, square metres (VLFM's code)."""
_LEAVE = 0.25
"""A robot that stands too near to an obstacle sees on from the first open cell within this distance, metres."""
_EVERY = 2
"""Every second row and column of pixels is used; at 5 m they are half a cell apart."""
_MARGIN = 8
_EIGHT = np.ones((3, 3))
Box = tuple[int, int, int, int]
"""First and last row, first and last column."""


class ExploredArea:
    """Obstacles and explored cells on a grid of the floor. Frame: start."""

    def __init__(self, grid: GridSpec) -> None:
        """Starts with nothing known."""
        self.grid = grid
        """The grid of the cells."""
        self.obstacles = np.zeros(grid.shape, bool)
        """(rows, cols) never cleared."""
        self.blocked = np.zeros(grid.shape, bool)
        """(rows, cols) obstacles and the cells within OBSTACLE_REACH of them."""
        self.explored = np.zeros(grid.shape, bool)
        """(rows, cols) not blocked, one connected area."""
        self._box = (grid.shape[0], -1, grid.shape[1], -1)
        self._frontiers: NDArray[np.float64] | None = None  # None = not known since the last change

    def see(
        self, depth_m: NDArray[np.float32], T_start_camera: NDArray[np.float64], camera: Camera, *, floor_y: float
    ) -> None:
        """Adds one view.

        Args:
            depth_m: (H, W) planar metres, 0 = no return.
            T_start_camera: (4, 4) pose of the camera (OpenCV axes).
            camera: Its intrinsics.
            floor_y: Height of the floor, metres.
        """
        assert depth_m.shape == (camera.height, camera.width), depth_m.shape
        u, v = self.grid.uv_from_xz(T_start_camera[[0, 2], 3])
        is_new, blocked_box = _mark_obstacles(
            np.ascontiguousarray(depth_m, np.float32),
            np.ascontiguousarray(T_start_camera[:3, :3], np.float64),
            (float(u), float(v), float(T_start_camera[1, 3]) - floor_y),
            camera.lens,
            self.grid.cell,
            self.obstacles,
            self.blocked,
            self.explored,
        )
        heading = math.atan2(T_start_camera[2, 0], T_start_camera[0, 0])  # of the camera's right, from u to v
        is_wider, box = _lift_fog(
            self.blocked, self.explored, (float(u), float(v)), heading, self.grid.cell, math.radians(camera.hfov_deg)
        )
        box = _around(_around(self._box, blocked_box), box)
        if is_new or is_wider or box != self._box:
            self._box, self._frontiers = box, None
            self._keep_one_area(float(u), float(v))

    def forget_explored(self) -> None:
        """Forgets all but the obstacles."""
        self.explored[:], self._frontiers = False, None

    def frontiers(self) -> NDArray[np.float64]:
        """(N, 2) (x, z) way-points, metres; found again only after a cell has changed."""
        if self._frontiers is None:
            self._frontiers = self._found_frontiers()
            self._frontiers.setflags(write=False)
        return self._frontiers

    def _found_frontiers(self) -> NDArray[np.float64]:
        part = self._part(_MARGIN)
        uv = frontier_midpoints(
            self.explored[part], ~self.blocked[part], least_cells=round(LEAST_ISLAND / self.grid.cell**2)
        )
        return self.grid.xz_from_uv(uv + np.array([part[1].start, part[0].start]))

    def _part(self, margin: int) -> tuple[slice, slice]:
        """Rows and columns of all explored and blocked cells, and a margin: beyond it all is open and unexplored."""
        r0, r1, c0, c1 = self._box
        return np.s_[max(r0 - margin, 0) : r1 + margin + 1, max(c0 - margin, 0) : c1 + margin + 1]

    def _keep_one_area(self, u: float, v: float) -> None:
        """Forgets all explored cells that are not connected with the one nearest to the robot."""
        part = self._part(0)
        explored = self.explored[part]
        found = ndimage.label(explored, structure=_EIGHT)
        labels: NDArray[np.int32] = found[0]  # type: ignore[index]  # scipy's stubs know the other form only
        if labels.max(initial=0) < 2:
            return
        cells = np.argwhere(explored)
        away = (cells[:, 0] + part[0].start + 0.5 - v) ** 2 + (cells[:, 1] + part[1].start + 0.5 - u) ** 2
        self.explored[part] = labels == labels[tuple(cells[away.argmin()])]


def _around(one: Box, other: Box) -> Box:
    """The box around two."""
    return min(one[0], other[0]), max(one[1], other[1]), min(one[2], other[2]), max(one[3], other[3])


def frontier_midpoints(
    explored: NDArray[np.bool_], navigable: NDArray[np.bool_], *, least_cells: int
) -> NDArray[np.float64]:
    """(N, 2) column and row, with fractions, of the middles of the open borders of the explored area.

    The explored area is widened first. A border is open where an unexplored navigable cell lies within one cell of it;
    open stretches of at least two border points give one way-point each, in the middle of their length.

    Args:
        explored: (rows, cols).
        navigable: (rows, cols); cells outside are unknown.
        least_cells: Unexplored areas with fewer cells that hold nothing explored are counted as explored.
    """
    inside = widened(explored, BORDER_REACH) & navigable
    inside |= _islands(navigable & ~inside, inside, least_cells)
    is_open = widened(navigable & ~inside, 1)
    found = [
        _middle(points[first : last + 1])
        for points, flags in _borders(inside, is_open)
        for points, first, last in _runs(points, flags)
    ]
    return np.array(found, float).reshape(-1, 2)


def _islands(unexplored: NDArray[np.bool_], inside: NDArray[np.bool_], least_cells: int) -> NDArray[np.bool_]:
    """(rows, cols) unexplored areas that are small and surround nothing explored; those at the edge go on beyond it."""
    found = ndimage.label(unexplored, structure=_EIGHT)
    labels: NDArray[np.int32] = found[0]  # type: ignore[index]
    sizes = np.bincount(labels.ravel())
    sizes[0] = least_cells
    sizes[np.unique(np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]]))] = least_cells
    islands = np.zeros(unexplored.shape, bool)
    small = np.flatnonzero(sizes < least_cells).tolist()
    boxes = ndimage.find_objects(labels) if small else []
    for label in small:
        part = boxes[label - 1]
        filled = is_island = labels[part] == label
        if min(filled.shape) > 2:  # else nothing lies inside
            filled = np.asarray(ndimage.binary_fill_holes(is_island), bool)
        if np.count_nonzero(filled) < least_cells and not (filled & inside[part]).any():
            islands[part] |= is_island
    return islands


def _borders(
    inside: NDArray[np.bool_], is_open: NDArray[np.bool_]
) -> list[tuple[NDArray[np.float64], NDArray[np.bool_]]]:
    """Each closed border: its points (N, 2), column and row between two cells, and whether each is open (N,)."""
    points, flags, starts = _traced(inside, is_open)
    ends = [*starts[1:].tolist(), len(points)]
    return [(points[first:last], flags[first:last]) for first, last in zip(starts.tolist(), ends, strict=True)]


def _runs(points: NDArray[np.float64], flags: NDArray[np.bool_]) -> list[tuple[NDArray[np.float64], int, int]]:
    """Points in the order of the border, and the first and last index of each open stretch of two or more."""
    if not flags.any():
        return []
    if flags.all():
        return [(points, 0, len(points) - 1)] if len(points) > 1 else []
    first_closed = int(np.flatnonzero(~flags)[0])
    points, flags = np.roll(points, -first_closed, axis=0), np.roll(flags, -first_closed)
    steps = np.diff(np.concatenate([flags, [False]]).astype(np.int8))
    begins, ends = np.flatnonzero(steps == 1) + 1, np.flatnonzero(steps == -1)
    return [(points, int(a), int(b)) for a, b in zip(begins, ends, strict=True) if b > a]


def _middle(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """(2,) the place at half the length of a line through points (N, 2)."""
    lengths = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    return np.array([np.interp(lengths[-1] / 2, lengths, points[:, axis]) for axis in (0, 1)])


@njit(cache=True, nogil=True)
def _traced(inside, is_open):
    """Points (N, 2), open or not (N,), and the index (B,) at which each border of the inner cells begins.

    Walks along the sides of inner cells with the inner ones on the right; cells that touch at a corner are connected.
    """
    rows, cols = inside.shape
    down, right = (-1, 0, 1, 0), (0, 1, 0, -1)  # the side of a cell, and clockwise from it
    was_at = np.zeros((rows, cols, 4), np.bool_)
    points, flags, starts = [(0.0, 0.0)], [False], [0]
    for first_row in range(rows):
        for first_col in range(cols):
            if not inside[first_row, first_col]:
                continue
            for first_side in range(4):
                r, c, side = first_row, first_col, first_side
                if was_at[r, c, side] or _is_in(inside, r + down[side], c + right[side]):
                    continue
                starts.append(len(points))
                while not was_at[r, c, side]:
                    was_at[r, c, side] = True
                    points.append((c + 0.5 + 0.5 * right[side], r + 0.5 + 0.5 * down[side]))
                    flags.append(is_open[r, c])
                    after = (side + 1) % 4
                    if _is_in(inside, r + down[side] + down[after], c + right[side] + right[after]):
                        r, c, side = r + down[side] + down[after], c + right[side] + right[after], (side + 3) % 4
                    elif _is_in(inside, r + down[after], c + right[after]):
                        r, c = r + down[after], c + right[after]
                    else:
                        side = after
    found = np.empty((len(points) - 1, 2))
    is_flagged = np.empty(len(points) - 1, np.bool_)
    for k in range(1, len(points)):
        found[k - 1, 0], found[k - 1, 1] = points[k]
        is_flagged[k - 1] = flags[k]
    begins = np.empty(len(starts) - 1, np.int64)
    for k in range(1, len(starts)):
        begins[k - 1] = starts[k] - 1
    return found, is_flagged, begins


@njit(cache=True, nogil=True)
def _is_in(inside, row, col):
    """Whether a cell lies on the grid and is an inner one."""
    return 0 <= row < inside.shape[0] and 0 <= col < inside.shape[1] and inside[row, col]


@njit(cache=True, nogil=True)
def _mark_obstacles(depth, R, eye, lens, cell, obstacles, blocked, explored):
    """Marks the obstacles that a view shows within RANGE, and the cells near them; changes the last three.

    Returns:
        Whether there was a new one; a box around the cells that it blocks.
    """
    fx, fy, cx, cy = lens
    r0, r1, c0, c1 = obstacles.shape[0], -1, obstacles.shape[1], -1
    rows, cols = obstacles.shape
    right = (np.arange(depth.shape[1]) + 0.5 - cx) / fx
    right_x, right_y, right_z = R[0, 0] * right, R[1, 0] * right, R[2, 0] * right
    is_new = False
    for i in range(0, depth.shape[0], _EVERY):
        down = (i + 0.5 - cy) / fy
        down_x, down_y, down_z = R[0, 1] * down, R[1, 1] * down, R[2, 1] * down
        for j in range(0, depth.shape[1], _EVERY):
            d = depth[i, j]
            height = eye[2] + d * (right_y[j] + down_y + R[1, 2])
            if not (OBSTACLE_LOW <= height <= OBSTACLE_HIGH and 0 < d < RANGE):
                continue
            c = math.floor(eye[0] + d * (right_x[j] + down_x + R[0, 2]) / cell)
            r = math.floor(eye[1] + d * (right_z[j] + down_z + R[2, 2]) / cell)
            if not (0 <= r < rows and 0 <= c < cols) or obstacles[r, c]:
                continue
            is_new = obstacles[r, c] = True
            r0, r1 = min(r0, max(r - OBSTACLE_REACH, 0)), max(r1, min(r + OBSTACLE_REACH, rows - 1))
            c0, c1 = min(c0, max(c - OBSTACLE_REACH, 0)), max(c1, min(c + OBSTACLE_REACH, cols - 1))
            for near_r in range(max(r - OBSTACLE_REACH, 0), min(r + OBSTACLE_REACH + 1, rows)):
                for near_c in range(max(c - OBSTACLE_REACH, 0), min(c + OBSTACLE_REACH + 1, cols)):
                    blocked[near_r, near_c] = True
                    explored[near_r, near_c] = False
    return is_new, (r0, r1, c0, c1)


@njit(cache=True, nogil=True)
def _lift_fog(blocked, explored, middle, heading, cell, fov):
    """Marks the open cells on rays from the robot, and those beside them, as explored.

    Args:
        blocked: (rows, cols).
        explored: (rows, cols), changed.
        middle: Column and row of the robot, with fractions.
        heading: Direction of the robot's right, radians from columns to rows.
        cell: Metres.
        fov: Radians.

    Returns:
        Whether one was unexplored; first and last row, first and last column of a box around them.
    """
    rows, cols = blocked.shape
    is_new, reach = False, math.ceil(RANGE / cell) + 1
    corner = math.floor(middle[1]) - reach, math.floor(middle[0]) - reach
    is_marked = np.zeros((2 * reach + 1, 2 * reach + 1), np.bool_)
    r0, r1, c0, c1 = rows, -1, cols, -1
    num_rays = math.ceil(2 * fov * RANGE / cell) + 1
    for ray in range(num_rays):
        angle = heading - math.pi / 2 + fov * (ray / (num_rays - 1) - 0.5)
        du, dv = math.cos(angle), math.sin(angle)
        has_left = False
        for step in range(int(2 * RANGE / cell) + 1):
            r, c = math.floor(middle[1] + 0.5 * step * dv), math.floor(middle[0] + 0.5 * step * du)
            if not (0 <= r < rows and 0 <= c < cols):
                break
            if blocked[r, c]:
                if has_left or 0.5 * step * cell > _LEAVE:
                    break
                continue
            has_left = True
            if is_marked[r - corner[0], c - corner[1]]:
                continue
            is_marked[r - corner[0], c - corner[1]] = True
            for near_r in range(max(r - 1, 0), min(r + 2, rows)):
                for near_c in range(max(c - 1, 0), min(c + 2, cols)):
                    if not (blocked[near_r, near_c] or explored[near_r, near_c]):
                        is_new = explored[near_r, near_c] = True
            r0, r1, c0, c1 = min(r0, r - 1), max(r1, r + 1), min(c0, c - 1), max(c1, c + 1)
    return is_new, (max(r0, 0), min(r1, rows - 1), max(c0, 0), min(c1, cols - 1))
