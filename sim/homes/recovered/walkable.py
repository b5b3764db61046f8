"""Finds the walkable cells of a schematic home: proven floor, corridors that recorded lengths require, strips, flights.

`Recorded` -> `Cells`; the corridors are chosen in corridors.py, the flights in flights.py.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree
from scipy.spatial import KDTree

from sim.types import STOREY_GAP
from sim.walk.floor_grid import FloorGrid
from sim.walk.storeys import nearest_storey

from ..cells import CELL, CellGrid, Cells
from ..images import distance_to
from ..plan import Furniture, Storey
from .approaches import approaches, is_beside
from .corridors import PLAN_CLIMB as PLAN_CLIMB
from .corridors import with_corridors
from .flights import RISER, TREAD, flight_between, num_risers, shortest_run, stepped_strip
from .recorded import Recorded

_LINK = 0.4
"""The floor between two places this close is free (metres). A thing between them would be within 0.2 m of one of them,
but Habitat's navmesh keeps that distance from things (AGENT_RADIUS rounded up to its cells of 0.05 m)."""
_LAYER_GAP = PLAN_CLIMB + 0.03
"""Heights in one column that are closer than this are one floor (metres)."""
_MAX_LINK_DY = 0.25
"""Largest rise of a link and of a level strip (metres)."""
_PLACE_RADIUS = 0.05
"""Radius of floor around a recorded place (metres); with the robot's larger radius, paths would cut every corner."""
_LINK_RADIUS = 0.05
"""Half the width of links (metres)."""
_STRIP_RADIUS = 0.1
"""Half the width of proven strips (metres): with a single cell, a way of some metres bumps at every other step."""
_UNKNOWN_REACH = 1.2
"""Largest distance of guessed floor from known floor (metres)."""
_STRAIGHT = 1.003  # a recorded length this near to the straight line's proves that the line is free
_NEIGHBOURS = 6
_COLUMN_GAP = 50_000.0  # metres; see cells.Metres
_MIN_ISLAND = 20
_THINNED = 0.3  # strips start at one place per square of this side (metres)
_NOISE = 0.25
"""Recorded heights this near to a storey's floor are that floor (metres): Habitat's navmesh has voxels of 0.2 m."""
_LEVEL = 0.02
"""Largest height difference of cells at a storey's height (metres)."""
_TOPS = (0.3, STOREY_GAP)
"""Heights above a storey's floor at which an island without records is the top of a bed or table (metres)."""
_SMOOTH = 3.0
"""Recorded heights of slopes are averaged over about this many cells."""
_ON_TOP = 0.2
"""Places higher than this above the foot of a piece, and over it, are on top of it (metres)."""

Points = NDArray[np.float64]
Pairs = NDArray[np.int64]


class _KnownFloor(NamedTuple):
    """Floor on which the robot certainly fits."""

    places: Points
    """(N, 3) recorded places of its centre."""
    cells: Cells
    """Cells around places, along links and along proven strips."""


def walkable_cells(
    recorded: Recorded,
    storeys: tuple[Storey, ...],
    *,
    grid: CellGrid,
    pieces: Sequence[Furniture] = (),
    solid: Sequence[Furniture] = (),
) -> Cells:
    """Cells where the robot's centre can be.

    Known cells are those around recorded places, between two places at most _LINK apart, and along the straight line of
    a record whose length proves that the line is free. All other cells are `guessed`: corridors that a recorded length
    requires, strips that join the islands of a storey, a flight of steps from each storey to the next, which leaves
    the floor and the `pieces` alone, and ways to things that were only reached from their top. A storey without space
    for a flight stays an island of its own.

    Nothing is floor on top of a `solid` piece (Habitat's navmesh covers beds), or guessed beside one.
    """
    floors_y = [storey.floor_y for storey in storeys]
    known = _known_floor(recorded, floors_y, solid, grid=grid)
    unknown = _away_from(solid, _unknown_cells(known, storeys, grid=grid), grid=grid)
    fitted = with_corridors(known.cells, unknown, recorded.lengths, floors_y=floors_y, grid=grid.grid)
    cells = _terraced(fitted, floors_y, is_known=_lies_on(fitted, known.cells), grid=grid)
    for strip in _strips(known.places, cells, floors_y, grid=grid):
        cells = _merged(strip, cells)  # steps that leave a level floor stay steps
    for k in range(len(storeys) - 1):
        cells, islands = _with_islands(cells, grid)
        low, high = (_largest(cells, islands, storey.floor_y) for storey in storeys[k : k + 2])
        if len(low) and len(high) and islands[low[0]] != islands[high[0]]:
            ends = cells.chosen(low), cells.chosen(high)
            for strip in flight_between(*ends, cells, storeys, k, recorded=recorded, pieces=pieces, grid=grid):
                cells = _merged(cells, strip)
    for strip in approaches(cells, recorded, solid, floors_y, grid=grid):
        cells = _merged(cells, strip)
    cells, islands = _with_islands(cells, grid)
    return cells.chosen(np.bincount(islands)[islands] >= _MIN_ISLAND)  # no single cells at the rim of a flight


