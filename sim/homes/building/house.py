"""Turns a HomePlan into triangles and semantics: rooms, walls, stairs (or cells), and every piece of furniture."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...mesh import SceneObject, TriangleMesh
from ..plan import HomePlan, Rect, Room
from .cells.mesh import add_cells
from .fittings import add_ceiling_lamp
from .quads import QuadBuilder, add_piece, floor_uv
from .stairs import add_stair
from .walls import CEILING_FINISH, add_wall

_LAMP_EVERY = 14.0
"""Area that one ceiling lamp lights, square metres."""
_FROM_HOLE = 0.4
"""Least distance of a lamp from the hole of a stair (metres)."""

_UNDER_FLIGHT = 0.03
"""The floor ends this far under the sides of a flight (metres)."""


def mesh_from_plan(plan: HomePlan) -> tuple[TriangleMesh, tuple[SceneObject, ...]]:
    """The home as lit, textured triangles with instance ids, and its objects; ids are 1, 2, ... in the plan's order."""
    builder = QuadBuilder()
    lamps = add_cells(builder, plan) if plan.cells is not None else []
    for room in plan.rooms:
        if room.rect is not None:
            _add_floor_and_ceiling(builder, plan, room, room.rect)
            lamps += _added_lamps(builder, plan, room, room.rect)
    for wall in plan.walls:
        add_wall(builder, plan, wall)
    for stair in plan.stairs:
        add_stair(builder, plan, stair)
    for instance, piece in enumerate(plan.furniture, start=1):
        add_piece(builder, piece, instance=instance)
    return builder.mesh(lamps=lamps), tuple(
        SceneObject(instance, piece.name, piece.category, piece.centre, piece.world_size)
        for instance, piece in enumerate(plan.furniture, start=1)
    )


def _add_floor_and_ceiling(builder: QuadBuilder, plan: HomePlan, room: Room, rect: Rect) -> None:
    """Adds a floor around stairs, with its planks along the room, and a ceiling around the next flight's hole."""
    storey = plan.storeys[room.storey]
    holes_below = [stair.rect for stair in plan.stairs if stair.storey == room.storey - 1]
    holes_above = [stair.rect for stair in plan.stairs if stair.storey == room.storey]
    # no floor inside a flight, where a robot would seem to fit
    flights = [stair.rect.grown(-_UNDER_FLIGHT) for stair in plan.stairs if stair.storey == room.storey]
    floor = np.array([_level_quad(part, storey.floor_y) for part in _without(rect, [*holes_below, *flights])])
    is_deep = rect.z1 - rect.z0 > rect.x1 - rect.x0
    if len(floor):
        builder.add_quads(floor, room.floor, uv=floor_uv(floor, is_deep=is_deep))
    for part in _without(rect, holes_above):
        builder.add_quads(_level_quad(part, storey.floor_y + storey.ceiling)[None, ::-1], CEILING_FINISH)


def _added_lamps(builder: QuadBuilder, plan: HomePlan, room: Room, rect: Rect) -> list[tuple[float, float, float]]:
    """Hangs ceiling lamps along the room's middle; returns the places of their light."""
    storey = plan.storeys[room.storey]
    holes = [stair.rect.grown(_FROM_HOLE) for stair in plan.stairs if stair.storey == room.storey]
    width, depth = rect.x1 - rect.x0, rect.z1 - rect.z0
    count = max(1, round(width * depth / _LAMP_EVERY))
    found = []
    for k in range(count):
        share = (k + 0.5) / count
        x = rect.x0 + width * (share if width >= depth else 0.5)
        z = rect.z0 + depth * (0.5 if width >= depth else share)
        if not any(hole.holds(x, z) for hole in holes):
            found.append(add_ceiling_lamp(builder, np.array([x, storey.floor_y + storey.ceiling, z])))
    return found


def _without(rect: Rect, holes: Sequence[Rect]) -> list[Rect]:
    """Rectangles that cover `rect` except for the holes."""
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


def _level_quad(rect: Rect, y: float) -> NDArray[np.float64]:
    """A quad (4, 3) that faces up."""
    return np.array([(rect.x0, y, rect.z0), (rect.x0, y, rect.z1), (rect.x1, y, rect.z1), (rect.x1, y, rect.z0)])
