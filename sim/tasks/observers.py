"""Observers of a running episode, and the reasoning that an agent may show. Watching never changes a run.

Points and grids of an `Insight` are in the `start` frame (sim/frames.py), the only one that an agent knows.
"""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from sim.episodes.schema import Episode
from sim.types import GridSpec, Observation

from .run_files import EpisodeRun, Step

UNKNOWN, FREE, OCCUPIED = 0, 1, 2
"""Values of `Insight.occupancy`."""


@dataclass(frozen=True, slots=True)
class Detection:
    """One thing that an agent recognised in its last picture."""

    label: str
    box: tuple[float, float, float, float]
    """(left, top, right, bottom) in pixels of `Observation.rgb`."""
    score: float
    """Higher means more certain."""
    position: tuple[float, float, float] | None = None
    """The thing's place, start frame, metres; None when the agent did not place it."""


@dataclass(frozen=True, slots=True)
class Insight:
    """The knowledge and intention of an agent when it chose its last action; every field is optional."""

    grid: GridSpec | None = None
    """Grid of the cells of `occupancy` and `similarity`, on the start frame's (x, z); needed by both."""
    occupancy: NDArray[np.uint8] | None = None
    """(rows, cols) UNKNOWN, FREE or OCCUPIED."""
    similarity: NDArray[np.float32] | None = None
    """(rows, cols) similarity of each cell to the query; NaN where nothing was seen."""
    frontiers: NDArray[np.float64] | None = None
    """(N, 2) (x, z) of the frontiers' middles, metres."""
    detections: tuple[Detection, ...] = ()
    candidates: NDArray[np.float64] | None = None
    """(K, 3) points that may be the target, best first, metres."""
    candidate_scores: tuple[float, ...] = ()
    """One per candidate, or none at all."""
    goal: tuple[float, float, float] | None = None
    """The agent's current goal, metres."""
    note: str = ""
    """The agent's reason, in words."""


@runtime_checkable
class Explains(Protocol):
    """An agent that shows its reasoning; agents need not."""

    def insight(self) -> Insight | None:
        """Its knowledge and intention when it chose the last action; None = nothing to show."""
        ...


class Observer(Protocol):
    """Receives each episode as it happens, on the researcher's side; the run never depends on it."""

    def on_reset(self, episode: Episode, observation: Observation) -> None:
        """An episode begins; this is its first observation."""
        ...

    def on_step(self, step: Step, observation: Observation, insight: Insight | None) -> None:
        """An action was taken: its result, the observation after it, and the agent's reason."""
        ...

    def on_end(self, run: EpisodeRun) -> None:
        """The episode is over and scored."""
        ...
