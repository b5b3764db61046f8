"""Guessed corridors of a schematic home, chosen so that its paths are as long as the recorded ones.

A recorded length is an upper and a lower bound. If our path is too long, a corridor is missing: the cheapest path of
fitting length over unknown floor is opened. If our path is too short, a corridor that was opened for other records
leads through a wall: it is closed, and those records get another corridor. Known floor is never closed.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.types import GridSpec
from sim.walk.floor_grid import FloorGrid
from sim.walk.grid_kernels import connected_parts
from sim.walk.grid_routes import End, PricedFloor, is_touched, mark_near, polyline_length, route, work_for

from ..cells import Cells
from .body_floor import BodyFloor
from .recorded import PathLength

PLAN_CLIMB = 0.3
"""Largest height difference of neighbouring cells of a schematic home (metres): recorded heights are noisy."""
CORRIDOR_RADIUS = 0.2
"""Half the width of a corridor for the robot's centre (metres)."""
_RADII = (CORRIDOR_RADIUS, 0.1)
"""Half the widths that are tried in turn: a wide corridor may cut a corner that another record needs."""
_RELUCTANCES = (50.0, 12.0, 4.0, 1.5, 0.6, 0.25, 0.1)  # prices of unknown floor, tried in turn
_TOO_SHORT, _TOO_LONG = 0.975, 1.025
_WRONG = 0.955  # for a path shorter than this share of the record, we look for a corridor to close
_CUT = 1.25  # paths longer than this many times the record are not measured
_ROUNDS = 2
_CHOICES = 3
_LONGEST_WAY = 1.1
_DETOUR_RADII = (0.3, 0.6, 0.9)
_DETOUR_PRICE = 20.0
_CLOSED_RADIUS = 0.2
_CLOSED_PRICE = 2.0  # floor that proved wrong costs this many times as much afterwards
_SHORT_TIMES = 1.5  # weight of paths that are too short: they certainly lead through a wall
_CELL_COST = 1e-4  # each cell of a corridor must reduce the misfit by this much
_UNREACHED = 0.4

Polyline = NDArray[np.float64]
Nodes = NDArray[np.int64]


class _Opening(NamedTuple):
    """Unknown floor that would become a corridor, and the effect of opening it."""

    nodes: Nodes
    opened: Nodes
    """The nodes, and the gaps beside them that open too."""
    gain: float
    measured: dict[int, tuple[float, Polyline]]
    """Path ratio and path of each record that changes."""


def with_corridors(
    known: Cells, unknown: Cells, lengths: tuple[PathLength, ...], *, floors_y: list[float], grid: GridSpec
) -> Cells:
    """The known cells and the unknown cells that the recorded lengths require, the latter marked as guessed.

    The result is closed by the robot's body (`BodyFloor`), so that drawn floor leaves it unchanged.

    Args:
        known: Certain floor, never closed; contains the ends of all lengths.
        unknown: Cells that may be floor.
        lengths: Records; those that are impossible, shorter than two cells, or end off the floor are left out.
        floors_y: Heights of the storeys' floors, metres.
        grid: Place of the cells.
    """
    rc, y = np.concatenate([known.rc, unknown.rc]), np.concatenate([known.y, unknown.y])
    order = np.lexsort((y, rc[:, 1], rc[:, 0]))  # the order of FloorGrid's nodes
    cells = Cells(rc, y, np.arange(len(rc)) >= len(known.rc)).chosen(order)
    floor = FloorGrid.from_cells(rc, y, grid=grid, max_climb=PLAN_CLIMB)
    body = BodyFloor(cells, floors_y, grid=grid)
    search = _Search(floor, body, ~cells.guessed, tuple(record for record in lengths if _is_usable(record, floor)))
    search.run()
    return cells._replace(guessed=~search.is_known).chosen(search.ground.is_free)


