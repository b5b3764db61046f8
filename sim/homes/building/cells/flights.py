"""Flights in homes given as cells: their steps, their sides, and railings along every drop."""

import itertools

import numpy as np
from numpy.typing import NDArray

from sim.types import GridSpec

from ...images import cells_of, nearest, neighbours
from ..fittings import add_railing
from ..quads import QuadBuilder
from ..stairs import RISER_FINISH, STRING_FINISH, TREAD_FINISH
from ..walls import WallPiece, add_wall_piece
from .outlines import Straight, WallLines, outline, straight_lines
from .storeys import StoreyCells, between, drawn
from .surfaces import edges_where, level_quads, side_quads

_RISER = 0.6
"""Largest height difference of neighbouring cells with a riser between them (metres)."""
_EDGE = 0.05
"""Smallest height difference of neighbouring cells with a riser between them (metres)."""
_STRING = 0.06
"""Thickness of a flight's side (metres)."""
_CURB = 0.04
"""Height of a flight's side above the steps (metres)."""
_SLAB = 0.25
"""Thickness of a flight with recorded floor below it (metres)."""
_PASSAGE = 0.35
"""Height difference between a step and floor beside it up to which people step on or off, so that the flight has no
side there (metres)."""
_DROP = 0.4
"""Railings stand along drops larger than this (metres)."""
_MIN_RAIL = 6
"""Least length of a railing (cells)."""

Heights = NDArray[np.float64]


def add_steps(builder: QuadBuilder, grid: GridSpec, surfaces: Heights) -> None:
    """Treads of all flights, and risers wherever one surface is a step above another.

    `surfaces` (2 * S - 1, rows, cols) are heights of drawn floors and steps: even layers are storeys, odd ones flights.
    """
    around = neighbours(surfaces)
    for layer, surface in enumerate(surfaces):
        if layer % 2:
            quads, _ = level_quads(grid, surface, np.zeros(surface.shape, np.int64))
            builder.add_quads(quads, TREAD_FINISH)
        rows, cols = cells_of(~np.isnan(surface))
        here = surface[rows, cols]
        for step, image in around:
            beside = image[:, rows, cols]  # (layers, N)
            lower = np.where(beside < here - 0.001, beside, -np.inf).max(axis=0)
            same = (np.abs(beside - here) <= 0.001).any(axis=0)
            rise = here - lower
            own = here - beside[layer]  # within one layer, such as at a platform or bed, every step is closed
            is_open = np.isfinite(lower) & ~same & (rise > _EDGE) & ((rise <= _RISER) | (own == rise))
            if is_open.any():
                quads, _ = side_quads(grid, (rows[is_open], cols[is_open]), (lower[is_open], here[is_open]), step)
                builder.add_quads(quads, RISER_FINISH)


def flight_surface(flight: Heights) -> Heights:
    """Heights of a flight's steps, (rows, cols), out to its straightened sides."""
    mask = ~np.isnan(flight)
    if not mask.any():
        return flight
    return np.where(between(mask, drawn(straight_lines(outline(mask)), mask.shape)), flight[nearest(mask)], np.nan)


def add_strings(
    builder: QuadBuilder, storey: StoreyCells, surfaces: Heights, layer: int, *, walked: NDArray[np.bool_]
) -> None:
    """Adds the sides of the flights that rise from a storey; they reach its floor unless there is recorded floor below.

    Args:
        builder: Takes the quads.
        storey: The storey from which the flights of `layer` rise.
        surfaces: (2 * S - 1, rows, cols) heights of drawn floors and steps.
        layer: Index of the flights' layer, odd.
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
    """Adds railings along flights and around wells, at every drop without a wall."""
    for k, storey in enumerate(storeys):
        for layer in (2 * k - 1, 2 * k + 1):
            if 0 <= layer < len(surfaces):
                level, flight = surfaces[2 * k], surfaces[layer]
                if layer < 2 * k < len(surfaces) - 1:  # no railing on the floor below the steps of a flight up
                    level = np.where(np.isnan(surfaces[2 * k + 1]), level, np.nan)
                # a railing stands on the higher side: on the floor around a well, on the steps of a flight up
                base = level if layer < 2 * k else flight
                for line in straight_lines(_drops(storey, level, flight)):
                    _add_rail_line(builder, storey, line, base)


def _drops(storey: StoreyCells, level: Heights, flight: Heights) -> WallLines:
    """Edges without a wall between the storey's floor and steps that lie far above or below it."""
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
    """Adds a railing along a line, on the surface `base` beside it."""
    heights = np.fmax(base[tuple(line.left.T)], base[tuple(line.right.T)])
    known = np.flatnonzero(~np.isnan(heights))
    if line.length < _MIN_RAIL or len(known) < 2:
        return
    share = (known + 0.5) / len(heights)
    share[0], share[-1] = known[0] / len(heights), (known[-1] + 1) / len(heights)
    xz = storey.xz(np.array([line.at(place) for place in share]))
    add_railing(builder, np.stack([xz[:, 0], heights[known], xz[:, 1]], axis=1))
