"""Optional packages: imported where they are used, with an error that names the extra that installs them."""

import importlib
from types import ModuleType

from sim.errors import MissingDependencyError


def require(module: str, *, extra: str) -> ModuleType:
    """The imported module.

    Args:
        module: Its import name.
        extra: The extra of this project that installs it, e.g. `models`.

    Raises:
        MissingDependencyError: The module or one of its own dependencies is not installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise MissingDependencyError(
            f"{module}: cannot be imported ({error}); expected the packages of extra {extra!r}. "
            f"Run: pip install 'personal-viz[{extra}]'"
        ) from error
