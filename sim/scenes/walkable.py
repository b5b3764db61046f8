"""Where the robot can walk in a schematic home: cells around the places where it stood, and guessed strips between."""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components, dijkstra, minimum_spanning_tree
from scipy.spatial import KDTree

from sim.types import AGENT_RADIUS
from sim.world.floor_grid import FloorGrid

from .cells import CELL, CellGrid, Cells
from .plan import Storey

LINK = 2 * AGENT_RADIUS
"""Standing points this close are joined without a guess (metres; the view points' lattice is 0.25)."""
SHORTCUTS = (0.5, 0.75, 1.0)
"""Longest guessed shortcuts of three rounds (metres); without them a home is a tree of islands, all paths detours."""
PLAN_CLIMB = 0.3
"""Largest height difference of neighbouring cells of a schematic home (metres): recorded heights are noisy."""
LAYER_GAP = PLAN_CLIMB + 0.03
"""Heights of one column closer than this are one floor (metres)."""
_DETOUR = 1.5  # a shortcut is worth a guess where the way round is this many times longer
_MAX_LINK_DY = 0.25
_MIN_ISLAND = 20
_MAX_SLOPE = math.radians(40)
_STOREY_PENALTY = 1000.0  # bridges between storeys come last, and one is enough
_LEVEL, _KNOWN, _RAMP = 0, 1, 2  # ranks of what says how high a cell is

Points = NDArray[np.float64]
Pairs = NDArray[np.int64]


def walkable_cells(standing: Points, storeys: tuple[Storey, ...], *, grid: CellGrid) -> Cells:
    """Cells within AGENT_RADIUS of a standing point (N, 3) or of the middle of two that are linked, and guessed strips.

    The strips join all that can be joined by a straight ramp of at most 40 degrees; a storey without room for one stays
    an island of its own.
    """
    links = KDTree(standing[:, [0, 2]]).query_pairs(LINK + 1e-6, output_type="ndarray")
    links = links[_rise(standing, links) <= _MAX_LINK_DY]
    bridges = _bridges(standing, links, storeys)
    strips = np.concatenate([bridges, _shortcuts(standing, np.concatenate([links, bridges]))])
    discs = [standing, standing[links].mean(axis=1)]
    ranks = [np.full(len(part), _KNOWN) for part in discs]
    for (a, b), rise in zip(strips, _rise(standing, strips), strict=True):
        discs.append(_along(standing[a], standing[b]))
        ranks.append(np.full(len(discs[-1]), _RAMP if rise > _MAX_LINK_DY else _LEVEL))
    return _without_crumbs(_cells_of_discs(np.concatenate(discs), np.concatenate(ranks), grid), grid)


def _without_crumbs(cells: Cells, grid: CellGrid) -> Cells:
    """The cells of islands of some size: single cells at the rim of a ramp are cut off from it."""
    order = np.lexsort((cells.y, cells.rc[:, 1], cells.rc[:, 0]))
    rc, y, guessed = cells.rc[order], cells.y[order], cells.guessed[order]
    islands = FloorGrid.from_cells(rc, y, grid=grid.grid, max_climb=PLAN_CLIMB).islands
    keep = np.bincount(islands)[islands] >= _MIN_ISLAND
    return Cells(rc[keep], y[keep], guessed[keep])


def _rise(standing: Points, pairs: Pairs) -> Points:
    return np.abs(standing[pairs[:, 0], 1] - standing[pairs[:, 1], 1])


def _along(start: Points, end: Points) -> Points:
    """Points (K, 3) of a straight strip, half a cell apart."""
    share = np.linspace(0, 1, max(2, math.ceil(math.dist(start, end) / (CELL / 2))))[:, None]
    return start * (1 - share) + end * share


def _graph(standing: Points, pairs: Pairs) -> csr_array:
    lengths = np.linalg.norm(standing[pairs[:, 0]] - standing[pairs[:, 1]], axis=1)
    num = len(standing)
    return coo_array((lengths, (pairs[:, 0], pairs[:, 1])), shape=(num, num)).tocsr()


