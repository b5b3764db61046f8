"""The input (`FeatureMap`) and output (`Grounding`) of grounders; maps are built from `sim.types.Frame`s.

numpy only; recordings and apps read them. The `map` frame is the frame in which a map is built: y up, metres, as the
world (sim/frames.py). For homes of the simulator it is the world; for a robot's recording it is the frame of its poses,
turned y-up.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sim.episodes.schema import Vector3
from sim.errors import AgentError
from sim.types import GridSpec

TIE = 1e-6
"""Cosines closer than this are equal, and the first cell in row-major order wins: float32 products of equal rows differ
by about 1e-7, depending on a row's place in the matrix."""
NO_FEATURES = "none"
"""The encoder's name in maps of geometry alone, which have free space and no features."""
_UNIT_TOLERANCE = 1e-4


@dataclass(frozen=True, slots=True)
class FeatureMap:
    """A grid map of one storey (or of a whole home) that stores its non-empty cells only, in row-major order."""

    rows: NDArray[np.float32]
    """(N, E) unit vectors of the non-empty cells."""
    rc: NDArray[np.int16]
    """(N, 2) row and column of each cell, ascending in row, then column."""
    grid: GridSpec
    floor_y: float
    """Height of the storey's floor, world metres."""
    cell_y: NDArray[np.float32]
    """(N,) height of the floor in each cell; differs from `floor_y` on split levels and in merged storeys."""
    encoder: str
    """Name of the encoder whose space the rows are in."""
    weights: NDArray[np.float32]
    """(N,) evidence in each cell, e.g. the number of objects."""
    centre_xz: tuple[float, float]
    """Middle of the bounding box of the mapped area, world x and z: the home on oracle maps, else the seen area."""

    def __post_init__(self) -> None:
        count = len(self.rows)
        assert self.rc.shape == (count, 2), self.rc.shape
        assert self.cell_y.shape == self.weights.shape == (count,), self.cell_y.shape
        assert bool(self.grid.contains(self.rc).all()), "cells outside the grid"
        assert bool((np.diff(self.flat_index) > 0).all()), "cells are not in row-major order, each once"
        assert np.allclose(np.linalg.norm(self.rows, axis=1), 1, atol=_UNIT_TOLERANCE), "rows are not unit vectors"
        for name in ("rows", "rc", "cell_y", "weights"):
            view = getattr(self, name).view()
            view.flags.writeable = False
            object.__setattr__(self, name, view)

    @property
    def dim(self) -> int:
        """E, the length of the vectors."""
        return self.rows.shape[1]

    @property
    def flat_index(self) -> NDArray[np.int64]:
        """(N,) row * columns + column of each stored cell."""
        return self.rc[:, 0].astype(np.int64) * self.grid.shape[1] + self.rc[:, 1]

    def dense(self) -> NDArray[np.float32]:
        """(H, W, E) with zero vectors in the empty cells."""
        return np.moveaxis(on_grid(self.rows.T, self.rc, shape=self.grid.shape, fill=0.0), 0, -1)

    def points_from_rc(self, rc: NDArray[np.integer]) -> NDArray[np.float64]:
        """World points (M, 3) on the floor at the centres of cells (M, 2); empty cells get the storey's floor."""
        xz = self.grid.xz_from_rc(rc)
        y_of = dict(zip(self.flat_index.tolist(), self.cell_y.tolist(), strict=True))
        y = [y_of.get(int(row) * self.grid.shape[1] + int(col), self.floor_y) for row, col in rc]
        return np.column_stack([xz[:, 0], y, xz[:, 1]]).reshape(-1, 3)


@dataclass(frozen=True, slots=True)
class Candidate:
    """One answer."""

    position: Vector3
    """World metres; y is the floor's height."""
    score: float
    """Higher is better; comparable within one Grounding only."""
    row: int
    col: int
    index: int
    """row * columns + col."""


