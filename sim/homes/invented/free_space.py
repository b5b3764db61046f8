"""Finds free space in an invented home before it has a mesh: for more pieces, the robot's path, and its view.

arrange.py asks `FreeSpace` for each group of pieces; plans.py checks the finished home with `walkable_floor` and
`unseen_pieces`.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.types import AGENT_RADIUS, RELAXED_RADIUS, SUCCESS_RADIUS, Camera, GridSpec

from ..cells import CELL
from ..images import distance_to, parts_of
from ..plan import HomePlan, Rect, Wall
from .layouts import HALF_WALL, landings
from .partitions import Partition

GAP = 0.12
"""Least distance between pieces on the floor (metres)."""
FRONT = 0.7
"""Free depth in front of a piece (metres); the robot needs 0.36 m."""
_TALL = 0.9
"""Pieces of at least this height would cover a window (metres)."""
_DOOR_DEPTH = 1.0
_CLEARANCE = AGENT_RADIUS + 0.04
"""A little more than the robot's radius (metres)."""
_OVERHEAD = 1.0
"""Pieces that hang above this height do not block the way (metres)."""
_FLAT = 0.1
_LEAST_SHARE = 0.85
"""Least share of a room's free floor that the robot can reach."""
_LEAST_AREA = 0.8
"""Least area of a room's floor that the robot can reach (square metres)."""
_STEEPEST = 1.0
"""Steepest line of sight (radians); one look up or down shows about this angle."""
_EYES = 30
_ROUNDING = 1e-6


class Body(NamedTuple):
    """The space that a piece of furniture takes."""

    rect: Rect
    low: float
    high: float
    """Lower and upper end above the floor, metres."""


class Pane(NamedTuple):
    """A window seen from above."""

    middle: tuple[float, float]
    """The window's middle (x, z)."""
    width: float


class ReachedFloor(NamedTuple):
    """The floor of one storey in cells."""

    grid: GridSpec
    reached: NDArray[np.bool_]
    """(rows, cols) cells that the robot's centre can reach."""

    def places(self) -> NDArray[np.float64]:
        """World x and z of the reached cells, (N, 2)."""
        return self.grid.xz_from_rc(np.argwhere(self.reached))


class FreeSpace:
    """One room while it is being furnished: pieces take space until it is full."""

    def __init__(self, rect: Rect, partition: Partition, *, blocked: Sequence[Rect]) -> None:
        """Starts with an empty room.

        Args:
            rect: Middle lines of its walls.
            partition: The storey's walls and gaps; those far from the room have no effect.
            blocked: Areas where nothing may stand: stairs and the floor at their ends.
        """
        self.inner = rect.grown(-HALF_WALL)
        openings = [(wall, opening) for wall in partition.walls for opening in wall.openings]
        doors = [wall.floor_beside(o, depth=_DOOR_DEPTH, margin=0.1) for wall, o in openings if o.kind == "door"]
        gaps = [_widened(gap, 0.85) for gap in partition.gaps]
        self._panes = [wall.floor_beside(o, depth=0.3, margin=0.02) for wall, o in openings if o.kind == "window"]
        self._keep_free = [*blocked, *doors, *gaps]
        self.windows = [
            Pane(wall.middle_of(o), o.width)
            for wall, o in openings
            if o.kind == "window" and rect.grown(0.01).holds(*wall.middle_of(o))
        ]
        self._bodies: list[Body] = []
        self._fronts: list[Rect] = []

    def take_floor(self, bodies: Sequence[Body], front: Rect) -> bool:
        """Takes the space of a group if it fits with a free strip in front of it; returns whether it does."""
        whole = bounds([body.rect for body in bodies])
        standing = [body for body in self._bodies if body.low < 1.5]
        if not self.inner.grown(0.001).holds_rect(whole) or not self.inner.grown(0.01).holds_rect(front):
            return False
        if any(whole.overlaps(zone) for zone in self._keep_free) or any(whole.overlaps(zone) for zone in self._fronts):
            return False
        if any(whole.grown(GAP).overlaps(body.rect) or front.overlaps(body.rect) for body in standing):
            return False
        if any(body.high > _TALL and body.rect.overlaps(pane) for body in bodies for pane in self._panes):
            return False
        if any(body.rect.overlaps(hung.rect) and body.high > hung.low for body in bodies for hung in self._bodies):
            return False
        self._bodies += bodies
        self._fronts.append(front)
        return True

    def take_wall(self, body: Body, *, beside_window: bool = False) -> bool:
        """Takes the space of a hanging piece if it fits here above the pieces below; returns whether it does."""
        near = body.rect.grown(0.06)
        if not self.inner.grown(0.001).holds_rect(body.rect) or any(near.overlaps(zone) for zone in self._keep_free):
            return False
        if not beside_window and any(near.overlaps(pane) for pane in self._panes):
            return False
        if any(
            near.overlaps(other.rect) and body.low < other.high + 0.05 and other.low < body.high
            for other in self._bodies
        ):
            return False
        self._bodies.append(body)
        return True

    def take_flat(self, rect: Rect) -> bool:
        """Takes the space of a rug, over which people walk, if it fits here; returns whether it does."""
        blocked = (*self._keep_free, *(body.rect for body in self._bodies if body.low < 0.5))
        if not self.inner.holds_rect(rect) or any(rect.overlaps(zone) for zone in blocked):
            return False
        self._bodies.append(Body(rect, 0.0, 0.02))
        return True


