"""Places of a mesh where a robot fits, by Recast's voxel rules with Habitat's settings, and ceilings over places.

A column of the height field holds *spans*, solid from `lo` to `hi` in voxels of 0.2 m; the robot stands on their tops.
Lengths inside the kernels are voxels; u, v and directions are those of grid_kernels.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.compiled import njit
from sim.errors import SceneError
from sim.types import GridSpec

from .grid_kernels import Cells, connected_parts, first_of_columns, with_diagonals
from .spans import CLIMB, bounds_of, spans_of

CELL = 0.05
"""Side of a column, metres (Habitat's cellSize)."""
VOXEL = 0.2
"""Height of a voxel, metres (Habitat's cellHeight); also the highest step, which is one voxel."""
MAX_SLOPE = math.radians(45)
"""Steeper faces are walls (Habitat's agentMaxSlope)."""
MIN_ISLAND_CELLS = 400
"""Smaller islands are dropped (Habitat's regionMinSize, 20 cells squared = 1 m2)."""
_MAX_COLUMNS = 25_000_000
"""About a square of 250 m; a larger mesh is in other units and would not fit in memory."""
_MAX_HEIGHT = 1000.0
"""Metres; a higher mesh is in other units, or has a stray vertex far away."""
_OPEN = 1 << 20
"""Ceiling height in voxels where nothing is above."""


class StandingPlaces(NamedTuple):
    """The nodes of a mesh's floor grid."""

    cells: Cells
    covered: NDArray[np.bool_]
    """(N,) whether something is above each node."""
    grid: GridSpec


def standing_places(
    vertices: NDArray[np.float32],
    faces: NDArray[np.int32],
    *,
    radius: float,
    height: float,
    both_sides: bool,
) -> StandingPlaces:
    """Places where the centre of a robot fits on a mesh, at the real floor's height; see `floor_grid_from_mesh`."""
    low, high = bounds_of(vertices, faces)
    rows, cols = _columns(low, high)
    spans = spans_of(
        vertices, faces, low, np.array([CELL, VOXEL, CELL]), rows, cols, math.cos(MAX_SLOPE), both_sides=both_sides
    )
    first, hi, walkable = spans.first, spans.hi, spans.walkable
    column = np.repeat(np.arange(rows * cols), np.diff(first))
    clearance = math.ceil(height / VOXEL - 1e-6)
    ceiling = np.where(np.append(column[1:] == column[:-1], False), np.append(spans.lo[1:], 0), _OPEN)
    _filter(first, spans.lo, hi, ceiling, walkable, rows, cols, clearance)
    links = _connect(first, hi, ceiling, walkable, rows, cols, clearance)
    fits = walkable & (_wall_distance(walkable, links) >= 2 * math.ceil(radius / CELL - 1e-6))
    islands = connected_parts(links, fits)
    sizes = np.bincount(islands + 1)
    nodes = np.flatnonzero(fits & (sizes[islands + 1] >= MIN_ISLAND_CELLS))
    number = np.full(len(fits) + 1, -1, np.int32)
    number[nodes] = np.arange(len(nodes))
    row, col = (column[nodes] // cols).astype(np.int32), (column[nodes] % cols).astype(np.int32)
    h = (low[1] + spans.top[nodes] * VOXEL) / CELL
    all_links = with_diagonals(number[links[nodes]], h, np.inf)
    cells = Cells(row, col, h, all_links, first_of_columns(row, col, rows, cols), rows, cols)
    return StandingPlaces(cells, ceiling[nodes] < _OPEN, GridSpec((float(low[0]), float(low[2])), CELL, (rows, cols)))


def _columns(low: NDArray[np.float64], high: NDArray[np.float64]) -> tuple[int, int]:
    """Rows and columns that cover a mesh between two corners (3,).

    Raises:
        SceneError: The mesh is larger than any home, or has corners that are not finite.
    """
    if not np.isfinite([low, high]).all():
        raise SceneError(
            "navigation: found vertices that are not finite (or no face at all); expected metres. Repair the mesh."
        )
    cols, rows = (max(int((high[axis] - low[axis]) / CELL + 0.5), 1) for axis in (0, 2))
    if rows * cols > _MAX_COLUMNS or high[1] - low[1] > _MAX_HEIGHT:
        raise SceneError(
            f"navigation: found a mesh of {cols * CELL:.0f} x {rows * CELL:.0f} m, {high[1] - low[1]:.0f} m high; "
            f"expected a home, at most {_MAX_COLUMNS * CELL**2:.0f} m2 and {_MAX_HEIGHT:.0f} m high. "
            "Check that the file's unit is metres."
        )
    return rows, cols


@njit(cache=True, nogil=True)
def _filter(first, lo, hi, ceiling, walkable, rows, cols, clearance):
    """Recast's three filters, in place: steps up onto obstacles, ledges, low ceilings."""
    for column in range(rows * cols):
        below_was_floor = False
        for span in range(first[column], first[column + 1]):
            was_floor = walkable[span]
            if not was_floor and below_was_floor and hi[span] - hi[span - 1] <= CLIMB:
                walkable[span] = True
            below_was_floor = was_floor
    for column in range(rows * cols):
        for span in range(first[column], first[column + 1]):
            if walkable[span] and _is_ledge(first, lo, hi, ceiling, span, column, rows, cols, clearance):
                walkable[span] = False
    for span in range(len(lo)):
        if ceiling[span] - hi[span] < clearance:
            walkable[span] = False


@njit(cache=True, nogil=True)
def _is_ledge(first, lo, hi, ceiling, span, column, rows, cols, clearance):
    """Whether a neighbour is more than a step below, or neighbours within a step differ by more than one step."""
    floor, roof = hi[span], ceiling[span]
    least = least_step = most_step = 0
    for side in range(4):
        r = column // cols + (side == 1) - (side == 3)
        c = column % cols + (side == 0) - (side == 2)
        if r < 0 or c < 0 or r >= rows or c >= cols:
            return True
        other = r * cols + c
        begin, end = first[other], first[other + 1]
        ground = lo[begin] if begin < end else _OPEN
        if min(roof, ground) - floor >= clearance:
            return True
        for near in range(begin, end):
            if min(roof, ceiling[near]) - max(floor, hi[near]) < clearance:
                continue
            rise = hi[near] - floor
            least = min(least, rise)
            if abs(rise) <= CLIMB:
                least_step, most_step = min(least_step, rise), max(most_step, rise)
    return least < -CLIMB or most_step - least_step > CLIMB


@njit(cache=True, nogil=True)
def _connect(first, hi, ceiling, walkable, rows, cols, clearance):
    """(S, 4) walkable spans to which a robot can step, -1 = none."""
    links = np.full((len(hi), 4), -1, np.int64)
    for column in range(rows * cols):
        for span in range(first[column], first[column + 1]):
            if not walkable[span]:
                continue
            for side in range(4):
                r = column // cols + (side == 1) - (side == 3)
                c = column % cols + (side == 0) - (side == 2)
                if r < 0 or c < 0 or r >= rows or c >= cols:
                    continue
                for near in range(first[r * cols + c], first[r * cols + c + 1]):
                    gap = min(ceiling[span], ceiling[near]) - max(hi[span], hi[near])
                    if walkable[near] and abs(hi[near] - hi[span]) <= CLIMB and gap >= clearance:
                        links[span, side] = near
                        break
    return links


@njit(cache=True, nogil=True)
def _wall_distance(walkable, links):
    """(S,) distance to the nearest border of the walkable spans, 2 per side step and 3 per diagonal."""
    far = 1 << 20
    distance = np.zeros(len(walkable), np.int32)
    for span in range(len(walkable)):
        if walkable[span] and links[span].min() >= 0:
            distance[span] = far
    for turn in range(2):
        backwards = turn == 0
        for i in range(len(walkable)):
            span = i if backwards else len(walkable) - 1 - i
            for k in range(2):
                side = (2 + k) if backwards else k
                near = links[span, side]
                if near < 0:
                    continue
                distance[span] = min(distance[span], distance[near] + 2)
                corner = links[near, (side + 1) % 4]
                if corner >= 0:
                    distance[span] = min(distance[span], distance[corner] + 3)
    return distance


@njit(cache=True, nogil=True)
def ceilings(vertices, faces, x, y, z, cell, clearance):
    """(N,) height of the lowest face at least `clearance` above each place, inf where there is none.

    Faces steeper than 60 degrees are walls. Places are held in columns of a grid of `cell` metres.
    """
    x0, z0 = x.min(), z.min()
    cols, rows = int((x.max() - x0) / cell) + 1, int((z.max() - z0) / cell) + 1
    first = np.zeros(rows * cols + 1, np.int64)
    column = np.empty(len(x), np.int64)
    for i in range(len(x)):
        column[i] = int((z[i] - z0) / cell) * cols + int((x[i] - x0) / cell)
        first[column[i] + 1] += 1
    first = np.cumsum(first)
    order = np.argsort(column, kind="mergesort")
    found = np.full(len(x), np.inf)
    for f in range(len(faces)):
        a, b, c = vertices[faces[f, 0]], vertices[faces[f, 1]], vertices[faces[f, 2]]
        ux, uy, uz = float(b[0] - a[0]), float(b[1] - a[1]), float(b[2] - a[2])
        vx, vy, vz = float(c[0] - a[0]), float(c[1] - a[1]), float(c[2] - a[2])
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        if ny * ny <= 0.25 * (nx * nx + ny * ny + nz * nz):
            continue
        c0 = max(int((min(a[0], b[0], c[0]) - x0) / cell), 0)
        c1 = min(int((max(a[0], b[0], c[0]) - x0) / cell), cols - 1)
        r0 = max(int((min(a[2], b[2], c[2]) - z0) / cell), 0)
        r1 = min(int((max(a[2], b[2], c[2]) - z0) / cell), rows - 1)
        for r in range(r0, r1 + 1):
            for k in range(first[r * cols + c0], first[r * cols + c1 + 1]) if c1 >= c0 else range(0):
                i = order[k]
                dx, dz = x[i] - a[0], z[i] - a[2]
                s = (dz * vx - dx * vz) / ny  # barycentric coordinates of the place seen from above
                t = (dx * uz - dz * ux) / ny
                if s >= 0 and t >= 0 and s + t <= 1:
                    height = a[1] + s * uy + t * vy
                    if height >= y[i] + clearance and height < found[i]:
                        found[i] = height
    return found
