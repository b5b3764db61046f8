"""Finds the walkable cells of a schematic home: proven floor, corridors that recorded lengths require, and bridges.

`Recorded` -> `Cells`; the corridors are chosen in corridors.py.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree
from scipy.spatial import KDTree

from sim.walk.floor_grid import FloorGrid
from sim.walk.storeys import nearest_storey

from ..cells import CELL, CellGrid, Cells
from ..images import distance_to
from ..plan import Storey
from .corridors import CORRIDOR_RADIUS, with_corridors
from .corridors import PLAN_CLIMB as PLAN_CLIMB
from .recorded import Recorded

_LINK = 0.4
"""The floor between two places this close is free (metres). A thing between them would be within 0.2 m of one of them,
but Habitat's navmesh keeps that distance from things (AGENT_RADIUS rounded up to its cells of 0.05 m)."""
_LAYER_GAP = PLAN_CLIMB + 0.03
"""Heights in one column that are closer than this are one floor (metres)."""
_MAX_LINK_DY = 0.25
"""Largest rise of a link and of a level strip (metres)."""
_PLACE_RADIUS = 0.15
"""Radius of floor around a recorded place (metres); with the robot's larger radius, paths would cut every corner."""
_STRIP_RADIUS = 0.12
"""Half the width of links and of proven strips (metres)."""
_UNKNOWN_REACH = 1.2
"""Largest distance of guessed floor from known floor (metres)."""
_STRAIGHT = 1.003  # a recorded length this near to the straight line's proves that the line is free
_NEIGHBOURS = 6
_COLUMN_GAP = 50_000.0  # metres; see cells.Metres
_MIN_ISLAND = 20
_MAX_SLOPE = math.radians(40)
_STOREY_PENALTY = 1000.0  # bridges between storeys come last, and one is enough
_THINNED = 0.3  # bridges start at one place per square of this side (metres)
_LEVEL, _RAMP = 0, 1

Points = NDArray[np.float64]
Pairs = NDArray[np.int64]


class _KnownFloor(NamedTuple):
    """Floor on which the robot certainly fits."""

    places: Points
    """(N, 3) recorded places of its centre."""
    cells: Cells
    """Cells around places, along links and along proven strips."""


def walkable_cells(recorded: Recorded, storeys: tuple[Storey, ...], *, grid: CellGrid) -> Cells:
    """Cells where the robot's centre can be.

    Known cells are those around recorded places, between two places at most _LINK apart, and along the straight line of
    a record whose length proves that the line is free. All other cells are `guessed`: corridors that a recorded length
    requires, and bridges, which join all islands that a straight ramp of at most 40 degrees can join. A storey without
    space for a bridge stays an island of its own.
    """
    known = _known_floor(recorded, grid=grid)
    unknown = _unknown_cells(known, storeys, grid=grid)
    fitted = with_corridors(known.cells, unknown, recorded.lengths, grid=grid.grid)
    bridges = _bridges(known.places, fitted, storeys, grid=grid)
    # a ramp that leaves a level floor stays a ramp, so bridges come first
    return _without_crumbs(fitted if bridges is None else _merged(bridges, fitted), grid)


def _without_crumbs(cells: Cells, grid: CellGrid) -> Cells:
    """The cells without tiny islands, which are single cells at the rim of a ramp."""
    ordered = cells.chosen(np.lexsort((cells.y, cells.rc[:, 1], cells.rc[:, 0])))
    islands = FloorGrid.from_cells(ordered.rc, ordered.y, grid=grid.grid, max_climb=PLAN_CLIMB).islands
    return ordered.chosen(np.bincount(islands)[islands] >= _MIN_ISLAND)


