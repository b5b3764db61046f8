"""Grounders `phrase` and `dual`: search for the phrase that the query means, not the query (GROUNDING.md, section 3).

Cosines of the phrases (owners stripped) with the cells -> optional smoothing -> optional dual softmax -> the row of
the query's phrase ranks the cells -> optional refinement of each answer within its cell's neighbourhood.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sim.errors import AgentError
from sim.types import Task

from ..encoders.protocol import TextEncoder
from ..maps.home_map import Memory, MemoryKind, require_grid
from ..phrases.ownership_text import parse_phrase, parse_query, wanted_phrase
from ..types import Candidate, FeatureMap, Grounding, Layers
from .baselines import CANDIDATE_NMS, NUM_CANDIDATES, QueryScoring, candidates_at, rank_cells

DUAL_TEMPERATURE = 10.0
"""Scale of cosines in both softmaxes (GROUNDING.md, section 3: 10-20); 10 beat 15 and 20 on noisy invented homes."""
SMOOTH_SIGMA = 0.7
"""Width of the smoothing, in cells (GROUNDING.md, section 3)."""
POINT_BETA = 20.0
"""Scale of cosines in the centroid's weights (GROUNDING.md, section 3)."""
MatchName = Literal["phrase", "dual", "dual-smooth", "dual-smooth-point"]


@dataclass(frozen=True, slots=True)
class MatchOptions:
    """Steps of the matching; 0 leaves one out."""

    temperature: float = 0.0
    """Temperature of the dual softmax."""
    sigma: float = 0.0
    """Width of the smoothing, cells."""
    beta: float = 0.0
    """Strength of the refinement."""

    def __post_init__(self) -> None:
        if min(self.temperature, self.sigma, self.beta) < 0:
            raise AgentError(f"matching: {self!r}; expected no negative value. Correct the options.")


MATCHERS: dict[MatchName, MatchOptions] = {
    "phrase": MatchOptions(),
    "dual": MatchOptions(temperature=DUAL_TEMPERATURE),
    "dual-smooth": MatchOptions(temperature=DUAL_TEMPERATURE, sigma=SMOOTH_SIGMA),
    "dual-smooth-point": MatchOptions(temperature=DUAL_TEMPERATURE, sigma=SMOOTH_SIGMA, beta=POINT_BETA),
}


class PhraseMatcher:
    """Ranks the cells by the phrase that the query means; without such a phrase it answers as QS does."""

    uses_phrases = True
    frame = "non-empty cells"
    takes: MemoryKind = "grid"

    def __init__(self, encoder: TextEncoder, *, name: str, options: MatchOptions) -> None:
        """Takes the encoder of the map, the name for tables and the steps."""
        self.name = name
        self._encoder = encoder
        self._options = options

    def ground(self, memory: Memory, task: Task, phrases: Sequence[str]) -> Grounding:
        """Matches the phrases with the cells.

        Raises:
            AgentError: The map was made with another encoder, or is no grid.
        """
        memory = require_grid(memory, self.name)
        memory.require_encoder(self._encoder.name, self._encoder.dim)
        things = [parse_phrase(phrase) for phrase in phrases]
        wanted = wanted_phrase(things, parse_query(task.queries[0]), self._encoder)
        if wanted is None:
            return QueryScoring(self._encoder).ground(memory, task, phrases)
        # a thing that several people own competes for a cell only once
        texts = tuple(dict.fromkeys(item.text for item in things))
        chosen = texts.index(things[wanted].text)
        similarity = self._encoder.encode_texts(texts) @ memory.rows.T
        cosines = smoothed(similarity, memory.rc, sigma=self._options.sigma)
        scores = dual_scores(cosines, temperature=self._options.temperature) if self._options.temperature else cosines
        best = rank_cells(scores[chosen], memory.rc)
        layers = Layers(
            memory.rc,
            memory.grid.shape,
            final=scores[chosen].astype(np.float32),
            phrases=texts,
            similarity=similarity,
            peaks=peaks_of(scores, memory.rc),
            chosen=chosen,
        )
        if self._options.beta:
            points = [refined_xz(cosines[chosen], memory, index, beta=self._options.beta) for index in best]
            return Grounding(candidates_near(memory, best, points, scores[chosen][best]), layers)
        return Grounding(candidates_at(memory, memory.rc[best], scores[chosen][best]), layers)


def smoothed(values: NDArray[np.floating], rc: NDArray[np.integer], *, sigma: float) -> NDArray[np.floating]:
    """Gaussian mean (K, N) of values (K, N) over the stored cells; empty cells weigh nothing, so borders do not fade.

    Args:
        values: Scores of the cells.
        rc: (N, 2) rows and columns of the cells.
        sigma: Width in cells; 0 leaves the values unchanged.
    """
    if not sigma or not len(rc):
        return values
    offsets = rc[:, None].astype(np.int32) - rc[None]
    weights = np.exp(-(offsets**2).sum(axis=2) / (2 * sigma**2))
    return values @ (weights / weights.sum(axis=1, keepdims=True)).T


def dual_scores(cosines: NDArray[np.floating], *, temperature: float) -> NDArray[np.float64]:
    """Logarithm (K, N) of softmax over cells times softmax over phrases: high where cell and phrase choose each other.

    Args:
        cosines: (K, N) of phrases with cells.
        temperature: Scale of the cosines.
    """
    logits = temperature * np.asarray(cosines, np.float64)
    if not logits.size:
        return logits
    return 2 * logits - _log_sum_exp(logits, axis=1) - _log_sum_exp(logits, axis=0)


def refined_xz(cosines: NDArray[np.floating], memory: FeatureMap, index: int, *, beta: float) -> NDArray[np.float64]:
    """World x and z (2,) of the centroid of the cells around one cell (3 x 3), weighted by exp(beta x cosine)."""
    near = np.flatnonzero(np.abs(memory.rc.astype(np.int64) - memory.rc[index]).max(axis=1) <= 1)
    weights = np.exp(beta * (cosines[near] - cosines[near].max()))
    return weights @ memory.grid.xz_from_rc(memory.rc[near]) / weights.sum()


def candidates_near(
    memory: FeatureMap, cells: Sequence[int], points_xz: Sequence[NDArray[np.float64]], scores: NDArray[np.floating]
) -> tuple[Candidate, ...]:
    """Candidates at points on the floors of cells (indices into the map), with row and column of the point's cell."""
    cols = memory.grid.shape[1]
    found = []
    for cell, point, score in zip(cells, points_xz, scores, strict=True):
        row, col = (int(value) for value in memory.grid.rc_from_xz(point))
        position = (float(point[0]), float(memory.cell_y[cell]), float(point[1]))
        found.append(Candidate(position, float(score), row, col, row * cols + col))
    return tuple(found)


def peaks_of(scores: NDArray[np.floating], rc: NDArray[np.integer], *, nms_r: int = CANDIDATE_NMS) -> NDArray[np.int64]:
    """Each phrase's best cells (K, 3), best first; -1 = no more."""
    peaks = np.full((len(scores), NUM_CANDIDATES), -1, np.int64)
    for row, best in zip(peaks, (rank_cells(values, rc, nms_r=nms_r) for values in scores), strict=True):
        row[: len(best)] = best
    return peaks


def _log_sum_exp(values: NDArray[np.float64], *, axis: int) -> NDArray[np.float64]:
    top = values.max(axis=axis, keepdims=True)
    return top + np.log(np.exp(values - top).sum(axis=axis, keepdims=True))
