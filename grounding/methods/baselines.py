"""The paper's simple POG baselines: a random cell, the middle of the map, and query scoring (QS)."""

import zlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sim.episodes.schema import Vector3
from sim.types import Task

from ..encoders.protocol import TextEncoder
from ..maps.home_map import Memory, MemoryKind, require_grid
from ..types import TIE, Candidate, FeatureMap, Grounding, Layers

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
        return Grounding(candidates_at(memory, rc, np.zeros(len(rc))))


class MapCentre:
    """Always answers the middle of the bounding box of the mapped area."""

    name = "center"
    uses_phrases = False
    frame = "middle of the bounding box of what is mapped"
    takes: MemoryKind = "grid"

    def ground(self, memory: Memory, task: Task, phrases: Sequence[str]) -> Grounding:
        """One candidate with score 0; it is the exact middle, not a cell's centre."""
        memory = require_grid(memory, self.name)
        row, col = (int(value) for value in memory.grid.rc_from_xz(np.array(memory.centre_xz)))
        x, z = memory.centre_xz
        position = (float(x), memory.floor_y, float(z))
        return Grounding((Candidate(position, 0.0, row, col, row * memory.grid.shape[1] + col),))


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
        """Ranks the non-empty cells by their cosine with the query.

        Raises:
            AgentError: The map was made with another encoder, or is no grid.
        """
        memory = require_grid(memory, self.name)
        memory.require_encoder(self._encoder.name, self._encoder.dim)
        scores = memory.rows @ self._encoder.encode_texts(task.queries[:1])[0]
        best = rank_cells(scores, memory.rc)
        layers = Layers(memory.rc, memory.grid.shape, final=scores)
        return Grounding(candidates_at(memory, memory.rc[best], scores[best]), layers)


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


def candidates_at(memory: FeatureMap, rc: NDArray[np.integer], scores: NDArray[np.floating]) -> tuple[Candidate, ...]:
    """Candidates at the centres of cells (M, 2), on the floor, with these scores (M,)."""
    points: list[Vector3] = [tuple(point) for point in memory.points_from_rc(rc).tolist()]
    return tuple(
        Candidate(point, float(score), int(row), int(col), int(row) * memory.grid.shape[1] + int(col))
        for point, score, (row, col) in zip(points, scores, rc, strict=True)
    )
