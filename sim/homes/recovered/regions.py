"""Assigns the open cells of a storey to seeds (objects of known rooms), and groups seeds of one room.

Cells and seeds -> labels, for rooms.py. Path lengths are weighted: a path counts as longer near walls and in doorways.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components, dijkstra

from sim.episodes.schema import Goal
from sim.words.places import RoomKind

from ..cells import CellGrid
from ..images import distance_to, nearest
from .names import RoomName
from .recorded import original_places

_CLEAR, _NARROW = 0.5, 4.0
"""Cells nearer than _CLEAR to a wall (metres) count up to 1 + _NARROW times as long, so that rooms end at doors."""
_SAME_ROOM = 2.0
_SAME_TEXT = 8.0
"""Rooms of one kind, and rooms with one text, are one room if their objects are this near (metres, weighted)."""
_FAR = 6.0
"""Cells farther than this from every object (metres, weighted) belong to the storey, not to a room."""
_SMALLEST = 1.8
"""Smallest room (square metres)."""
_SMOOTH = 9  # side in cells of the square around a cell in which the most frequent label wins
_SINGLE: tuple[RoomKind, ...] = ("kitchen", "garage", "dining room", "laundry room", "utility room", "attic")
"""Kinds of rooms that a storey has only once, even if texts give parts of the room different names."""
_FILLERS = frozenset(("of", "the", "with", "a", "an", "in", "near", "next", "to", "before", "and", "its", "on", "part"))

_OPEN_BORDER = 2.0
"""Nothing divides two rooms of one kind with an open border of this length (metres): it is wider than doors."""
_CROSSED, _LEAST_CROSSED = 0.05, 5
"""Nothing divides two rooms of one kind either if this share, and number, of the lines of sight to their objects cross
from one to the other."""

Labels = NDArray[np.int64]


class Seed(NamedTuple):
    """An object that decides the room around it."""

    goal: Goal
    room: RoomName


class CellGraph(NamedTuple):
    """The open cells of one storey as a graph."""

    node: Labels
    """(rows, cols) index of the node of each open cell, -1 elsewhere."""
    links: csr_array


def cell_graph(mask: NDArray[np.bool_], cell: float) -> CellGraph:
    """The graph of open cells; links between neighbours have weighted lengths in metres."""
    node = np.full(mask.shape, -1, np.int64)
    node[mask] = np.arange(mask.sum())
    clearance = distance_to(~np.pad(mask, 1))[1:-1, 1:-1] * cell
    weight = 1 + _NARROW * np.clip(1 - clearance / _CLEAR, 0, 1)
    rows, cols = mask.shape
    starts, ends, lengths = [], [], []
    for dr, dc in ((0, 1), (1, 0), (1, 1), (1, -1)):
        a = (slice(0, rows - dr), slice(max(0, -dc), cols - max(0, dc)))
        b = (slice(dr, rows), slice(max(0, dc), cols + min(0, dc)))
        both = mask[a] & mask[b]
        starts.append(node[a][both])
        ends.append(node[b][both])
        lengths.append(np.hypot(dr, dc) * cell * (weight[a][both] + weight[b][both]) / 2)
    num = int(mask.sum())
    pairs = (np.concatenate(starts), np.concatenate(ends))
    links = coo_array((np.concatenate(lengths), pairs), shape=(num, num)).tocsr()
    return CellGraph(node, (links + links.T).tocsr())


def spread(graph: CellGraph, seeds: Sequence[Seed], grid: CellGrid) -> tuple[NDArray[np.float64], Labels]:
    """Weighted path length from each cell to the nearest seed (inf = none), and that seed's index (-1); (rows, cols).

    A path starts at a place that sees the seed's object, or at the object itself, so that it crosses no wall.
    """
    num = int(graph.node.max()) + 1
    distance, nearest = np.full(graph.node.shape, np.inf), np.full(graph.node.shape, -1, np.int64)
    rows, cols, lengths = [], [], []
    for index, seed in enumerate(seeds):
        centre, places = np.array(seed.goal.position)[[0, 2]], places_of(seed.goal)[:, [0, 2]]
        points = np.concatenate([places, centre[None]])
        rc = grid.nearest_rc(points)
        nodes = graph.node[rc[:, 0], rc[:, 1]]
        away = np.linalg.norm(points - centre, axis=1) + grid.cell
        rows.append(np.full((nodes >= 0).sum(), num + index))
        cols.append(nodes[nodes >= 0])
        lengths.append(away[nodes >= 0])
    if not seeds or not sum(map(len, cols)):
        return distance, nearest
    size = num + len(seeds)
    cells = graph.links.tocoo()
    data = np.concatenate([cells.data, *lengths])
    ends = (np.concatenate([cells.coords[0], *rows]), np.concatenate([cells.coords[1], *cols]))
    # duplicates would add up, so only the shortest of equal pairs counts
    order = np.lexsort((data, ends[1], ends[0]))
    first = np.ones(len(order), bool)
    first[1:] = (np.diff(ends[0][order]) != 0) | (np.diff(ends[1][order]) != 0)
    keep = order[first]
    whole = csr_array((data[keep], (ends[0][keep], ends[1][keep])), shape=(size, size))
    lengths_to, _, sources = dijkstra(
        whole, directed=True, indices=np.arange(num, size), min_only=True, return_predecessors=True
    )
    is_open = graph.node >= 0
    distance[is_open] = lengths_to[:num]
    nearest[is_open] = np.where(sources[:num] >= 0, sources[:num] - num, -1)
    return distance, nearest


def places_of(goal: Goal) -> NDArray[np.float64]:
    """Places (V, 3) that see an object or, where none is known, the extra view points on its storey."""
    places = original_places(goal)
    if len(places):
        return places
    added = np.array([point.agent_state.position for point in goal.view_points], float).reshape(-1, 3)
    return added[np.abs(added[:, 1] - goal.floor_y) < 0.5]


def distance_at(goal: Goal, distance: NDArray[np.float64], grid: CellGrid) -> float:
    """Least of the distances (rows, cols) at the places that see a goal; 0 where no place is known."""
    rc = grid.nearest_rc(places_of(goal)[:, [0, 2]])
    return float(distance[rc[:, 0], rc[:, 1]].min()) if len(rc) else 0.0


def groups_of(seeds: Sequence[Seed], distance: NDArray[np.float64], nearest: Labels) -> Labels:
    """Index (N,) of the first seed in each seed's room; seeds of one kind share a room if they are near enough."""
    num = len(seeds)
    if not num:
        return np.zeros(0, np.int64)
    ways = _ways_between(distance, nearest, num)
    pairs = [
        (a, b)
        for a in range(num)
        for b in range(a + 1, num)
        if _is_one_room(seeds[a], seeds[b], float(min(ways[a, b], ways[b, a])))
    ]
    return _grouped(pairs, num)


