"""Edges of cells with a wall, their chains, and the few straight lines that replace the chains."""

import itertools
import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sim.compiled import njit

_STUMP = 10
"""A wall with a free end and fewer cells than this is left out."""
_SCRAP = 40
"""Connected walls with fewer cells than this together are left out."""
_STEPS = ((0, 1), (0, -1), (1, 0), (-1, 0))
"""(row, col) steps in the four directions from a corner, in the order of `WallLines.ways`."""


class WallLines(NamedTuple):
    """Sides of cells with a wall."""

    across: NDArray[np.bool_]
    """(rows + 1, cols): between cell (r - 1, c) and cell (r, c)."""
    along: NDArray[np.bool_]
    """(rows, cols + 1): between cell (r, c - 1) and cell (r, c)."""

    @classmethod
    def none(cls, shape: tuple[int, ...]) -> "WallLines":
        """No wall on a grid of this shape (rows, cols)."""
        rows, cols = shape
        return cls(np.zeros((rows + 1, cols), bool), np.zeros((rows, cols + 1), bool))

    def ways(self) -> NDArray[np.bool_]:
        """Whether a wall leaves each corner to the east, west, south (row + 1), north: (rows + 1, cols + 1, 4)."""
        rows, cols = self.along.shape[0], self.across.shape[1]
        found = np.zeros((rows + 1, cols + 1, 4), bool)
        found[:, :-1, 0] = found[:, 1:, 1] = self.across
        found[:-1, :, 2] = found[1:, :, 3] = self.along
        return found

    def corners(self) -> NDArray[np.bool_]:
        """Mask (rows + 1, cols + 1) of the corners of cells at which a wall stands."""
        return np.asarray(self.ways().any(axis=2), bool)


def outline(mask: NDArray[np.bool_]) -> WallLines:
    """The border of a mask (rows, cols)."""
    wide = np.pad(mask, 1)
    return WallLines(wide[1:, 1:-1] != wide[:-1, 1:-1], wide[1:-1, 1:] != wide[1:-1, :-1])