@dataclass(frozen=True, slots=True)
class Layers:
    """A grounder's intermediate results on the cells `rc`; views draw them, nothing scores them."""

    rc: NDArray[np.int16]
    """(N, 2) cells of the columns below."""
    shape: tuple[int, int]
    """(rows, cols) of the grid."""
    final: NDArray[np.float32]
    """(N,) score of each cell for the query; -inf where the grounder does not look."""
    phrases: tuple[str, ...] = ()
    """The K phrases."""
    similarity: NDArray[np.float32] = field(default_factory=lambda: np.empty((0, 0), np.float32))
    """(K, N) cosine of each phrase with each cell."""
    peaks: NDArray[np.int64] = field(default_factory=lambda: np.empty((0, 0), np.int64))
    """(K, top_k) index into `rc` of each phrase's best cells, best first; -1 = no more."""
    gate: NDArray[np.bool_] | None = None
    """(N,) cells that the phrases leave open; None for grounders without a gate."""
    chosen: int = -1
    """Index into `phrases` of the phrase that the query means; -1 for grounders that choose none."""

    def on_grid(self, values: NDArray) -> NDArray[np.float32]:
        """(..., H, W) picture of values (..., N); NaN in cells that the layers do not cover."""
        return on_grid(np.asarray(values, np.float32), self.rc, shape=self.shape, fill=np.nan)


@dataclass(frozen=True, slots=True)
class Grounding:
    """A grounder's answer to one task: candidates, best first; none when the map is empty."""

    candidates: tuple[Candidate, ...]
    layers: Layers | None = None
    """Intermediate results; None for grounders that score no cells."""
    fell_back: bool = False
    """Whether another method had to answer, because a chat model gave nothing that can be used."""


def require_same_encoder(of_map: tuple[str, int], of_query: tuple[str, int], *, where: str = "map") -> None:
    """Refuses a query whose encoder differs from the map's; both are (name, dimension).

    Raises:
        AgentError: The encoders differ; the message begins with `where`.
    """
    if of_map[0] == NO_FEATURES:
        raise AgentError(
            f"{where}: holds geometry alone, made with --encoder {NO_FEATURES}; expected a map with features. Build it "
            "again with personal-viz map --encoder clip:MODEL."
        )
    if of_map != of_query:
        raise AgentError(
            f"{where}: holds {of_map[1]}-d vectors of encoder {of_map[0]!r}, the query is {of_query[1]}-d from "
            f"{of_query[0]!r}; expected one encoder. Encode the query with {of_map[0]!r}, or build the map with "
            f"{of_query[0]!r}."
        )


def map_from_cells(
    vectors: NDArray[np.floating],
    rc: NDArray[np.integer],
    *,
    grid: GridSpec,
    floor_y: float,
    encoder: str,
    centre_xz: tuple[float, float] | None = None,
    cell_y: NDArray[np.floating] | None = None,
    weights: NDArray[np.floating] | None = None,
) -> FeatureMap:
    """A packed map made from cells in any order; vectors are normalised and zero vectors left out.

    Args:
        vectors: (N, E), any length.
        rc: (N, 2), each cell once, inside the grid.
        grid: Grid of the cells.
        floor_y: The storey's floor, world metres.
        encoder: Name of the encoder of the vectors.
        centre_xz: Middle of the mapped area; default the grid's middle.
        cell_y: (N,) floor under each cell; default `floor_y`.
        weights: (N,) evidence; default 1.
    """
    rc = np.asarray(rc).reshape(-1, 2)
    vectors = np.asarray(vectors, np.float64)
    norms = np.linalg.norm(vectors, axis=1)
    order = np.lexsort((rc[:, 1], rc[:, 0]))
    order = order[norms[order] > 0]
    rows = (vectors[order] / norms[order, None]).astype(np.float32)
    heights = np.full(len(rc), floor_y) if cell_y is None else np.asarray(cell_y)
    evidence = np.ones(len(rc)) if weights is None else np.asarray(weights)
    middle = (grid.origin_xz[0] + grid.shape[1] * grid.cell / 2, grid.origin_xz[1] + grid.shape[0] * grid.cell / 2)
    return FeatureMap(
        rows=rows,
        rc=rc[order].astype(np.int16),
        grid=grid,
        floor_y=float(floor_y),
        cell_y=heights[order].astype(np.float32),
        encoder=encoder,
        weights=evidence[order].astype(np.float32),
        centre_xz=centre_xz or middle,
    )


def on_grid(
    values: NDArray[np.float32], rc: NDArray[np.integer], *, shape: tuple[int, int], fill: float
) -> NDArray[np.float32]:
    """(..., H, W) with values (..., N) at cells rc (N, 2) and `fill` elsewhere."""
    picture = np.full((*values.shape[:-1], *shape), fill, np.float32)
    picture[..., rc[:, 0], rc[:, 1]] = values
    return picture
