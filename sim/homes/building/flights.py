"""Flights: sides and railings of those given as cells (steps: stairs_mesh), and whole ones of invented homes."""

import itertools

import numpy as np
from numpy.typing import NDArray

from ..furniture.shapes import box, slab
from ..plan import Finish, HomePlan, Stair
from .openings import Spot, add_shape
from .outlines import Straight, WallLines, straight_lines
from .quads import QuadBuilder
from .rasters import edges_where, nearest
from .stairs_mesh import RISER_FINISH, TREAD_FINISH, add_railing, stepped
from .storey_cells import StoreyCells, between
from .walls import CEILING_FINISH, WallPiece, add_wall_piece, upright

STRING_FINISH = Finish(material="plaster", rgb=(226, 222, 212))
_STRING = 0.06
"""Thickness of a flight's side (metres)."""
_CURB = 0.04
"""How far it rises over the steps (metres)."""
_SLAB = 0.25
"""Thickness of a flight that somebody walks below (metres)."""
_PASSAGE = 0.35
"""No side stands where one steps on or off the flight: floor this near beside a step (metres)."""
_DROP = 0.4
"""A railing stands where it goes down farther (metres)."""
_MIN_RAIL = 6
"""Railings are longer than this many cells."""

Heights = NDArray[np.float64]


def flight_surface(flight: Heights, floor_y: float) -> Heights:
    """Heights of a flight's steps, (rows, cols), out to its straightened sides."""
    mask = ~np.isnan(flight)
    if not mask.any():
        return flight
    steps = stepped(flight, floor_y)[nearest(mask)]
    return np.where(between(mask, straight_lines(outline(mask))), steps, np.nan)


def outline(mask: NDArray[np.bool_]) -> WallLines:
    """The border of a mask (rows, cols)."""
    wide = np.pad(mask, 1)
    return WallLines(wide[1:, 1:-1] != wide[:-1, 1:-1], wide[1:-1, 1:] != wide[1:-1, :-1])


def add_strings(
    builder: QuadBuilder, storey: StoreyCells, surfaces: Heights, layer: int, *, walked: NDArray[np.bool_]
) -> None:
    """The sides of the flights that rise from a storey: closed down to its floor, unless somebody walks below.

    Args:
        builder: Takes the quads.
        storey: From which the flights of `layer` rise.
        surfaces: (2 * S - 1, rows, cols) what is drawn as floor or step.
        layer: Of the flights, odd.
        walked: (rows, cols) recorded floor of the storey.
    """
    flight = surfaces[layer]
    by = _STRING / storey.grid.cell
    for line in straight_lines(outline(~np.isnan(flight))):
        is_left = not np.isnan(flight[tuple(line.left[0])])
        own, other = (line.left, line.right) if is_left else (line.right, line.left)
        steps = flight[tuple(own.T)]
        beside = surfaces[:, other[:, 0], other[:, 1]]
        is_way = (np.abs(beside - steps) < _PASSAGE).any(axis=0)
        steps = np.where(is_way, np.nan, steps)
        bottoms = np.where(walked[tuple(own.T)], steps - _SLAB, storey.floor_y)
        is_new = (np.diff(steps) != 0) | (np.diff(bottoms) != 0)
        changes = np.flatnonzero(is_new & ~(np.isnan(steps[1:]) & np.isnan(steps[:-1]))) + 1
        for low, high in itertools.pairwise([0, *changes.tolist(), len(steps)]):
            if np.isnan(steps[low]):
                continue
            ends = [line.at(place / len(steps)) for place in (low, high)]
            miters = [line.miter_at(place / len(steps)) for place in (low, high)]
            outer = [p + m * (-by if is_left else by) for p, m in zip(ends, miters, strict=True)]
            corners = [storey.xz(p) for p in ((*ends, *outer) if is_left else (*outer, *ends))]
            add_wall_piece(
                builder,
                WallPiece(
                    *corners,
                    bottom=max(storey.floor_y, float(bottoms[low])),
                    top=float(steps[low]) + _CURB,
                    left=STRING_FINISH,
                    right=STRING_FINISH,
                    skirting=False,
                    ends=(True, True),
                    has_top=True,
                ),
            )


def add_railings(builder: QuadBuilder, storeys: list[StoreyCells], surfaces: Heights) -> None:
    """Railings along flights and around wells, where nothing else keeps one from falling."""
    for k, storey in enumerate(storeys):
        for layer in (2 * k - 1, 2 * k + 1):
            if 0 <= layer < len(surfaces):
                level, flight = surfaces[2 * k], surfaces[layer]
                # one stands on the higher side: on the floor around a well, on the steps of a flight up
                base = level if layer < 2 * k else flight
                for line in straight_lines(_drops(storey, level, flight)):
                    _add_rail_line(builder, storey, line, base)


def _drops(storey: StoreyCells, level: Heights, flight: Heights) -> WallLines:
    """Edges without wall between the storey's floor and steps that lie far above or below."""
    inside = storey.space.inside
    walls = (storey.space.walls.across[1:-1], storey.space.walls.along[:, 1:-1])

    def drops(a: tuple[slice, slice], b: tuple[slice, slice], axis: int) -> NDArray[np.bool_]:
        found = np.zeros(walls[axis].shape, bool)
        for one, other in ((a, b), (b, a)):
            on_level = ~np.isnan(level[other]) & np.isnan(flight[other])
            found |= on_level & (np.abs(level[other] - flight[one]) > _DROP)
        return found & ~walls[axis] & inside[a] & inside[b]

    return edges_where(drops)


def _add_rail_line(builder: QuadBuilder, storey: StoreyCells, line: Straight, base: Heights) -> None:
    """A railing along a line, on the surface `base` beside it."""
    heights = np.fmax(base[tuple(line.left.T)], base[tuple(line.right.T)])
    known = np.flatnonzero(~np.isnan(heights))
    if line.length < _MIN_RAIL or len(known) < 2:
        return
    share = (known + 0.5) / len(heights)
    share[0], share[-1] = known[0] / len(heights), (known[-1] + 1) / len(heights)
    xz = storey.xz(np.array([line.at(place) for place in share]))
    add_railing(builder, np.stack([xz[:, 0], heights[known], xz[:, 1]], axis=1))


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