class Chain(NamedTuple):
    """A line of walls from corner to corner without a fork."""

    corners: NDArray[np.int64]
    """(N + 1, 2) row and column of cell corners; the first equals the last where `is_closed`."""
    is_closed: bool

    @property
    def steps(self) -> NDArray[np.int64]:
        """The step from each corner to the next, (N, 2)."""
        return np.diff(self.corners, axis=0)

    def steps_around(self, at: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The steps before and after places (N,) along the chain, (N, 2) each; the same one inside a step."""
        steps, mode = self.steps.astype(float), "wrap" if self.is_closed else "clip"
        before, after = np.ceil(at).astype(int) - 1, np.floor(at).astype(int)
        return steps.take(before, axis=0, mode=mode), steps.take(after, axis=0, mode=mode)

    def cells(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Rows and columns of the cells on the left and on the right of every step, each (N, 2); -z is left of +x."""
        start, step = self.corners[:-1], self.steps
        second = np.minimum(start, start + step)  # south or east of the step
        first = second + np.where((step[:, 0] == 0)[:, None], [-1, 0], [0, -1])  # north or west of it
        forward = (step[:, 1] == 1) | (step[:, 0] == -1)
        return np.where(forward[:, None], first, second), np.where(forward[:, None], second, first)


def chains_of(walls: WallLines) -> list[Chain]:
    """All chains; forks and free ends are their ends, everything else is a loop."""
    ways = walls.ways()
    left = ways.copy()
    degree = ways.sum(axis=2)
    found = []
    ends = np.argwhere((degree > 0) & (degree != 2))
    for start in ends.tolist():
        for way in range(4):
            if left[start[0], start[1], way]:
                found.append(Chain(_followed(start[0], start[1], way, left, degree), False))
    for start in np.argwhere((degree == 2) & left.any(axis=2)).tolist():
        if left[start[0], start[1]].any():
            way = int(left[start[0], start[1]].argmax())
            found.append(Chain(_followed(start[0], start[1], way, left, degree), True))
    return found


@njit(cache=True, nogil=True)
def _followed(row, col, way, left, degree):
    """(N, 2) corners from a start to a fork, an end or back to the start; removes the steps from `left`."""
    corners = [(row, col)]
    while way >= 0:
        left[row, col, way] = False
        row, col = row + _STEPS[way][0], col + _STEPS[way][1]
        left[row, col, way ^ 1] = False
        corners.append((row, col))
        way = -1
        if degree[row, col] == 2:
            for other in range(3, -1, -1):
                way = other if left[row, col, other] else way
    return np.array(corners)


def without_bits(walls: WallLines) -> WallLines:
    """The walls without short stumps and without scraps that touch no other wall."""
    across, along = walls.across.copy(), walls.along.copy()
    degree = walls.ways().sum(axis=2)
    for chain in chains_of(walls):
        ends = degree[chain.corners[[0, -1], 0], chain.corners[[0, -1], 1]]
        if not chain.is_closed and len(chain.corners) <= _STUMP and (ends == 1).any():
            _erase(across, along, chain.corners)
    return _without_scraps(WallLines(across, along))


def _erase(across: NDArray[np.bool_], along: NDArray[np.bool_], corners: NDArray[np.int64]) -> None:
    low = np.minimum(corners[:-1], corners[1:])
    is_across = np.diff(corners[:, 0]) == 0
    across[tuple(low[is_across].T)] = False
    along[tuple(low[~is_across].T)] = False


def _without_scraps(walls: WallLines) -> WallLines:
    rows, cols = walls.along.shape[0], walls.across.shape[1]
    r, c = np.nonzero(walls.across)
    a_across = r * (cols + 1) + c
    r2, c2 = np.nonzero(walls.along)
    a_along = r2 * (cols + 1) + c2
    a = np.concatenate([a_across, a_along])
    b = np.concatenate([a_across + 1, a_along + cols + 1])
    num = (rows + 1) * (cols + 1)
    _, part = connected_components(coo_array((np.ones(len(a), bool), (a, b)), shape=(num, num)), directed=False)
    keep = np.bincount(part[a], minlength=part.max() + 1)[part[a]] >= _SCRAP
    across, along = np.zeros_like(walls.across), np.zeros_like(walls.along)
    across[r, c], along[r2, c2] = keep[: len(r)], keep[len(r) :]
    return WallLines(across, along)


_LONG_RUN = 9
"""Straight runs of this many cells keep both ends, shorter runs only their middle, so that stairs become diagonals."""
_TOLERANCE = 0.5
"""Corners of a wall lie at most this far from its straight line (cells)."""
_SLANT = 0.5
"""Lines that deviate from an axis by fewer cells than this are made parallel to it."""
_SPREAD = 0.5
"""Lines that get a common coordinate lie within this many cells."""
_CLEARED = 0.04
"""Lines beside clear cells keep this far from them (cells)."""
_PROBED = 0.02
"""Whether a line cuts cells is asked this often along it (cells)."""
_NEAR, _REACH = 1.0, 24
"""Lines that follow edges leave out corners up to this far from them (cells), at most _REACH - 1 in a row."""
_GRAZED = 0.3
"""A line is also moved away from the next corners of its wall where it cuts less than this far into them (cells)."""
_ROUNDS = 4
"""Number of times that lines are moved."""
_STAY = 1e-3
"""Weight with which points stay where they are, so that lines in one direction have one meeting point."""
_MITER = 2.0
"""Longest offset at a corner, as a multiple of the wall's."""

Points = NDArray[np.float64]


class Straight(NamedTuple):
    """One straight piece of a wall; lengths in cells, points are (row, col) of corners."""

    start: Points
    end: Points
    """Ends of the line, (2,) each."""
    start_miter: Points
    end_miter: Points
    """Offsets (2,) from `start` and `end` to the ends of a line one cell to the left."""
    left: NDArray[np.int64]
    right: NDArray[np.int64]
    """Cells (N, 2) beside the replaced edges, on each side, in order."""
    is_free: tuple[bool, bool]
    """Whether its start and its end are free, joined by no other line."""

    @property
    def length(self) -> float:
        """Length in cells."""
        return float(np.hypot(*(self.end - self.start)))

    def at(self, share: float | Points) -> Points:
        """The point (2,) at a share of the way from start to end; (N, 2) for shares (N, 1)."""
        return self.start + (self.end - self.start) * share

    def miter_at(self, share: float | Points) -> Points:
        """The offset (2,) at a share of the way to the line one cell to the left; (N, 2) for shares (N, 1)."""
        return self.start_miter + (self.end_miter - self.start_miter) * share


class _Kept(NamedTuple):
    """A chain's kept corners, as indices of points, and their places along the chain."""

    points: list[int]
    at: list[float]


def straight_lines(
    walls: WallLines, *, tolerance: float = _TOLERANCE, clear: NDArray[np.bool_] | None = None
) -> list[Straight]:
    """The walls as straight lines, at most `tolerance` cells away; lines that met in a corner still meet there.

    Lines between a cell of `clear` (rows, cols) and another cell are then moved until they cut no cell of `clear`;
    where that fails, they follow the edges of the cells. These lines may be farther away than `tolerance`.
    """
    chains = chains_of(walls)
    places: list[tuple[float, float]] = []
    number: dict[tuple[float, ...], int] = {}
    kept = []
    for chain in chains:
        points, at = _simplified(chain, tolerance)
        ids = []
        for k, (row, col) in enumerate(points.tolist()):
            is_end = k in (0, len(points) - 1)
            key: tuple[float, ...] = (row, col) if is_end else (row, col, len(kept), k)
            if key not in number:
                number[key] = len(places)
                places.append((row, col))
            ids.append(number[key])
        kept.append(_Kept(ids, at))
    where = _on_axes(np.array(places, float).reshape(-1, 2), kept)
    if clear is not None:
        where = _moved_out(chains, kept, where, clear)
        kept, where = _with_edges(chains, kept, where, clear)
    degree = np.bincount([end for chain in kept for end in (chain.points[0], chain.points[-1])], minlength=len(where))
    return [
        line for chain, line_ids in zip(chains, kept, strict=True) for line in _lines(chain, line_ids, where, degree)
    ]


def _simplified(chain: Chain, tolerance: float) -> tuple[Points, list[float]]:
    """Points (K, 2) of a line near the chain, and their places along the chain in steps; its ends stay."""
    corners = chain.corners.astype(float)
    if chain.is_closed:
        turns = np.flatnonzero((chain.steps != np.roll(chain.steps, 1, axis=0)).any(axis=1))
        runs = np.diff(np.append(turns, turns[0] + len(chain.steps)))
        first = int(turns[runs.argmax()])
        corners = np.concatenate([corners[first:-1], corners[: first + 1]])
    points, at = _key_points(corners)
    if chain.is_closed:  # two halves, because a loop has no chord
        far = int(np.hypot(*(points - points[0]).T).argmax())
        keep = sorted({*_reduced(points, 0, far, tolerance), *_reduced(points, far, len(points) - 1, tolerance)})
    else:
        keep = _reduced(points, 0, len(points) - 1, tolerance)
    offset = first if chain.is_closed else 0
    return points[keep], [float(at[k]) + offset for k in keep]


def _key_points(corners: Points) -> tuple[Points, Points]:
    """Ends of long runs and middles of short ones, the chain's ends among them, with their places along the chain."""
    steps = np.diff(corners, axis=0)
    turns = np.flatnonzero((np.diff(steps, axis=0) != 0).any(axis=1)) + 1
    cuts = np.concatenate([[0], turns, [len(steps)]])
    at = [0.0]
    for low, high in itertools.pairwise(cuts):
        at += [low, high] if high - low >= _LONG_RUN else [(low + high) / 2]
    found = np.unique([*at, float(len(steps))])
    low = np.floor(found).astype(int)
    high = np.minimum(low + 1, len(steps))
    share = (found - low)[:, None]
    return corners[low] * (1 - share) + corners[high] * share, found


def _reduced(points: Points, first: int, last: int, tolerance: float) -> list[int]:
    """Indices of points[first : last + 1] that the Ramer-Douglas-Peucker algorithm keeps."""
    keep = {first, last}
    stack = [(first, last)]
    while stack:
        a, b = stack.pop()
        if b <= a + 1:
            continue
        chord = points[b] - points[a]
        length = float(np.hypot(*chord))
        between = points[a + 1 : b] - points[a]
        if length > 0:
            share = np.clip(between @ chord / length**2, 0, 1)
            off = np.hypot(*(between - share[:, None] * chord).T)
        else:
            off = np.hypot(*between.T)
        worst = int(off.argmax())
        if off[worst] > tolerance:
            keep.add(a + 1 + worst)
            stack += [(a, a + 1 + worst), (a + 1 + worst, b)]
    return sorted(keep)


def _on_axes(places: Points, kept: list[_Kept]) -> Points:
    """The points (P, 2), moved so that lines nearly parallel to an axis become so; groups of lines become collinear."""
    ends = np.array([pair for chain in kept for pair in zip(chain.points[:-1], chain.points[1:], strict=True)], int)
    moved = places.copy()
    if not len(ends):
        return moved
    away = np.abs(places[ends[:, 0]] - places[ends[:, 1]])  # (L, 2)
    length = away.max(axis=1)
    for axis in (0, 1):
        level = np.flatnonzero((away[:, axis] <= _SLANT) & (away[:, 1 - axis] >= 3 * away[:, axis]))
        group = np.arange(len(places))
        for line in level[np.argsort(-length[level], kind="stable")]:
            a, b = group[ends[line]]
            both = (group == a) | (group == b)
            if a != b and np.ptp(places[both, axis]) <= _SPREAD:
                group[both] = min(a, b)
        weight = np.full(len(places), 1e-6)
        np.add.at(weight, ends[level].reshape(-1), np.repeat(length[level], 2))
        mean = np.bincount(group, weight * places[:, axis], minlength=len(places)) / np.maximum(
            np.bincount(group, weight, minlength=len(places)), 1e-12
        )
        moved[:, axis] = mean[group]
    return moved


def _moved_out(chains: list[Chain], kept: list[_Kept], where: Points, clear: NDArray[np.bool_]) -> Points:
    """The points (P, 2), moved until the lines beside clear cells cut none of them.

    Each line would move by the largest depth to which it cuts; a point moves to where its moved lines meet.
    """
    ends, signs, corners, own = [], [], [], []
    for chain, line_ids in zip(chains, kept, strict=True):
        for k, low, high, sign in _sided(chain, line_ids, clear):
            ends.append(line_ids.points[k : k + 2])
            signs.append(sign)
            near = np.arange(low - 1, high + 2)
            if not chain.is_closed:
                near = near[(near >= 0) & (near < len(chain.corners))]
            corners.append(chain.corners[near % len(chain.steps) if chain.is_closed else near])
            own.append((near >= low) & (near <= high))
    if not ends:
        return where
    (first, last), sign, points = np.array(ends).T, np.array(signs), np.concatenate(corners)
    counts = np.array([len(part) for part in corners])
    line, is_own = np.repeat(np.arange(len(counts)), counts), np.concatenate(own)
    for _ in range(_ROUNDS):
        normal = _left_of(where[last] - where[first]) * sign[:, None]
        along, away = (where[last] - where[first])[line], points - where[first][line]
        share = (away * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), 1e-9)
        depth = (away * normal[line]).sum(axis=1)
        depth[~((share >= 0) & (share <= 1) & (is_own | (depth < _GRAZED)))] = -np.inf
        by = np.maximum(np.maximum.reduceat(depth, np.cumsum(counts) - counts) + _CLEARED, 0.0)
        squares, wanted = np.tile(_STAY * np.eye(2), (len(where), 1, 1)), np.zeros((len(where), 2))
        for end in (first, last):
            np.add.at(squares, end, normal[:, :, None] * normal[:, None, :])
            np.add.at(wanted, end, by[:, None] * normal)
        moves = np.linalg.solve(squares, wanted[..., None])[..., 0]
        length = np.hypot(*moves.T)[:, None]
        where = where + moves * np.minimum(1.0, _MITER / np.maximum(length, 1e-9))
    return np.round(where, 2)  # lines along an axis stay exactly along it


