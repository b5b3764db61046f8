"""Steps and railings: flights of homes given as cells, flights of invented homes, and posts along any drop."""

import itertools

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from sim.types import GridSpec

from ..furniture.shapes import box
from ..plan import Finish
from .cell_quads import level_quads, neighbours, side_quads
from .openings import Spot, add_shape
from .quads import QuadBuilder
from .rasters import cells_of, parts_of

TREAD_FINISH = Finish(material="wood", rgb=(172, 128, 86))
RISER_FINISH = Finish(material="wood", rgb=(150, 110, 72))
RAIL_FINISH = Finish(material="wood", rgb=(128, 88, 56))
POST_FINISH = Finish(material="wood", rgb=(150, 110, 72))
RISE = 0.17
"""Height of a step where the recorded heights do not tell (metres)."""
RAIL_HEIGHT = 0.9
_POST_GAP = 0.14
_POST = 0.03
_RAIL = (0.05, 0.04)
_FLAT = 0.17
"""Recorded heights this near a storey's floor are that floor (metres)."""
_RISER = 0.6
"""A higher difference between neighbouring cells is no step (metres)."""
_EDGE = 0.05
"""... nor is a lower one (metres)."""
_SMOOTH = 2.0
"""Recorded heights of flights are averaged over about so many cells."""

Heights = NDArray[np.float64]


def stepped(heights: Heights, floor_y: float) -> Heights:
    """Heights of one layer as level steps; what is near the floor is the floor."""
    above = heights - floor_y
    return np.where(np.abs(above) < _FLAT, floor_y, floor_y + np.round(above / RISE) * RISE)


def with_whole_flights(floors: Heights, floors_y: list[float]) -> Heights:
    """Layers in which flights hold also their first and last steps, which lie near a storey's floor.

    Args:
        floors: (2 * S - 1, rows, cols) heights: even layers are storeys, odd ones the flights from there up.
        floors_y: Heights of the storeys' floors.
    """
    found = floors.copy()
    for layer in range(1, len(floors), 2):
        flight = ~np.isnan(floors[layer])
        low = floors[layer - 1] > floors_y[layer // 2] + _FLAT
        high = floors[layer + 1] < floors_y[layer // 2 + 1] - _FLAT
        parts, count = parts_of(flight | low | high, diagonal=True)
        if not count:
            continue
        touched = np.bincount(parts.ravel(), flight.ravel()) > 0
        touched[0] = False
        whole = touched[parts]
        steps = np.where(flight, floors[layer], np.where(high, floors[layer + 1], floors[layer - 1]))
        found[layer] = np.where(whole, _smoothed(np.where(whole, steps, np.nan)), np.nan)
        found[layer - 1][whole & low] = np.nan
        found[layer + 1][whole & high] = np.nan
    return found


def _smoothed(heights: Heights) -> Heights:
    """Recorded heights without their noise, so that steps have straight edges; cells without height have no say."""
    known = ~np.isnan(heights)
    weight = ndimage.gaussian_filter(known.astype(float), _SMOOTH)
    total = ndimage.gaussian_filter(np.where(known, heights, 0.0), _SMOOTH)
    return np.where(known, total / np.maximum(weight, 1e-9), np.nan)


def add_steps(builder: QuadBuilder, grid: GridSpec, surfaces: Heights) -> None:
    """Treads of all flights, and risers wherever one surface is a step above another.

    Args:
        builder: Takes the quads.
        grid: Place of the images.
        surfaces: (2 * S - 1, rows, cols) heights of what is drawn: even layers are storeys, odd ones the flights.
    """
    for layer, surface in enumerate(surfaces):
        if layer % 2:
            quads, _ = level_quads(grid, surface, np.zeros(surface.shape, np.int64))
            builder.add_quads(quads, TREAD_FINISH)
        for step, beside in neighbours(surfaces):
            lower = np.where(beside < surface - 0.001, beside, -np.inf).max(axis=0)
            same = (np.abs(beside - surface) <= 0.001).any(axis=0)
            rise = surface - lower
            own = surface - beside[layer]  # within one layer every step is closed: a platform, a bed
            cells = cells_of(np.isfinite(lower) & ~same & (rise > _EDGE) & ((rise <= _RISER) | (own == rise)))
            if len(cells[0]):
                quads, _ = side_quads(grid, cells, (lower[cells], surface[cells]), step)
                builder.add_quads(quads, RISER_FINISH)


def add_railing(builder: QuadBuilder, feet: Heights, *, height: float = RAIL_HEIGHT) -> None:
    """Posts on a line of points and a rail over them.

    Args:
        builder: Takes the quads.
        feet: (N, 3) world metres, in order.
        height: Of the rail's top over the feet, metres.
    """
    places = _spaced(feet)
    for a, b in itertools.pairwise(places):
        along = b - a
        length = float(np.hypot(along[0], along[2]))
        if length > 1e-6:
            _add_rail(builder, a, b, height - _RAIL[1])
    for x, y, z in places:
        spot = Spot(np.array([x, y, z]), 0.0)
        add_shape(builder, box((0, (height - _RAIL[1]) / 2, 0), (_POST, height - _RAIL[1], _POST)), spot, POST_FINISH)


def _spaced(feet: Heights) -> Heights:
    """Points about _POST_GAP apart on a line, with its ends."""
    length = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(feet[:, [0, 2]], axis=0).T))])
    count = max(2, round(float(length[-1]) / _POST_GAP) + 1)
    at = np.linspace(0, length[-1], count)
    return np.stack([np.interp(at, length, feet[:, axis]) for axis in range(3)], axis=1)


def _add_rail(builder: QuadBuilder, a: Heights, b: Heights, height: float) -> None:
    """A bar between two points `height` over `a` and `b`; its ends are upright, so that bars join."""
    along = np.array([b[0] - a[0], b[2] - a[2]])
    side = np.array([along[1], -along[0]]) / np.hypot(*along) * _RAIL[0] / 2
    side = np.array([side[0], 0, side[1]])
    up = np.array([0.0, _RAIL[1], 0])
    base = np.array([0.0, height, 0])
    ring = [[end + base - side, end + base + side, end + base + side + up, end + base - side + up] for end in (a, b)]
    first, second = ring
    quads = [[first[k], second[k], second[(k + 1) % 4], first[(k + 1) % 4]] for k in range(4)]
    builder.add_quads(np.array(quads)[:, ::-1], RAIL_FINISH)
    builder.add_quads(np.array([first[::-1], second]), RAIL_FINISH)
