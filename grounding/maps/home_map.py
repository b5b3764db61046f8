"""The result of exploring a home: for each storey, the free space and a map of features or of objects. numpy only.

Map builders make a `HomeMemory`, map files hold it, grounders get one storey's `Memory`, recordings draw it.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sim.episodes.schema import Vector3
from sim.errors import AgentError
from sim.types import GridSpec

from ..encoders.protocol import TextEncoder
from ..types import FeatureMap, map_from_cells, require_same_encoder

_CELL = 1.0
_MARGIN = 1
"""Margin of an object map's grid, in cells and so in metres."""


@dataclass(frozen=True, slots=True)
class OccupancyGrid:
    """A robot's knowledge of one storey's floor."""

    cells: NDArray[np.uint8]
    """(rows, cols) `UNKNOWN`, `FREE` or `OCCUPIED` of sim.tasks.observers."""
    grid: GridSpec
    """Cells of 5 cm, map frame."""

    def __post_init__(self) -> None:
        assert self.cells.shape == tuple(self.grid.shape), self.cells.shape


@dataclass(frozen=True, slots=True)
class ObjectInstance:
    """One thing that was seen, merged over views."""

    points: NDArray[np.float32]
    """(P, 3) points on its surface, thinned to about 5 cm, map frame."""
    feature: NDArray[np.float32]
    """(E,) mean of the encoder's vectors of its views, as a unit vector."""
    caption: str
    """Words from a captioner; "" when there are none."""
    weight: float
    """Evidence: number of views."""

    @property
    def box(self) -> tuple[Vector3, Vector3]:
        """Lowest and highest corner, metres."""
        low, high = self.points.min(axis=0).tolist(), self.points.max(axis=0).tolist()
        return (low[0], low[1], low[2]), (high[0], high[1], high[2])

    @property
    def centre(self) -> Vector3:
        """Middle of the box, metres."""
        low, high = self.box
        return ((low[0] + high[0]) / 2, (low[1] + high[1]) / 2, (low[2] + high[2]) / 2)


@dataclass(frozen=True, slots=True)
class ObjectMap:
    """The things of one storey, or of all storeys of a home."""

    objects: tuple[ObjectInstance, ...]
    floor_y: float
    """Height of the storey's floor, or of the lowest one, metres."""
    encoder: str
    """Name of the encoder of the features."""
    dim: int
    """E; known even when there are no objects."""
    centre_xz: tuple[float, float]
    """Middle of all things' points, world x and z in metres."""
    merge_m: float
    """Views of one thing are merged when their points are within this many metres."""
    upper_floors: tuple[float, ...] = ()
    """Heights of the floors of further storeys, ascending."""

    @property
    def storeys(self) -> NDArray[np.int64]:
        """(N,) storey of each thing, 0 = the lowest."""
        heights = np.array([item.centre[1] for item in self.objects], np.float64)
        return floors_below(heights, np.array([self.floor_y, *self.upper_floors]))

    @property
    def places(self) -> NDArray[np.float64]:
        """(N, 3) middles of the things' boxes, on the floor below each; world metres."""
        floors = np.array([self.floor_y, *self.upper_floors])
        return np.insert(self.middles_xz, 1, floors[self.storeys], axis=1)

    @property
    def middles_xz(self) -> NDArray[np.float64]:
        """(N, 2) x and z of the middles of the things' boxes."""
        return np.array([item.centre for item in self.objects], np.float64).reshape(-1, 3)[:, [0, 2]]

    @property
    def grid(self) -> GridSpec:
        """Cells of 1 m around all things, for candidates and layers; several things may be in one cell."""
        middles = self.middles_xz if self.objects else np.array([self.centre_xz], np.float64)
        low = np.floor(middles.min(axis=0) / _CELL) - _MARGIN
        cols, rows = (np.floor(middles.max(axis=0) / _CELL) + _MARGIN + 1 - low).astype(int).tolist()
        return GridSpec((float(low[0] * _CELL), float(low[1] * _CELL)), _CELL, (rows, cols))


def floors_below(y: NDArray[np.float64], floors: NDArray[np.float64]) -> NDArray[np.int64]:
    """(N,) index of the nearest floor below each height (N,), of floors in ascending order; the lowest if none is."""
    return np.maximum(np.searchsorted(floors, y, side="right") - 1, 0)


