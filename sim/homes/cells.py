"""Floor cells of a schematic home: stored as runs in a `HomePlan`, arrays in memory."""

from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import AllowInfNan, BaseModel, ConfigDict, Field

from sim.types import GridSpec

CELL = 0.05
"""Side of a plan's cells (metres)."""
Metres = Annotated[float, AllowInfNan(False), Field(ge=-10_000, le=10_000)]
"""A coordinate within the largest possible home."""
Positive = Annotated[float, AllowInfNan(False), Field(gt=0, le=10_000)]
Xz = tuple[Metres, Metres]
Index = Annotated[int, Field(ge=0, le=1_000_000)]
Count = Annotated[int, Field(ge=1, le=1_000_000)]


class CellRun(NamedTuple):
    """Neighbouring cells of one row at one height."""

    row: Index
    col: Index
    """First column."""
    length: Count
    y_cm: Annotated[int, Field(ge=-1_000_000, le=1_000_000)]
    """Height in centimetres."""
    guessed: bool = False
    """Whether the recovery guessed the floor here, where nobody was recorded."""


class AreaRun(NamedTuple):
    """Neighbouring cells of one row that belong to one room."""

    row: Index
    col: Index
    """First column."""
    length: Count


class CellGrid(BaseModel):
    """Cells with heights, several per column allowed, stored as runs."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    origin_xz: Xz
    shape: tuple[Count, Count]
    """(rows, cols)."""
    cell: Positive = CELL
    walkable: tuple[CellRun, ...]
    """Cells where the robot's centre can be."""
    plinth: tuple[CellRun, ...] = ()
    """Cells of open space that is not walkable: the tops of low blocks."""

    @property
    def grid(self) -> GridSpec:
        """The cells' place in the world."""
        return GridSpec(self.origin_xz, self.cell, self.shape)

    def nearest_rc(self, xz: NDArray[np.float64]) -> NDArray[np.int64]:
        """Row and column (N, 2) of the cell nearest to each point (N, 2)."""
        return np.clip(self.grid.rc_from_xz(xz), 0, np.array(self.shape) - 1)


class Cells(NamedTuple):
    """Cells as arrays."""

    rc: NDArray[np.int64]
    """(N, 2) row and column."""
    y: NDArray[np.float64]
    """(N,) heights in metres."""
    guessed: NDArray[np.bool_]
    """(N,) whether the recovery guessed each cell."""

    def chosen(self, keep: NDArray[np.bool_] | NDArray[np.int64]) -> "Cells":
        """The cells where a mask (N,) is true, or the cells with the given indices (M,), in their order."""
        return Cells(self.rc[keep], self.y[keep], self.guessed[keep])


def cells_from_runs(runs: tuple[CellRun, ...]) -> Cells:
    """The single cells of runs, in the runs' order."""
    if not runs:
        return Cells(np.zeros((0, 2), np.int64), np.zeros(0), np.zeros(0, bool))
    table = np.array(runs, np.int64)  # (R, 5)
    lengths = table[:, 2]
    first = np.repeat(np.cumsum(lengths) - lengths, lengths)
    cols = np.repeat(table[:, 1], lengths) + np.arange(lengths.sum()) - first
    rc = np.stack([np.repeat(table[:, 0], lengths), cols], axis=1)
    return Cells(rc, np.repeat(table[:, 3], lengths) / 100, np.repeat(table[:, 4], lengths).astype(bool))


def runs_from_cells(cells: Cells) -> tuple[CellRun, ...]:
    """Runs of cells, sorted by height, row and column; heights are rounded to a centimetre."""
    y_cm = np.round(cells.y * 100).astype(np.int64)
    rows, cols = cells.rc.T
    firsts, lengths = runs_of(np.column_stack([y_cm, cells.guessed.astype(np.int64), rows]), cols)
    return tuple(
        CellRun(int(rows[k]), int(cols[k]), int(length), int(y_cm[k]), bool(cells.guessed[k]))
        for k, length in zip(firsts, lengths, strict=True)
    )


def runs_of(keys: NDArray[np.int64], along: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Joins entries with equal `keys` (N, K) and consecutive `along` (N,): index of each first entry, and lengths."""
    if not len(along):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    order = np.lexsort((along, *keys.T[::-1]))
    keys, along = keys[order], along[order]
    new = np.ones(len(order), bool)
    new[1:] = (np.diff(along) != 1) | (np.diff(keys, axis=0) != 0).any(axis=1)
    firsts = np.flatnonzero(new)
    return order[firsts], np.diff(np.append(firsts, len(order)))