def bounds(rects: Sequence[Rect]) -> Rect:
    """The smallest rectangle around all these rectangles."""
    x0, z0, x1, z1 = zip(*rects, strict=True)
    return Rect(min(x0), min(z0), max(x1), max(z1))


def walkable_floor(plan: HomePlan) -> list[ReachedFloor] | None:
    """The floor of each storey that the robot can reach; None where it cannot reach a room or a stair."""
    found = [_reached_floor(plan, storey) for storey in range(len(plan.storeys))]
    reached = [floor for floor in found if floor is not None]
    return reached if len(reached) == len(found) else None


def unseen_pieces(plan: HomePlan, floors: Sequence[ReachedFloor]) -> set[int]:
    """Indices of pieces that cannot be seen from nearby; a strict check, in which every piece fills its box."""
    found: set[int] = set()
    for storey, floor in enumerate(floors):
        rooms = {room.name for room in plan.rooms if room.storey == storey}
        index = [k for k, piece in enumerate(plan.furniture) if piece.room in rooms]
        boxes = np.array([plan.furniture[k].box for k in index]).reshape(-1, 6)
        floor_y = plan.storeys[storey].floor_y
        eye_y = floor_y + Camera().mount_height
        solids = [(rect, wall) for wall in plan.walls if wall.storey == storey for rect in _wall_rects(wall)]
        walls = np.array([(r.x0, floor_y, r.z0, r.x1, floor_y + wall.height, r.z1) for r, wall in solids])
        places = floor.places()
        for row, k in enumerate(index):
            others = np.concatenate([np.delete(boxes, row, axis=0), walls])
            if not _is_seen(boxes[row], others, places, eye_y):
                found.add(k)
    return found


def _widened(line: Rect, depth: float) -> Rect:
    """The floor on both sides of a line without width."""
    if line.z0 == line.z1:
        return Rect(line.x0, line.z0 - depth, line.x1, line.z1 + depth)
    return Rect(line.x0 - depth, line.z0, line.x1 + depth, line.z1)


def _reached_floor(plan: HomePlan, storey: int) -> ReachedFloor | None:
    rooms = [room for room in plan.rooms if room.storey == storey]
    rects = [room.rect for room in rooms if room.rect is not None]
    whole = bounds(rects).grown(0.5)
    shape = (round((whole.z1 - whole.z0) / CELL), round((whole.x1 - whole.x0) / CELL))
    grid = GridSpec((whole.x0, whole.z0), CELL, shape)
    free = np.zeros(shape, bool)
    for rect in rects:
        free[rect.cells(grid, slack=_ROUNDING)] = True
    for wall in plan.walls:
        if wall.storey == storey:
            for rect in _wall_rects(wall):
                free[rect.cells(grid, slack=_ROUNDING)] = False
    floor_y = plan.storeys[storey].floor_y
    names = {room.name for room in rooms}
    for piece in plan.furniture:
        low = piece.bottom_y - floor_y
        if piece.room in names and piece.size[1] > _FLAT and low < _OVERHEAD:
            free[piece.rect.cells(grid, slack=_ROUNDING)] = False
    for stair in plan.stairs:
        free[stair.rect.cells(grid, slack=_ROUNDING)] = False
    standing = distance_to(~free) * CELL > _CLEARANCE
    if not standing.any():
        return None
    parts, _ = parts_of(standing)
    reached = parts == 1 + np.bincount(parts[standing] - 1).argmax()
    rect_ok = all(_is_open(rect, standing, reached, grid) for rect in rects)
    ends = [landings(stair)[0 if stair.storey == storey else 1] for stair in plan.stairs]
    if not rect_ok or not all(reached[end.cells(grid, slack=_ROUNDING)].any() for end in ends):
        return None
    return ReachedFloor(grid, reached)


