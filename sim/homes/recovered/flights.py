"""Guessed flights of a schematic home: straight stairs between two storeys, where nothing recorded is in their way.

Floor cells of two storeys -> the cells of one flight with its landings, for walkable.py; `stepped_strip` gives the
cells of any straight way with steps.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from sim.types import CAMERA_HEIGHT

from ..cells import CELL, CellGrid, Cells
from ..images import distance_to, nearest
from ..plan import Furniture, Storey
from .corridors import CORRIDOR_RADIUS
from .recorded import Recorded, original_places

RISER = 0.19
"""Largest rise of a step (metres); one voxel of the navigation map is 0.2 m."""
TREAD, _LEAST_TREAD = 0.25, 0.2
"""Usual and least depth of a step (metres)."""
HEADROOM = 2.0
"""Least height above a step (metres)."""
_HALF_WIDTH = 0.2
"""Half the width of steps for the robot's centre (metres)."""
_LANDING = 0.3
"""Length of level floor before the first and behind the last step (metres)."""
_ASIDE = 14
"""Floor this near to the middle of a flight would lose places: its own half width, the body twice, a string (cells)."""
_PIECE_ASIDE = 10
"""A piece this near to the middle of a flight would reach over its steps (cells)."""
_SIDE = 8
"""Half the width of the steps (cells)."""
_UNDER_SIGHT = 0.1
"""Least height of a line of sight above a step (metres)."""
_LONGEST_STRIP = 4.0
"""Largest distance of a landing from the floor that it is joined to (metres)."""
_SLAB = 0.12
"""Thickness of the floor between two storeys (metres)."""
_LEVEL = 0.02
"""Cells that differ more from a storey's height are steps (metres)."""
_OWN_STOREY = 1.0
"""Places this near to a storey's height belong to it (metres)."""
_DIRECTIONS = 16
_SLANTED = 1.0
"""A flight along an axis may have landings that are this much longer together (metres)."""
_PITCH = 2
"""First steps are tried on every _PITCH-th cell along both axes."""
_BATCH = 20_000

Mask = NDArray[np.bool_]
Points = NDArray[np.float64]


class _Way(NamedTuple):
    """What stands in a flight's way; distances are in cells, heights above the lower storey's floor."""

    floor: Points
    """(2, rows, cols) distance to the floor of the lower and of the upper storey."""
    piece: Points
    """(2, rows, cols) distance to the furniture, and to bodies on other steps, of the lower and of the upper storey."""
    sight: Points
    """(rows, cols) height of the lowest line of sight in the lower storey that a step may cut."""
    covered_from: float
    """Steps higher than this need an open storey above them."""


def stepped_strip(low: Points, high: Points, *, grid: CellGrid, half_width: float = CORRIDOR_RADIUS) -> Cells:
    """Guessed cells of the straight way between two places (3,), with level steps in its middle.

    Steps rise by at most RISER and are TREAD deep, or less where the way is too short for that.
    """
    if low[1] > high[1]:
        low, high = high, low
    rise, planar = float(high[1] - low[1]), float(np.hypot(*(high - low)[[0, 2]]))
    count = num_risers(rise)
    tread = min(TREAD, planar / max(count - 1, 1))
    before = (planar - (count - 1) * tread) / 2
    spec = grid.grid
    corners = spec.rc_from_xz(np.array([low[[0, 2]], high[[0, 2]]]))
    reach = math.ceil(half_width / CELL) + 1
    (top, left), (bottom, right) = corners.min(axis=0) - reach, corners.max(axis=0) + reach
    rows = np.arange(max(top, 0), min(bottom + 1, grid.shape[0]))
    cols = np.arange(max(left, 0), min(right + 1, grid.shape[1]))
    rc = np.stack(np.meshgrid(rows, cols, indexing="ij"), axis=-1).reshape(-1, 2)
    away = spec.xz_from_rc(rc) - low[[0, 2]]
    along = (high - low)[[0, 2]] / max(planar, 1e-9)
    at = away @ along
    off = np.hypot(*(away - np.clip(at, 0, planar)[:, None] * along).T)
    inside = off <= half_width + 1e-6
    steps = np.clip(np.floor((at[inside] - before) / max(tread, 1e-9) + 1e-6) + 1, 0, count)
    y = low[1] + rise / max(count, 1) * steps
    return Cells(rc[inside], y, np.ones(len(y), bool))


def num_risers(rise: float) -> int:
    """Number of equal steps of at most RISER."""
    return math.ceil(abs(rise) / RISER - 1e-6)