def _with_islands(cells: Cells, grid: CellGrid) -> tuple[Cells, NDArray[np.int32]]:
    """The cells, sorted by column and height, and the number of the island of each."""
    ordered = cells.chosen(np.lexsort((cells.y, cells.rc[:, 1], cells.rc[:, 0])))
    floor = FloorGrid.from_cells(ordered.rc, ordered.y, grid=grid.grid, max_climb=PLAN_CLIMB)
    return ordered, floor.islands


def _largest(cells: Cells, islands: NDArray[np.int32], floor_y: float) -> NDArray[np.int64]:
    """Indices of the cells at a storey's height in the island that has most of them."""
    level = np.flatnonzero(np.abs(cells.y - floor_y) < _LEVEL)
    return level[islands[level] == np.bincount(islands[level]).argmax()] if len(level) else level


def _strips(places: Points, cells: Cells, floors_y: list[float], *, grid: CellGrid) -> list[Cells]:
    """Straight strips that join the islands of each storey, guessed where they leave known floor."""
    floor = FloorGrid.from_cells(cells.rc, cells.y, grid=grid.grid, max_climb=PLAN_CLIMB)
    islands = np.array([floor.island(place) for place in places])
    square = np.column_stack([islands, np.floor(places / _THINNED)])
    kept = np.sort(np.unique(square, axis=0, return_index=True)[1])
    strips = [
        stepped_strip(*places[kept][pair], grid=grid) for pair in _shortest_pairs(places[kept], islands[kept], floors_y)
    ]
    known = cells.chosen(~cells.guessed)
    return [strip._replace(guessed=~_lies_on(strip, known)) for strip in strips]


def _shortest_pairs(points: Points, islands: NDArray[np.int64], floors_y: list[float]) -> Pairs:
    """Pairs of points (K, 2) whose strips join the islands (N,): a minimum spanning tree over the islands."""
    names, island = np.unique(islands, return_inverse=True)
    order = np.argsort(island, kind="stable")
    ends = np.append(np.searchsorted(island[order], np.arange(len(names))), len(points))
    cost = _strip_costs(points[order], floors_y)
    between = np.minimum.reduceat(np.minimum.reduceat(cost, ends[:-1], axis=0), ends[:-1], axis=1)
    np.fill_diagonal(between, 0)
    tree = minimum_spanning_tree(np.where(np.isfinite(between), between, 0)).tocoo()
    pairs = []
    for a, b in zip(tree.row, tree.col, strict=True):
        block = cost[ends[a] : ends[a + 1], ends[b] : ends[b + 1]]
        row, col = np.unravel_index(int(block.argmin()), block.shape)
        pairs.append((order[ends[a] + row], order[ends[b] + col]))
    return np.array(pairs, np.int64).reshape(-1, 2)


def _strip_costs(points: Points, floors_y: list[float]) -> NDArray[np.float64]:
    """Cost (N, N) of a straight strip between two points: its length, inf between storeys or if it is too steep."""
    planar = np.hypot(points[:, None, 0] - points[None, :, 0], points[:, None, 2] - points[None, :, 2])
    rise = np.abs(points[:, None, 1] - points[None, :, 1])
    storey = nearest_storey(points[:, 1], floors_y)
    is_possible = (storey[:, None] == storey[None, :]) & (planar >= shortest_run(rise))
    return np.where(is_possible, np.maximum(planar, 1e-3) + 2 * rise, np.inf)


