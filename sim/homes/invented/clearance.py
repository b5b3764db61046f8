"""Checks that a planned home can be walked through and its pieces seen, from their boxes, before there is a mesh."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, label

from sim.types import AGENT_RADIUS, Camera

from ..plan import HomePlan, Rect, Wall
from .layouts import landings

CELL = 0.05
_CLEARANCE = AGENT_RADIUS + 0.04
"""A little more than the robot's radius (metres)."""
_OVERHEAD = 1.0
"""Pieces that hang above this height do not block the way (metres)."""
_FLAT = 0.1
_LEAST_SHARE = 0.85
"""Least share of a room's free floor that can be walked to."""
_LEAST_AREA = 0.8
"""Least area of every room that can be walked to, square metres."""
_REACHES = (1.0, 1.5)
"""Planar metres within which a piece must be visible (view_points_around); the second if the first has no place."""
_STEEPEST = 1.0
"""Steepest line of sight, radians; one look up or down shows about this much."""
_EYES = 30


class Ground(NamedTuple):
    """The floor of one storey in cells."""

    origin: tuple[float, float]
    reached: NDArray[np.bool_]
    """(rows, cols) cells that the robot's centre can reach."""

    def places(self) -> NDArray[np.float64]:
        """(N, 2) x and z of the reached cells."""
        rows, cols = np.nonzero(self.reached)
        return np.stack([cols, rows], axis=1).astype(np.float64) * CELL + CELL / 2 + np.array(self.origin)


def walkable_ground(plan: HomePlan) -> list[Ground] | None:
    """The floor of each storey that can be walked to; None where a room or a stair cannot be reached."""
    found: list[Ground] = []
    for storey in range(len(plan.storeys)):
        ground = _ground(plan, storey)
        if ground is None:
            return None
        found.append(ground)
    return found


def unseen_pieces(plan: HomePlan, ground: Sequence[Ground]) -> set[int]:
    """Indices of pieces that cannot be seen from nearby; a strict check, as if every piece filled its box."""
    found: set[int] = set()
    for storey, floor in enumerate(ground):
        rooms = {room.name for room in plan.rooms if room.storey == storey}
        index = [k for k, piece in enumerate(plan.furniture) if piece.room in rooms]
        boxes = np.array([plan.furniture[k].box for k in index]).reshape(-1, 6)
        walls = np.array([box for wall in plan.walls if wall.storey == storey for box in _wall_boxes(plan, wall)])
        eye_y = plan.storeys[storey].floor_y + Camera().mount_height
        places = floor.places()
        for row, k in enumerate(index):
            others = np.concatenate([np.delete(boxes, row, axis=0), walls])
            if not _is_seen(boxes[row], others, places, eye_y):
                found.add(k)
    return found


def _ground(plan: HomePlan, storey: int) -> Ground | None:
    rooms = [room for room in plan.rooms if room.storey == storey]
    rects = [room.rect for room in rooms if room.rect is not None]
    origin = (min(rect.x0 for rect in rects) - 0.5, min(rect.z0 for rect in rects) - 0.5)
    far = (max(rect.x1 for rect in rects) + 0.5, max(rect.z1 for rect in rects) + 0.5)
    free = np.zeros((round((far[1] - origin[1]) / CELL), round((far[0] - origin[0]) / CELL)), bool)
    for rect in rects:
        free[_cells(rect, origin)] = True
    for wall in plan.walls:
        if wall.storey == storey:
            for rect in _wall_rects(wall):
                free[_cells(rect, origin)] = False
    floor_y = plan.storeys[storey].floor_y
    names = {room.name for room in rooms}
    for piece in plan.furniture:
        low = piece.centre[1] - piece.size[1] / 2 - floor_y
        if piece.room in names and piece.size[1] > _FLAT and low < _OVERHEAD:
            free[_cells(piece.rect, origin)] = False
    for stair in plan.stairs:
        free[_cells(stair.rect, origin)] = False
    standing = np.asarray(distance_transform_edt(free)) * CELL > _CLEARANCE
    if not standing.any():
        return None
    parts = np.zeros(standing.shape, np.int32)
    label(standing, output=parts)
    reached = parts == 1 + np.bincount(parts[standing] - 1).argmax()
    rect_ok = all(_is_open(rect, standing, reached, origin) for rect in rects)
    ends = [landings(stair)[0 if stair.storey == storey else 1] for stair in plan.stairs]
    if not rect_ok or not all(reached[_cells(end, origin)].any() for end in ends):
        return None
    return Ground(origin, reached)


def _is_open(rect: Rect, standing: NDArray[np.bool_], reached: NDArray[np.bool_], origin: tuple[float, float]) -> bool:
    cells = _cells(rect, origin)
    area = float(reached[cells].sum()) * CELL**2
    return area >= _LEAST_AREA and area >= _LEAST_SHARE * float(standing[cells].sum()) * CELL**2


def _cells(rect: Rect, origin: tuple[float, float]) -> tuple[slice, slice]:
    """The cells that a rectangle touches."""
    row = slice(
        max(0, int(np.floor((rect.z0 - origin[1]) / CELL + 1e-6))), int(np.ceil((rect.z1 - origin[1]) / CELL - 1e-6))
    )
    col = slice(
        max(0, int(np.floor((rect.x0 - origin[0]) / CELL + 1e-6))), int(np.ceil((rect.x1 - origin[0]) / CELL - 1e-6))
    )
    return row, col


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


def _wall_boxes(plan: HomePlan, wall: Wall) -> list[tuple[float, ...]]:
    floor_y = plan.storeys[wall.storey].floor_y
    return [(r.x0, floor_y, r.z0, r.x1, floor_y + wall.height, r.z1) for r in _wall_rects(wall)]


def _is_seen(box: NDArray, others: NDArray, places: NDArray, eye_y: float) -> bool:
    """Whether any place near the box has a free line to a point of its surface."""
    low, high = box[:3], box[3:]
    overlapping = ((others[:, :3] < high - 1e-6) & (others[:, 3:] > low + 1e-6)).all(axis=1)
    others = others[~overlapping]  # a couch does not hide its cushion
    centre = (low + high) / 2
    away = np.hypot(*(places - centre[[0, 2]]).T)
    targets = _surface_points(low, high)
    for reach in _REACHES:
        near = places[away <= reach]
        near = near[:: max(1, len(near) // _EYES)]
        if not len(near):
            continue
        eyes = np.stack([near[:, 0], np.full(len(near), eye_y), near[:, 1]], axis=1)
        if _free_lines(eyes, targets, others).any():
            return True
    return False


def _surface_points(low: NDArray, high: NDArray) -> NDArray[np.float64]:
    """(14, 3) middles of five faces and of the quarters of the top, and points near the upper edges."""
    shares = np.array(
        [(0.5, 1, 0.5), (0.2, 1, 0.2), (0.8, 1, 0.2), (0.2, 1, 0.8), (0.8, 1, 0.8), (0.5, 0.6, 0), (0.5, 0.6, 1),
         (0, 0.6, 0.5), (1, 0.6, 0.5)]
    )  # fmt: skip
    out = np.array([0.004, 0.004, 0.004])
    return low - out + shares * (high - low + 2 * out)


def _free_lines(eyes: NDArray, targets: NDArray, boxes: NDArray) -> NDArray[np.bool_]:
    """(E, T) whether the line from eye to target meets no box and is not too steep."""
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
