"""RPG, region-gated personalized grounding (the paper's Algorithm 1): products in torch, compiled loops, two layouts.

`rpg_packed` runs many episodes on one sparse map, as evaluations do; `rpg_dense` runs the paper's batch of full grids.
Steps: take the cosine of every phrase with every cell; find each phrase's `top_k` peaks with non-maximum suppression;
open a gate of the cells within `nhood` of a peak; answer the cell inside the gate that is most like the query.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from sim.errors import AgentError
from sim.types import Task

from ..encoders.packed_bert import one_thread
from ..encoders.protocol import TextEncoder
from ..maps.home_map import Memory, MemoryKind, require_grid
from ..types import TIE, FeatureMap, Grounding, Layers
from .baselines import candidates_at, rank_cells
from .rpg_kernels import few_answers, find_peaks, gated_answers, open_cells

RpgPreset = Literal["paper", "authors", "literal"]
_SHORTEST = 1e-12
"""Length below which a text's vector counts as zero."""
_FEW = 16
"""Largest number of texts for which our own loops beat the general product; one episode has about 9 texts, which take
4.9 against 6.6 ms of CPU time on 64 maps of 175 x 768."""


@dataclass(frozen=True, slots=True)
class RpgOptions:
    """Parameters of Algorithm 1; distances in cells, Chebyshev (squares), clipped at the borders."""

    top_k: int = 3
    """Peaks per phrase (paper, Sec. IV: top-3)."""
    nhood: int = 1
    """Distance by which peaks grow (paper: 1 pixel = 1 m)."""
    nms_r: int = 1
    """Peaks of one phrase are more than this many cells apart; 0 = plain top-k."""
    literal: bool = False
    """Algorithm 1 as printed: empty cells take part with cosine 0, and cells outside the gate score 0 instead of -inf,
    so the answer leaves the gate when all cosines in it are negative."""

    def __post_init__(self) -> None:
        if self.top_k < 1 or self.nhood < 0 or self.nms_r < 0:
            raise AgentError(f"rpg: {self!r}; expected top_k >= 1, nhood >= 0, nms_r >= 0. Correct the options.")


PRESETS: dict[RpgPreset, RpgOptions] = {
    "paper": RpgOptions(),
    # the values that the authors' public code uses
    "authors": RpgOptions(top_k=4, nhood=0, nms_r=0),
    "literal": RpgOptions(literal=True),
}


class RpgResult(NamedTuple):
    """Algorithm 1's outputs and layers; B episodes, P phrases (shared or per episode), N cells."""

    index: Tensor
    """(B,) int64, flat row-major cell row * W + col; -1 = no answer."""
    value: Tensor
    """(B,) cosine of the query with that cell; -inf = no answer."""
    final: Tensor
    """(B, N) cosine with the query inside the gate; outside -inf (literal: 0)."""
    gate: Tensor
    """(B, N) bool."""
    peaks: Tensor
    """(P, top_k) or (B, P, top_k) int64 cell positions in N, best first; -1 = no more."""
    similarity: Tensor
    """(P, N) or (B, P, N) cosine."""


def rpg_packed(
    rows: Tensor,
    rc: Tensor,
    phrases: Tensor,
    queries: Tensor,
    *,
    width: int,
    uses: Tensor | None = None,
    options: RpgOptions = PRESETS["paper"],
) -> RpgResult:
    """Algorithm 1 for B episodes on one map, given by its non-empty cells; it costs one product with the cells.

    Args:
        rows: (N, E) unit vectors of the cells.
        rc: (N, 2) rows and columns of the cells, in row-major order.
        phrases: (P, E) different phrases of all episodes, any length.
        queries: (B, E), any length.
        width: Columns of the grid.
        uses: (B, P) bool, which phrases each episode has; default all. An episode without any gets QS.
        options: `literal` needs the empty cells: use `rpg_dense`.
    """
    if options.literal:
        raise ValueError("rpg_packed has no empty cells, which the literal form needs; call rpg_dense")
    used = np.ones((len(queries), len(phrases)), bool) if uses is None else uses.numpy()
    places = rc.long().numpy(), width, used, options.top_k, options.nms_r, options.nhood, np.float32(TIE)
    if len(phrases) + len(queries) <= _FEW:
        inputs = phrases.numpy(), queries.numpy(), rows.numpy()
        found, cosines = few_answers(*inputs, *places, np.float32(_SHORTEST))
    else:
        cosines = _cosines(torch.cat([phrases, queries]), rows)
        found = gated_answers(cosines, *places)
    return RpgResult(*map(torch.from_numpy, (*found, cosines[: len(phrases)])))


