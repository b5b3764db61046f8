"""Stairs of homes whose plans have stairs: a flight of solid steps, the hole above it, and its banisters."""

import numpy as np

from ..furniture.shapes import box, slab
from ..plan import Finish, HomePlan, Stair
from .fittings import add_railing
from .quads import QuadBuilder, Spot, add_shapes
from .walls import CEILING_FINISH, upright

TREAD_FINISH = Finish(material="wood", rgb=(172, 128, 86))
RISER_FINISH = Finish(material="wood", rgb=(150, 110, 72))
STRING_FINISH = Finish(material="plaster", rgb=(226, 222, 212))
_TREAD = 0.035
_NOSING = 0.02
_BESIDE = 0.2
"""A side of a flight needs no banister if a wall is this near (metres)."""
_BANISTER = 0.9


def add_stair(builder: QuadBuilder, plan: HomePlan, stair: Stair) -> None:
    """Adds a flight of solid steps from the floor up; the top of every step is at its full rise."""
    low, high = plan.storeys[stair.storey].floor_y, plan.storeys[stair.storey + 1].floor_y
    rect = stair.rect
    is_along_x = stair.towards[1] == "x"
    length, width = rect.x1 - rect.x0, rect.z1 - rect.z0
    if not is_along_x:
        length, width = width, length
    spot = Spot(np.array([rect.centre[0], low, rect.centre[1]]), stair.yaw)  # z runs up the flight, x to its left
    rise, run = (high - low) / stair.num_steps, length / stair.num_steps
    for step in range(stair.num_steps):
        z, top = (step + 0.5) * run - length / 2, (step + 1) * rise
        tread = box((0, top - _TREAD / 2, z - _NOSING / 2), (width, _TREAD, run + _NOSING))
        sides = slab((0, (top - _TREAD) / 2, z), (width - 0.02, top - _TREAD, run), faces="+x-x")
        add_shapes(builder, spot, TREAD_FINISH, tread)
        add_shapes(builder, spot, RISER_FINISH, slab((0, top - rise / 2, z), (width - 0.02, rise, run), faces="-z"))
        add_shapes(builder, spot, STRING_FINISH, sides)
    add_shapes(builder, spot, STRING_FINISH, slab((0, (high - low) / 2, 0), (width, high - low, length), faces="+z"))
    _add_rim(builder, plan, stair)
    for side in (-1, 1):
        _add_banister(builder, plan, stair, spot, (side * (width / 2 - 0.03), length, rise))


def _add_rim(builder: QuadBuilder, plan: HomePlan, stair: Stair) -> None:
    """Adds the cut through ceiling and floor around the hole, seen from inside."""
    low = plan.storeys[stair.storey].floor_y + plan.storeys[stair.storey].ceiling
    high = plan.storeys[stair.storey + 1].floor_y
    x0, z0, x1, z1 = stair.rect
    corners = ((x0, z0), (x1, z0), (x1, z1), (x0, z1))
    for k in range(4):
        builder.add_quads(upright(corners[k], corners[(k + 1) % 4], low, high)[None], CEILING_FINISH)


def _add_banister(
    builder: QuadBuilder, plan: HomePlan, stair: Stair, spot: Spot, at: tuple[float, float, float]
) -> None:
    """Adds posts and a rail along one side of a flight, unless a wall stands there.

    Args:
        builder: Takes the quads.
        plan: The plan with its walls.
        stair: The flight.
        spot: Middle of the flight; z runs up the flight.
        at: Place across the flight, length of the flight and rise of a step, metres.
    """
    x, length, rise = at
    run = length / stair.num_steps
    middle = spot.world(np.array([x, 0.0, 0.0]))
    for wall in plan.walls:
        axis = 0 if wall.is_along_x else 1  # along x or along z
        is_parallel = (axis == 0) == (stair.towards[1] == "x")
        low, high = sorted((wall.start[axis], wall.end[axis]))
        off = abs(wall.start[1 - axis] - middle[2 * (1 - axis)])
        if wall.storey == stair.storey and is_parallel and off < _BESIDE and low <= middle[2 * axis] <= high:
            return
    steps = np.arange(stair.num_steps)
    feet = [spot.world(np.array([x, (step + 1) * rise, (step + 0.5) * run - length / 2])) for step in steps]
    add_railing(builder, np.array(feet), height=_BANISTER)
