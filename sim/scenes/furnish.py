"""HomePlan -> triangles and semantics: rooms, walls, stairs (or cells), and every piece of furniture."""

import itertools

import numpy as np

from .cell_mesh import add_cells
from .cut import CUT_HEIGHT
from .furniture.appearance import tinted
from .furniture.parts import parts_of
from .plan import Finish, Furniture, HomePlan, Opening, Rect, Rgb, Room, Stair, Wall
from .quads import QuadBuilder
from .scene import SceneObject, TriangleMesh

_SKIRTING = 0.08
_TILE = 0.5
_SLAB = 0.2
_FRAME_RGB: Rgb = (120, 92, 66)
_PANE_RGB: Rgb = (176, 206, 226)
_CEILING = Finish(material="plaster", rgb=(244, 243, 238))
_OUTSIDE_RGB: Rgb = (186, 178, 166)
_CAP_RGB: Rgb = (70, 70, 76)
_STAIR_RGB: Rgb = (166, 128, 88)
_LIT = (0.0, 0.6, 0.0)
"""Direction that lights ceilings, which would be dark from below."""


def mesh_from_plan(plan: HomePlan) -> tuple[TriangleMesh, tuple[SceneObject, ...]]:
    """The home as triangles with colours and instance ids, and its objects; ids are 1, 2, ... in the plan's order."""
    builder = QuadBuilder()
    if plan.cells is not None:
        add_cells(builder, plan)
    for room in plan.rooms:
        if room.rect is not None:
            _add_floor_and_ceiling(builder, plan, room, room.rect)
    for wall in plan.walls:
        _add_wall(builder, plan, wall)
    for stair in plan.stairs:
        _add_stair(builder, plan, stair)
    for instance, piece in enumerate(plan.furniture, start=1):
        add_piece(builder, piece, instance=instance)
    return builder.mesh(), tuple(
        SceneObject(instance, piece.name, piece.category, piece.centre, piece.world_size)
        for instance, piece in enumerate(plan.furniture, start=1)
    )


def add_piece(builder: QuadBuilder, piece: Furniture, *, instance: int) -> None:
    """Adds the solids of one piece at its place."""
    cos, sin = np.cos(piece.yaw), np.sin(piece.yaw)
    bottom = piece.centre[1] - piece.size[1] / 2
    for part in parts_of(piece):
        x, y, z = part.centre
        centre = (piece.centre[0] + cos * x + sin * z, bottom + y, piece.centre[2] - sin * x + cos * z)
        size = tuple(max(0.004, value) for value in part.size)
        builder.add_box(
            centre, size, finish=Finish(rgb=part.rgb), yaw=piece.yaw, is_round=part.is_round, instance=instance
        )


def _add_floor_and_ceiling(builder: QuadBuilder, plan: HomePlan, room: Room, rect: Rect) -> None:
    """Floor tiles around stair holes and a ceiling around the next flight's hole."""
    storey = plan.storeys[room.storey]
    holes_below = [stair.rect for stair in plan.stairs if stair.storey == room.storey - 1]
    holes_above = [stair.rect for stair in plan.stairs if stair.storey == room.storey]
    for index, tile in enumerate(_tiles(rect, holes_below)):
        rgb = tinted(room.floor.rgb, 1.0 if index % 2 else 0.95)
        builder.add_quads(_flat_quad(tile, storey.floor_y), Finish(rgb=rgb))
        if room.storey > 0:
            builder.add_quads(_flat_quad(tile, storey.floor_y - _SLAB + 0.001)[::-1], _CEILING, normals=[_LIT])
    for piece in _without(rect, holes_above):
        builder.add_quads(_flat_quad(piece, storey.floor_y + storey.ceiling)[::-1], _CEILING, normals=[_LIT])


def _tiles(rect: Rect, holes: list[Rect]) -> list[Rect]:
    """Planks of about _TILE metres along x that cover the rectangle but not the holes."""
    edges = np.linspace(rect.x0, rect.x1, max(2, round((rect.x1 - rect.x0) / _TILE) + 1))
    planks = [Rect(float(a), rect.z0, float(b), rect.z1) for a, b in itertools.pairwise(edges)]
    return [part for plank in planks for part in _without(plank, holes)]


def _without(rect: Rect, holes: list[Rect]) -> list[Rect]:
    """Rectangles that cover `rect` without the holes."""
    parts = [rect]
    for hole in holes:
        parts = [piece for part in parts for piece in _minus(part, hole)]
    return parts


