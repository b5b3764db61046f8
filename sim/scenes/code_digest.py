"""Digests of our own code, for the keys of files that are made once: other code makes them anew."""

import hashlib
from functools import lru_cache
from pathlib import Path

import sim


@lru_cache
def code_digest(*modules: str) -> str:
    """sha256 of modules of this package, or of all modules of `sim` where none is named.

    Args:
        modules: File names in the folder of this module: `atlas.py`.
    """
    total = hashlib.sha256()
    here, root = Path(__file__).parent, Path(sim.__file__).parent
    for path in [here / name for name in sorted(modules)] or sorted(root.rglob("*.py")):
        total.update(f"{path.relative_to(root)}\0".encode() + path.read_bytes())
    return total.hexdigest()
