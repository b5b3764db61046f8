"""Loads the public names of each package when they are first used, so that importing a package costs nothing."""

from collections.abc import Callable, Mapping
from importlib import import_module


def loaders_of(
    package: str, places: Mapping[str, tuple[str, str]]
) -> tuple[Callable[[str], object], Callable[[], list[str]]]:
    """The `__getattr__` and `__dir__` (PEP 562) of this package; `places` maps each public name to its module and its
    name there.
    """

    def load(name: str) -> object:
        """The object of this public name; AttributeError for any other."""
        if name not in places:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        module, own_name = places[name]
        return getattr(import_module(module), own_name)

    return load, lambda: list(places)