Memory = FeatureMap | ObjectMap
"""The maps that a grounder may get; each grounder says which kind it takes."""


MemoryKind = Literal["grid", "objects"]
"""`FeatureMap` or `ObjectMap`."""


def require_grid(memory: Memory, grounder: str, encoder: TextEncoder | None = None) -> FeatureMap:
    """The memory, which must be a grid map in the encoder's space.

    Raises:
        AgentError: It is a map of objects, or was made with another encoder.
    """
    if not isinstance(memory, FeatureMap):
        raise AgentError(
            f"grounder {grounder!r}: got a map of {len(memory.objects)} objects; expected a grid map. "
            'Use "object-phrase" or "object-dual", or build a grid map.'
        )
    if encoder is not None:
        require_same_encoder((memory.encoder, memory.dim), (encoder.name, encoder.dim))
    return memory


def require_objects(memory: Memory, grounder: str, encoder: TextEncoder) -> ObjectMap:
    """The memory, which must be a map of objects in the encoder's space.

    Raises:
        AgentError: It is a grid map, or was made with another encoder.
    """
    if not isinstance(memory, ObjectMap):
        raise AgentError(
            f"grounder {grounder!r}: got a grid map of {len(memory.rows)} cells; expected a map of objects. "
            'Use "dual" or "joint", or build a map of objects.'
        )
    require_same_encoder((memory.encoder, memory.dim), (encoder.name, encoder.dim))
    return memory


@dataclass(frozen=True, slots=True)
class StoreyMemory:
    """One storey."""

    occupancy: OccupancyGrid
    memory: Memory

    @property
    def floor_y(self) -> float:
        """Height of its floor, metres."""
        return self.memory.floor_y


@dataclass(frozen=True, slots=True)
class HomeMemory:
    """The result of one or more explorations of a home."""

    storeys: tuple[StoreyMemory, ...]
    """Ascending in `floor_y`."""
    frame: str
    """`world` for homes of the simulator; otherwise words that name the robot's frame."""
    num_frames: int
    """Number of views in the map."""

    def storey_near(self, y: float) -> StoreyMemory:
        """The storey whose floor is nearest to this height, metres.

        Raises:
            AgentError: The memory is empty.
        """
        if not self.storeys:
            raise AgentError("map: has no storey; expected at least one. Explore the home, or add valid frames.")
        return min(self.storeys, key=lambda storey: abs(storey.floor_y - y))


def merged_storeys(home: HomeMemory) -> Memory:
    """One memory for all storeys, for queries that do not name a storey; cells above each other become one.

    A merged cell holds the mean of its storeys' vectors, weighted by evidence, and the floor of the storey with the
    most evidence.

    Raises:
        AgentError: The memory is empty.
    """
    lowest = home.storey_near(-np.inf).memory
    memories = [storey.memory for storey in home.storeys]
    if isinstance(lowest, ObjectMap):
        objects = [item for memory in memories if isinstance(memory, ObjectMap) for item in memory.objects]
        return replace(lowest, objects=tuple(objects), upper_floors=tuple(item.floor_y for item in home.storeys[1:]))
    maps = [memory for memory in memories if isinstance(memory, FeatureMap)]
    assert all(item.grid == lowest.grid for item in maps), "storeys of one home have one grid"
    flat = np.concatenate([item.flat_index for item in maps])
    weights = np.concatenate([item.weights for item in maps]).astype(np.float64)
    heights = np.concatenate([item.cell_y for item in maps])
    cells, inverse = np.unique(flat, return_inverse=True)
    vectors = np.zeros((len(cells), lowest.dim))
    np.add.at(vectors, inverse, np.concatenate([item.rows for item in maps]) * weights[:, None])
    total = np.bincount(inverse, weights, len(cells)).astype(np.float64)
    best = np.lexsort((-weights, inverse))[np.unique(np.sort(inverse), return_index=True)[1]]
    return map_from_cells(
        vectors,
        np.column_stack([cells // lowest.grid.shape[1], cells % lowest.grid.shape[1]]),
        grid=lowest.grid,
        floor_y=lowest.floor_y,
        encoder=lowest.encoder,
        centre_xz=lowest.centre_xz,
        cell_y=heights[best],
        weights=total,
    )
