"""OneMap's map: features of touched cells, and how surely, how often and with what obstacles each was seen.

`CellView`s of `projection` -> `FeatureGrid` -> similarity to the text -> `goals`.
"""

import numpy as np
from numpy.typing import NDArray

from sim.compiled import njit
from sim.homes.images import widened
from sim.tasks.observers import FREE, OCCUPIED, UNKNOWN
from sim.types import Camera, GridSpec

from .confidence import observation_confidence
from .projection import CellView, cells_of_pixels, view_of_cells

CELL, SIDE = 0.1, 600
"""Side of a cell (metres) and of the grid (cells); the start is in its middle (OneMap's configuration)."""
UPSTREAM_THRESHOLD = 0.2
"""OneMap's configuration: a cell is explored, and checked, when 1 / confidence is less. It assumes turns of 5 degrees
at 90 degrees of view: a spin shows each bearing 18 times."""
THRESHOLD = 1.0
"""The same for turns of 30 degrees at 79 degrees of view, where a spin shows each bearing 2.6 times (AGENTS.md, section
2.4; BASELINES.md, section 0.4)."""
OCCUPIED_SHARE = 0.4
"""A cell is occupied when the weighted share of views that show an obstacle is greater (OneMap's code)."""
START_CONFIDENCE, START_REACH = 10.0, 10
"""Confidence added to the cells around the start, and how many of them to each side (OneMap's code)."""
_MARGIN = 32
"""Cells around the seen ones that `box` includes; scores look 25 cells far."""
_GROWTH = 2048
"""Rows by which the table of features grows."""


