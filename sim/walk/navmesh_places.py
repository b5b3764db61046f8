"""Dense places on a navigation mesh: its 5 cm cells, places near a point, and ceilings above them."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.compiled import njit
from sim.types import STOREY_GAP, GridSpec

from .height_field import ceilings
from .navigation_map import Points
from .navmesh_kernels import closest_on_polygon, height
from .navmesh_polygons import Polygons, owners, triangle_areas

if TYPE_CHECKING:
    from sim.mesh import TriangleMesh

CELL = 0.05
"""Spacing of places, metres."""
MAX_SPAN = 50_000.0
"""Largest area of the boxes of all polygons together, square metres (20 million cells)."""
_CEILING = 0.5
"""Least height of a ceiling above the mesh (metres): clear of the floor below it, and of stairs."""
_CEILING_STEP = 4
"""Ceilings are searched above every fourth cell in both directions (20 cm)."""
_TRIES = 1000
_BARE = 30.0
"""Squared outline over area below which an island is a bare plate: 16 for a square, hundreds for a furnished storey."""


class Cells(NamedTuple):
    """Cells whose centres lie over the mesh, once per layer."""

    grid: GridSpec
    row: NDArray[np.int32]
    """(N,)."""
    col: NDArray[np.int32]
    y: NDArray[np.float32]
    """(N,) height of the mesh there, world metres."""
    polygon: NDArray[np.int32]
    """(N,) polygon of each cell."""


def spanned_area(polygons: Polygons) -> float:
    """Area from above of the boxes of all polygons together, or of the box around them if that is more (m2)."""
    usable = polygons.island >= 0
    low, high = (bound[usable][:, [0, 2]].astype(np.float64) for bound in (polygons.low, polygons.high))
    return max(float(np.prod(high - low, axis=1).sum()), float(np.prod(high.max(axis=0) - low.min(axis=0))))


def cells_of(polygons: Polygons) -> Cells:
    """The CELL-sized cells of a mesh; cell borders are whole multiples of CELL in the world."""
    usable = polygons.island >= 0
    low = np.floor(polygons.low[usable].min(axis=0).astype(np.float64) / CELL)
    high = np.floor(polygons.high[usable].max(axis=0).astype(np.float64) / CELL) + 1
    grid = GridSpec((float(low[0]) * CELL, float(low[2]) * CELL), CELL, (int(high[2] - low[2]), int(high[0] - low[0])))
    return Cells(grid, *_rasterise(polygons, *grid.origin_xz, CELL))


def places_near(polygons: Polygons, cells: Cells, centre: Points, *, radius: float, max_dy: float) -> Points:
    """Places (K, 3) on the mesh within planar `radius` of a point (3,) and `max_dy` of its y.

    They are cell centres, points of walls, and points on the circle itself, each at most CELL apart.
    """
    reach = radius * (1 - 1e-9)  # so that rounding never puts a place outside
    xz = cells.grid.xz_from_rc(np.stack([cells.row, cells.col], axis=1))
    is_inside = np.hypot(xz[:, 0] - centre[0], xz[:, 1] - centre[2]) <= reach
    turn = np.linspace(0, 2 * np.pi, max(8, int(np.ceil(2 * np.pi * radius / CELL))), endpoint=False)
    rim = centre[[0, 2]] + reach * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    index, rim_y = _layers(polygons, np.column_stack([rim[:, 0], np.full(len(rim), centre[1]), rim[:, 1]]))
    wall, wall_y = _walls_near(polygons, centre[[0, 2]], reach)
    xz = np.concatenate([xz[is_inside], rim[index], wall])
    y = np.concatenate([cells.y[is_inside], rim_y, wall_y]).astype(np.float64)
    near = np.abs(y - centre[1]) <= max_dy
    return np.column_stack([xz[near, 0], y[near], xz[near, 1]])


def random_place(polygons: Polygons, rng: np.random.Generator, *, band: tuple[float, float]) -> Points | None:
    """A place (3,) uniform over the mesh's surface with its height strictly inside a band; None if none was hit."""
    lowest, highest = polygons.triangle[:, :, 1].min(axis=1), polygons.triangle[:, :, 1].max(axis=1)
    areas = np.where((highest > band[0]) & (lowest < band[1]), triangle_areas(polygons), 0.0)
    if not areas.any():
        return None
    upto = np.cumsum(areas)
    for _ in range(_TRIES):
        triangle = int(np.searchsorted(upto, rng.random() * upto[-1], side="right"))
        a, b, c = polygons.triangle[triangle].astype(np.float64)
        u, v = rng.random(2)
        if u + v > 1:
            u, v = 1 - u, 1 - v
        place = a + u * (b - a) + v * (c - a)
        if band[0] < place[1] < band[1]:
            return place
    return None


def covered_cells(polygons: Polygons, cells: Cells, mesh: "TriangleMesh | None") -> tuple[NDArray, NDArray, NDArray]:
    """(heights, islands, whether something is above) for a sample of cells (K,); tells roofs from storeys.

    Without a mesh the ceilings are unknown. Then a cell counts as covered unless it is on a bare plate (an island with
    a plain outline, without walls or furniture in it) over which the navigation mesh has nothing else.
    """
    sampled = (cells.row % _CEILING_STEP == 0) & (cells.col % _CEILING_STEP == 0)
    row, col, y = cells.row[sampled], cells.col[sampled], cells.y[sampled].astype(np.float64)
    island = polygons.island[cells.polygon[sampled]]
    if mesh is not None:
        xz = cells.grid.xz_from_rc(np.stack([row, col], axis=1))
        step = CELL * _CEILING_STEP
        return y, island, np.isfinite(ceilings(mesh.vertices, mesh.faces, xz[:, 0], y, xz[:, 1], step, _CEILING))
    top = np.full(cells.grid.shape, -np.inf)
    np.maximum.at(top, (row, col), y)
    return y, island, ~_is_bare(polygons)[island] | (top[row, col] > y + STOREY_GAP)


