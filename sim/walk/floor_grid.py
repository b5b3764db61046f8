"""A layered floor grid of 5 cm cells for the robot's centre; the navigation map of every home without a navmesh.

Made from a mesh (`floor_grid_from_mesh`, Recast's filters) or from known free cells (`FloorGrid.from_cells`).
"""

import hashlib
import math
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.errors import NoFloorError, SceneError
from sim.types import AGENT_HEIGHT, AGENT_RADIUS, GridSpec

from .grid_field import Field, lengths_to_goals, path_to_goal, spread
from .grid_kernels import (
    INSET,
    Cells,
    clamp,
    connected_parts,
    first_of_columns,
    linked_layers,
    nearest_node,
    slide_end,
    snap_all,
    walk,
    with_diagonals,
)
from .height_field import standing_places
from .navigation_map import Points, StepResult, TopDown
from .storeys import is_on_storey_island, no_such_storey, same_storey, storey_levels

if TYPE_CHECKING:
    from sim.mesh import TriangleMesh

SNAP_REACH = 2.0
"""Largest sideways distance of a snap, metres (habitat-sim's half extents are (2, 4, 2))."""
SNAP_HEIGHT = 4.0
"""Largest height difference of a snap, metres."""
SNAP_CLIMB = 0.2
"""Over a cell, a height difference up to this counts as none; the nearest storey wins (Detour, walkableClimb)."""
MAX_CLIMB = 0.2
"""Highest step between neighbouring cells, metres (Habitat's agentMaxClimb)."""
STOP_MARGIN = 1e-4
"""A blocked walk ends this far before the wall (metres), so that its end is navigable."""
SLOPE_REACH = 0.3
"""Distance over which a slope is measured, metres (Recast's detailSampleDist, 6 cells)."""
_KEPT_FIELDS = 8
"""Number of stored distance fields: an episode needs the same goals again and again."""


class Ends(NamedTuple):
    """Points moved onto the grid; grid units."""

    u: NDArray[np.float64]
    v: NDArray[np.float64]
    h: NDArray[np.float64]
    """Height from which a path's length counts."""
    nodes: NDArray[np.int32]
    """Node of each point; -1 where no cell is near."""


