"""Grid maps from posed pictures: the vector of each patch or picture is added to the cells that it shows.

Posed frames + encoder -> sums per cell and storey -> `HomeMemory` (home_map.py). It holds seen places only, no ground
truth.
"""

from collections.abc import Sequence
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from sim.errors import AgentError
from sim.types import Frame, GridSpec

from ..encoders.protocol import DenseEncoder, TextImageEncoder
from ..types import NO_FEATURES, FeatureMap, map_from_cells
from .home_map import HomeMemory
from .storeys import Storeys, ViewOptions, points_at
from .view_quality import NEAR, bearing_weight, patches_of

GRID_SIZE = 50.0
"""Side of the mapped square, metres; 50 cells of 1 m (paper, Sec. IV)."""
FeatureSource = Literal["patches", "images"]
"""A vector for each patch of a view, or one for the whole view in every cell that it shows (the authors' code)."""
_EVERY_PIXEL = 8
"""For whole views, only every 8th pixel of every 8th row is used to find the cells that they show."""
_WHOLE = 1e-9
_NO_PATCHES = (16, 16)
_FIRST_CELLS = 64


class MapBuilder(Protocol):
    """Makes a map from views; raises AgentError where an encoder or segmenter breaks its contract.

    `grounding.checks.check_map_builder` tests a plug-in.
    """

    @property
    def name(self) -> str:
        """Says how the map is made and from which input; it is written into map files."""
        ...

    def reset(self) -> None:
        """Forgets all views."""
        ...

    def add(self, frame: Frame) -> None:
        """Adds a view. The builder does not change its arrays but may read them until `finish`: do not change them."""
        ...

    def finish(self) -> HomeMemory:
        """The map of all views since `reset`, without storeys if there was no view. More views may be added later."""
        ...