def shortest_run(rise: NDArray[np.float64]) -> NDArray[np.float64]:
    """Least length (...) of a strip with steps that rises by these heights (...), metres."""
    return (np.ceil(np.abs(rise) / RISER - 1e-6) - 1) * _LEAST_TREAD


def flight_between(
    low: Cells,
    high: Cells,
    cells: Cells,
    storeys: Sequence[Storey],
    k: int,
    *,
    recorded: Recorded,
    pieces: Sequence[Furniture],
    grid: CellGrid,
) -> list[Cells]:
    """Cells of a flight from storey k to the next one: its steps, then strips to its landings; empty if none fits.

    Of all straight flights that leave the floor, the furniture and the lines of sight alone, it is the one whose
    landings are nearest to the floors that they join.

    Args:
        low: Level floor of the lower storey that the flight starts from.
        high: Level floor of the upper storey that it leads to.
        cells: All floor.
        storeys: All storeys.
        k: Index of the lower storey.
        recorded: Its goals have lines of sight.
        pieces: All furniture.
        grid: Place of the cells.
    """
    heights = [storey.floor_y for storey in storeys[k : k + 2]]
    floors = np.zeros((2, *grid.shape), bool)
    for image, part in zip(floors, (low, high), strict=True):
        image[tuple(part.rc.T)] = True
    near = [nearest(floor) for floor in floors]
    far = np.stack([distance_to(floor) for floor in floors])
    way = _way(cells, storeys, k, recorded=recorded, pieces=pieces, grid=grid)
    for tread in (TREAD, _LEAST_TREAD):
        found = _best(way, near, far, rise=heights[1] - heights[0], tread=tread)
        if found is not None:
            corner = np.asarray(grid.origin_xz)
            ends, joints = (corner + (part[:, ::-1] + 0.5) * CELL for part in found)
            return _strips(ends, joints, (heights[0], heights[1]), grid=grid)
    return []


def _strips(ends: Points, joints: Points, heights: tuple[float, float], *, grid: CellGrid) -> list[Cells]:
    """The strips of a flight between two ends (2, 2), with landings that lead to two joints (2, 2), all (x, z)."""
    out = (ends - ends[::-1]) / np.linalg.norm(ends[1] - ends[0])
    ends, landings, joints = (np.insert(xz, 1, heights, axis=1) for xz in (ends, ends + out * _LANDING, joints))
    ways = [ends, *np.stack([ends, landings], axis=1), *np.stack([landings, joints], axis=1)]
    return [stepped_strip(start, end, grid=grid, half_width=_HALF_WIDTH) for start, end in ways]


def _way(
    cells: Cells, storeys: Sequence[Storey], k: int, *, recorded: Recorded, pieces: Sequence[Furniture], grid: CellGrid
) -> _Way:
    low_y, high_y = (storey.floor_y for storey in storeys[k : k + 2])
    ceiling_y = min(low_y + storeys[k].ceiling, high_y - _SLAB)
    floor, piece, steps = np.zeros((3, 2, *grid.shape), bool)
    is_step = (np.abs(cells.y[:, None] - [storey.floor_y for storey in storeys]) > _LEVEL).all(axis=1)
    for image, bottom, top in ((0, low_y - HEADROOM, ceiling_y), (1, ceiling_y, high_y + HEADROOM)):
        within = (cells.y > bottom) & (cells.y < top)
        floor[image][tuple(cells.rc[within].T)] = True
        steps[image][tuple(cells.rc[is_step & (cells.y < top)].T)] = True  # a flight has a well above it
        for one in pieces:
            if one.top_y > max(bottom, low_y) and one.bottom_y < top:
                piece[image][one.rect.cells(grid.grid)] = True
    sight = np.full(grid.shape, np.inf)
    for goal in recorded.goals.values():
        places, centre = original_places(goal), np.array(goal.position)
        places = places[np.abs(places[:, 1] - low_y) < _OWN_STOREY]
        if len(places):
            longest = float(np.linalg.norm(places - centre, axis=1).max())
            share = np.linspace(0, 1, 2 + math.ceil(longest / (2 * CELL)))[:, None, None]
            points = ((places + np.array([0.0, CAMERA_HEIGHT, 0.0])) * (1 - share) + centre * share).reshape(-1, 3)
            rc = grid.grid.rc_from_xz(points[:, [0, 2]])
            inside = grid.grid.contains(rc)
            np.minimum.at(sight, tuple(rc[inside].T), points[inside, 1] - low_y)
    return _Way(
        np.stack([distance_to(image) for image in floor]),
        np.stack([np.minimum(distance_to(a), distance_to(b) - _SIDE) for a, b in zip(piece, steps, strict=True)]),
        ndimage.minimum_filter(sight, 2 * _SIDE + 1),
        ceiling_y - HEADROOM - low_y,
    )