class FeatureGrid:
    """The cells seen so far. Only touched cells keep a feature: 300 steps take 75 MB instead of 1.1 GB.

    Images are (rows, cols) of `grid`; they belong to the map and change with it.
    """

    def __init__(self, *, threshold: float = THRESHOLD) -> None:
        """Starts empty; cells count as explored and checked when 1 / confidence is less than `threshold`."""
        shape, corner = (SIDE, SIDE), -SIDE * CELL / 2
        self.grid = GridSpec((corner, corner), CELL, shape)
        """The cells on the floor plane, in the frame of the first start."""
        self.confidence = np.zeros(shape, np.float32)
        """Sum of the confidences of all views of a cell; 0 = never seen."""
        self.checked = np.zeros(shape, np.float32)
        """The same since the last query."""
        self.obstacle = np.zeros(shape, np.float32)
        """Share of views with an obstacle in the cell, weighted by confidence."""
        self.similarity = np.zeros(shape, np.float32)
        """Product of each cell's feature with the text's; 0 where nothing was seen."""
        self._threshold = threshold
        self._row_of = np.full(shape, -1, np.int32)
        self._features = np.zeros((0, 0), np.float32)
        self._touched = np.zeros(0, np.int32)  # cell of each row in use
        self._text: NDArray[np.float32] | None = None

    def set_query(self, text: NDArray[np.float32]) -> None:
        """Compares all cells with another text's vector (E,), and forgets which cells were checked; features stay."""
        self._text = np.asarray(text, np.float32)
        self.checked[:] = 0
        self.similarity[:] = 0
        if len(self._touched):
            self.similarity.ravel()[self._touched] = self._features[: len(self._touched)] @ self._text

    def add(
        self,
        depth_m: NDArray[np.float32],
        T_map_camera: NDArray[np.float64],
        camera: Camera,
        patches: NDArray[np.float32],
    ) -> NDArray[np.int32]:
        """Adds one view; returns the cell index row * columns + column of each pixel (H, W), -1 where it has none.

        Args:
            depth_m: (H, W) planar metres, 0 = no return.
            T_map_camera: (4, 4) pose of the camera (OpenCV axes) in the map.
            camera: The camera of the view.
            patches: (h, w, E) unit vectors of patches that tile the picture evenly.
        """
        is_first = not len(self._touched)
        confidence = observation_confidence(depth_m, camera.lens)
        cells, is_obstacle = cells_of_pixels(depth_m, confidence, T_map_camera, camera, self.grid)
        self.fuse(view_of_cells(cells, is_obstacle, confidence, patches, SIDE * SIDE))
        if is_first:
            row, col = self.grid.rc_from_xz(T_map_camera[[0, 2], 3]).tolist()
            reach = START_REACH
            around = np.s_[max(row - reach, 0) : max(row + reach, 0), max(col - reach, 0) : max(col + reach, 0)]
            self.confidence[around] += START_CONFIDENCE
            self.checked[around] += START_CONFIDENCE
        return cells

    def fuse(self, view: CellView) -> None:
        """Adds the cells of one view: features and obstacles as means weighted by confidence; confidence adds up."""
        if not len(view.cells):
            return
        rows = self._rows_of(view.cells, view.features.shape[1])
        old, new = self.confidence.ravel()[view.cells], view.confidence
        share = np.asarray(new / (old + new), np.float32)
        text = np.zeros(view.features.shape[1], np.float32) if self._text is None else self._text
        self.similarity.ravel()[view.cells] = _fused(self._features, rows, view.features, share, text)
        obstacle = self.obstacle.ravel()
        obstacle[view.cells] += share * (view.is_blocked - obstacle[view.cells])
        self.confidence.ravel()[view.cells] = old + new
        self.checked.ravel()[view.cells] += new

    def feature_at(self, rc: tuple[int, int]) -> NDArray[np.float32] | None:
        """(E,) mean feature of a cell; None if it was never seen."""
        row = int(self._row_of[rc])
        return None if row < 0 else self._features[row].copy()

    @property
    def num_touched(self) -> int:
        """Number of cells with a feature."""
        return len(self._touched)

    @property
    def box(self) -> tuple[slice, slice]:
        """Rows and columns around the seen cells, with a margin; one cell of the middle if none was seen."""
        rows, cols = np.flatnonzero(self.confidence.any(axis=1)), np.flatnonzero(self.confidence.any(axis=0))
        if not len(rows):
            return np.s_[SIDE // 2 : SIDE // 2 + 1, SIDE // 2 : SIDE // 2 + 1]
        spans = [slice(max(int(k[0]) - _MARGIN, 0), int(k[-1]) + _MARGIN + 1) for k in (rows, cols)]
        return spans[0], spans[1]

    def is_occupied(self, part: tuple[slice, slice]) -> NDArray[np.bool_]:
        """(rows, cols) of a part: cells with an obstacle."""
        return self.obstacle[part] > OCCUPIED_SHARE

    def is_navigable(self, part: tuple[slice, slice]) -> NDArray[np.bool_]:
        """(rows, cols) of a part: cells without an obstacle in them or beside them; unseen ones are navigable."""
        return ~widened(self.is_occupied(part), 1)

    def is_explored(self, part: tuple[slice, slice]) -> NDArray[np.bool_]:
        """(rows, cols) of a part: cells that were seen well enough."""
        return self.confidence[part] * self._threshold > 1

    def is_checked(self, part: tuple[slice, slice]) -> NDArray[np.bool_]:
        """(rows, cols) of a part: cells that were seen well enough since the last query."""
        return self.checked[part] * self._threshold > 1

    def occupancy(self) -> NDArray[np.uint8]:
        """(rows, cols) UNKNOWN, FREE or OCCUPIED, for people who watch."""
        found = np.where(self.is_occupied(np.s_[:, :]), np.uint8(OCCUPIED), np.uint8(FREE))
        found[self.confidence == 0] = UNKNOWN
        return found

    def _rows_of(self, cells: NDArray[np.int32], dim: int) -> NDArray[np.int32]:
        """(N,) row of each cell in the table of features; new cells get a zero row."""
        row_of = self._row_of.ravel()
        fresh = cells[row_of[cells] < 0]
        if len(fresh):
            count = len(self._touched)
            row_of[fresh] = np.arange(count, count + len(fresh), dtype=np.int32)
            self._touched = np.concatenate([self._touched, fresh])
            if len(self._touched) > len(self._features):
                grown = np.zeros((len(self._touched) + _GROWTH, dim), np.float32)
                grown[:count] = self._features[:count] if count else 0
                self._features = grown
        return row_of[cells]


@njit(cache=True, nogil=True)
def _fused(features, rows, seen, share, text):
    """Moves each row of the table towards what was seen, by its share; (N,) similarity of these rows to the text.

    One product a row: of all rows at once, BLAS would share it among threads, which wait for each other by computing.
    """
    similarity = np.empty(len(rows), np.float32)
    for k in range(len(rows)):
        row = features[rows[k]]
        for e in range(seen.shape[1]):
            row[e] += share[k] * (seen[k, e] - row[e])
        similarity[k] = np.dot(row, text)
    return similarity