class _Search:
    """Greedy search with undo; lengths in cells."""

    def __init__(
        self, floor: FloorGrid, body: BodyFloor, is_known: NDArray[np.bool_], records: tuple[PathLength, ...]
    ) -> None:
        self.is_known = body.closed(is_known)
        self.ground = PricedFloor(floor.cells, self.is_known.copy(), np.ones(len(is_known)))
        self._body = body
        self._opened = self.is_known.copy()
        """Known floor and corridors; free floor is its closing."""
        self._work = work_for(len(is_known))
        self._cell = floor.grid.cell
        self._lengths = [record.length / self._cell for record in records]
        self._ends = list(
            zip(
                _ends(floor, [record.start for record in records]),
                _ends(floor, [record.end for record in records]),
                strict=True,
            )
        )
        straight = [math.dist(record.start, record.end) / self._cell for record in records]
        # nearly straight paths leave the fewest choices, so they come first
        tightness = np.array(self._lengths) / np.maximum(straight, 1e-6)
        self._order: list[int] = np.argsort(tightness, kind="stable").tolist()
        self._ratios = np.full(len(records), math.inf)
        self._paths: list[Polyline] = [np.empty((0, 3))] * len(records)
        self._number_parts()
        for i in range(len(records)):
            self._measure_anew(i)

    def run(self) -> None:
        """Opens and closes corridors until the records fit."""
        for _ in range(_ROUNDS):
            self._open(self._order)
            self._close()
        self._open(self._order)

    def _number_parts(self) -> None:
        """Numbers the connected parts of the free floor again."""
        self._parts = connected_parts(self.ground.cells.links, self.ground.is_free)

    def _measure(self, i: int) -> tuple[float, Polyline]:
        """The ratio of our length to a record's, and our path; inf and an empty path where it is much too long."""
        limit = min(self._ratios[i] + 0.01, _CUT) * self._lengths[i] + 2
        path = route(self.ground, self._work, *self._ends[i], math.inf, limit)
        return (polyline_length(path) / self._lengths[i], path) if len(path) else (math.inf, path)

    def _measure_anew(self, i: int) -> None:
        """Measures a record whose present path is unknown."""
        start, goal = self._ends[i]
        self._ratios[i], self._paths[i] = math.inf, np.empty((0, 3))
        if self._parts[start.node] == self._parts[goal.node]:
            self._ratios[i], self._paths[i] = self._measure(i)

    def _open(self, order: list[int]) -> None:
        """For each record whose path is too long, opens the corridor with the largest gain."""
        for i in order:
            if self._ratios[i] <= _TOO_LONG:
                continue
            best: _Opening | None = None
            for radius in _RADII:
                for nodes in self._candidates(i, radius) if best is None else ():
                    best = self._tried(nodes, best.gain if best else 0.0) or best
            if best is not None:
                self._opened[best.nodes] = True
                self.ground.is_free[best.opened] = True
                self._number_parts()
                for j, (ratio, path) in best.measured.items():
                    self._ratios[j], self._paths[j] = ratio, path

    def _candidates(self, i: int, radius: float) -> list[Nodes]:
        """The corridors over unknown floor whose lengths fit a record best; `radius` in metres."""
        found: dict[float, Nodes] = {}
        path = np.empty((0, 3))
        for reluctance in _RELUCTANCES:
            path = self._route(i, reluctance)
            if not len(path) or self._add_way(i, path, radius, found) < _TOO_SHORT:
                break
        if len(path) and all(error > _TOO_LONG - 1 for error in found):
            self._add_detours(i, path, radius, found)
        return [found[error] for error in sorted(found)[:_CHOICES]]

    def _add_way(self, i: int, path: Polyline, radius: float, found: dict[float, Nodes]) -> float:
        """Adds the unknown floor of a path to `found`, by the error of its length; returns the ratio of the length."""
        ratio = polyline_length(path) / self._lengths[i]
        error = round(abs(ratio - 1), 3)
        if ratio <= _LONGEST_WAY and error not in found:
            nodes = self._near([path], radius)
            nodes = nodes[~self.ground.is_free[nodes]]
            if len(nodes):
                found[error] = nodes
        return ratio

    def _add_detours(self, i: int, path: Polyline, radius: float, found: dict[float, Nodes]) -> None:
        """Adds longer and longer paths around the unknown floor of a path that is too short."""
        price = self.ground.price.copy()
        for around in _DETOUR_RADII:
            nodes = self._near([path], around)
            self.ground.price[nodes] = price[nodes] + _DETOUR_PRICE
            way = self._route(i, 1.0)
            if not len(way) or self._add_way(i, way, radius, found) >= _TOO_SHORT:
                break
        self.ground.price[:] = price

    def _route(self, i: int, reluctance: float) -> Polyline:
        limit = 1.06 * self._lengths[i] + 3
        return route(self.ground, self._work, *self._ends[i], reluctance, limit)

    def _near(self, paths: list[Polyline], radius: float) -> Nodes:
        mark = np.zeros(len(self.is_known), bool)
        for path in paths:
            mark_near(self.ground.cells, path, radius / self._cell, mark)
        return np.flatnonzero(mark)

    def _tried(self, nodes: Nodes, least: float) -> _Opening | None:
        """The opening of `nodes` with its gain; None as soon as the gain is certainly no more than `least`."""
        opened = self._with_gaps(nodes)
        concerned = self._concerned(opened)
        self.ground.is_free[opened] = True
        measured: dict[int, tuple[float, Polyline]] = {}
        gain = -_CELL_COST * len(opened)
        possible = sum(_misfit(self._ratios[j]) for j in concerned)
        for j in concerned:
            if gain + possible <= least:
                break
            measured[j] = self._measure(j)
            misfit = _misfit(self._ratios[j])
            gain += misfit - _misfit(measured[j][0])
            possible -= misfit
        self.ground.is_free[opened] = False
        return _Opening(nodes, opened, gain, measured) if gain > least else None

    def _with_gaps(self, nodes: Nodes) -> Nodes:
        """Nodes that become free when some open: these, and gaps beside them that are too narrow for a wall."""
        opened = self._opened.copy()
        opened[nodes] = True
        found = self._body.added(opened, nodes)
        return found[~self.ground.is_free[found]]

    def _concerned(self, nodes: Nodes) -> list[int]:
        """Records whose paths may become shorter when `nodes` are opened, those with the largest misfit first."""
        cells = self.ground.cells
        u, v = cells.col[nodes] + 0.5, cells.row[nodes] + 0.5
        links = cells.links[nodes]
        joined = set(self._parts[links[links >= 0]].tolist())
        found = []
        for j, (start, goal) in enumerate(self._ends):
            parts = {int(self._parts[start.node]), int(self._parts[goal.node])}
            around = np.hypot(u - start.u, v - start.v) + np.hypot(u - goal.u, v - goal.v)
            is_nearer = around.min() < min(self._ratios[j], _CUT) * self._lengths[j]
            if is_nearer and (len(parts) == 1 or parts <= joined):
                found.append(j)
        return sorted(found, key=lambda j: -_misfit(self._ratios[j]))

    def _close(self) -> None:
        """For each record whose path is too short, closes the corridors that it uses, unless the fit gets worse."""
        for i in np.argsort(self._ratios, kind="stable").tolist():
            if self._ratios[i] >= _WRONG:
                continue
            nodes = self._near([self._paths[i]], _CLOSED_RADIUS)
            nodes = nodes[self._opened[nodes] & ~self.is_known[nodes]]
            if not len(nodes):
                continue
            before = self.ground.is_free.copy(), self._ratios.copy(), list(self._paths)
            opened = self._opened.copy()
            self._opened[nodes] = False
            is_free = self._body.closed(self._opened)
            shut = np.flatnonzero(self.ground.is_free & ~is_free)
            self.ground.is_free[:] = is_free
            self.ground.price[nodes] += _CLOSED_PRICE
            self._measure_again(shut)
            self._open([j for j in self._order if self._ratios[j] > before[1][j] or not math.isfinite(self._ratios[j])])
            if sum(map(_misfit, self._ratios.tolist())) >= sum(map(_misfit, before[1].tolist())) - 1e-6:
                self._opened[:] = opened
                self.ground.is_free[:], self._ratios, self._paths = before
                self._number_parts()

    def _measure_again(self, closed: Nodes) -> None:
        """Measures the records whose paths use closed nodes."""
        self._number_parts()
        mark = np.zeros(len(self.is_known), bool)
        mark[closed] = True
        for j, path in enumerate(self._paths):
            if is_touched(self.ground.cells, path, mark):
                self._measure_anew(j)


def _is_usable(record: PathLength, floor: FloorGrid) -> bool:
    """Whether a record gives information about the floor."""
    is_on_floor = all(floor.snap(np.array(place)) is not None for place in (record.start, record.end))
    return record.is_possible and record.length >= 2 * floor.grid.cell and is_on_floor


def _misfit(ratio: float) -> float:
    """Cost of a path ratio: its error, plus one penalty above 5 % and another above 10 %; too short counts for more."""
    error = min(abs(ratio - 1) * (_SHORT_TIMES if ratio < 1 else 1.0), 0.3) if math.isfinite(ratio) else _UNREACHED
    fines = [min(max((error - limit + 0.02) / 0.04, 0.0), 1.0) for limit in (0.05, 0.1)]
    return error + 0.1 * sum(fines)


def _ends(floor: FloorGrid, points: list[tuple[float, float, float]]) -> list[End]:
    """The points as ends on the floor's nodes."""
    ends = floor.ends(np.array(points, float).reshape(-1, 3))
    return [End(*end) for end in zip(*(values.tolist() for values in ends), strict=True)]
