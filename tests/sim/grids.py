"""Floor grids of known cells, for tests of navigation."""

import numpy as np

from sim.mesh import TriangleMesh
from sim.types import GridSpec
from sim.walk.floor_grid import FloorGrid
from tests.sim.meshes import box, floor, mesh_of

CELL = 0.05


def at(x: float, z: float, y: float = 0.0) -> np.ndarray:
    return np.array([x, y, z])


def grid_of(free=lambda x, z: x < np.inf, *, size: float = 4.0) -> FloorGrid:
    """A square from (0, 0); `free(x, z)` says which cell centres are free."""
    spec = GridSpec((0.0, 0.0), CELL, (round(size / CELL), round(size / CELL)))
    rc = np.argwhere(np.ones(spec.shape, bool))
    rc = rc[free(*spec.xz_from_rc(rc).T)]
    return FloorGrid.from_cells(rc, np.zeros(len(rc)), grid=spec)


def level_floors(shape: tuple[int, int], *heights: float, corner: tuple[float, float] = (0.0, 0.0)) -> FloorGrid:
    """Free rectangles of `shape` = (rows, columns) cells at each height, with their first corner at (x, z)."""
    rc = np.argwhere(np.ones(shape, bool))
    grid = GridSpec(corner, CELL, shape)
    return FloorGrid.from_cells(np.tile(rc, (len(heights), 1)), np.repeat(heights, len(rc)), grid=grid)


def height_at(grid: FloorGrid, point: np.ndarray) -> float:
    """Height of the floor to which a point snaps."""
    snapped = grid.snap(point)
    assert snapped is not None
    return float(snapped[1])


def cluttered_home() -> TriangleMesh:
    """A floor of 6 x 6 m turned by 17 degrees with three boxes and a platform."""
    turn = np.radians(17)
    turned = np.array([[np.cos(turn), 0, -np.sin(turn)], [0, 1, 0], [np.sin(turn), 0, np.cos(turn)]])
    boxes = [
        ((1, 0, 1), (2, 1, 2)),
        ((3, 0, 0.5), (3.4, 1, 4)),
        ((0.5, 0, 3), (2, 0.5, 3.3)),
        ((4, 0, 4), (6, 0.15, 6)),
    ]
    quads = [floor(0, 0, 6, 6), *(quad for low, high in boxes for quad in box(low, high))]
    return mesh_of(*((corners @ turned, rgb, instance) for corners, rgb, instance in quads))