def _bridges(places: Points, cells: Cells, storeys: tuple[Storey, ...], *, grid: CellGrid) -> Cells | None:
    """Straight strips that join all islands, guessed where they leave known floor; None if no islands can be joined."""
    floor = FloorGrid.from_cells(cells.rc, cells.y, grid=grid.grid, max_climb=PLAN_CLIMB)
    islands = np.array([floor.island(place) for place in places])
    square = np.column_stack([islands, np.floor(places / _THINNED)])
    kept = np.sort(np.unique(square, axis=0, return_index=True)[1])
    pairs = _shortest_pairs(places[kept], islands[kept], storeys)
    if not len(pairs):
        return None
    strips = [_along(*places[kept][pair]) for pair in pairs]
    rise = [float(np.ptp(places[kept][pair][:, 1])) for pair in pairs]
    rank = np.repeat([_RAMP if dy > _MAX_LINK_DY else _LEVEL for dy in rise], [len(strip) for strip in strips])
    bridges = _cells_of_discs(np.concatenate(strips), CORRIDOR_RADIUS, grid=grid, rank=rank)
    return bridges._replace(guessed=~_lies_on(bridges, cells.chosen(~cells.guessed)))


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
    """Cost (N, N) of a straight strip between two points: its length, more between storeys, inf if it is too steep."""
    planar = np.hypot(points[:, None, 0] - points[None, :, 0], points[:, None, 2] - points[None, :, 2])
    rise = np.abs(points[:, None, 1] - points[None, :, 1])
    storey = nearest_storey(points[:, 1], [storey.floor_y for storey in storeys])
    apart = np.abs(storey[:, None] - storey[None, :])
    cost = np.maximum(planar, 1e-3) + 2 * rise + _STOREY_PENALTY * apart**2
    return np.where(rise <= planar * math.tan(_MAX_SLOPE) + 0.02, cost, np.inf)


def _known_floor(recorded: Recorded, *, grid: CellGrid) -> _KnownFloor:
    """The floor that the files prove; see the module's constants."""
    places = _connected_places(recorded)
    links = _links(places)
    middles = [places[links[:, 0]] * (1 - share) + places[links[:, 1]] * share for share in (0.25, 0.5, 0.75)]
    for record in recorded.lengths:
        start, end = np.array(record.start), np.array(record.end)
        is_level = abs(start[1] - end[1]) <= _MAX_LINK_DY
        if record.is_possible and is_level and record.length < _STRAIGHT * math.dist(start, end):
            middles.append(_along(start, end))
    strips = np.concatenate(middles)
    # many links are similar, so one disc per half cell is enough
    strips = strips[np.sort(np.unique(np.round(strips / (CELL / 2)), axis=0, return_index=True)[1])]
    parts = (_cells_of_discs(places, _PLACE_RADIUS, grid=grid), _cells_of_discs(strips, _STRIP_RADIUS, grid=grid))
    return _KnownFloor(places, _merged(*parts))


def _along(start: Points, end: Points) -> Points:
    """Points (K, 3) of a straight strip, half a cell apart."""
    share = np.linspace(0, 1, max(2, math.ceil(math.dist(start, end) / (CELL / 2))))[:, None]
    return start * (1 - share) + end * share


def _links(places: Points) -> Pairs:
    pairs = KDTree(places[:, [0, 2]]).query_pairs(_LINK + 1e-6, output_type="ndarray").reshape(-1, 2)
    return pairs[np.abs(places[pairs[:, 0], 1] - places[pairs[:, 1], 1]) <= _MAX_LINK_DY]


def _connected_places(recorded: Recorded) -> Points:
    """Standing places, and the extra places that links join to one of them or to the end of a record.

    Other extra places may be on tops of tables (they are islands of Habitat's navmesh too).
    """
    places = recorded.places
    links = _links(places)
    graph = coo_array((np.ones(len(links)), (links[:, 0], links[:, 1])), shape=(len(places), len(places)))
    count, island = connected_components(graph, directed=False)
    is_sure = np.zeros(count, bool)
    is_sure[island[: len(recorded.standing)]] = True
    ends = np.array([record.end for record in recorded.lengths]).reshape(-1, 3)
    is_sure[island[KDTree(places).query(ends)[1]]] = True
    return places[is_sure[island]]


