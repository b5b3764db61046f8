"""The two kinds of map; a grounder takes one kind and refuses the other."""

from typing import Literal

from sim.errors import AgentError

from ..types import FeatureMap
from .home_map import Memory, ObjectMap

MemoryKind = Literal["grid", "objects"]
"""`FeatureMap` or `ObjectMap`."""


def require_grid(memory: Memory, grounder: str) -> FeatureMap:
    """The memory, which must be a grid map.

    Raises:
        AgentError: It is a map of objects.
    """
    if not isinstance(memory, FeatureMap):
        raise AgentError(
            f"grounder {grounder!r}: got a map of {len(memory.objects)} objects; expected a grid map. "
            'Use "object-phrase" or "object-dual", or build a grid map.'
        )
    return memory


def require_objects(memory: Memory, grounder: str) -> ObjectMap:
    """The memory, which must be a map of objects.

    Raises:
        AgentError: It is a grid map.
    """
    if not isinstance(memory, ObjectMap):
        raise AgentError(
            f"grounder {grounder!r}: got a grid map of {len(memory.rows)} cells; expected a map of objects. "
            'Use "dual" or "joint", or build a map of objects.'
        )
    return memory
