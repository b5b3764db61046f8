"""Explore a home, map it, and ground queries: find the object that a query names on the map.

The public names are loaded when they are first used: `import grounding` itself loads nothing heavy.
"""

from typing import TYPE_CHECKING

from sim.public_names import loaders_of

if TYPE_CHECKING:
    from .agents.explore import explore as explore
    from .checks import check_encoder as check_encoder
    from .encoders.protocol import TextEncoder as Encoder
    from .evaluation.home_maps import build_map as build_map
    from .maps.home_map import HomeMemory as Map
    from .methods.free_text import ground as ground
    from .perception.protocol import Detector as Detector
    from .phrases.sources import PhraseSource as Phrases

_PLACES = {
    "Detector": ("grounding.perception.protocol", "Detector"),
    "Encoder": ("grounding.encoders.protocol", "TextEncoder"),
    "Map": ("grounding.maps.home_map", "HomeMemory"),
    "Phrases": ("grounding.phrases.sources", "PhraseSource"),
    "build_map": ("grounding.evaluation.home_maps", "build_map"),
    "check_encoder": ("grounding.checks", "check_encoder"),
    "explore": ("grounding.agents.explore", "explore"),
    "ground": ("grounding.methods.free_text", "ground"),
}
"""Module of each public name, and its name there."""
__all__ = [
    "Detector",
    "Encoder",
    "Map",
    "Phrases",
    "build_map",
    "check_encoder",
    "explore",
    "ground",
]

if not TYPE_CHECKING:  # a type checker that saw them would accept any name
    __getattr__, __dir__ = loaders_of(__name__, _PLACES)
