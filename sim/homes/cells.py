"""Floor cells of a schematic home: runs on disk, arrays in memory; part of `HomePlan`."""

from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import AllowInfNan, BaseModel, ConfigDict, Field

from sim.types import GridSpec

CELL = 0.05
"""Side of a plan's cells (metres)."""
Metres = Annotated[float, AllowInfNan(False), Field(ge=-10_000, le=10_000)]
"""A coordinate; no home is larger."""
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
    """Nobody was recorded here; the recovery put a bridge."""


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
    """Where the robot's centre can be."""
    plinth: tuple[CellRun, ...] = ()
    """Open but not walkable space: tops of low blocks."""

    @property
    def grid(self) -> GridSpec:
        """The cells' place in the world."""
        return GridSpec(self.origin_xz, self.cell, self.shape)


class Cells(NamedTuple):
    """Cells as arrays."""

    rc: NDArray[np.int64]
    """(N, 2) row and column."""
    y: NDArray[np.float64]
    """(N,) heights in metres."""
    guessed: NDArray[np.bool_]
    """(N,)."""


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
    if not len(cells.rc):
        return ()
    y_cm = np.round(cells.y * 100).astype(np.int64)
    order = np.lexsort((cells.rc[:, 1], cells.rc[:, 0], cells.guessed, y_cm))
    rows, cols, y_cm, guessed = cells.rc[order, 0], cells.rc[order, 1], y_cm[order], cells.guessed[order]
    new = np.ones(len(rows), bool)
    new[1:] = (np.diff(rows) != 0) | (np.diff(cols) != 1) | (np.diff(y_cm) != 0) | (guessed[1:] != guessed[:-1])
    firsts = np.flatnonzero(new)
    lengths = np.diff(np.append(firsts, len(rows)))
    return tuple(
        CellRun(int(rows[k]), int(cols[k]), int(length), int(y_cm[k]), bool(guessed[k]))
        for k, length in zip(firsts, lengths, strict=True)
    )
