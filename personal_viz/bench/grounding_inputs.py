"""Inputs of the grounding benchmark: the released episodes if they are there, else those of an invented home."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from grounding.encoders.protocol import TextEncoder
from grounding.maps.oracle_map import GRID_CELLS, oracle_home
from grounding.maps.oracle_noise import OracleVariant, variant_map
from grounding.methods.rpg import RpgResult, rpg_packed
from grounding.phrases.ownership_text import parse_phrase
from grounding.phrases.sources import DatasetPhrases
from grounding.types import FeatureMap, map_from_cells
from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode
from sim.types import GridSpec, Task

from .harness import InputKind, episodes_at_hand

_SEEN = OracleVariant(blur=1.0)
"""Map variant that fills all observed cells: about 7 % of the grid."""
CELLS = 175
"""Filled cells of a map: 7 % of 50 x 50."""


@dataclass(frozen=True, slots=True)
class MapBatch:
    """B episodes on one map, ready for the matrix product; tensors are only read."""

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


def solve_batch(batch: MapBatch) -> RpgResult:
    """The result of Algorithm 1 for all episodes of the batch."""
    width = batch.memory.grid.shape[1]
    return rpg_packed(batch.rows, batch.rc, batch.phrases, batch.queries, width=width, uses=batch.uses)


@dataclass(frozen=True, slots=True)
class SceneInputs:
    """One map and its episodes."""

    memory: FeatureMap
    tasks: tuple[Task, ...]
    phrases: tuple[tuple[str, ...], ...]
    """Phrases of each task, with the owners' names."""

    def batch(self, encoder: TextEncoder) -> MapBatch:
        """The episodes with each different text encoded once by the map's encoder; phrases leave the owners out."""
        texts = [tuple(dict.fromkeys(parse_phrase(phrase).text for phrase in phrases)) for phrases in self.phrases]
        different = list(dict.fromkeys(phrase for phrases in texts for phrase in phrases))
        uses = [[phrase in phrases for phrase in different] for phrases in texts]
        vectors = torch.from_numpy(encoder.encode_texts([*different, *(task.queries[0] for task in self.tasks)]))
        return MapBatch(
            self.memory,
            # torch has no read-only tensors and warns; a copy of N x E is cheap
            torch.from_numpy(np.array(self.memory.rows)),
            torch.from_numpy(self.memory.rc.astype(np.int64)),
            vectors[: len(different)],
            vectors[len(different) :],
            torch.tensor(uses),
        )


def scene_inputs(encoder: TextEncoder, *, limit: int | None = None) -> tuple[InputKind, list[SceneInputs]]:
    """The maps (all storeys of a scene merged, blurred over the observed cells) and episodes to measure.

    Args:
        encoder: Encoder of the maps.
        limit: Number of scenes, from the first on; None = all.
    """
    with episodes_at_hand() as (kind, folder):
        dataset = PersonalDataset(folder)
        return kind, [_scene(dataset, scene, encoder) for scene in dataset.scenes[:limit]]


def random_map(
    rng: np.random.Generator, *, dim: int, size: int = GRID_CELLS, cells: int = CELLS, encoder: str = "random"
) -> FeatureMap:
    """A map of `size` x `size` cells, `cells` of them filled with random unit vectors."""
    index = rng.choice(size * size, cells, replace=False)
    return map_from_cells(
        rng.normal(size=(cells, dim)),
        np.column_stack([index // size, index % size]),
        grid=GridSpec((0.0, 0.0), 1.0, (size, size)),
        floor_y=0.0,
        encoder=encoder,
    )


def _scene(dataset: PersonalDataset, scene: str, encoder: TextEncoder) -> SceneInputs:
    episodes: Sequence[Episode] = tuple(dataset.episodes(scenes=(scene,)))
    source = DatasetPhrases(episodes)
    tasks = tuple(episode.task("pog") for episode in episodes)
    memory = variant_map(oracle_home(dataset, scene), encoder, floor_id=None, variant=_SEEN)
    return SceneInputs(memory, tasks, tuple(map(source.phrases, tasks)))