def _minus(rect: Rect, hole: Rect) -> list[Rect]:
    if not rect.overlaps(hole):
        return [rect]
    x0, x1 = max(rect.x0, hole.x0), min(rect.x1, hole.x1)
    z0, z1 = max(rect.z0, hole.z0), min(rect.z1, hole.z1)
    around = (
        Rect(rect.x0, rect.z0, x0, rect.z1),
        Rect(x1, rect.z0, rect.x1, rect.z1),
        Rect(x0, rect.z0, x1, z0),
        Rect(x0, z1, x1, rect.z1),
    )
    return [part for part in around if part.x1 - part.x0 > 1e-6 and part.z1 - part.z0 > 1e-6]


def _flat_quad(rect: Rect, y: float) -> np.ndarray:
    """(4, 3), facing up."""
    return np.array([(rect.x0, y, rect.z0), (rect.x0, y, rect.z1), (rect.x1, y, rect.z1), (rect.x1, y, rect.z0)])


def _add_wall(builder: QuadBuilder, plan: HomePlan, wall: Wall) -> None:
    """A wall of solid pieces around its openings; each side has the colour of the room that it faces."""
    edges = _room_edges(plan, wall)
    at = 0.0
    for opening in sorted(wall.openings, key=lambda opening: opening.offset):
        left, right = opening.offset - opening.width / 2, opening.offset + opening.width / 2
        _add_solid(builder, plan, wall, (at, left), edges)
        _add_span(builder, plan, wall, (left, right), (0.0, opening.sill))
        _add_span(builder, plan, wall, (left, right), (opening.top, wall.height))
        _add_opening(builder, plan, wall, opening)
        at = right
    _add_solid(builder, plan, wall, (at, wall.length), edges)


def _add_solid(builder: QuadBuilder, plan: HomePlan, wall: Wall, span: tuple[float, float], edges: list[float]) -> None:
    """A piece of full height, split where another room begins so that every room gets its own colour."""
    cuts = [span[0], *(edge for edge in edges if span[0] < edge < span[1]), span[1]]
    for piece in itertools.pairwise(cuts):
        _add_span(builder, plan, wall, piece, (0.0, wall.height))


def _room_edges(plan: HomePlan, wall: Wall) -> list[float]:
    """Metres along the wall at which rooms of its storey begin or end."""
    along_x = wall.start[1] == wall.end[1]
    rects = [room.rect for room in plan.rooms if room.storey == wall.storey and room.rect is not None]
    ends = {edge for rect in rects for edge in ((rect.x0, rect.x1) if along_x else (rect.z0, rect.z1))}
    origin, sign = (
        (wall.start[0], wall.end[0] - wall.start[0]) if along_x else (wall.start[1], wall.end[1] - wall.start[1])
    )
    return sorted((edge - origin) * (1 if sign > 0 else -1) for edge in ends)