def _best(
    way: _Way, near: Sequence[tuple[NDArray[np.int64], ...]], far: Points, *, rise: float, tread: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Ends (2, 2) of the steps and the floor cells (2, 2) that they are joined to, in (row, col); None if none fits."""
    count = num_risers(rise)
    length = (count - 1) * tread / CELL
    shape = np.array(way.sight.shape)
    first = np.argwhere(far[0] <= _LONGEST_STRIP / CELL)
    first = first[(first % _PITCH == 0).all(axis=1)]
    angles = np.arange(_DIRECTIONS) * 2 * math.pi / _DIRECTIONS
    towards = np.column_stack([np.sin(angles), np.cos(angles)])
    ends = np.stack(np.broadcast_arrays(first[:, None], first[:, None] + towards * length), axis=2).reshape(-1, 2, 2)
    turned = np.tile(towards, (len(first), 1))
    margin = _SIDE + _LANDING / CELL + 2
    inside = ((ends >= margin) & (ends < shape - margin)).all(axis=(1, 2))
    ends, turned = ends[inside], turned[inside]
    at = np.round(ends).astype(np.int64)
    gaps = np.stack([far[i][tuple(at[:, i].T)] for i in (0, 1)], axis=1)
    good = gaps[:, 1] <= _LONGEST_STRIP / CELL
    ends, turned, at, gaps = ends[good], turned[good], at[good], gaps[good]
    joints = np.stack([np.stack([part[tuple(at[:, i].T)] for part in near[i]], axis=1) for i in (0, 1)], axis=1)
    # strips to the landings leave the flight; they do not run below or above it
    out = ((joints - ends) * turned[:, None]).sum(axis=2) * (-1, 1)
    cost = gaps.sum(axis=1) + np.where(np.abs(turned.prod(axis=1)) > 1e-9, _SLANTED / CELL, 0)
    order = np.argsort(cost, kind="stable")
    order = order[(out >= -0.3 * gaps - 1).all(axis=1)[order]]
    for batch in range(0, len(order), _BATCH):
        chosen = order[batch : batch + _BATCH]
        fits = _fits(way, ends[chosen], joints[chosen], gaps[chosen], rise=rise, count=count)
        if fits.any():
            one = chosen[fits.argmax()]
            return ends[one], joints[one].astype(float)
    return None


def _fits(way: _Way, ends: Points, joints: NDArray[np.int64], gaps: Points, *, rise: float, count: int) -> Mask:
    """Whether flights (N,) between two ends have nothing in their way; near its ends a flight may be near floor."""
    runs = ends[:, 1] - ends[:, 0]
    length = float(np.linalg.norm(runs, axis=1).max())
    aside = runs[:, ::-1] * (1, -1) / length * _SIDE
    fits = np.ones(len(ends), bool)
    beyond = _LANDING / CELL / length
    for share in np.linspace(-beyond, 1 + beyond, math.ceil(length / 2) + 1).tolist():
        step = rise / count * min(max(math.floor(share * (count - 1)) + 1, 0), count)
        for side in (0, -1, 1):
            left = np.flatnonzero(fits)
            at = tuple(np.round(ends[left, 0] + runs[left] * share + aside[left] * side).astype(np.int64).T)
            clear = _ASIDE - _SIDE * abs(side)
            near = [np.minimum(clear, 0.85 * (gaps[left, i] + length * (share, 1 - share)[i]) - 1) for i in (0, 1)]
            if side == 0 and share <= 1:
                fits[left] &= way.piece[0][at] >= _PIECE_ASIDE
            if 0 < share <= 1:
                fits[left] &= (way.sight[at] > step + _UNDER_SIGHT) & (way.floor[0][at] >= near[0])
            if step > way.covered_from:
                fits[left] &= (side != 0) | (way.piece[1][at] >= _PIECE_ASIDE)
                fits[left] &= (share >= 1) | (way.floor[1][at] >= near[1])
    for i, share in ((i, share) for i in (0, 1) for share in (0.25, 0.5, 0.75)):
        at = tuple(np.round(ends[:, i] * (1 - share) + joints[:, i] * share).astype(np.int64).T)
        fits &= way.piece[i][at] >= _SIDE
    return fits
