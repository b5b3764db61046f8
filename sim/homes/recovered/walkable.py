"""Walkable cells of a schematic home: known floor, corridors that fit the recorded lengths, and bridges."""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import minimum_spanning_tree

from sim.walk.floor_grid import FloorGrid

from ..cells import CellGrid, Cells
from ..plan import Storey
from .corridors import CORRIDOR_RADIUS, with_corridors
from .corridors import PLAN_CLIMB as PLAN_CLIMB
from .known_floor import MAX_LINK_DY, along, cells_of_discs, known_floor, lies_on, merged, unknown_cells
from .recorded import Recorded

_MIN_ISLAND = 20
_MAX_SLOPE = math.radians(40)
_STOREY_PENALTY = 1000.0  # bridges between storeys come last, and one is enough
_THINNED = 0.3  # bridges start at one place per square of this side (metres)
_LEVEL, _RAMP = 0, 1

Points = NDArray[np.float64]
Pairs = NDArray[np.int64]


def walkable_cells(recorded: Recorded, storeys: tuple[Storey, ...], *, grid: CellGrid) -> Cells:
    """Cells where the robot's centre can be.

    Known cells are those around recorded places, between two places at most LINK apart, and along the straight line of
    a record whose length proves that it is free. All others are `guessed`: corridors that a recorded length requires,
    and bridges, which join all islands that a straight ramp of at most 40 degrees can join; a storey without space for
    a bridge stays an island of its own.
    """
    known = known_floor(recorded, grid=grid)
    unknown = unknown_cells(known, storeys, grid=grid)
    fitted = with_corridors(known.cells, unknown, recorded.lengths, grid=grid.grid)
    bridges = _bridges(known.places, fitted, storeys, grid=grid)
    # a ramp that leaves a level floor stays a ramp, so bridges come first
    return _without_crumbs(fitted if bridges is None else merged(bridges, fitted), grid)


def _without_crumbs(cells: Cells, grid: CellGrid) -> Cells:
    """The cells without tiny islands, which are single cells at the rim of a ramp."""
    order = np.lexsort((cells.y, cells.rc[:, 1], cells.rc[:, 0]))
    rc, y, guessed = cells.rc[order], cells.y[order], cells.guessed[order]
    islands = FloorGrid.from_cells(rc, y, grid=grid.grid, max_climb=PLAN_CLIMB).islands
    keep = np.bincount(islands)[islands] >= _MIN_ISLAND
    return Cells(rc[keep], y[keep], guessed[keep])


def _bridges(places: Points, cells: Cells, storeys: tuple[Storey, ...], *, grid: CellGrid) -> Cells | None:
    """Straight strips that join all islands, guessed where they leave known floor; None if no islands can be joined."""
    floor = FloorGrid.from_cells(cells.rc, cells.y, grid=grid.grid, max_climb=PLAN_CLIMB)
    islands = np.array([floor.island(place) for place in places])
    square = np.column_stack([islands, np.floor(places / _THINNED)])
    kept = np.sort(np.unique(square, axis=0, return_index=True)[1])
    pairs = _shortest_pairs(places[kept], islands[kept], storeys)
    if not len(pairs):
        return None
    strips = [along(*places[kept][pair]) for pair in pairs]
    rise = [float(np.ptp(places[kept][pair][:, 1])) for pair in pairs]
    rank = np.repeat([_RAMP if dy > MAX_LINK_DY else _LEVEL for dy in rise], [len(strip) for strip in strips])
    bridges = cells_of_discs(np.concatenate(strips), CORRIDOR_RADIUS, grid=grid, rank=rank)
    known = Cells(cells.rc[~cells.guessed], cells.y[~cells.guessed], cells.guessed[~cells.guessed])
    return Cells(bridges.rc, bridges.y, ~lies_on(bridges, known))


def _shortest_pairs(points: Points, islands: NDArray[np.int64], storeys: tuple[Storey, ...]) -> Pairs:
    """Pairs of points (K, 2) whose strips join the islands (N,): a minimum spanning tree over the islands."""
    names, island = np.unique(islands, return_inverse=True)
    order = np.argsort(island, kind="stable")
    ends = np.append(np.searchsorted(island[order], np.arange(len(names))), len(points))
    cost = _strip_costs(points[order], storeys)
    between = np.minimum.reduceat(np.minimum.reduceat(cost, ends[:-1], axis=0), ends[:-1], axis=1)
    np.fill_diagonal(between, 0)
    tree = minimum_spanning_tree(np.where(np.isfinite(between), between, 0)).tocoo()
    pairs = []
    for a, b in zip(tree.row, tree.col, strict=True):
        block = cost[ends[a] : ends[a + 1], ends[b] : ends[b + 1]]
        row, col = np.unravel_index(int(block.argmin()), block.shape)
        pairs.append((order[ends[a] + row], order[ends[b] + col]))
    return np.array(pairs, np.int64).reshape(-1, 2)


def _strip_costs(points: Points, storeys: tuple[Storey, ...]) -> NDArray[np.float64]:
    """(N, N) length of a straight strip between two points, inf where it is too steep; storeys cost extra."""
    planar = np.hypot(points[:, None, 0] - points[None, :, 0], points[:, None, 2] - points[None, :, 2])
    rise = np.abs(points[:, None, 1] - points[None, :, 1])
    storey = np.abs(points[:, 1, None] - [storey.floor_y for storey in storeys]).argmin(axis=1)
    apart = np.abs(storey[:, None] - storey[None, :])
    cost = np.maximum(planar, 1e-3) + 2 * rise + _STOREY_PENALTY * apart**2
    return np.where(rise <= planar * math.tan(_MAX_SLOPE) + 0.02, cost, np.inf)