def _grouped(pairs: Sequence[tuple[int, int]], num: int) -> Labels:
    """Index (N,) of the first of all that are linked to each of `num` things, directly or through others."""
    links = np.array(pairs, np.int64).reshape(-1, 2)
    graph = coo_array((np.ones(len(links)), (links[:, 0], links[:, 1])), shape=(num, num))
    _, group = connected_components(graph, directed=False)
    first = np.full(num, num, np.int64)
    np.minimum.at(first, group, np.arange(num))
    return first[group]


def _borders(labels: Labels) -> Iterator[tuple[tuple[slice, ...], tuple[slice, ...], NDArray[np.bool_]]]:
    """Two shifted views of an image of labels, and where different labels (not -1) lie side by side in them."""
    for a, b in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1, :], np.s_[1:, :])):
        yield a, b, (labels[a] >= 0) & (labels[b] >= 0) & (labels[a] != labels[b])


def _ways_between(distance: NDArray[np.float64], nearest: Labels, num: int) -> NDArray[np.float64]:
    """Weighted path lengths (N, N) between seeds whose cells touch, else inf; the smaller of both directions counts."""
    ways = np.full((num, num), np.inf)
    for a, b, touch in _borders(nearest):
        np.minimum.at(ways, (nearest[a][touch], nearest[b][touch]), distance[a][touch] + distance[b][touch])
    return ways


def home_of(goal: Goal, labels: Labels, grid: CellGrid) -> tuple[int, Counter[int]]:
    """The label with most of the places that see an object (-1 = none), and their number by label."""
    rc = grid.nearest_rc(np.concatenate([places_of(goal), np.array([goal.position])])[:, [0, 2]])
    votes = Counter(label for label in labels[rc[:, 0], rc[:, 1]].tolist() if label >= 0)
    return min(votes, key=lambda label: (-votes[label], label), default=-1), votes