def _off_furniture(places: Points, solid: Sequence[Furniture]) -> Points:
    """The places (N, 3) that are not on top of a piece."""
    keep = np.ones(len(places), bool)
    for piece in solid:
        x0, z0, x1, z1 = piece.rect
        above = places[:, 1] - piece.bottom_y
        over = (places[:, 0] > x0) & (places[:, 0] < x1) & (places[:, 2] > z0) & (places[:, 2] < z1)
        keep &= ~(over & (above > _ON_TOP) & (above < piece.size[1] + _ON_TOP))
    return places[keep]


def _away_from(solid: Sequence[Furniture], cells: Cells, *, grid: CellGrid) -> Cells:
    """The cells at which a robot's body meets no piece."""
    return cells.chosen(~is_beside(np.insert(grid.grid.xz_from_rc(cells.rc), 1, cells.y, axis=1), solid))


def _known_floor(
    recorded: Recorded, floors_y: list[float], solid: Sequence[Furniture], *, grid: CellGrid
) -> _KnownFloor:
    """The floor that the files prove; see the module's constants."""
    places = _off_furniture(reached_places(recorded, floors_y), solid)
    links = _links(places)
    places = np.column_stack([places[:, 0], _levelled(places[:, 1], floors_y), places[:, 2]])
    middles = [places[links[:, 0]] * (1 - share) + places[links[:, 1]] * share for share in (0.25, 0.5, 0.75)]
    strips = [np.zeros((0, 3))]
    for record in recorded.lengths:
        start, end = np.array(record.start), np.array(record.end)
        start[1], end[1] = _levelled(np.array([start[1], end[1]]), floors_y)
        is_level = abs(start[1] - end[1]) <= _MAX_LINK_DY
        if record.is_possible and is_level and record.length < _STRAIGHT * math.dist(start, end):
            strips.append(_along(start, end))
    cells = _cells_of_discs(places, _PLACE_RADIUS, grid=grid)
    for points, radius in ((np.concatenate(middles), _LINK_RADIUS), (np.concatenate(strips), _STRIP_RADIUS)):
        # many links are similar, so one disc per half cell is enough
        kept = points[np.sort(np.unique(np.round(points / (CELL / 2)), axis=0, return_index=True)[1])]
        cells = _merged(cells, _cells_of_discs(kept, radius, grid=grid))
    return _KnownFloor(places, cells)


def _along(start: Points, end: Points) -> Points:
    """Points (K, 3) of a straight strip, half a cell apart."""
    share = np.linspace(0, 1, max(2, math.ceil(math.dist(start, end) / (CELL / 2))))[:, None]
    return start * (1 - share) + end * share


def _links(places: Points) -> Pairs:
    pairs = KDTree(places[:, [0, 2]]).query_pairs(_LINK + 1e-6, output_type="ndarray").reshape(-1, 2)
    return pairs[np.abs(places[pairs[:, 0], 1] - places[pairs[:, 1], 1]) <= _MAX_LINK_DY]


def _levelled(y: NDArray[np.float64], floors_y: list[float]) -> NDArray[np.float64]:
    """Heights (N,), those near a storey's floor exactly at its height."""
    floor = np.array(floors_y)[nearest_storey(y, floors_y)]
    return np.where(np.abs(y - floor) <= _NOISE, floor, y)


def reached_places(recorded: Recorded, floors_y: list[float]) -> Points:
    """Places (N, 3) whose island, by links, holds a standing place on a storey's floor or an end of a record.

    Other islands are tops of beds and tables (islands of Habitat's navmesh too), on which nobody walks.
    """
    places = recorded.places
    links = _links(places)
    graph = coo_array((np.ones(len(links)), (links[:, 0], links[:, 1])), shape=(len(places), len(places)))
    count, island = connected_components(graph, directed=False)
    above = places[:, 1] - np.array(floors_y)[nearest_storey(places[:, 1], floors_y)]
    is_sure = np.zeros(count, bool)
    is_standing = np.arange(len(places)) < len(recorded.standing)
    is_sure[island[is_standing & ((above < _TOPS[0]) | (above > _TOPS[1]))]] = True
    ends = np.array([[record.start, record.end] for record in recorded.lengths]).reshape(-1, 3)
    is_sure[island[KDTree(places).query(ends)[1]]] = True
    return places[is_sure[island]]


