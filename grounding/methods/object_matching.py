"""Grounders `object-phrase` and `object-dual` match phrases with the things of an object map and answer their middles.

They work as `phrase` and `dual` do on grids (GROUNDING.md, section 3), with instances instead of cells: cosines of the
phrases (owners stripped) with the instances' features -> dual softmax (`object-dual` only) -> the row of the query's
phrase ranks the instances.
"""

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sim.types import GridSpec, Task

from ..encoders.protocol import TextEncoder
from ..maps.home_map import Memory, MemoryKind, ObjectMap, require_objects
from ..phrases.ownership_text import parse_phrase, parse_query, wanted_phrase
from ..types import Candidate, Grounding, Layers
from .baselines import rank_cells
from .matching import DUAL_TEMPERATURE, dual_scores, peaks_of

_CELL = 1.0
_MARGIN = 1
"""Margin of the layers' grid around the instances, in metres and in cells, since its cells measure 1 m."""
ObjectMatchName = Literal["object-phrase", "object-dual"]
OBJECT_MATCHERS: dict[ObjectMatchName, float] = {"object-phrase": 0.0, "object-dual": DUAL_TEMPERATURE}
"""Temperature of the dual softmax; 0 = cosines alone."""


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
        """Matches the phrases with the things; ties go to the first in the map.

        Raises:
            AgentError: The map was made with another encoder, or is a grid.
        """
        memory = require_objects(memory, self.name)
        memory.require_encoder(self._encoder.name, self._encoder.dim)
        things = [parse_phrase(phrase) for phrase in phrases]
        wanted = wanted_phrase(things, parse_query(task.queries[0]), self._encoder)
        if wanted is None:
            texts, chosen = (task.queries[0],), 0
        else:
            texts = tuple(dict.fromkeys(item.text for item in things))
            chosen = texts.index(things[wanted].text)
        features = np.array([item.feature for item in memory.objects], np.float32).reshape(-1, memory.dim)
        similarity = self._encoder.encode_texts(texts) @ features.T
        scores = dual_scores(similarity, temperature=self._temperature) if self._temperature else similarity
        grid = objects_grid(memory)
        each = np.arange(len(memory.objects))[:, None]  # several may stand in one cell
        best = rank_cells(scores[chosen], each, nms_r=0)
        rc = grid.rc_from_xz(_middles_xz(memory))
        found = []
        for index in best:
            (x, _, z), (row, col) = memory.objects[index].centre, rc[index].tolist()
            found.append(
                Candidate((x, memory.floor_y, z), float(scores[chosen][index]), row, col, row * grid.shape[1] + col)
            )
        layers = Layers(
            rc.astype(np.int16),
            grid.shape,
            final=scores[chosen].astype(np.float32),
            phrases=texts if wanted is not None else (),
            similarity=similarity if wanted is not None else similarity[:0],
            peaks=peaks_of(scores if wanted is not None else scores[:0], each, nms_r=0),
            chosen=chosen if wanted is not None else -1,
        )
        return Grounding(tuple(found), layers)


def objects_grid(memory: ObjectMap) -> GridSpec:
    """Cells of 1 m around the middles of all things; candidates' rows and columns and the layers use this grid.

    Several things may be in one cell: layers keep one column per thing.
    """
    middles = _middles_xz(memory)
    if not len(middles):
        middles = np.array([memory.centre_xz], np.float64)
    low = np.floor(middles.min(axis=0) / _CELL) - _MARGIN
    cols, rows = (np.floor(middles.max(axis=0) / _CELL) + _MARGIN + 1 - low).astype(int).tolist()
    return GridSpec((float(low[0] * _CELL), float(low[1] * _CELL)), _CELL, (rows, cols))


def _middles_xz(memory: ObjectMap) -> NDArray[np.float64]:
    """(N, 2) world x and z of the middles of the things' boxes."""
    return np.array([item.centre for item in memory.objects], np.float64).reshape(-1, 3)[:, [0, 2]]