class GridMapBuilder:
    """Builds the occupancy and one vector per cell for each storey."""

    def __init__(
        self,
        encoder: TextImageEncoder | DenseEncoder,
        *,
        cell: float = 1.0,
        features: FeatureSource = "patches",
        views: ViewOptions = ViewOptions(),  # noqa: B008 - frozen value
    ) -> None:
        """Starts an empty map.

        The grid's corner is floor(middle) - GRID_SIZE / 2 (GROUNDING.md, section 0), so that the cells of all maps of a
        home lie on one lattice. With `OracleHome.centre_xz` as the middle they are those of its oracle map.

        Args:
            encoder: Encodes the views; with `features="patches"` it must have `encode_patches`.
            cell: Side of a cell, metres; 1, or 1 divided by a whole number.

        Raises:
            AgentError: The encoder or `cell` does not fit.
        """
        if not (0 < cell <= 1 and abs(1 / cell - round(1 / cell)) < _WHOLE):
            raise AgentError(
                f"map builder: cell is {cell!r}; expected 1 m divided by a whole number, so that the cells of all maps "
                "fit into each other. Give 1, 0.5, 0.25, 0.2 or 0.1."
            )
        if features == "patches" and not hasattr(encoder, "encode_patches"):
            raise AgentError(
                f"map builder: encoder {encoder.name!r} has no encode_patches; expected a DenseEncoder for "
                'features="patches". Take features="images", or another encoder.'
            )
        self.name = f"{cell:g} m cells of {features}"
        """Map files keep this name of the builder."""
        self._encoder = encoder
        self._cell, self._features, self._views = cell, features, views
        self.reset()

    def reset(self) -> None:
        """Forgets all views."""
        self._storeys = Storeys(self._views)
        self._sums: dict[int, CellSums] = {}
        self._low, self._high = np.full(2, np.inf), np.full(2, -np.inf)

    def add(self, frame: Frame) -> None:
        """Adds a view; some wait until a batch is full or until the robot is off the stairs."""
        self._place(self._storeys.take(frame))

    def finish(self) -> HomeMemory:
        """The map of all views since `reset`; raises AgentError where a seen cell is outside the grid."""
        self._place(self._storeys.rest())
        centre = _middle(self._low, self._high)
        corner = np.floor(self._views.centre_xz or centre) - GRID_SIZE / 2
        count = round(GRID_SIZE / self._cell)
        grid = GridSpec((float(corner[0]), float(corner[1])), self._cell, (count, count))
        return self._storeys.home(lambda index: self._feature_map(index, grid, centre))

    def _place(self, frames: Sequence[Frame]) -> None:
        """Encodes frames and adds their vectors to the cells that they show."""
        if not frames:
            return
        if self._features == "patches":
            vectors = encoded_patches(self._encoder, frames)  # type: ignore[arg-type]  # checked at construction
            for frame, patches in zip(frames, vectors, strict=True):
                seen = patches_of(frame, patches.shape[:2], max_depth=self._views.max_depth)
                self._add_points(seen.points, patches.reshape(-1, self._encoder.dim), seen.weights)
        else:
            for frame, vector in zip(frames, _encoded_images(self._encoder, frames), strict=True):
                points, weights = self._shown_cells(frame)
                self._add_points(points, np.broadcast_to(vector, (len(points), len(vector))), weights)

    def _add_points(self, points: NDArray, vectors: NDArray[np.float32], weights: NDArray) -> None:
        """Adds vectors (N, E) with weights (N,) to the cells under points (N, 3); zero vectors add nothing."""
        storeys = self._storeys.index_of(points[:, 1])
        seen = (weights > 0) & (storeys >= 0)
        if not seen.any():
            return
        xz = points[:, [0, 2]]
        self._low = np.minimum(self._low, xz[seen].min(axis=0))
        self._high = np.maximum(self._high, xz[seen].max(axis=0))
        says = seen & vectors.any(axis=1)
        for index in np.unique(storeys[says]).tolist():
            here = says & (storeys == index)
            rc = np.floor(xz[here][:, ::-1] / self._cell).astype(np.int64)
            self._sums.setdefault(index, CellSums(self._encoder.dim)).add(rc, vectors[here], weights[here])

    def _shown_cells(self, frame: Frame) -> tuple[NDArray, NDArray]:
        """A point (N, 3) in each cell that a view shows, and its weight (N,): the mean bearing weight of its pixels."""
        height, width = frame.depth_m.shape
        rows, cols = np.mgrid[_EVERY_PIXEL // 2 : height : _EVERY_PIXEL, _EVERY_PIXEL // 2 : width : _EVERY_PIXEL]
        depth = frame.depth_m[rows, cols]
        is_valid = (depth >= NEAR) & (depth <= self._views.max_depth)
        rc = np.column_stack([rows[is_valid], cols[is_valid]])
        points = points_at(frame, rc)
        cells = np.column_stack([np.floor(points[:, [0, 2]] / self._cell), self._storeys.index_of(points[:, 1])])
        _, first, inverse = np.unique(cells, axis=0, return_index=True, return_inverse=True)
        trust = bearing_weight(rc[:, 1] + 0.5, frame.camera)
        weights = np.bincount(inverse.reshape(-1), trust) / np.bincount(inverse.reshape(-1))
        return points[first], weights if len(first) else np.empty(0)

    def _feature_map(self, index: int, grid: GridSpec, centre_xz: tuple[float, float]) -> FeatureMap:
        rc, sums, weights = self._sums.get(index, CellSums(self._encoder.dim)).cells()
        rc = rc - np.round(np.array(grid.origin_xz)[::-1] / grid.cell).astype(np.int64)
        outside = int((~grid.contains(rc)).sum())
        if outside:
            raise AgentError(
                f"map builder: {outside} of {len(rc)} seen cells are outside of the {GRID_SIZE:g} x {GRID_SIZE:g} m "
                f"around {self._views.centre_xz or centre_xz}; expected all inside. Give another centre_xz, or fewer "
                "views."
            )
        return map_from_cells(
            sums,
            rc,
            grid=grid,
            floor_y=self._storeys.floors[index],
            encoder=self._encoder.name,
            centre_xz=centre_xz,
            weights=weights,
        )


class NoFeatures:
    """An encoder for maps of geometry alone: zero vectors, which add nothing to any cell.

    Map files keep its name, so that every query to such a map is refused.
    """

    name, dim = NO_FEATURES, 1

    def encode_texts(self, texts: Sequence[str]) -> NDArray[np.float32]:
        """(N, 1) zeros."""
        return np.zeros((len(texts), self.dim), np.float32)

    def encode_images(self, frames: Sequence[Frame]) -> NDArray[np.float32]:
        """(N, 1) zeros."""
        return np.zeros((len(frames), self.dim), np.float32)

    def encode_patches(self, frames: Sequence[Frame]) -> NDArray[np.float32]:
        """(N, h, w, 1) zeros; as many patches as a model has, because the map's middle is that of their points."""
        return np.zeros((len(frames), *_NO_PATCHES, self.dim), np.float32)


class CellSums:
    """Sums of one storey; cells are (row, col) of a lattice whose cell (0, 0) begins at the frame's origin."""

    def __init__(self, dim: int) -> None:
        """Starts without cells; vectors have E = `dim` numbers."""
        self._place: dict[tuple[int, int], int] = {}
        self._sums = np.zeros((_FIRST_CELLS, dim))
        self._weights = np.zeros(_FIRST_CELLS)

    def __len__(self) -> int:
        """The number of touched cells."""
        return len(self._place)

    def add(self, rc: NDArray[np.integer], vectors: NDArray[np.floating], weights: NDArray[np.floating]) -> None:
        """Adds `weights` (N,) times `vectors` (N, E) to the cells `rc` (N, 2), in which cells may repeat."""
        if not len(rc):
            return
        cells, inverse = np.unique(rc, axis=0, return_inverse=True)
        inverse = inverse.reshape(-1)
        order = np.argsort(inverse, kind="stable")
        firsts = np.searchsorted(inverse[order], np.arange(len(cells)))
        weighted = vectors[order] * weights[order, None].astype(vectors.dtype)
        parts = np.add.reduceat(weighted, firsts, axis=0)
        places = [self._place.setdefault((row, col), len(self._place)) for row, col in cells.tolist()]
        self._grow()
        self._sums[places] += parts
        self._weights[places] += np.bincount(inverse, weights, len(cells))

    def cells(self) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
        """(M, 2) cells, (M, E) sums and (M,) sums of weights, in the order in which the cells were first touched."""
        count = len(self._place)
        rc = np.array(list(self._place), np.int64).reshape(-1, 2)
        return rc, self._sums[:count].copy(), self._weights[:count].copy()

    def _grow(self) -> None:
        missing = len(self._place) - len(self._weights)
        if missing > 0:
            more = max(missing, len(self._weights))
            self._sums = np.concatenate([self._sums, np.zeros((more, self._sums.shape[1]))])
            self._weights = np.concatenate([self._weights, np.zeros(more)])


def encoded_patches(encoder: DenseEncoder, frames: Sequence[Frame]) -> NDArray[np.float32]:
    """Patch vectors (N, h, w, E) from an encoder, with shape and numbers checked.

    Raises:
        AgentError: The array breaks the contract of `DenseEncoder`.
    """
    vectors = encoder.encode_patches(frames)
    _require_vectors(encoder.name, "encode_patches", vectors, 4, (len(frames), encoder.dim))
    return vectors


def _encoded_images(encoder: TextImageEncoder, frames: Sequence[Frame]) -> NDArray[np.float32]:
    vectors = encoder.encode_images(frames)
    _require_vectors(encoder.name, "encode_images", vectors, 2, (len(frames), encoder.dim))
    return vectors


def _require_vectors(name: str, what: str, vectors: NDArray, ndim: int, ends: tuple[int, int]) -> None:
    shape = np.shape(vectors)
    if len(shape) != ndim or (shape[0], shape[-1]) != ends or not np.isfinite(vectors).all():
        expected = f"({ends[0]}, {'h, w, ' if ndim == 4 else ''}{ends[1]})"
        raise AgentError(
            f"encoder {name!r}: {what} gave an array of shape {shape}; expected finite numbers of shape {expected}. "
            "Correct the encoder."
        )


def _middle(low: NDArray, high: NDArray) -> tuple[float, float]:
    """Middle of the bounds; the origin where nothing was seen."""
    middle = (low + high) / 2 if np.isfinite(low).all() else np.zeros(2)
    return float(middle[0]), float(middle[1])
