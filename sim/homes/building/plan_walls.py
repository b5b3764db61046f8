"""Walls of invented homes: solid pieces around their openings, each side in its room's finish, doors and windows."""

import itertools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...types import CUT_HEIGHT
from ..plan import Finish, HomePlan, Opening, Rect, Room, Wall
from .openings import LEAF_THICKNESS, add_door_frame, add_leaf, add_pane, add_strip, add_window, spot_on_wall
from .quads import QuadBuilder
from .stairs_mesh import add_railing
from .walls import WallPiece, add_wall_piece

RAILING = 1.2
"""Walls lower than this are railings (metres)."""
_OUTSIDE_FINISH = Finish(material="plaster", rgb=(206, 198, 184))
_BEYOND = 0.2
"""Which room a side of a wall belongs to is looked up so far from its middle (metres)."""
_LEAF_GAP = 0.025
"""Between an open leaf and the wall (metres)."""
_LEAF_FREE = 0.08
"""An open leaf keeps this far from everything (metres)."""

Point = NDArray[np.float64]


class _Frame(NamedTuple):
    """A wall's own directions on the floor plane."""

    start: Point
    along: Point
    left: Point
    """(2,) world (x, z); unit vectors."""
    half: float
    """Half of its thickness, metres."""

    def at(self, offset: float, across: float = 0.0) -> Point:
        """(2,) world (x, z) of a place `offset` metres from the start and `across` to the left."""
        return self.start + self.along * offset + self.left * across


def add_wall(builder: QuadBuilder, plan: HomePlan, wall: Wall) -> None:
    """A wall around its openings with what fills them, or a railing."""
    along = (np.array(wall.end) - np.array(wall.start)) / wall.length
    frame = _Frame(np.array(wall.start), along, np.array([along[1], -along[0]]), wall.thickness / 2)
    floor_y = plan.storeys[wall.storey].floor_y
    if wall.height < RAILING:
        feet = np.array([[x, floor_y, z] for x, z in (wall.start, wall.end)])
        add_railing(builder, feet, height=wall.height)
        return
    at = 0.0
    for opening in sorted(wall.openings, key=lambda opening: opening.offset):
        left, right = opening.offset - opening.width / 2, opening.offset + opening.width / 2
        _add_solid(builder, plan, wall, frame, (at, left))
        _add_span(builder, plan, wall, frame, (left, right), (0.0, opening.sill))
        _add_span(builder, plan, wall, frame, (left, right), (opening.top, wall.height))
        _add_opening(builder, plan, wall, frame, opening)
        at = right
    _add_solid(builder, plan, wall, frame, (at, wall.length))


def _add_solid(builder: QuadBuilder, plan: HomePlan, wall: Wall, frame: _Frame, span: tuple[float, float]) -> None:
    """A piece of full height, split where another room begins so that every room gets its own finish."""
    edges = _room_edges(plan, wall)
    cuts = [span[0], *(edge for edge in edges if span[0] < edge < span[1]), span[1]]
    for low, high in itertools.pairwise(cuts):
        ends = (low == span[0], high == span[1])
        _add_span(builder, plan, wall, frame, (low, high), (0.0, wall.height), ends=ends)


def _room_edges(plan: HomePlan, wall: Wall) -> list[float]:
    """Metres along the wall at which rooms of its storey begin or end."""
    axis = 0 if wall.is_along_x else 1
    sign = 1 if wall.end[axis] > wall.start[axis] else -1
    rects = [room.rect for room in plan.rooms if room.storey == wall.storey and room.rect is not None]
    return sorted({(edge - wall.start[axis]) * sign for rect in rects for edge in (rect[axis], rect[axis + 2])})


def _add_span(
    builder: QuadBuilder,
    plan: HomePlan,
    wall: Wall,
    frame: _Frame,
    span: tuple[float, float],
    heights: tuple[float, float],
    *,
    ends: tuple[bool, bool] = (False, False),
) -> None:
    """One solid piece of a wall, with a rim where a storey is cut."""
    if span[1] - span[0] < 1e-6 or heights[1] - heights[0] < 1e-6:
        return
    floor_y = plan.storeys[wall.storey].floor_y
    middle = (span[0] + span[1]) / 2
    rooms = [_room_at(plan, wall.storey, frame.at(middle, side * _BEYOND)) for side in (1, -1)]
    left, right = (room.wall if room is not None else _OUTSIDE_FINISH for room in rooms)
    low, high = heights
    cut = CUT_HEIGHT - 0.004
    add_wall_piece(
        builder,
        WallPiece(
            *(frame.at(offset, side * frame.half) for side in (1, -1) for offset in span),
            bottom=floor_y + low,
            top=floor_y + high,
            left=left,
            right=right,
            skirting=low == 0 and high > low,
            rims=(floor_y + cut,) if low < cut < high else (),
            ends=ends,
            end_finish=left if rooms[0] is not None else right,
            has_top=True,
            has_underside=low > 0,
        ),
    )