def _sided(chain: Chain, line_ids: _Kept, clear: NDArray[np.bool_]) -> Iterator[tuple[int, int, int, float]]:
    """The lines of a chain between clear cells and others: number, first and last corner, 1 = clear cells are right."""
    left, right = (clear[side[:, 0], side[:, 1]] for side in chain.cells())
    for k, (low, high) in enumerate(itertools.pairwise(np.round(line_ids.at).astype(int).tolist())):
        steps = np.arange(low, max(high, low + 1))
        steps = steps % len(left) if chain.is_closed else np.minimum(steps, len(left) - 1)
        is_left, is_right = (2 * np.count_nonzero(side[steps]) >= len(steps) for side in (left, right))
        if is_left != is_right:
            yield k, low, max(high, low + 1), 1.0 if is_right else -1.0  # the line moves to the left, or to the right


def _with_edges(
    chains: list[Chain], kept: list[_Kept], where: Points, clear: NDArray[np.bool_]
) -> tuple[list[_Kept], Points]:
    """The chains and points (P, 2); lines that cut a clear cell follow the edges of the cells, a little outside.

    Their ends move to these edges too, and so may other lines that end there.
    """
    where, found = where.copy(), []
    sided = [{k: sign for k, _, _, sign in _sided(chain, ids, clear)} for chain, ids in zip(chains, kept, strict=True)]
    exact: list[list[int]] = [[] for _ in chains]
    moved = np.ones(len(where), bool)
    while moved.any():
        asked, moved = moved, np.zeros(len(where), bool)
        for chain, ids, signs, done in zip(chains, kept, sided, exact, strict=True):
            for k in [k for k in signs if k not in done]:
                ends = ids.points[k : k + 2]
                if (asked[ends] | moved[ends]).any() and _cuts(where[ends[0]], where[ends[1]], clear):
                    where[ends] = _beside_edges(chain, np.array(ids.at[k : k + 2]), signs[k])
                    moved[ends] = True
                    done.append(k)
    for chain, ids, signs, done in zip(chains, kept, sided, exact, strict=True):
        points, at = list(ids.points), list(ids.at)
        for k in sorted(done, reverse=True):
            corners = np.arange(math.floor(at[k]) + 1.0, math.ceil(at[k + 1]))
            before, after = chain.steps_around(corners)
            turns = corners[(before != after).any(axis=1)]
            line = np.stack([where[points[k]], *_beside_edges(chain, turns, signs[k]), where[points[k + 1]]])
            needed = _needed(line, clear)[1:-1]
            points[k + 1 : k + 1] = range(len(where), len(where) + len(needed))
            at[k + 1 : k + 1] = turns[np.array(needed, int) - 1].tolist()
            where = np.concatenate([where, line[needed].reshape(-1, 2)])
        found.append(_Kept(points, at))
    return found, where


