"""The paper's simple POG baselines: a random cell, the middle of the map, and query scoring (QS)."""

import zlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sim.types import GridSpec, Task

from ..encoders.protocol import TextEncoder
from ..maps.home_map import Memory, MemoryKind, require_grid
from ..types import TIE, Candidate, Grounding, Layers

NUM_CANDIDATES = 3
"""The paper's top-3 (Sec. IV)."""
CANDIDATE_NMS = 1
"""Candidates are more than this many cells apart (Chebyshev), so that three answers are three places."""


class RandomCell:
    """Three different cells of the whole grid, drawn anew for each task; the same task gets the same cells."""

    name = "random"
    uses_phrases = False
    frame = "whole grid"
    takes: MemoryKind = "grid"

    def __init__(self, *, seed: int) -> None:
        """Takes the seed of all draws."""
        self._seed = seed

    def ground(self, memory: Memory, task: Task, phrases: Sequence[str]) -> Grounding:
        """Uniform over all cells of the grid, empty ones included; all scores are 0."""
        memory = require_grid(memory, self.name)
        text = "\n".join((*task.queries, task.description))
        rng = np.random.default_rng([self._seed, zlib.crc32(text.encode())])
        rows, cols = memory.grid.shape
        index = rng.choice(rows * cols, size=min(NUM_CANDIDATES, rows * cols), replace=False)
        rc = np.column_stack([index // cols, index % cols])
        return Grounding(candidates_at(memory.grid, memory.points_from_rc(rc), np.zeros(len(rc))))


class MapCentre:
    """Always answers the middle of the bounding box of the mapped area."""

    name = "center"
    uses_phrases = False
    frame = "middle of the bounding box of what is mapped"
    takes: MemoryKind = "grid"

    def ground(self, memory: Memory, task: Task, phrases: Sequence[str]) -> Grounding:
        """One candidate with score 0; it is the exact middle, not a cell's centre."""
        memory = require_grid(memory, self.name)
        x, z = memory.centre_xz
        return Grounding(candidates_at(memory.grid, np.array([[x, memory.floor_y, z]]), np.zeros(1)))


class QueryScoring:
    """QS: answers the cell that is most like the query; ignores the description."""

    name = "qs"
    uses_phrases = False
    frame = "non-empty cells"
    takes: MemoryKind = "grid"

    def __init__(self, encoder: TextEncoder) -> None:
        """Takes the encoder of the map."""
        self._encoder = encoder

    def ground(self, memory: Memory, task: Task, phrases: Sequence[str]) -> Grounding:
        """Ranks the non-empty cells by their cosine with the query."""
        memory = require_grid(memory, self.name, self._encoder)
        scores = memory.rows @ self._encoder.encode_texts(task.queries[:1])[0]
        best = rank_cells(scores, memory.rc)
        layers = Layers(memory.rc, memory.grid.shape, final=scores)
        return Grounding(candidates_at(memory.grid, memory.points_from_rc(memory.rc[best]), scores[best]), layers)


def rank_cells(
    scores: NDArray[np.floating],
    rc: NDArray[np.integer],
    *,
    count: int = NUM_CANDIDATES,
    nms_r: int = CANDIDATE_NMS,
) -> list[int]:
    """Indices of the best cells, best first: arg-max, drop all cells within `nms_r` (Chebyshev), repeat.

    Args:
        scores: (N,); cells with -inf are never taken, ties (closer than TIE) go to the first.
        rc: (N, 2).
        count: Largest number of indices to return.
        nms_r: Radius in cells; 0 drops only the cell itself.
    """
    left = np.array(scores, np.float64)
    best: list[int] = []
    while len(best) < count and len(left) and np.isfinite(top := left.max()):
        index = int(np.argmax(left >= top - TIE))
        best.append(index)
        left[np.abs(rc.astype(np.int64) - rc[index]).max(axis=1) <= nms_r] = -np.inf
    return best


def candidates_at(grid: GridSpec, points: NDArray[np.float64], scores: NDArray[np.floating]) -> tuple[Candidate, ...]:
    """Candidates at world points (M, 3) on the floor with these scores (M,); the grid says in which cell each is."""
    cells = grid.rc_from_xz(points[:, [0, 2]]).tolist()
    return tuple(
        Candidate((x, y, z), float(score), row, col, row * grid.shape[1] + col)
        for (x, y, z), score, (row, col) in zip(points.tolist(), scores, cells, strict=True)
    )