def joined(labels: Labels, rooms: Sequence[RoomName | None], goals: Iterable[Goal], grid: CellGrid) -> Labels:
    """The new label (L,) of each label: rooms of one kind that nothing divides are one, also with empty rooms.

    Args:
        labels: (rows, cols) label of each open cell, -1 elsewhere.
        rooms: (L,) name of each label; None for the part of a storey without a name.
        goals: The storey's objects.
        grid: Place of the cells.
    """
    lines = np.zeros((len(rooms), len(rooms)), np.int64)
    for goal in goals:
        home, votes = home_of(goal, labels, grid)
        for label, count in votes.items():
            lines[home, label] += count
    borders = np.zeros(lines.shape)
    for a, b, touch in _borders(labels):
        np.add.at(borders, (labels[a][touch], labels[b][touch]), grid.cell)
    borders += borders.T
    pairs = [(a, b) for a, b in np.argwhere(np.triu(borders) > 0).tolist() if _is_open(a, b, rooms, lines, borders)]
    is_empty = [room is not None and not own.any() for room, own in zip(rooms, lines, strict=True)]
    widest = borders.argmax(axis=1).tolist()
    pairs += [(k, widest[k]) for k in np.flatnonzero(is_empty).tolist() if borders[k, widest[k]] >= _OPEN_BORDER]
    return _grouped(pairs, len(rooms))


def _is_open(a: int, b: int, rooms: Sequence[RoomName | None], lines: Labels, borders: NDArray[np.float64]) -> bool:
    """Whether nothing divides two labels of one kind, by lines of sight (L, L) and lengths of borders (L, L)."""
    first, second = rooms[a], rooms[b]
    if first is None or second is None or first.kind != second.kind:
        return False
    is_crossed = lines[a, b] + lines[b, a] >= max(_LEAST_CROSSED, _CROSSED * lines[[a, b]].sum())
    return bool(is_crossed) or (bool(borders[a, b] >= _OPEN_BORDER) and _may_be_one(first, second))


def _may_be_one(a: RoomName, b: RoomName) -> bool:
    """Whether texts may give one room both names: equal words, or one names only the kind."""
    return _own_words(a) == _own_words(b) or not (_own_words(a) and _own_words(b))


def _own_words(room: RoomName) -> set[str]:
    """The words of a room's text that are more than its kind."""
    words = set(room.text.split()) - _FILLERS
    return set() if words == set(room.kind.split()) else words


def _is_one_room(a: Seed, b: Seed, way: float) -> bool:
    if a.room.kind != b.room.kind:
        return False
    straight = float(np.hypot(a.goal.position[0] - b.goal.position[0], a.goal.position[2] - b.goal.position[2]))
    words = [_own_words(seed.room) for seed in (a, b)]
    is_plain = [not own for own in words]
    if a.room.kind in _SINGLE:
        return way < _SAME_TEXT or straight < _SAME_TEXT
    if words[0] == words[1]:
        return way < (_SAME_TEXT / 2 if all(is_plain) else _SAME_TEXT) or (not any(is_plain) and straight < _SAME_TEXT)
    return any(is_plain) and way < _SAME_ROOM


def settled(labels: Labels, distance: NDArray[np.float64], mask: NDArray[np.bool_], *, num: int, cell: float) -> Labels:
    """Labels of all open cells: smoothed, without small regions; `num` labels cells without a room's name."""
    labels = np.where(mask & np.isinf(distance), -1, labels)
    far = mask & (labels >= 0) & (distance > _FAR)
    labels = np.where(far, num, labels)
    labels = _filled(np.where(mask, labels, -1), mask, rest=num)
    for _ in range(2):
        labels = _majority(labels, mask)
    for _ in range(3):
        found, count = np.unique(labels[mask], return_counts=True)
        small = found[count * cell**2 < _SMALLEST]
        if not len(small) or len(small) == len(found):
            break
        labels = _filled(np.where(np.isin(labels, small), -1, labels), mask, rest=num)
    return labels


def _filled(labels: Labels, mask: NDArray[np.bool_], *, rest: int) -> Labels:
    """The labels, where each open cell without one (-1) takes the nearest cell's, or `rest` if no cell has a label."""
    has = mask & (labels >= 0)
    if not has.any():
        return np.where(mask, rest, -1)
    return np.where(mask, labels[nearest(has)], -1)


def _majority(labels: Labels, mask: NDArray[np.bool_]) -> Labels:
    """The labels after each open cell has taken the most frequent label around it."""
    found = np.unique(labels[mask])
    votes = np.stack([ndimage.uniform_filter((labels == label).astype(np.float32), _SMOOTH) for label in found])
    return np.where(mask, found[votes.argmax(axis=0)], -1)
