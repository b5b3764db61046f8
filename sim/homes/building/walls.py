"""Walls as quads: straight pieces with two faces and skirting, and dark rims that mark them where a storey is cut.

All homes are built of such pieces. `add_wall` builds a wall of a plan from pieces around its doors and windows.
"""

import itertools
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...types import CUT_HEIGHT
from ..plan import Finish, HomePlan, Opening, Rect, Room, Wall
from .fittings import LEAF_THICKNESS, add_door_frame, add_leaf, add_pane, add_railing, add_strip, add_window
from .quads import QuadBuilder, spot_on_wall

SKIRTING = 0.08
_SKIRTING_DEPTH = 0.012
SKIRTING_FINISH = Finish(material="wood", rgb=(206, 178, 142))
CEILING_FINISH = Finish(material="plaster", rgb=(244, 243, 238))
CAP_FINISH = Finish(material="plaster", rgb=(70, 70, 76))
_RAILING = 1.2
"""Walls lower than this are railings (metres)."""
_OUTSIDE_FINISH = Finish(material="plaster", rgb=(206, 198, 184))
_BEYOND = 0.2
"""Distance from a wall's middle line at which the room on each side is looked up (metres)."""
_LEAF_GAP = 0.025
"""Gap between an open leaf and the wall (metres)."""
_LEAF_FREE = 0.08
"""Least distance of an open leaf from everything else (metres)."""

Point = NDArray[np.float64]


class WallPiece(NamedTuple):
    """A straight piece of wall of one height; its ground plan has four corners, world (x, z) in metres."""

    left_start: Point
    left_end: Point
    right_start: Point
    right_end: Point
    """Corners of the ground plan, (2,) each; left is the left side seen from above from start to end."""
    bottom: float
    top: float
    """World heights of its lower and upper edge."""
    left: Finish | None
    right: Finish | None
    """Finish of each side; None = nobody can see that side."""
    skirting: bool = True
    """Whether the piece stands on the floor."""
    rims: tuple[float, ...] = ()
    """World heights of the rims that are seen from above."""
    ends: tuple[bool, bool] = (False, False)
    """Whether its start and its end can be seen."""
    end_finish: Finish | None = None
    """Finish of the ends; None = the finish of the left side, or else of the right side."""
    has_top: bool = False
    """Whether its top can be seen, like that of a railing."""
    has_underside: bool = False
    """Whether it can be seen from below, like a lintel."""


def add_wall_piece(builder: QuadBuilder, piece: WallPiece) -> None:
    """Adds the faces, ends, rims and skirting of a piece."""
    if piece.top - piece.bottom < 1e-6:
        return
    low, high = piece.bottom, piece.top
    foot = min(low + SKIRTING, high) if piece.skirting else low
    if piece.left is not None:
        _add_side(builder, piece.left_end, piece.left_start, (low, foot, high), piece.left)
    if piece.right is not None:
        _add_side(builder, piece.right_start, piece.right_end, (low, foot, high), piece.right)
    finish = piece.end_finish or piece.left or piece.right
    assert finish is not None
    if piece.ends[0]:
        builder.add_quads(upright(piece.left_start, piece.right_start, low, high)[None], finish)
    if piece.ends[1]:
        builder.add_quads(upright(piece.right_end, piece.left_end, low, high)[None], finish)
    plan = np.array([piece.left_start, piece.right_start, piece.right_end, piece.left_end])
    for height in piece.rims if _is_convex(plan) else ():
        builder.add_quads(_at(plan, height)[None], CAP_FINISH)
    if piece.has_top:
        builder.add_quads(_at(plan, high)[None], finish)
    if piece.has_underside:
        builder.add_quads(_at(plan, low)[None, ::-1], finish)


def _is_convex(plan: NDArray[np.float64]) -> bool:
    """Whether the four corners (4, 2) turn one way; where mitres cross, a rim would stick out of the wall."""
    after = [1, 2, 3, 0]
    sides = plan[after] - plan
    turns = sides[:, 0] * sides[after, 1] - sides[:, 1] * sides[after, 0]
    return bool((turns >= -1e-9).all() or (turns <= 1e-9).all())


def upright(start: ArrayLike, end: ArrayLike, low: float, high: float) -> NDArray[np.float64]:
    """An upright quad (4, 3) over a line from `start` to `end` (x, z), seen from the right of that line."""
    (xa, za), (xb, zb) = np.asarray(start, float), np.asarray(end, float)
    return np.array([(xa, low, za), (xb, low, zb), (xb, high, zb), (xa, high, za)])


