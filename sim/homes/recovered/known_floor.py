"""The known floor of a schematic home: cells around recorded places and proven strips; and the possible floor.

`Recorded` -> `KnownFloor`, `unknown_cells`; used by `walkable`.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from ..cells import CELL, CellGrid, Cells
from ..plan import Storey
from .corridors import PLAN_CLIMB
from .recorded import Recorded

LINK = 0.4
"""The way between places this close is free (metres): a thing between them would be within 0.2 m of one of them, and
Habitat's navmesh keeps that distance from things (AGENT_RADIUS rounded up to its cells of 0.05 m)."""
LAYER_GAP = PLAN_CLIMB + 0.03
"""Heights of one column closer than this are one floor (metres)."""
MAX_LINK_DY = 0.25
"""Largest rise of a link and of a level strip (metres)."""
PLACE_RADIUS = 0.15
"""Radius of floor around a recorded place (metres); with the robot's radius, paths would cut every corner."""
STRIP_RADIUS = 0.12
"""Half the width of links and of proven strips (metres)."""
UNKNOWN_REACH = 1.2
"""Largest distance of guessed floor from known floor (metres)."""
_STRAIGHT = 1.003  # a recorded length this near to the straight line's proves that the line is free
_NEIGHBOURS = 6
_COLUMN_GAP = 50_000.0  # metres; see cells.Metres

Points = NDArray[np.float64]
Pairs = NDArray[np.int64]


class KnownFloor(NamedTuple):
    """Floor on which the robot certainly fits."""

    places: Points
    """(N, 3) recorded places of its centre."""
    cells: Cells
    """Cells around places, along links and along proven strips."""


def known_floor(recorded: Recorded, *, grid: CellGrid) -> KnownFloor:
    """The floor that the files prove; see the module's constants."""
    places = _connected_places(recorded)
    links = _links(places)
    middles = [places[links[:, 0]] * (1 - share) + places[links[:, 1]] * share for share in (0.25, 0.5, 0.75)]
    for record in recorded.lengths:
        start, end = np.array(record.start), np.array(record.end)
        is_level = abs(start[1] - end[1]) <= MAX_LINK_DY
        if record.is_possible and is_level and record.length < _STRAIGHT * math.dist(start, end):
            middles.append(along(start, end))
    strips = np.concatenate(middles)
    # links are many and similar: one disc per half cell is enough
    strips = strips[np.sort(np.unique(np.round(strips / (CELL / 2)), axis=0, return_index=True)[1])]
    parts = (cells_of_discs(places, PLACE_RADIUS, grid=grid), cells_of_discs(strips, STRIP_RADIUS, grid=grid))
    return KnownFloor(places, merged(*parts))


def along(start: Points, end: Points) -> Points:
    """Points (K, 3) of a straight strip, half a cell apart."""
    share = np.linspace(0, 1, max(2, math.ceil(math.dist(start, end) / (CELL / 2))))[:, None]
    return start * (1 - share) + end * share


def _links(places: Points) -> Pairs:
    pairs = KDTree(places[:, [0, 2]]).query_pairs(LINK + 1e-6, output_type="ndarray").reshape(-1, 2)
    return pairs[np.abs(places[pairs[:, 0], 1] - places[pairs[:, 1], 1]) <= MAX_LINK_DY]


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


def cells_of_discs(discs: Points, radius: float, *, grid: CellGrid, rank: NDArray[np.int64] | None = None) -> Cells:
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
    new[1:] = (np.diff(rc, axis=0) != 0).any(axis=1) | (np.diff(y) > LAYER_GAP)
    group = np.cumsum(new) - 1
    highest = np.maximum.reduceat(rank, np.flatnonzero(new)) if len(rank) else rank
    weight = weight * (rank == highest[group])
    mean = np.bincount(group, weight * y) / np.bincount(group, weight)
    return Cells(rc[new], mean, np.zeros(len(mean), bool))


def merged(first: Cells, second: Cells) -> Cells:
    """All cells of the first, and those of the second outside its floors; sorted by column and height."""
    is_new = ~lies_on(second, first)
    rc, y = np.concatenate([first.rc, second.rc[is_new]]), np.concatenate([first.y, second.y[is_new]])
    order = np.lexsort((y, rc[:, 1], rc[:, 0]))
    return Cells(rc[order], y[order], np.concatenate([first.guessed, second.guessed[is_new]])[order])


def lies_on(cells: Cells, floor: Cells) -> NDArray[np.bool_]:
    """(N,) whether the floor has a cell in each cell's column at its height."""
    width = 1 + max(int(part.rc[:, 1].max(initial=0)) for part in (cells, floor))
    # one axis for column and height: columns are farther apart than any two heights
    at, at_floor = ((rc[:, 0] * width + rc[:, 1]) * _COLUMN_GAP + y for rc, y, _ in (cells, floor))
    ordered = np.concatenate([[-np.inf], np.sort(at_floor), [np.inf]])
    above = np.searchsorted(ordered, at)
    return np.minimum(ordered[above] - at, at - ordered[above - 1]) <= LAYER_GAP


def unknown_cells(known: KnownFloor, storeys: tuple[Storey, ...], *, grid: CellGrid) -> Cells:
    """Cells within UNKNOWN_REACH of a storey's known floor in columns where it has none, marked as guessed.

    Their heights are between those of the nearest places, so that a ramp joins half a storey.
    """
    floors = np.array([storey.floor_y for storey in storeys])
    cell_storey, place_storey = (
        np.abs(y[:, None] - floors).argmin(axis=1) for y in (known.cells.y, known.places[:, 1])
    )
    found = known.cells
    for k in range(len(storeys)):
        places = known.places[place_storey == k]
        rows, cols = known.cells.rc[cell_storey == k].T
        if not len(places) or not len(rows):
            continue
        mask = np.zeros(grid.shape, bool)
        mask[rows, cols] = True
        away = np.asarray(ndimage.distance_transform_edt(~mask))
        rc = np.argwhere(~mask & (away * CELL <= UNKNOWN_REACH))
        distance, near = KDTree(places[:, [0, 2]]).query(grid.grid.xz_from_rc(rc), k=min(_NEIGHBOURS, len(places)))
        near, weight = (array.reshape(len(rc), -1) for array in (near, 1 / (distance**2 + 0.1**2)))
        y = (places[near, 1] * weight).sum(axis=1) / weight.sum(axis=1)
        found = merged(found, Cells(rc, y, np.ones(len(rc), bool)))
    return Cells(found.rc[found.guessed], found.y[found.guessed], found.guessed[found.guessed])