def _terraced(cells: Cells, floors_y: list[float], *, is_known: NDArray[np.bool_], grid: CellGrid) -> Cells:
    """The cells with slopes as equal steps between two floors, of RISER below the first floor and above the last.

    Other steps are as deep as the distance to known floor at other heights allows, up to TREAD. Where a storey has
    two floors in one column, such as a level of too few places to be a storey, the upper one keeps its heights.
    """
    storey = nearest_storey(cells.y, floors_y)
    is_upper = np.zeros(len(cells.y), bool)  # cells are sorted by column and height
    is_upper[1:] = (np.diff(cells.rc, axis=0) == 0).all(axis=1) & (np.diff(storey) == 0)
    rises = [rise / num_risers(rise) for rise in np.diff(floors_y).tolist()]
    y = cells.y.copy()
    for k, (below, beyond) in enumerate(zip([RISER, *rises], [*rises, RISER], strict=True)):
        own = np.flatnonzero((storey == k) & ~is_upper)
        at = tuple(cells.rc[own].T)
        above = np.full(grid.shape, np.nan)
        above[at] = cells.y[own] - floors_y[k]
        known, guessed = np.zeros((2, *grid.shape), bool)
        known[tuple(cells.rc[own[is_known[own]]].T)] = True
        guessed[tuple(cells.rc[own[cells.guessed[own]]].T)] = True
        smooth = np.where(np.abs(above) < 0.01, 0, _smoothed(np.where(guessed, np.nan, above)))
        raised = np.where(guessed, above, smooth)
        steps = np.round(raised / np.where(raised < 0, below, beyond))
        low, high = np.full(grid.shape, -np.inf), np.full(grid.shape, np.inf)
        for step in np.unique(steps[known]).tolist():
            away = distance_to(known & (steps == step)) * CELL / TREAD
            low, high = np.maximum(low, step - away), np.minimum(high, step + away)
        is_short = np.round(low) > np.round(high)
        between = np.clip(steps, np.round(low), np.round(high))
        between[is_short] = np.round((low[is_short] + high[is_short]) / 2)
        steps = np.where(known, steps, between)
        y[own] = floors_y[k] + (steps * np.where(steps < 0, below, beyond))[at]
    is_near = np.zeros(len(y), bool)
    is_near[1:] = is_upper[1:] & (np.diff(y) <= PLAN_CLIMB)  # the lower floor rose to it
    return cells._replace(y=y).chosen(~is_near)


def _smoothed(heights: NDArray[np.float64]) -> NDArray[np.float64]:
    """An image of heights without their noise, so that steps have straight edges; cells without height do not count."""
    known = ~np.isnan(heights)
    weight = ndimage.gaussian_filter(known.astype(float), _SMOOTH)
    total = ndimage.gaussian_filter(np.where(known, heights, 0.0), _SMOOTH)
    return np.where(known, total / np.maximum(weight, 1e-9), np.nan)


def _cells_of_discs(discs: Points, radius: float, *, grid: CellGrid) -> Cells:
    """Cells whose centre is within `radius` of a disc's centre (N, 3), and the cells of the centres.

    There is one cell per column and floor.
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
    return _one_per_floor(rc[disc, offset], discs[disc, 1], weight)


def _one_per_floor(rc: NDArray[np.int64], y: NDArray[np.float64], weight: NDArray[np.float64]) -> Cells:
    """One cell per column and floor, at the weighted mean height."""
    order = np.lexsort((y, rc[:, 1], rc[:, 0]))
    rc, y, weight = rc[order], y[order], weight[order]
    new = np.ones(len(rc), bool)
    new[1:] = (np.diff(rc, axis=0) != 0).any(axis=1) | (np.diff(y) > _LAYER_GAP)
    group = np.cumsum(new) - 1
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