def _add_side(
    builder: QuadBuilder, start: Point, end: Point, heights: tuple[float, float, float], finish: Finish
) -> None:
    """Adds one face over a line, seen from the line's right; the skirting stands a little in front of it."""
    low, foot, high = heights
    along = end - start
    length = float(np.hypot(*along))
    if length < 1e-9:
        return
    builder.add_quads(upright(start, end, low, high)[None], finish)
    if foot > low:
        out = np.array([-along[1], along[0]]) / length * _SKIRTING_DEPTH
        front = upright(start + out, end + out, low, foot)
        ledge = np.array([front[3], front[2], *upright(start, end, low, foot)[[2, 3]]])
        builder.add_quads(np.stack([front, ledge]), SKIRTING_FINISH)


def _at(plan: NDArray[np.float64], height: float) -> NDArray[np.float64]:
    """A level quad (4, 3) at a height over four points (x, z)."""
    return np.stack([plan[:, 0], np.full(4, height), plan[:, 1]], axis=1)


class _PlanWall(NamedTuple):
    """A wall of a plan with its own directions on the floor plane."""

    plan: HomePlan
    wall: Wall
    along: Point
    left: Point
    """(2,) world (x, z); unit vectors."""

    @property
    def half(self) -> float:
        """Half of the wall's thickness, metres."""
        return self.wall.thickness / 2

    @property
    def floor_y(self) -> float:
        """World height of its storey's floor."""
        return self.plan.storeys[self.wall.storey].floor_y

    def at(self, offset: float, across: float = 0.0) -> Point:
        """World (x, z) of a place `offset` metres from the start and `across` metres to the left, (2,)."""
        return np.array(self.wall.start) + self.along * offset + self.left * across

    def room(self, offset: float, side: int) -> Room | None:
        """The room of its storey on the left (side 1) or on the right (-1), `offset` metres from the start."""
        x, z = self.at(offset, side * _BEYOND).tolist()
        rooms = (room for room in self.plan.rooms if room.storey == self.wall.storey)
        return next((room for room in rooms if room.rect is not None and room.rect.holds(x, z)), None)


def add_wall(builder: QuadBuilder, plan: HomePlan, wall: Wall) -> None:
    """Adds a wall around its openings, with doors and windows in them, or a railing."""
    along = (np.array(wall.end) - np.array(wall.start)) / wall.length
    site = _PlanWall(plan, wall, along, np.array([along[1], -along[0]]))
    if wall.height < _RAILING:
        feet = np.array([[x, site.floor_y, z] for x, z in (wall.start, wall.end)])
        add_railing(builder, feet, height=wall.height)
        return
    at = 0.0
    for opening in sorted(wall.openings, key=lambda opening: opening.offset):
        left, right = opening.offset - opening.width / 2, opening.offset + opening.width / 2
        _add_solid(builder, site, (at, left))
        _add_span(builder, site, (left, right), (0.0, opening.sill))
        _add_span(builder, site, (left, right), (opening.top, wall.height))
        _add_opening(builder, site, opening)
        at = right
    _add_solid(builder, site, (at, wall.length))


def _add_solid(builder: QuadBuilder, site: _PlanWall, span: tuple[float, float]) -> None:
    """Adds a piece of full height, split where another room begins, so that every room gets its own finish."""
    cuts = [span[0], *(edge for edge in _room_edges(site) if span[0] < edge < span[1]), span[1]]
    for low, high in itertools.pairwise(cuts):
        ends = (low == span[0], high == span[1])
        _add_span(builder, site, (low, high), (0.0, site.wall.height), ends=ends)


def _room_edges(site: _PlanWall) -> list[float]:
    """Metres along the wall at which rooms of its storey begin or end."""
    wall = site.wall
    axis = 0 if wall.is_along_x else 1
    sign = 1 if wall.end[axis] > wall.start[axis] else -1
    rects = [room.rect for room in site.plan.rooms if room.storey == wall.storey and room.rect is not None]
    return sorted({(edge - wall.start[axis]) * sign for rect in rects for edge in (rect[axis], rect[axis + 2])})