def _frame_of(wall: Wall) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors (3,) along the wall and to its left side."""
    along = np.array([wall.end[0] - wall.start[0], 0.0, wall.end[1] - wall.start[1]]) / wall.length
    return along, np.array([along[2], 0.0, -along[0]])


def _add_span(
    builder: QuadBuilder, plan: HomePlan, wall: Wall, span: tuple[float, float], heights: tuple[float, float]
) -> None:
    """One solid piece of a wall, cut at the skirting and at CUT_HEIGHT so that a storey cut is clean."""
    if span[1] - span[0] < 1e-6 or heights[1] - heights[0] < 1e-6:
        return
    along, left = _frame_of(wall)
    floor_y = plan.storeys[wall.storey].floor_y
    start = np.array([wall.start[0], floor_y, wall.start[1]])
    sides = [_side_rgb(plan, wall, start + along * (span[0] + span[1]) / 2 + left * s * 0.2) for s in (1, -1)]
    cuts = [heights[0], *(h for h in (_SKIRTING, CUT_HEIGHT) if heights[0] < h < heights[1]), heights[1]]
    up = np.array([0.0, 1.0, 0.0])
    for low, high in itertools.pairwise(cuts):
        is_skirting = high <= _SKIRTING
        for sign, rgb in zip((1, -1), sides, strict=True):
            a, b = (span[1], span[0]) if sign > 0 else (span[0], span[1])
            side = start + left * sign * wall.thickness / 2
            quad = [side + along * s + up * h for s, h in ((a, low), (b, low), (b, high), (a, high))]
            builder.add_quads(np.array(quad), Finish(rgb=tinted(rgb, 0.6) if is_skirting else rgb))
        for at, sign in ((span[0], -1), (span[1], 1)):
            middle = start + along * at
            a, b = (1, -1) if sign > 0 else (-1, 1)
            half = left * wall.thickness / 2
            quad = [middle + half * s + up * h for s, h in ((a, low), (b, low), (b, high), (a, high))]
            builder.add_quads(np.array(quad)[:, :], Finish(rgb=_FRAME_RGB if high > low else _CAP_RGB))
    caps = [(heights[1], _CAP_RGB if heights[1] < wall.height else tinted(sides[0], 0.9))]
    if heights[0] < CUT_HEIGHT < heights[1]:
        caps.append((CUT_HEIGHT - 0.004, _CAP_RGB))
    if heights[0] > 0:
        caps.append((heights[0], _FRAME_RGB))
    for height, rgb in caps:
        rim = [(span[0], 1), (span[0], -1), (span[1], -1), (span[1], 1)]
        quad = np.array([start + along * s + left * t * wall.thickness / 2 + up * height for s, t in rim])
        builder.add_quads(quad if height != heights[0] else quad[::-1], Finish(rgb=rgb))


def _side_rgb(plan: HomePlan, wall: Wall, point: np.ndarray) -> Rgb:
    """Wall colour of the room at a point (3,); facade colour outside."""
    for room in plan.rooms:
        if room.storey == wall.storey and room.rect is not None and room.rect.holds(float(point[0]), float(point[2])):
            return room.wall.rgb
    return _OUTSIDE_RGB


def _add_opening(builder: QuadBuilder, plan: HomePlan, wall: Wall, opening: Opening) -> None:
    """A window's pane and cross, or a door's frame."""
    along, _ = _frame_of(wall)
    yaw = float(np.arctan2(-along[2], along[0]))
    floor_y = plan.storeys[wall.storey].floor_y
    height = opening.top - opening.sill
    foot = np.array([wall.start[0], floor_y, wall.start[1]]) + along * opening.offset
    middle = foot + np.array([0, (opening.sill + opening.top) / 2, 0])
    if opening.kind == "window":
        builder.add_box(middle, (opening.width, height, 0.02), finish=Finish(rgb=_PANE_RGB), yaw=yaw)
        builder.add_box(middle, (0.05, height, 0.05), finish=Finish(rgb=_FRAME_RGB), yaw=yaw)
        builder.add_box(middle, (opening.width, 0.05, 0.05), finish=Finish(rgb=_FRAME_RGB), yaw=yaw)
        return
    for side in (-1, 1):
        low = min(height, CUT_HEIGHT)
        post = foot + along * side * (opening.width / 2 - 0.02) + np.array([0, low / 2, 0])
        builder.add_box(post, (0.04, low, wall.thickness + 0.03), finish=Finish(rgb=_FRAME_RGB), yaw=yaw)


def _add_stair(builder: QuadBuilder, plan: HomePlan, stair: Stair) -> None:
    """Solid steps from the floor up, and the rim of the hole above."""
    low, high = plan.storeys[stair.storey].floor_y, plan.storeys[stair.storey + 1].floor_y
    rise = (high - low) / stair.num_steps
    rect = stair.rect
    along_x, sign = stair.towards[1] == "x", 1 if stair.towards[0] == "+" else -1
    length = (rect.x1 - rect.x0) if along_x else (rect.z1 - rect.z0)
    run = length / stair.num_steps
    for step in range(stair.num_steps):
        offset = ((step + 0.5) * run - length / 2) * sign
        centre = (rect.centre[0] + offset, rect.centre[1]) if along_x else (rect.centre[0], rect.centre[1] + offset)
        size = (run, rect.z1 - rect.z0) if along_x else (rect.x1 - rect.x0, run)
        top = low + (step + 1) * rise
        finish = Finish(rgb=tinted(_STAIR_RGB, 1.06 if step % 2 else 0.94))
        for bottom, upper in _storey_pieces(low, top):
            builder.add_box(
                (centre[0], (bottom + upper) / 2, centre[1]), (size[0], upper - bottom, size[1]), finish=finish
            )
    sides = (
        ((rect.x0, rect.z0), (rect.x1, rect.z0)), ((rect.x1, rect.z0), (rect.x1, rect.z1)),
        ((rect.x1, rect.z1), (rect.x0, rect.z1)), ((rect.x0, rect.z1), (rect.x0, rect.z0)),
    )  # fmt: skip
    for (xa, za), (xb, zb) in sides:
        rim = [(xa, high - _SLAB, za), (xb, high - _SLAB, zb), (xb, high, zb), (xa, high, za)]
        builder.add_quads(np.array(rim), _CEILING)


def _storey_pieces(low: float, top: float) -> list[tuple[float, float]]:
    """A step's height, cut at CUT_HEIGHT so that the lower storey keeps its part."""
    cut = low + CUT_HEIGHT
    return [(low, cut), (cut, top)] if top > cut else [(low, top)]
