"""The grounders known by name. A grounder sees a map, a `Task` and phrases, never an `Episode`."""

from collections.abc import Sequence
from typing import Literal, Protocol

from sim.types import Task

from .baselines import MapCentre, QueryScoring, RandomCell
from .encoders import TextEncoder
from .types import FeatureMap, Grounding

GrounderName = Literal["random", "center", "qs", "rpg"]


class Grounder(Protocol):
    """Answers where on a map the query's object is. `grounding.checks.check_grounder` tests a plug-in."""

    @property
    def name(self) -> str:
        """Row name in tables."""
        ...

    @property
    def uses_phrases(self) -> bool:
        """Whether the answer depends on the phrases; printed beside every result."""
        ...

    @property
    def frame(self) -> str:
        """Among which places it chooses; a baseline's figure means nothing without it."""
        ...

    def ground(self, memory: FeatureMap, task: Task, phrases: Sequence[str]) -> Grounding:
        """Ranked answers; the same inputs give the same answers.

        Args:
            memory: The map.
            task: Description and queries; the first query counts.
            phrases: Of the task's description; may be empty.
        """
        ...


def make_grounder(name: GrounderName, encoder: TextEncoder, *, seed: int = 0) -> Grounder:
    """The grounder of this name with the paper's parameters.

    Args:
        name: Which.
        encoder: The map's encoder; `random` and `center` do without.
        seed: Of `random`'s draws.
    """
    match name:
        case "random":
            return RandomCell(seed=seed)
        case "center":
            return MapCentre()
        case "qs":
            return QueryScoring(encoder)
        case "rpg":
            from .rpg import RegionGated  # torch

            return RegionGated(encoder)