class FloorGrid:
    """Implements `NavigationMap` on square cells in one or more layers.

    A place is a (cell, layer) pair with one floor height; all heights returned are that height, never interpolated.
    Neighbours are joined by the layers' links, so storeys that lie over each other meet only on a stair. The grid is
    immutable and may be read from several threads.

    Query points may lie off the map: they count from their snapped point, those over free floor also with their height.
    """

    def __init__(
        self, cells: Cells, grid: GridSpec, *, covered: NDArray[np.bool_] | None = None, digest: str = ""
    ) -> None:
        """Use `FloorGrid.from_cells` or `floor_grid_from_mesh`.

        Args:
            cells: Nodes and links.
            grid: Grid of the cells in the world.
            covered: (N,) whether something is above each node; None = unknown. It tells roofs from storeys.
            digest: sha256 of nodes and grid.
        """
        self.cells = cells
        self.grid = grid
        self.digest = digest
        self.node_y = cells.h * grid.cell
        """(N,) floor height of each node, metres."""
        self.islands = connected_parts(cells.links, np.ones(len(cells.links), bool))
        """(N,) number of each node's connected part."""
        self.storey_heights: tuple[float, ...] = storey_levels(self.node_y, self.islands, covered)
        self._is_storey = is_on_storey_island(self.node_y, self.islands, covered, self.storey_heights)
        self._fields: tuple[tuple[bytes, Field], ...] = ()

    @classmethod
    def from_cells(
        cls, rc: NDArray[np.int64], y: NDArray[np.float64], *, grid: GridSpec, max_climb: float = MAX_CLIMB
    ) -> "FloorGrid":
        """The grid of known free cells.

        Neighbours (8) are joined when their heights differ by at most `max_climb`; a diagonal needs one of the two
        cells beside it as well.

        Args:
            rc: (N, 2) cells where the robot's CENTRE may be; a cell may appear once per layer.
            y: (N,) floor heights, world metres.
            grid: Cell size and place; all `rc` lie inside its shape.
            max_climb: Largest height difference of joined neighbours, metres.

        Raises:
            SceneError: There are no cells, cells outside the grid, heights that are not finite, or repeated places.
        """
        rc, y = np.asarray(rc, np.int64).reshape(-1, 2), np.asarray(y, float).reshape(-1)
        _check_cells(rc, y, grid, max_climb)
        rows, cols = grid.shape
        order = np.lexsort((y, rc[:, 0] * cols + rc[:, 1]))
        row, col = rc[order, 0].astype(np.int32), rc[order, 1].astype(np.int32)
        h = y[order] / grid.cell
        first = first_of_columns(row, col, rows, cols)
        limit = max_climb / grid.cell + 1e-9
        links = with_diagonals(linked_layers(row, col, h, first, rows, cols, limit), h, limit)
        cells = Cells(row, col, h, links, first, rows, cols)
        return cls(cells, grid, digest=_digest(cells, grid))

    @property
    def area(self) -> float:
        """Free area in square metres, seen from above, all layers."""
        return len(self.cells.row) * self.grid.cell**2

    @property
    def surface_area(self) -> float:
        """Free area in square metres along the floor, all layers: the `navigable_area` of habitat-sim.

        Stairs count as ramps: slopes are taken over SLOPE_REACH, as Habitat's detail mesh samples them.
        """
        count = round(SLOPE_REACH / 2 / self.grid.cell)
        slopes = [_rise_per_cell(self.cells, side, count) for side in (0, 1)]
        return float(np.sqrt(1 + slopes[0] ** 2 + slopes[1] ** 2).sum()) * self.grid.cell**2

    def snap(self, point: Points) -> Points | None:
        """Nearest place (3,) to stand within 2 m sideways and 4 m in height, on the floor; None if there is none."""
        ends = self.ends(np.asarray(point, float)[None])
        return self._points(ends.u, ends.v, ends.nodes)[0] if ends.nodes[0] >= 0 else None

    def island(self, point: Points) -> int | None:
        """Number of the connected part that `point` snaps to; None if there is none."""
        node = self.ends(np.asarray(point, float)[None]).nodes[0]
        return int(self.islands[node]) if node >= 0 else None

    def is_navigable(self, point: Points, *, max_dy: float = 0.5) -> bool:
        """Whether the robot can stand at this x, z with its feet within `max_dy` of this y."""
        u, h, v = self._grid_units(np.asarray(point, float)[None])
        node = nearest_node(self.cells, u[0], h[0], v[0], 0.0, max_dy / self.grid.cell + 1e-9, 0.0)
        return node >= 0

    def step(self, start: Points, end: Points, *, slide: bool = False) -> StepResult:
        """The result of walking straight from `start` (3,) to `end` (3,), stopping at the first wall unless `slide`.

        As in Habitat, a start off the map is snapped first, but the collision test counts from the start as given (its
        height from the floor below it); no move if start or end is on no island or they are on different ones.
        """
        start, end = np.asarray(start, float), np.asarray(end, float)
        ends = self.ends(np.stack([start, end]))
        if min(ends.nodes) < 0 or self.islands[ends.nodes[0]] != self.islands[ends.nodes[1]]:
            return _step_result(start, start, wanted=end)
        end_u, _, end_v = self._grid_units(end[None])
        u, v, node = self._end_of_walk((ends.u[0], ends.v[0]), int(ends.nodes[0]), (end_u[0], end_v[0]), slide=slide)
        position = self._points(np.array([u]), np.array([v]), np.array([node]))[0]
        on_floor = np.array([start[0], self.node_y[ends.nodes[0]], start[2]])
        return _step_result(on_floor, position, wanted=on_floor + (end - start))

    def distances(self, starts: Points, goals: Points) -> NDArray[np.float64]:
        """Geodesic metres from each start (M, 3) to its nearest goal (N, 3), each counted from its snapped point.

        The length of `shortest_path`: an any-angle path over the grid, so a little longer than the exact one (mean
        below 1 %). Its straight pieces are 3-D chords, also over stairs, as in Detour. A point over free floor keeps
        its height, as in Detour: height beyond SNAP_CLIMB above the floor adds to the path's first or last piece, but
        not if start and goal are over the same point. inf where unreachable, or where no place is near a point.
        """
        field = self._field(goals)
        ends = self.ends(np.asarray(starts, float).reshape(-1, 3))
        return lengths_to_goals(self.cells, field, ends.u, ends.v, ends.h, ends.nodes) * self.grid.cell

    def shortest_path(self, start: Points, goals: Points) -> Points | None:
        """Polyline (K, 3) on the floor from `start` (3,) to the nearest of `goals` (N, 3); None if unreachable.

        Its ends are the snapped points. A start on the goal gives two equal points.
        """
        field = self._field(goals)
        ends = self.ends(np.asarray(start, float)[None])
        if ends.nodes[0] < 0:
            return None
        uv, nodes = path_to_goal(self.cells, field, ends.u[0], ends.v[0], ends.h[0], ends.nodes[0])
        return self._points(uv[:, 0], uv[:, 1], nodes) if len(nodes) else None

    def points_within(self, centres: Points, radius: float, *, max_dy: float) -> Points:
        """Places (K, 3) to stand within planar `radius` of any centre (N, 3) and within `max_dy` of its y.

        One per cell: its centre, or where that is too far, the cell's point nearest to the circle's rim (so the
        places reach the rim itself). The boundary counts as inside. (0, 3) when there are none.
        """
        parts = [self._within(centre, radius, max_dy) for centre in np.asarray(centres, float).reshape(-1, 3)]
        if not parts:
            return np.empty((0, 3))
        nodes, u, v, is_rim = (np.concatenate(part) for part in zip(*parts, strict=True))
        order = np.lexsort((is_rim, nodes))  # a cell's centre before a rim point
        _, first = np.unique(nodes[order], return_index=True)
        kept = order[first]
        return self._points(u[kept], v[kept], nodes[kept])

    def _within(
        self, centre: Points, radius: float, max_dy: float
    ) -> tuple[NDArray[np.integer], NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        """(nodes, u, v, on the rim) of the places within `radius` of one centre (3,)."""
        (u,), _, (v,) = self._grid_units(centre[None])
        reach = radius / self.grid.cell * (1 - 1e-9)  # so that rounding never puts a place outside
        level = np.flatnonzero(np.abs(self.node_y - centre[1]) <= max_dy)
        row, col = self.cells.row[level], self.cells.col[level]
        near_u, near_v = (np.clip(at, low + INSET, low + 1 - INSET) for at, low in ((u, col), (v, row)))
        touches = np.hypot(near_u - u, near_v - v) <= reach
        nodes, row, col, near_u, near_v = (array[touches] for array in (level, row, col, near_u, near_v))
        mid_u, mid_v = col + 0.5, row + 0.5
        away = np.hypot(mid_u - u, mid_v - v)
        is_rim = away > reach
        share = np.where(is_rim, reach / np.maximum(away, 1e-12), 1.0)
        rim_u, rim_v = u + share * (mid_u - u), v + share * (mid_v - v)
        on_cell = (np.floor(rim_u) == col) & (np.floor(rim_v) == row)
        return nodes, np.where(on_cell, rim_u, near_u), np.where(on_cell, rim_v, near_v), is_rim

    def random_point(self, rng: np.random.Generator, *, storey_y: float | None = None) -> Points:
        """A place (3,) to stand, uniform over the free area (of one storey if its height is given).

        Islands that belong to no storey, such as tops of tables and beds and roofs, are left out.

        Raises:
            SceneError: The storey has no free cell.
        """
        nodes = np.flatnonzero(self._is_storey if storey_y is None else self._is_storey & self._on_storey(storey_y))
        if not len(nodes):
            raise no_such_storey(storey_y, self.storey_heights)
        node = int(rng.choice(nodes))
        u, v = self.cells.col[node] + rng.random(), self.cells.row[node] + rng.random()
        return self._points(np.array([u]), np.array([v]), np.array([node]))[0]

    def top_down(self, storey_y: float) -> TopDown:
        """Free space of the storey at this height: all cells less than STOREY_GAP above or below it."""
        free = np.zeros(self.grid.shape, bool)
        nodes = self._on_storey(storey_y)
        free[self.cells.row[nodes], self.cells.col[nodes]] = True
        return TopDown(free, self.grid, float(storey_y))

    def _end_of_walk(
        self, start_uv: tuple[float, float], node: int, end_uv: tuple[float, float], *, slide: bool
    ) -> tuple[float, float, int]:
        """(u, v, node) at the end of a straight walk from a place on `node`.

        Without sliding the walk stops STOP_MARGIN before the first side of a cell that it cannot cross. With sliding it
        ends at the reachable point nearest to the wanted end, which may be a little farther away than one step (as in
        Detour).
        """
        (u, v), (end_u, end_v) = start_uv, end_uv
        last, share = walk(self.cells, u, v, node, end_u, end_v)
        if share >= 1.0:
            return end_u, end_v, last
        if slide:
            return slide_end(self.cells, u, v, node, end_u, end_v)
        wanted = math.hypot(end_u - u, end_v - v)
        kept = max(0.0, share * wanted - STOP_MARGIN / self.grid.cell) / wanted
        u, v = u + kept * (end_u - u), v + kept * (end_v - v)
        # The last cell may have been entered within the margin: then the end lies in the cell before it.
        last, _ = walk(self.cells, *start_uv, node, u, v)
        return (*clamp(self.cells, last, u, v), last)

    def _on_storey(self, storey_y: float) -> NDArray[np.bool_]:
        return same_storey(self.node_y, storey_y)

    def _grid_units(self, points: Points) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """(u, h, v) of world points (M, 3)."""
        x0, z0 = self.grid.origin_xz
        cell = self.grid.cell
        return (points[:, 0] - x0) / cell, points[:, 1] / cell, (points[:, 2] - z0) / cell

    def _points(self, u: NDArray[np.float64], v: NDArray[np.float64], nodes: NDArray[np.integer]) -> Points:
        """World points (K, 3) of places in grid units."""
        x0, z0 = self.grid.origin_xz
        return np.stack([x0 + u * self.grid.cell, self.node_y[nodes], z0 + v * self.grid.cell], axis=-1)

    def ends(self, points: Points) -> Ends:
        """World points (M, 3) moved onto the map, in grid units."""
        u, h, v = self._grid_units(points)
        cell = self.grid.cell
        return Ends(*snap_all(self.cells, u, h, v, SNAP_REACH / cell, SNAP_HEIGHT / cell, SNAP_CLIMB / cell))

    def _field(self, goals: Points) -> Field:
        """The distance field of these goals, remembered for the last few goal sets."""
        goals = np.ascontiguousarray(np.asarray(goals, float).reshape(-1, 3))
        key = hashlib.sha256(goals.tobytes()).digest()
        for known, field in self._fields:
            if known == key:
                return field
        ends = self.ends(goals)
        kept = np.flatnonzero(ends.nodes >= 0)
        kept = kept[np.argsort(ends.nodes[kept], kind="stable")]
        count = len(self.cells.row)
        u, v, h, nodes = ends.u[kept], ends.v[kept], ends.h[kept], ends.nodes[kept]
        field = Field(np.full(count, np.inf), np.full(count, -1, np.int32), u, v, h, nodes)
        spread(self.cells, field)
        self._fields = ((key, field), *self._fields[: _KEPT_FIELDS - 1])
        return field


def floor_grid_from_mesh(
    mesh: "TriangleMesh", *, radius: float = AGENT_RADIUS, height: float = AGENT_HEIGHT, both_sides: bool = False
) -> FloorGrid:
    """The places where a robot fits on a mesh, by Recast's rules with Habitat's settings (HABITAT_SEMANTICS.md 2.5).

    Heights are those of the real floor (Habitat's navmesh lies 0-0.2 m above it). Islands under 1 m2 are dropped, as in
    Habitat; roofs and large table tops stay islands of their own.

    Args:
        mesh: World frame; faces are wound counter-clockwise seen from their outside (floors from above).
        radius: Radius of the robot, rounded up to whole cells (0.18 -> 0.20).
        height: Clearance the robot needs, rounded up to whole 0.2 m (0.88 -> 1.0).
        both_sides: Whether faces wound downwards are floors too. False is Recast's rule; True is for houses whose
            winding is mixed, and then the upper sides of ceilings and of table tops without thickness are floors.

    Raises:
        SceneError: The robot can stand nowhere on the mesh, or the mesh is larger than any home.
    """
    find = partial(standing_places, mesh.vertices, mesh.faces, radius=radius, height=height)
    places = find(both_sides=both_sides)
    if not len(places.covered):
        turned = not both_sides and len(find(both_sides=True).covered)
        hint = " Its faces are wound downwards; both_sides=True counts them as floor." if turned else ""
        raise NoFloorError(
            f"navigation: found no floor of 1 m2 or more on {len(mesh.faces)} faces where a robot of radius {radius!r} "
            f"and height {height!r} fits; expected a furnished home in metres, y up "
            f'(files are y-up, as glTF is, but for HM3D\'s and where "up" in a <Name>.stage_config.json says z). '
            f"Check the file's unit and up axis.{hint}"
        )
    return FloorGrid(places.cells, places.grid, covered=places.covered, digest=_digest(places.cells, places.grid))


def _step_result(start: Points, end: Points, *, wanted: Points) -> StepResult:
    """The result of a walk from `start` that ended at `end`; all (3,)."""
    moved, asked = end - start, wanted - start
    x, y, z = (float(value) for value in end)
    return StepResult((x, y, z), bool(moved @ moved + 1e-5 < asked @ asked))


def _check_cells(rc: NDArray[np.int64], y: NDArray[np.float64], grid: GridSpec, max_climb: float) -> None:
    """Raises SceneError when cells cannot make a grid."""
    problem = ""
    if len(rc) != len(y):
        problem = f"{len(rc)} cells but {len(y)} heights; expected one height per cell"
    elif not len(rc):
        problem = "no free cell; expected at least one"
    elif not np.isfinite(y).all():
        problem = f"height {y[~np.isfinite(y)][0]!r} at cell {rc[~np.isfinite(y)][0].tolist()}; expected metres"
    elif not grid.contains(rc).all():
        problem = f"cell {rc[~grid.contains(rc)][0].tolist()} outside the grid; expected (row, col) below {grid.shape}"
    else:
        order = np.lexsort((y, rc[:, 1], rc[:, 0]))
        same = np.all(np.diff(rc[order], axis=0) == 0, axis=1) & (np.diff(y[order]) <= max_climb)
        if same.any():
            problem = (
                f"cell {rc[order][:-1][same][0].tolist()} given twice with heights less than {max_climb} m apart; "
                "expected once per layer"
            )
    if problem:
        raise SceneError(f"navigation: found {problem}. Check the home's plan.")


def _rise_per_cell(cells: Cells, side: int, count: int) -> NDArray[np.float64]:
    """(N,) mean slope over up to `count` linked cells before and after a node along `side` (0 u, 1 v)."""
    ends, taken = [], np.zeros(len(cells.h))
    for towards in (side, side + 2):
        node = np.arange(len(cells.h))
        for _ in range(count):
            following = cells.links[node, towards]
            taken += following >= 0
            node = np.where(following >= 0, following, node)
        ends.append(cells.h[node])
    return (ends[0] - ends[1]) / np.maximum(taken, 1)


def _digest(cells: Cells, grid: GridSpec) -> str:
    total = hashlib.sha256(repr((grid.origin_xz, grid.cell, grid.shape)).encode())
    for array in (cells.row, cells.col, cells.h, cells.links):
        total.update(array.tobytes())
    return total.hexdigest()