def _room_at(plan: HomePlan, storey: int, point: Point) -> Room | None:
    """The room of a storey at a point (x, z)."""
    for room in plan.rooms:
        if room.storey == storey and room.rect is not None and room.rect.holds(float(point[0]), float(point[1])):
            return room
    return None


def _add_opening(builder: QuadBuilder, plan: HomePlan, wall: Wall, frame: _Frame, opening: Opening) -> None:
    """A window that its room looks out of, or a door's frame, threshold and leaf."""
    floor_y = plan.storeys[wall.storey].floor_y
    rooms = [_room_at(plan, wall.storey, frame.at(opening.offset, side * _BEYOND)) for side in (1, -1)]
    height = opening.top - opening.sill
    if opening.kind == "window":
        side = 1 if rooms[0] is not None else -1
        spot = spot_on_wall(frame.at(opening.offset, side * frame.half), frame.left * side, floor_y + opening.sill)
        add_window(builder, spot, (opening.width, height), depth=frame.half)
        back = spot_on_wall(frame.at(opening.offset, -side * 0.01), frame.left * -side, floor_y + opening.sill)
        add_pane(builder, back, (opening.width, height))
        return
    spot = spot_on_wall(frame.at(opening.offset), frame.left, floor_y + opening.sill)
    add_door_frame(builder, spot, (opening.width, height), thickness=wall.thickness)
    floors = [room.floor for room in rooms if room is not None]
    if len(floors) == 2 and floors[0] != floors[1]:
        add_strip(builder, spot, opening.width - 0.1)
    _add_open_leaf(builder, plan, wall, frame, opening)


def _add_open_leaf(builder: QuadBuilder, plan: HomePlan, wall: Wall, frame: _Frame, opening: Opening) -> None:
    """A leaf that is folded back against the wall, at the first of four places where nothing is; else none."""
    floor_y = plan.storeys[wall.storey].floor_y
    width = opening.width - 0.04
    for side, end in itertools.product((1, -1), (1, -1)):
        hinge = opening.offset + end * (opening.width / 2 + 0.01)
        span = sorted((hinge, hinge + end * width))
        across = side * (frame.half + _LEAF_GAP)
        if not _is_free(plan, wall, frame, opening, (span[0], span[1]), side):
            continue
        # the leaf's x runs to the right as its face is seen, which is against the wall's direction on its left
        x_sign = -side
        origin = frame.at(span[0] if x_sign > 0 else span[1], across)
        add_leaf(
            builder, spot_on_wall(origin, frame.left * side, floor_y + 0.01), (width, opening.top - 0.03),
            is_hinged_right=(x_sign > 0) != (end > 0),
        )  # fmt: skip
        return


def _is_free(plan: HomePlan, wall: Wall, frame: _Frame, opening: Opening, span: tuple[float, float], side: int) -> bool:
    """Whether a leaf on one side of the wall hides and meets nothing, and one room is before all of it."""
    if span[0] < _LEAF_FREE or span[1] > wall.length - _LEAF_FREE:
        return False
    for other in wall.openings:
        if other is not opening and abs(other.offset - (span[0] + span[1]) / 2) < (other.width + span[1] - span[0]) / 2:
            return False
    near, far = frame.half + _LEAF_GAP, frame.half + _LEAF_GAP + LEAF_THICKNESS + 0.04
    corners = [frame.at(offset, side * across) for offset in span for across in (near, far)]
    low, high = np.min(corners, axis=0).tolist(), np.max(corners, axis=0).tolist()
    zone = Rect(low[0], low[1], high[0], high[1]).grown(_LEAF_FREE)
    floor_y = plan.storeys[wall.storey].floor_y
    for piece in plan.furniture:
        if abs(piece.centre[1] - floor_y - 1.0) < 1.0 + piece.size[1] / 2 and zone.overlaps(piece.rect):
            return False
    for other in plan.walls:
        if other.storey == wall.storey and other is not wall and zone.overlaps(_rect_of(other)):
            return False
    stairs = [stair.rect for stair in plan.stairs if stair.storey in (wall.storey, wall.storey - 1)]
    if any(zone.overlaps(rect) for rect in stairs):
        return False
    rooms = [_room_at(plan, wall.storey, frame.at(offset, side * _BEYOND)) for offset in span]
    return rooms[0] is not None and rooms[0] is rooms[1]


def _rect_of(wall: Wall) -> Rect:
    (x0, x1), (z0, z1) = (sorted((wall.start[axis], wall.end[axis])) for axis in (0, 1))
    return Rect(x0, z0, x1, z1).grown(wall.thickness / 2)
