"""Sides and railings of the flights of homes given as cells; their steps are made in stairs_mesh."""

import itertools

import numpy as np
from numpy.typing import NDArray

from ..plan import Finish
from .outlines import Straight, straight_lines
from .quads import QuadBuilder
from .rasters import edges_where, nearest
from .stairs_mesh import add_railing, stepped
from .storey_cells import StoreyCells, between
from .wall_lines import WallLines
from .walls import WallPiece, add_wall_piece

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