def _needed(line: Points, clear: NDArray[np.bool_]) -> list[int]:
    """Indices of the points (N, 2) of a line that are left out only where it stays near them and cuts no clear cell."""
    found = [0]
    while found[-1] < len(line) - 1:
        first = found[-1]
        for last in range(min(len(line) - 1, first + _REACH), first, -1):
            along, away = line[last] - line[first], line[first + 1 : last] - line[first]
            off = np.abs(away @ np.array([-along[1], along[0]])) / max(float(np.hypot(*along)), 1e-9)
            if last == first + 1 or (off.max() <= _NEAR and not _cuts(line[first], line[last], clear)):
                found.append(last)
                break
    return found


def _beside_edges(chain: Chain, at: Points, sign: float) -> Points:
    """Points (N, 2) at places (N,) along a chain, a little away from its clear side (sign 1 = right, -1 = left)."""
    before, after = chain.steps_around(at)
    out = _left_of(before) + np.where((before == after).all(axis=1)[:, None], 0.0, _left_of(after))
    start = np.floor(at).astype(int)
    corners = chain.corners[start % len(chain.steps) if chain.is_closed else start]
    return corners + (at - start)[:, None] * after + sign * _CLEARED * out


@njit(cache=True, nogil=True)
def _cuts(start, end, clear):
    """Whether a line between two points (row, col) leads through a clear cell; a hundredth of a cell does not count."""
    rows, cols = clear.shape
    count = max(2, math.ceil(math.hypot(end[0] - start[0], end[1] - start[1]) / _PROBED))
    for k in range(count):
        share = k / (count - 1)
        y, x = start[0] + (end[0] - start[0]) * share, start[1] + (end[1] - start[1]) * share
        row, col = min(max(math.floor(y), 0), rows - 1), min(max(math.floor(x), 0), cols - 1)
        inside = min(y - row, row + 1 - y, x - col, col + 1 - x)
        if inside > _PROBED / 2 and clear[row, col]:
            return True
    return False