def _add_span(
    builder: QuadBuilder,
    site: _PlanWall,
    span: tuple[float, float],
    heights: tuple[float, float],
    *,
    ends: tuple[bool, bool] = (False, False),
) -> None:
    """Adds one solid piece of a wall, with a rim where a storey is cut."""
    if span[1] - span[0] < 1e-6 or heights[1] - heights[0] < 1e-6:
        return
    rooms = [site.room((span[0] + span[1]) / 2, side) for side in (1, -1)]
    left, right = (room.wall if room is not None else _OUTSIDE_FINISH for room in rooms)
    low, high = heights
    cut = CUT_HEIGHT - 0.004
    add_wall_piece(
        builder,
        WallPiece(
            *(site.at(offset, side * site.half) for side in (1, -1) for offset in span),
            bottom=site.floor_y + low,
            top=site.floor_y + high,
            left=left,
            right=right,
            skirting=low == 0 and high > low,
            rims=(site.floor_y + cut,) if low < cut < high else (),
            ends=ends,
            end_finish=left if rooms[0] is not None else right,
            has_top=True,
            has_underside=low > 0,
        ),
    )


def _add_opening(builder: QuadBuilder, site: _PlanWall, opening: Opening) -> None:
    """Adds a window on the side of its room, or a door's frame, threshold and leaf."""
    rooms = [site.room(opening.offset, side) for side in (1, -1)]
    size, low = (opening.width, opening.top - opening.sill), site.floor_y + opening.sill
    if opening.kind == "window":
        side = 1 if rooms[0] is not None else -1
        spot = spot_on_wall(site.at(opening.offset, side * site.half), site.left * side, low)
        add_window(builder, spot, size, depth=site.half)
        add_pane(builder, spot_on_wall(site.at(opening.offset, -side * 0.01), site.left * -side, low), size)
        return
    spot = spot_on_wall(site.at(opening.offset), site.left, low)
    add_door_frame(builder, spot, size, thickness=site.wall.thickness)
    floors = [room.floor for room in rooms if room is not None]
    if len(floors) == 2 and floors[0] != floors[1]:
        add_strip(builder, spot, opening.width - 0.1)
    _add_open_leaf(builder, site, opening)


def _add_open_leaf(builder: QuadBuilder, site: _PlanWall, opening: Opening) -> None:
    """Adds a leaf folded back against the wall, at the first free one of four places; none if no place is free."""
    width = opening.width - 0.04
    for side, end in itertools.product((1, -1), (1, -1)):
        hinge = opening.offset + end * (opening.width / 2 + 0.01)
        first, last = sorted((hinge, hinge + end * width))
        if not _is_free(site, opening, (first, last), side):
            continue
        # the leaf's x runs to the right of its face, so on the wall's left it runs against the wall's direction
        origin = site.at(last if side > 0 else first, side * (site.half + _LEAF_GAP))
        spot = spot_on_wall(origin, site.left * side, site.floor_y + 0.01)
        add_leaf(builder, spot, (width, opening.top - 0.03), is_hinged_right=(side < 0) != (end > 0))
        return


def _is_free(site: _PlanWall, opening: Opening, span: tuple[float, float], side: int) -> bool:
    """Whether a leaf on one side of the wall hides and meets nothing, with a single room in front of it."""
    plan, wall = site.plan, site.wall
    if span[0] < _LEAF_FREE or span[1] > wall.length - _LEAF_FREE:
        return False
    for other in wall.openings:
        if other is not opening and abs(other.offset - (span[0] + span[1]) / 2) < (other.width + span[1] - span[0]) / 2:
            return False
    near, far = site.half + _LEAF_GAP, site.half + _LEAF_GAP + LEAF_THICKNESS + 0.04
    corners = [site.at(offset, side * across) for offset in span for across in (near, far)]
    zone = Rect(*np.min(corners, axis=0).tolist(), *np.max(corners, axis=0).tolist()).grown(_LEAF_FREE)
    for piece in plan.furniture:
        if abs(piece.centre[1] - site.floor_y - 1.0) < 1.0 + piece.size[1] / 2 and zone.overlaps(piece.rect):
            return False
    for other in plan.walls:
        is_other = other.storey == wall.storey and other is not wall
        if is_other and zone.overlaps(other.line.grown(other.thickness / 2)):
            return False
    stairs = [stair.rect for stair in plan.stairs if stair.storey in (wall.storey, wall.storey - 1)]
    if any(zone.overlaps(rect) for rect in stairs):
        return False
    rooms = [site.room(offset, side) for offset in span]
    return rooms[0] is not None and rooms[0] is rooms[1]
