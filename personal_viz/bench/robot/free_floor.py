"""Scores a robot's map of a storey against the mesh of its home: free floor that was seen, and edges of obstacles."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from grounding.maps.occupancy import FLOOR_HIGH, FLOOR_LOW, MAX_DEPTH, OBSTACLE_TOP
from grounding.maps.storeys import points_at
from sim.mesh import Scene
from sim.render.raycast import Raycaster
from sim.tasks.observers import FREE, OCCUPIED
from sim.types import CUT_HEIGHT, Frame, GridSpec

_FINE = 0.02
"""Side of the squares in which the mesh is probed, metres."""
_BESIDE = np.array([-_FINE, 0.0, _FINE])
"""A cell of a map is truly free where the mesh is free this far (metres) around its middle."""
_MARGIN = 0.2


@dataclass(frozen=True, slots=True)
class TrueFloor:
    """Where a storey's floor is free of anything that blocks a robot."""

    grid: GridSpec
    is_free: NDArray[np.bool_]
    """(rows, cols) whether the floor is there, and nothing between FLOOR_HIGH and OBSTACLE_TOP above it."""

    @classmethod
    def of(cls, scene: Scene, floor_y: float) -> Self:
        """Probes the mesh from above; in homes made from plans, walls are solid and have a rim at CUT_HEIGHT."""
        low, high = (bound(scene.mesh.vertices, axis=0)[[0, 2]].astype(float) for bound in (np.min, np.max))
        cols, rows = np.ceil((high - low + 2 * _MARGIN) / _FINE).astype(int).tolist()
        grid = GridSpec((low[0] - _MARGIN, low[1] - _MARGIN), _FINE, (rows, cols))
        xz = grid.xz_from_rc(np.argwhere(np.ones(grid.shape, bool)))
        heights, is_inside = _heights_below(scene, xz, floor_y + OBSTACLE_TOP)
        rims, _ = _heights_below(scene, xz, floor_y + CUT_HEIGHT + 0.02)
        is_floor = (heights - floor_y >= FLOOR_LOW) & (heights - floor_y <= FLOOR_HIGH)
        is_wall = np.abs(rims - floor_y - CUT_HEIGHT) < 0.02
        return cls(grid, (is_floor & ~is_inside & ~is_wall).reshape(grid.shape))


@dataclass(frozen=True, slots=True)
class MapScore:
    """A map of one storey beside the truth."""

    num_free: int
    """Truly free cells whose floor a sensor without noise would have shown."""
    num_recalled: int
    """Those that the map calls free."""
    edges: NDArray[np.float64]
    """(N,) metres from each blocked cell beside the map's largest free area to the nearest true edge."""


def cells_seen(frame: Frame, grid: GridSpec, floor_y: float, *, nearest: float) -> NDArray[np.int64]:
    """(N, 2) cells whose floor a view with true depth shows between `nearest` and MAX_DEPTH metres; some repeat."""
    rows, cols = np.nonzero((frame.depth_m >= nearest) & (frame.depth_m <= MAX_DEPTH))
    points = points_at(frame, np.column_stack([rows, cols]))
    is_floor = (points[:, 1] - floor_y >= FLOOR_LOW) & (points[:, 1] - floor_y <= FLOOR_HIGH)
    rc = grid.rc_from_xz(points[is_floor][:, [0, 2]])
    return rc[grid.contains(rc)]


def map_score(
    cells: NDArray[np.uint8], grid: GridSpec, seen_rc: Sequence[NDArray[np.int64]], truth: TrueFloor
) -> MapScore:
    """Scores a map's cells (rows, cols).

    Args:
        seen_rc: Cells of the map whose floor the views showed, from `cells_seen`.
    """
    is_seen = np.zeros(grid.shape, bool)
    for rc in seen_rc:
        is_seen[rc[:, 0], rc[:, 1]] = True
    seen = np.argwhere(is_seen)
    xz = grid.xz_from_rc(seen)
    around = [_at(truth, xz + np.array([dx, dz]), truth.is_free) for dx in _BESIDE for dz in _BESIDE]
    free_rc = seen[np.all(around, axis=0)]
    inside, outside = (np.asarray(ndimage.distance_transform_edt(there)) for there in (truth.is_free, ~truth.is_free))
    to_edge = _FINE * (np.maximum(inside, outside) - 0.5)
    areas, _ = ndimage.label(cells == FREE)  # type: ignore[misc]
    sizes = np.bincount(areas.ravel())
    sizes[0] = 0
    is_edge = (cells == OCCUPIED) & ndimage.binary_dilation(areas == sizes.argmax())
    edges = _at(truth, grid.xz_from_rc(np.argwhere(is_edge)), to_edge)
    return MapScore(len(free_rc), int((cells[free_rc[:, 0], free_rc[:, 1]] == FREE).sum()), edges)


def _at(truth: TrueFloor, xz: NDArray[np.float64], values: NDArray) -> NDArray:
    """(N,) the values at these places (N, 2); the nearest ones outside the grid."""
    rc = np.clip(truth.grid.rc_from_xz(xz), 0, np.array(truth.grid.shape) - 1)
    return values[rc[:, 0], rc[:, 1]]


def _heights_below(scene: Scene, xz: NDArray[np.float64], y: float) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """(N,) heights of the first surface below these places (N, 2) at height y, and whether it is seen from inside."""
    origins = np.column_stack([xz[:, 0], np.full(len(xz), y), xz[:, 1]])
    hits = Raycaster(scene.mesh).cast(origins, np.broadcast_to([0.0, -1.0, 0.0], origins.shape))
    a, b, c = scene.mesh.vertices[scene.mesh.faces[np.maximum(hits.face_ids, 0)]].astype(float).swapaxes(0, 1)
    is_inside = (hits.face_ids >= 0) & (np.cross(b - a, c - a)[:, 1] < 0)
    return np.where(hits.face_ids >= 0, hits.positions[:, 1], -np.inf), is_inside