def _bridges(standing: Points, links: Pairs, storeys: tuple[Storey, ...]) -> Pairs:
    """Pairs of standing points whose straight strips join all islands: a minimum spanning tree over the islands."""
    num_islands, island = connected_components(_graph(standing, links), directed=False)
    order = np.argsort(island, kind="stable")
    firsts = np.searchsorted(island[order], np.arange(num_islands))
    cost = _bridge_costs(standing[order], storeys)
    between = np.minimum.reduceat(np.minimum.reduceat(cost, firsts, axis=0), firsts, axis=1)
    np.fill_diagonal(between, 0)
    tree = minimum_spanning_tree(np.where(np.isfinite(between), between, 0)).tocoo()
    ends = np.append(firsts, len(standing))
    bridges = []
    for a, b in zip(tree.row, tree.col, strict=True):
        block = cost[ends[a] : ends[a + 1], ends[b] : ends[b + 1]]
        row, col = np.unravel_index(int(block.argmin()), block.shape)
        bridges.append((order[firsts[a] + row], order[firsts[b] + col]))
    return np.array(bridges, np.int64).reshape(-1, 2)


def _bridge_costs(points: Points, storeys: tuple[Storey, ...]) -> NDArray[np.float64]:
    """(N, N) length of a straight strip between two points, inf where it is too steep; storeys cost extra."""
    planar = np.hypot(points[:, None, 0] - points[None, :, 0], points[:, None, 2] - points[None, :, 2])
    rise = np.abs(points[:, None, 1] - points[None, :, 1])
    storey = np.abs(points[:, 1, None] - [storey.floor_y for storey in storeys]).argmin(axis=1)
    apart = np.abs(storey[:, None] - storey[None, :])
    cost = np.maximum(planar, 1e-3) + 2 * rise + _STOREY_PENALTY * apart**2
    return np.where(rise <= planar * math.tan(_MAX_SLOPE) + 0.02, cost, np.inf)


def _shortcuts(standing: Points, joined: Pairs) -> Pairs:
    """Short level strips where the way along `joined` is a long detour; at most one per point and round."""
    near = KDTree(standing[:, [0, 2]]).query_pairs(SHORTCUTS[-1], output_type="ndarray")
    near = near[_rise(standing, near) <= _MAX_LINK_DY]
    lengths = np.linalg.norm(standing[near[:, 0]] - standing[near[:, 1]], axis=1)
    order = np.lexsort((near[:, 1], near[:, 0], lengths))
    near, lengths = near[order], lengths[order]
    found: list[tuple[int, int]] = []
    for longest in SHORTCUTS:
        pairs = np.concatenate([joined, np.array(found, np.int64).reshape(-1, 2)])
        walked = dijkstra(_graph(standing, pairs), directed=False, limit=2 * _DETOUR * SHORTCUTS[-1])
        is_detour = walked[near[:, 0], near[:, 1]] > _DETOUR * lengths + CELL
        used: set[int] = set()
        for a, b in near[is_detour & (lengths <= longest)].tolist():
            if a not in used and b not in used:
                used |= {a, b}
                found.append((a, b))
    return np.array(found, np.int64).reshape(-1, 2)


def _cells_of_discs(discs: Points, rank: NDArray[np.int64], grid: CellGrid) -> Cells:
    """Cells whose centre is within AGENT_RADIUS of a disc's centre (N, 3); one cell per column and floor.

    The discs of the highest rank (N,) in a cell give its height: a ramp that leaves a known floor stays a ramp.
    """
    reach = math.ceil(AGENT_RADIUS / CELL)
    side = np.arange(-reach, reach + 1)
    offsets = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1).reshape(-1, 2)
    spec = grid.grid
    rc = spec.rc_from_xz(discs[:, [0, 2]])[:, None] + offsets  # (N, O, 2)
    distance = np.linalg.norm(spec.xz_from_rc(rc) - discs[:, None, [0, 2]], axis=-1)
    disc, offset = np.nonzero(distance <= AGENT_RADIUS)
    rc, distance, y, rank = rc[disc, offset], distance[disc, offset], discs[disc, 1], rank[disc]
    order = np.lexsort((y, rc[:, 1], rc[:, 0]))
    rc, distance, y, rank = rc[order], distance[order], y[order], rank[order]
    new = np.ones(len(rc), bool)
    new[1:] = (np.diff(rc, axis=0) != 0).any(axis=1) | (np.diff(y) > LAYER_GAP)
    group = np.cumsum(new) - 1
    highest = np.maximum.reduceat(rank, np.flatnonzero(new))
    # a cell at a standing point gets that point's height, one between two points something between
    weight = (rank == highest[group]) / (distance**2 + 0.01**2)
    mean = np.bincount(group, weight * y) / np.bincount(group, weight)
    return Cells(rc[new], mean, np.bincount(group, rank == _KNOWN) == 0)