def _cells_of_discs(discs: Points, radius: float, *, grid: CellGrid, rank: NDArray[np.int64] | None = None) -> Cells:
    """Cells whose centre is within `radius` of a disc's centre (N, 3), and the cells of the centres.

    There is one cell per column and floor. The discs with the highest rank (N,) in a cell give its height: a ramp that
    leaves a level floor stays a ramp.
    """
    reach = math.ceil(radius / CELL)
    side = np.arange(-reach, reach + 1)
    offsets = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1).reshape(-1, 2)
    spec = grid.grid
    rc = spec.rc_from_xz(discs[:, [0, 2]])[:, None] + offsets  # (N, O, 2)
    distance = np.linalg.norm(spec.xz_from_rc(rc) - discs[:, None, [0, 2]], axis=-1)
    is_inside = ((rc >= 0) & (rc < np.array(grid.shape))).all(axis=-1)
    disc, offset = np.nonzero(((distance <= radius) | (offsets == 0).all(axis=1)) & is_inside)
    weight = 1 / (distance[disc, offset] ** 2 + 0.01**2)
    ranks = np.zeros(len(disc), np.int64) if rank is None else rank[disc]
    return _one_per_floor(rc[disc, offset], discs[disc, 1], weight, ranks)


def _one_per_floor(
    rc: NDArray[np.int64], y: NDArray[np.float64], weight: NDArray[np.float64], rank: NDArray[np.int64]
) -> Cells:
    """One cell per column and floor, at the weighted mean height of those with the highest rank."""
    order = np.lexsort((y, rc[:, 1], rc[:, 0]))
    rc, y, weight, rank = rc[order], y[order], weight[order], rank[order]
    new = np.ones(len(rc), bool)
    new[1:] = (np.diff(rc, axis=0) != 0).any(axis=1) | (np.diff(y) > _LAYER_GAP)
    group = np.cumsum(new) - 1
    highest = np.maximum.reduceat(rank, np.flatnonzero(new)) if len(rank) else rank
    weight = weight * (rank == highest[group])
    mean = np.bincount(group, weight * y) / np.bincount(group, weight)
    return Cells(rc[new], mean, np.zeros(len(mean), bool))


def _merged(first: Cells, second: Cells) -> Cells:
    """All cells of `first`, and those of `second` that are not on its floors; sorted by column and height."""
    is_new = ~_lies_on(second, first)
    rc, y = np.concatenate([first.rc, second.rc[is_new]]), np.concatenate([first.y, second.y[is_new]])
    both = Cells(rc, y, np.concatenate([first.guessed, second.guessed[is_new]]))
    return both.chosen(np.lexsort((y, rc[:, 1], rc[:, 0])))


def _lies_on(cells: Cells, floor: Cells) -> NDArray[np.bool_]:
    """Whether the floor has a cell in each cell's column at its height, (N,)."""
    width = 1 + max(int(part.rc[:, 1].max(initial=0)) for part in (cells, floor))
    # one axis for column and height: columns are farther apart than any two heights
    at, at_floor = ((rc[:, 0] * width + rc[:, 1]) * _COLUMN_GAP + y for rc, y, _ in (cells, floor))
    ordered = np.concatenate([[-np.inf], np.sort(at_floor), [np.inf]])
    above = np.searchsorted(ordered, at)
    return np.minimum(ordered[above] - at, at - ordered[above - 1]) <= _LAYER_GAP


def _unknown_cells(known: _KnownFloor, storeys: tuple[Storey, ...], *, grid: CellGrid) -> Cells:
    """Cells within _UNKNOWN_REACH of a storey's known floor in columns where it has none, marked as guessed.

    Their heights are between those of the nearest places, so that a ramp joins half a storey.
    """
    floors = np.array([storey.floor_y for storey in storeys])
    cell_storey, place_storey = (nearest_storey(y, floors) for y in (known.cells.y, known.places[:, 1]))
    found = known.cells
    for k in range(len(storeys)):
        places = known.places[place_storey == k]
        rows, cols = known.cells.rc[cell_storey == k].T
        if not len(places) or not len(rows):
            continue
        mask = np.zeros(grid.shape, bool)
        mask[rows, cols] = True
        rc = np.argwhere(~mask & (distance_to(mask) * CELL <= _UNKNOWN_REACH))
        distance, near = KDTree(places[:, [0, 2]]).query(grid.grid.xz_from_rc(rc), k=min(_NEIGHBOURS, len(places)))
        near, weight = (array.reshape(len(rc), -1) for array in (near, 1 / (distance**2 + 0.1**2)))
        y = (places[near, 1] * weight).sum(axis=1) / weight.sum(axis=1)
        found = _merged(found, Cells(rc, y, np.ones(len(rc), bool)))
    return found.chosen(found.guessed)