def rpg_dense(
    features: Tensor,
    phrases: Tensor,
    queries: Tensor,
    *,
    phrase_mask: Tensor | None = None,
    options: RpgOptions = PRESETS["paper"],
) -> RpgResult:
    """Algorithm 1 as the paper states it: a batch of full grids, each with its own phrases.

    Args:
        features: F (B, H, W, E), zero vectors in empty cells.
        phrases: D (B, K, E), any length.
        queries: q (B, E), any length.
        phrase_mask: (B, K) bool, False for padding; default all True. An episode without any phrase gets QS.
        options: Parameters. An empty map has no answer, not even with `literal`.
    """
    batch, height, width, dim = features.shape
    cells = features.reshape(batch, height * width, dim)
    rc = torch.cartesian_prod(torch.arange(height), torch.arange(width)).reshape(-1, 2)
    norms = cells.norm(dim=2)
    filled = norms > 0
    texts = torch.cat([_unit(phrases), _unit(queries)[:, None]], dim=1)
    product = torch.where(filled, norms.reciprocal(), 0.0)[:, None] * (texts @ cells.mT)
    similarity, scores = product[:, :-1], product[:, -1]
    used = torch.ones(phrases.shape[:2], dtype=torch.bool) if phrase_mask is None else phrase_mask
    allowed = used[:, :, None] & (filled[:, None] | options.literal)
    searched = torch.where(allowed, similarity, -torch.inf)
    peaks = nms_peaks(searched.flatten(0, 1), rc, top_k=options.top_k, nms_r=options.nms_r)
    opened = grown(peaks, rc, nhood=options.nhood).unflatten(0, used.shape)
    gate = opened.any(dim=1) | ~used.any(dim=1, keepdim=True)
    outside = torch.zeros_like(scores) if options.literal else torch.full_like(scores, -torch.inf)
    final = torch.where(gate & (filled | options.literal), scores, outside)
    final = torch.where(filled.any(dim=1, keepdim=True), final, -torch.inf)
    cell, value = first_best(final)
    return RpgResult(cell, value, final, gate, peaks.unflatten(0, used.shape), similarity)


def nms_peaks(scores: Tensor, rc: Tensor, *, top_k: int, nms_r: int) -> Tensor:
    """Each row's best cells (L, top_k) by scores (L, N): arg-max, drop all within `nms_r` (Chebyshev), repeat.

    -inf is never a peak; -1 = no more peaks.
    """
    peaks = torch.full((len(scores), top_k), -1, dtype=torch.int64)
    find_peaks(scores.numpy(), rc.long().numpy(), top_k, nms_r, np.float32(TIE), peaks.numpy())
    return peaks


def grown(peaks: Tensor, rc: Tensor, *, nhood: int) -> Tensor:
    """(L, N) bool: the cells within `nhood` (Chebyshev) of any of a row's peaks (L, top_k); -1 opens nothing."""
    opened = torch.zeros(len(peaks), len(rc), dtype=torch.bool)
    open_cells(peaks.numpy(), rc.long().numpy(), nhood, opened.numpy())
    return opened


def first_best(scores: Tensor) -> tuple[Tensor, Tensor]:
    """Position (L,) and value (L,) of each row's (L, N) maximum; -1 if all are -inf.

    Ties (closer than TIE) go to the first.
    """
    if not scores.shape[1]:
        return torch.full((len(scores),), -1), torch.full((len(scores),), -torch.inf)
    top = scores.amax(dim=1, keepdim=True)
    # argmax of 0/1 is documented to return the first of equal values; topk is not
    position = (scores >= top - TIE).to(torch.uint8).argmax(dim=1)
    value = scores.gather(1, position[:, None])[:, 0]
    return torch.where(torch.isfinite(value), position, -1), value


class RegionGated:
    """RPG as a grounder; keeps its layers."""

    uses_phrases = True
    takes: MemoryKind = "grid"

    def __init__(self, encoder: TextEncoder, *, options: RpgOptions = PRESETS["paper"], name: str = "rpg") -> None:
        """Takes the encoder of the map, the parameters and the name for tables."""
        self.name = name
        self.frame = "whole grid" if options.literal else "non-empty cells"
        self._encoder = encoder
        self._options = options

    def ground(self, memory: Memory, task: Task, phrases: Sequence[str]) -> Grounding:
        """Runs Algorithm 1 with the phrases as they are (owners' names included)."""
        memory = require_grid(memory, self.name, self._encoder)
        with one_thread():
            return self._ground(memory, task, phrases)

    def _ground(self, memory: FeatureMap, task: Task, phrases: Sequence[str]) -> Grounding:
        texts = torch.from_numpy(self._encoder.encode_texts([*phrases, task.queries[0]]))
        if self._options.literal:
            dense = torch.from_numpy(memory.dense())[None]
            result = rpg_dense(dense, texts[None, :-1], texts[-1:], options=self._options)
            rc = np.argwhere(np.ones(memory.grid.shape, bool)).astype(np.int16)
            peaks, similarity = result.peaks[0], result.similarity[0]
        else:
            rc = memory.rc
            # torch has no read-only tensors and warns; a copy of N x 2 is cheap, rows are only read
            cells = torch.from_numpy(np.array(rc, np.int64))
            rows = torch.from_numpy(np.array(memory.rows))
            result = rpg_packed(rows, cells, texts[:-1], texts[-1:], width=memory.grid.shape[1], options=self._options)
            peaks, similarity = result.peaks, result.similarity
        final = result.final[0].numpy()
        best = rank_cells(final, rc)
        layers = Layers(
            rc,
            memory.grid.shape,
            final=final,
            phrases=tuple(phrases),
            similarity=similarity.numpy(),
            peaks=peaks.numpy(),
            gate=result.gate[0].numpy(),
        )
        return Grounding(candidates_at(memory.grid, memory.points_from_rc(rc[best]), final[best]), layers)


def _unit(vectors: Tensor) -> Tensor:
    return torch.nn.functional.normalize(vectors, dim=-1, eps=_SHORTEST)


def _cosines(texts: Tensor, rows: Tensor) -> NDArray[np.float32]:
    """Cosines (L, N) of texts (L, E) of any length with unit rows (N, E); divides the product, so copies no texts."""
    lengths = torch.linalg.vector_norm(texts, dim=1, keepdim=True).clamp(min=_SHORTEST)
    return (texts @ rows.T).div_(lengths).numpy()