def _is_bare(polygons: Polygons) -> NDArray[np.bool_]:
    """(I,) whether each island is a bare plate."""
    wall, polygon = _walls(polygons)
    count = int(polygons.island.max()) + 1
    outline = np.bincount(
        polygons.island[polygon], np.linalg.norm((wall[:, 1] - wall[:, 0])[:, [0, 2]], axis=1), minlength=count
    )
    owner = polygons.island[owners(polygons)]
    area = np.bincount(owner[owner >= 0], triangle_areas(polygons)[owner >= 0], minlength=count)
    return outline**2 < _BARE * area


def _walls(polygons: Polygons) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """(ends (W, 2, 3), polygon (W,)) of all walls."""
    polygon, k = np.nonzero(
        (polygons.neighbour < 0)
        & (polygons.island[:, None] >= 0)
        & (np.arange(polygons.neighbour.shape[1]) < polygons.count[:, None])
    )
    following = np.where(k + 1 < polygons.count[polygon], k + 1, 0)
    ends = np.stack([polygons.corner[polygon, k], polygons.corner[polygon, following]], axis=1)
    return ends.astype(np.float64), polygon


def _walls_near(
    polygons: Polygons, centre_xz: NDArray[np.float64], reach: float
) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
    """(xz (K, 2), height (K,)) of points at most CELL apart on the parts of walls within `reach` of a point."""
    ends, polygon = _walls(polygons)
    start, along = ends[:, 0, ::2] - centre_xz, (ends[:, 1] - ends[:, 0])[:, ::2]
    length = np.linalg.norm(along, axis=1)
    unit = along / np.maximum(length, 1e-12)[:, None]
    nearest = -(start * unit).sum(axis=1)
    half_sq = reach**2 - ((start + nearest[:, None] * unit) ** 2).sum(axis=1)
    half = np.sqrt(np.maximum(half_sq, 0.0))
    enter, leave = np.maximum(nearest - half, 0.0), np.minimum(nearest + half, length)
    touched = np.flatnonzero((half_sq >= 0) & (leave >= enter))
    places = [np.empty((0, 2))]
    for w in touched:
        stops = np.linspace(enter[w], leave[w], 1 + int(np.ceil((leave[w] - enter[w]) / CELL)))
        places.append(centre_xz + start[w] + stops[:, None] * unit[w])
    owner = np.repeat(polygon[touched], [len(part) for part in places[1:]])
    xz = np.concatenate(places)
    return xz, _heights_in(polygons, owner, xz.astype(np.float32))


@njit(cache=True, nogil=True, error_model="numpy")
def _rasterise(mesh, x0, z0, cell):
    """(row, col, y, polygon) (N,) of the cells whose centres lie over polygons, row by row within each polygon."""
    rows, cols = [np.int32(0) for _ in range(0)], [np.int32(0) for _ in range(0)]
    heights, found = [np.float32(0) for _ in range(0)], [np.int32(0) for _ in range(0)]
    for polygon in range(len(mesh.count)):
        if mesh.island[polygon] < 0:
            continue
        r0, r1 = int((mesh.low[polygon, 2] - z0) / cell), int((mesh.high[polygon, 2] - z0) / cell)
        c0, c1 = int((mesh.low[polygon, 0] - x0) / cell), int((mesh.high[polygon, 0] - x0) / cell)
        for r in range(r0, r1 + 1):
            for c in range(c0, c1 + 1):
                centre = (np.float32(x0 + (c + 0.5) * cell), np.float32(0.0), np.float32(z0 + (r + 0.5) * cell))
                over, y = height(mesh, polygon, centre)
                if over:
                    rows.append(np.int32(r))
                    cols.append(np.int32(c))
                    heights.append(y)
                    found.append(np.int32(polygon))
    return np.array(rows), np.array(cols), np.array(heights), np.array(found)


@njit(cache=True, nogil=True, error_model="numpy")
def _layers(mesh, points):
    """(index (K,), height (K,)) of all polygons over or under each point (N, 3)."""
    index, heights = [0 for _ in range(0)], [np.float32(0) for _ in range(0)]
    for i in range(len(points)):
        point = (np.float32(points[i, 0]), np.float32(points[i, 1]), np.float32(points[i, 2]))
        for polygon in range(len(mesh.count)):
            x_in = mesh.low[polygon, 0] <= point[0] <= mesh.high[polygon, 0]
            z_in = mesh.low[polygon, 2] <= point[2] <= mesh.high[polygon, 2]
            if mesh.island[polygon] >= 0 and x_in and z_in:
                over, y = height(mesh, polygon, point)
                if over:
                    index.append(i)
                    heights.append(y)
    return np.array(index), np.array(heights)


@njit(cache=True, nogil=True, error_model="numpy")
def _heights_in(mesh, polygons, xz):
    """(K,) height of polygons (K,) at or next to points (K, 2)."""
    heights = np.empty(len(xz), np.float32)
    for i in range(len(xz)):
        heights[i] = closest_on_polygon(mesh, polygons[i], (xz[i, 0], mesh.low[polygons[i], 1], xz[i, 1]))[1][1]
    return heights
