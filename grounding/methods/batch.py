"""Algorithm 1 for many episodes at once: those on one map share one product with its cells.

Phrases are encoded and looked for once per map however many episodes have them, and the maps are taken one after
another. Answers are those of `RegionGated` one by one.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from sim.types import Task

from ..encoders.protocol import TextEncoder
from ..types import FeatureMap, Grounding
from .baselines import candidates_at, rank_cells
from .rpg import PRESETS, RpgOptions, RpgResult, one_thread, rpg_packed


@dataclass(frozen=True, slots=True)
class MapBatch:
    """B episodes on one map, ready for the product; tensors are only read."""

    memory: FeatureMap
    rows: Tensor
    """(N, E) float32 unit vectors of the map's cells."""
    rc: Tensor
    """(N, 2) int64."""
    phrases: Tensor
    """(P, E) float32, different phrases of all episodes."""
    queries: Tensor
    """(B, E) float32."""
    uses: Tensor
    """(B, P) bool, which phrases each episode has."""


def make_batch(
    memory: FeatureMap, tasks: Sequence[Task], phrases: Sequence[Sequence[str]], encoder: TextEncoder
) -> MapBatch:
    """Encodes each different phrase and each query once.

    Args:
        memory: The map.
        tasks: B of them.
        phrases: Of each task.
        encoder: The map's.

    Raises:
        AgentError: The map is of another encoder.
    """
    memory.require_encoder(encoder.name, encoder.dim)
    different = list(dict.fromkeys(phrase for texts in phrases for phrase in texts))
    place = {phrase: index for index, phrase in enumerate(different)}
    uses = np.zeros((len(tasks), len(different)), bool)
    for episode, texts in enumerate(phrases):
        uses[episode, [place[phrase] for phrase in texts]] = True
    vectors = torch.from_numpy(encoder.encode_texts([*different, *(task.queries[0] for task in tasks)]))
    return MapBatch(
        memory,
        # torch has no read-only tensors and warns; a copy of N x E is cheap
        torch.from_numpy(np.array(memory.rows)),
        torch.from_numpy(memory.rc.astype(np.int64)),
        vectors[: len(different)],
        vectors[len(different) :],
        torch.from_numpy(uses),
    )


def solve_batch(batch: MapBatch, *, options: RpgOptions = PRESETS["paper"]) -> RpgResult:
    """Algorithm 1 for all episodes of the batch."""
    width = batch.memory.grid.shape[1]
    return rpg_packed(batch.rows, batch.rc, batch.phrases, batch.queries, width=width, uses=batch.uses, options=options)


def ground_batch(
    memories: Sequence[FeatureMap],
    tasks: Sequence[Task],
    phrases: Sequence[Sequence[str]],
    encoder: TextEncoder,
    *,
    options: RpgOptions = PRESETS["paper"],
) -> list[Grounding]:
    """The answers of many tasks, in their order, without layers.

    Args:
        memories: The map of each task; tasks that share a map share the object.
        tasks: Any number.
        phrases: Of each task.
        encoder: Of all maps.
        options: Parameters; `literal` needs the empty cells and is answered by `RegionGated` only.

    Raises:
        AgentError: A map is of another encoder.
        ValueError: `literal`.
    """
    groups: dict[int, list[int]] = defaultdict(list)
    for index, memory in enumerate(memories):
        groups[id(memory)].append(index)
    answers: dict[int, Grounding] = {}
    with one_thread():
        for members in groups.values():
            memory = memories[members[0]]
            batch = make_batch(memory, [tasks[k] for k in members], [phrases[k] for k in members], encoder)
            for index, final in zip(members, solve_batch(batch, options=options).final.numpy(), strict=True):
                best = rank_cells(final, memory.rc)
                answers[index] = Grounding(candidates_at(memory, memory.rc[best], final[best]))
    return [answers[index] for index in range(len(tasks))]