def _lines(chain: Chain, kept: _Kept, where: Points, degree: NDArray[np.int64]) -> list[Straight]:
    """The straight pieces of one chain."""
    points = where[kept.points]
    left, right = chain.cells()
    bounds = np.round(kept.at).astype(int)
    long = np.hypot(*np.diff(points, axis=0).T) > 1e-6
    pieces = np.flatnonzero(long)
    normal = _left_of(np.diff(points, axis=0))
    found = []
    for place, k in enumerate(pieces.tolist()):
        before = pieces[place - 1] if place or chain.is_closed else k
        after = pieces[(place + 1) % len(pieces)] if place + 1 < len(pieces) or chain.is_closed else k
        steps = np.arange(bounds[k], max(bounds[k + 1], bounds[k] + 1)) % len(left)
        is_free = (
            not chain.is_closed and place == 0 and degree[kept.points[0]] == 1,
            not chain.is_closed and place == len(pieces) - 1 and degree[kept.points[-1]] == 1,
        )
        found.append(
            Straight(
                points[k], points[k + 1], _miter(normal[before], normal[k]), _miter(normal[k], normal[after]),
                left[steps], right[steps], is_free,
            )
        )  # fmt: skip
    return found


def _left_of(along: Points) -> Points:
    """Unit vectors (N, 2) to the left of directions (row, col) on the map."""
    length = np.maximum(np.hypot(*along.T), 1e-12)[:, None]
    return np.stack([-along[:, 1], along[:, 0]], axis=1) / length


def _miter(first: Points, second: Points) -> Points:
    """The offset (2,) of the corner between two lines when these move one cell to their left."""
    both = first + second
    scale = 2.0 / max(float(both @ both), 1e-9)
    found = both * scale
    length = float(np.hypot(*found))
    return found if length <= _MITER else found * _MITER / length
