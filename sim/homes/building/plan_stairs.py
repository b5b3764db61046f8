"""Straight flights of invented homes: treads, risers, closed sides, the rim of the hole above and a banister."""

import numpy as np
from numpy.typing import NDArray

from ..furniture.shapes import box, slab
from ..plan import HomePlan, Stair
from .cell_mesh import CEILING_FINISH
from .flights import STRING_FINISH
from .openings import Spot, add_shape
from .quads import QuadBuilder
from .stairs_mesh import RISER_FINISH, TREAD_FINISH, add_railing
from .walls import upright

_TREAD = 0.035
_NOSING = 0.02
_BESIDE = 0.2
"""A side with a wall this near needs no banister (metres)."""
_BANISTER = 0.9


def add_stair(builder: QuadBuilder, plan: HomePlan, stair: Stair) -> None:
    """A flight of solid steps from the floor up; every step's top is at its full rise."""
    low, high = plan.storeys[stair.storey].floor_y, plan.storeys[stair.storey + 1].floor_y
    rect = stair.rect
    is_along_x = stair.towards[1] == "x"
    yaw = {"+z": 0.0, "+x": np.pi / 2, "-z": np.pi, "-x": -np.pi / 2}[stair.towards]
    length, width = rect.x1 - rect.x0, rect.z1 - rect.z0
    if not is_along_x:
        length, width = width, length
    spot = Spot(np.array([rect.centre[0], low, rect.centre[1]]), yaw)  # z is the way up, x its left
    rise, run = (high - low) / stair.num_steps, length / stair.num_steps
    for step in range(stair.num_steps):
        z, top = (step + 0.5) * run - length / 2, (step + 1) * rise
        tread = box((0, top - _TREAD / 2, z - _NOSING / 2), (width, _TREAD, run + _NOSING))
        add_shape(builder, tread, spot, TREAD_FINISH)
        add_shape(builder, slab((0, top - rise / 2, z), (width - 0.02, rise, run), faces="-z"), spot, RISER_FINISH)
        sides = slab((0, (top - _TREAD) / 2, z), (width - 0.02, top - _TREAD, run), faces="+x-x")
        add_shape(builder, sides, spot, STRING_FINISH)
    back = slab((0, (high - low) / 2, 0), (width, high - low, length), faces="+z")
    add_shape(builder, back, spot, STRING_FINISH)
    _add_rim(builder, plan, stair)
    for side in (-1, 1):
        _add_banister(builder, plan, stair, spot, (side * (width / 2 - 0.03), length, rise))


def _add_rim(builder: QuadBuilder, plan: HomePlan, stair: Stair) -> None:
    """The cut through ceiling and floor around the hole, seen from inside."""
    low = plan.storeys[stair.storey].floor_y + plan.storeys[stair.storey].ceiling
    high = plan.storeys[stair.storey + 1].floor_y
    x0, z0, x1, z1 = stair.rect
    corners = ((x0, z0), (x1, z0), (x1, z1), (x0, z1))
    for k in range(4):
        builder.add_quads(upright(corners[k], corners[(k + 1) % 4], low, high)[None], CEILING_FINISH)


def _add_banister(
    builder: QuadBuilder, plan: HomePlan, stair: Stair, spot: Spot, at: tuple[float, float, float]
) -> None:
    """Posts and a rail along one side, unless a wall stands there.

    Args:
        builder: Takes the quads.
        plan: Says where walls are.
        stair: The flight.
        spot: Its middle; z is the way up.
        at: Place across the flight, the flight's length and the rise of a step, metres.
    """
    x, length, rise = at
    run = length / stair.num_steps
    middle = _world(spot, np.array([x, 0.0, 0.0]))
    for wall in plan.walls:
        axis = 0 if wall.is_along_x else 1  # along x or along z
        is_parallel = (axis == 0) == (stair.towards[1] == "x")
        low, high = sorted((wall.start[axis], wall.end[axis]))
        off = abs(wall.start[1 - axis] - middle[2 * (1 - axis)])
        if wall.storey == stair.storey and is_parallel and off < _BESIDE and low <= middle[2 * axis] <= high:
            return
    steps = np.arange(stair.num_steps)
    feet = [_world(spot, np.array([x, (step + 1) * rise, (step + 0.5) * run - length / 2])) for step in steps]
    add_railing(builder, np.array(feet), height=_BANISTER)


def _world(spot: Spot, point: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3,) world place of a point of the spot's frame."""
    cos, sin = np.cos(spot.yaw), np.sin(spot.yaw)
    x, y, z = point
    return spot.origin + np.array([cos * x + sin * z, y, -sin * x + cos * z])