def _is_open(rect: Rect, standing: NDArray[np.bool_], reached: NDArray[np.bool_], grid: GridSpec) -> bool:
    cells = rect.cells(grid, slack=_ROUNDING)
    area = float(reached[cells].sum()) * CELL**2
    return area >= _LEAST_AREA and area >= _LEAST_SHARE * float(standing[cells].sum()) * CELL**2


def _wall_rects(wall: Wall) -> list[Rect]:
    """The solid parts of a wall between its doors."""
    at = [0.0]
    for opening in sorted(wall.openings, key=lambda opening: opening.offset):
        if opening.kind == "door":
            at += [opening.offset - opening.width / 2, opening.offset + opening.width / 2]
    at.append(wall.length)
    half = wall.thickness / 2
    x, z = wall.start
    return [
        Rect(x + a, z - half, x + b, z + half) if wall.is_along_x else Rect(x - half, z + a, x + half, z + b)
        for a, b in zip(at[::2], at[1::2], strict=True)
    ]


def _is_seen(box: NDArray, others: NDArray, places: NDArray, eye_y: float) -> bool:
    """Whether a place as near as those of `view_points_around` has a free line to a point of the box's surface."""
    low, high = box[:3], box[3:]
    overlapping = ((others[:, :3] < high - 1e-6) & (others[:, 3:] > low + 1e-6)).all(axis=1)
    others = others[~overlapping]  # a couch does not hide its cushion
    centre = (low + high) / 2
    away = np.hypot(*(places - centre[[0, 2]]).T)
    targets = _surface_points(low, high)
    for reach in (SUCCESS_RADIUS, RELAXED_RADIUS):
        near = places[away <= reach]
        near = near[:: max(1, len(near) // _EYES)]
        if not len(near):
            continue
        eyes = np.stack([near[:, 0], np.full(len(near), eye_y), near[:, 1]], axis=1)
        if _free_lines(eyes, targets, others).any():
            return True
    return False


def _surface_points(low: NDArray, high: NDArray) -> NDArray[np.float64]:
    """Points (9, 3) just outside a box: five above its top, and one beside each side at 0.6 of the height."""
    shares = np.array(
        [(0.5, 1, 0.5), (0.2, 1, 0.2), (0.8, 1, 0.2), (0.2, 1, 0.8), (0.8, 1, 0.8), (0.5, 0.6, 0), (0.5, 0.6, 1),
         (0, 0.6, 0.5), (1, 0.6, 0.5)]
    )  # fmt: skip
    out = np.array([0.004, 0.004, 0.004])
    return low - out + shares * (high - low + 2 * out)


def _free_lines(eyes: NDArray, targets: NDArray, boxes: NDArray) -> NDArray[np.bool_]:
    """Whether the line from each eye to each target meets no box and is not too steep, (E, T)."""
    to = targets[None] - eyes[:, None]  # (E, T, 3)
    steep = np.abs(np.arctan2(to[..., 1], np.hypot(to[..., 0], to[..., 2]))) > _STEEPEST
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1.0 / np.where(np.abs(to) < 1e-9, 1e-9, to)
        a = (boxes[:, None, None, :3] - eyes[None, :, None]) * inverse
        b = (boxes[:, None, None, 3:] - eyes[None, :, None]) * inverse
    enter = np.minimum(a, b).max(axis=-1)
    leave = np.maximum(a, b).min(axis=-1)
    blocked = ((enter < leave) & (leave > 1e-6) & (enter < 0.999)).any(axis=0)
    return ~blocked & ~steep
