"""Which layers over the home a researcher has switched on. Light: texts and 3-D both read it."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class LayerChoice:
    """One flag per layer that can be switched."""

    view_points: bool = True
    region: bool = True
    names: bool = False
    """Category names over all objects."""
