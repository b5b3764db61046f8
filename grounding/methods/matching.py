"""Grounders `phrase` and `dual`: search for the phrase that the query means, not the query (GROUNDING.md, section 3).

Cosines of the phrases (owners stripped) with the cells of a grid, or with the things of an object map -> optional
smoothing -> optional dual softmax -> the row of the query's phrase ranks the places -> optional refinement of each
answer within its cell's neighbourhood.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sim.errors import AgentError
from sim.types import Task

from ..encoders.protocol import TextEncoder
from ..maps.home_map import Memory, MemoryKind, require_grid, require_objects
from ..phrases.ownership_text import asked_thing
from ..types import FeatureMap, Grounding, Layers
from .baselines import CANDIDATE_NMS, NUM_CANDIDATES, QueryScoring, candidates_at, rank_cells

DUAL_TEMPERATURE = 10.0
"""Scale of cosines in both softmaxes (GROUNDING.md, section 3: 10-20); 10 beat 15 and 20 on noisy invented homes."""
SMOOTH_SIGMA = 0.7
"""Width of the smoothing, in cells (GROUNDING.md, section 3)."""
POINT_BETA = 20.0
"""Scale of cosines in the centroid's weights (GROUNDING.md, section 3)."""
MatchName = Literal["phrase", "dual", "dual-smooth", "dual-smooth-point"]
ObjectMatchName = Literal["object-phrase", "object-dual"]


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
OBJECT_MATCHERS: dict[ObjectMatchName, float] = {"object-phrase": 0.0, "object-dual": DUAL_TEMPERATURE}
"""Temperature of the dual softmax; 0 = cosines alone."""


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
        """Matches the phrases with the cells."""
        memory = require_grid(memory, self.name, self._encoder)
        asked = asked_thing(phrases, task.queries[0], self._encoder)
        if asked is None:
            return QueryScoring(self._encoder).ground(memory, task, phrases)
        similarity = self._encoder.encode_texts(asked.texts) @ memory.rows.T
        cosines = smoothed(similarity, memory.rc, sigma=self._options.sigma)
        scores = dual_scores(cosines, temperature=self._options.temperature)
        final = scores[asked.chosen]
        best = rank_cells(final, memory.rc)
        points = memory.points_from_rc(memory.rc[best])
        if self._options.beta:
            refined = [refined_xz(cosines[asked.chosen], memory, index, beta=self._options.beta) for index in best]
            points[:, [0, 2]] = np.reshape(refined, (-1, 2))
        layers = Layers(
            memory.rc,
            memory.grid.shape,
            final=final.astype(np.float32),
            phrases=asked.texts,
            similarity=similarity,
            peaks=peaks_of(scores, memory.rc),
            chosen=asked.chosen,
        )
        return Grounding(candidates_at(memory.grid, points, final[best]), layers)


class ObjectMatcher:
    """Ranks a map's things by the phrase that the query means, or by the query itself if there is no such phrase."""

    uses_phrases = True
    frame = "middles of the map's objects"
    takes: MemoryKind = "objects"

    def __init__(self, encoder: TextEncoder, *, name: str, temperature: float) -> None:
        """Takes the encoder of the map, the name for tables, and the dual softmax's scale of cosines (0 = none)."""
        self.name = name
        self._encoder = encoder
        self._temperature = temperature

    def ground(self, memory: Memory, task: Task, phrases: Sequence[str]) -> Grounding:
        """Matches the phrases with the things and answers their middles; ties go to the first in the map."""
        memory = require_objects(memory, self.name, self._encoder)
        asked = asked_thing(phrases, task.queries[0], self._encoder)
        texts, chosen = (task.queries[:1], 0) if asked is None else (asked.texts, asked.chosen)
        features = np.array([item.feature for item in memory.objects], np.float32).reshape(-1, memory.dim)
        similarity = self._encoder.encode_texts(texts) @ features.T
        scores = dual_scores(similarity, temperature=self._temperature)
        each = np.arange(len(memory.objects))[:, None]  # several may stand in one cell
        best = rank_cells(scores[chosen], each, nms_r=0)
        grid = memory.grid
        num_phrases = 0 if asked is None else len(texts)
        layers = Layers(
            grid.rc_from_xz(memory.middles_xz).astype(np.int16),
            grid.shape,
            final=scores[chosen].astype(np.float32),
            phrases=texts[:num_phrases],
            similarity=similarity[:num_phrases],
            peaks=peaks_of(scores[:num_phrases], each, nms_r=0),
            chosen=-1 if asked is None else chosen,
        )
        return Grounding(candidates_at(grid, memory.places[best], scores[chosen][best]), layers)


def smoothed(values: NDArray[np.floating], rc: NDArray[np.integer], *, sigma: float) -> NDArray[np.floating]:
    """Gaussian mean (K, N) of values (K, N) over the stored cells; empty cells weigh nothing, so borders do not fade.

    Args:
        rc: (N, 2) rows and columns of the cells.
        sigma: Width in cells; 0 leaves the values unchanged.
    """
    if not sigma or not len(rc):
        return values
    offsets = rc[:, None].astype(np.int32) - rc[None]
    weights = np.exp(-(offsets**2).sum(axis=2) / (2 * sigma**2))
    return values @ (weights / weights.sum(axis=1, keepdims=True)).T


def dual_scores(cosines: NDArray[np.floating], *, temperature: float) -> NDArray[np.floating]:
    """Logarithm (K, N) of softmax over cells times softmax over phrases: high where cell and phrase choose each other.

    Args:
        cosines: (K, N) of phrases with cells.
        temperature: Scale of the cosines; 0 leaves them unchanged.
    """
    if not temperature or not cosines.size:
        return cosines
    logits = temperature * np.asarray(cosines, np.float64)
    return 2 * logits - _log_sum_exp(logits, axis=1) - _log_sum_exp(logits, axis=0)


def refined_xz(cosines: NDArray[np.floating], memory: FeatureMap, index: int, *, beta: float) -> NDArray[np.float64]:
    """World x and z (2,) of the centroid of the cells around one cell (3 x 3), weighted by exp(beta x cosine)."""
    near = np.flatnonzero(np.abs(memory.rc.astype(np.int64) - memory.rc[index]).max(axis=1) <= 1)
    weights = np.exp(beta * (cosines[near] - cosines[near].max()))
    return weights @ memory.grid.xz_from_rc(memory.rc[near]) / weights.sum()


def peaks_of(scores: NDArray[np.floating], rc: NDArray[np.integer], *, nms_r: int = CANDIDATE_NMS) -> NDArray[np.int64]:
    """Each phrase's best cells (K, 3), best first; -1 = no more."""
    peaks = np.full((len(scores), NUM_CANDIDATES), -1, np.int64)
    for row, best in zip(peaks, (rank_cells(values, rc, nms_r=nms_r) for values in scores), strict=True):
        row[: len(best)] = best
    return peaks


def _log_sum_exp(values: NDArray[np.float64], *, axis: int) -> NDArray[np.float64]:
    top = values.max(axis=axis, keepdims=True)
    return top + np.log(np.exp(values - top).sum(axis=axis, keepdims=True))
