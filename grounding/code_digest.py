"""Digests of this room's code: explorations and maps that other code made are not taken for our own."""

import hashlib
from functools import lru_cache
from pathlib import Path

_HERE = Path(__file__).parent
_POLICY = ("agents/*.py", "occupancy*.py")
"""What decides where the explorer goes."""


@lru_cache(maxsize=1)
def policy_digest() -> str:
    """12 letters of the explorer's code."""
    return _digest(sorted(path for pattern in _POLICY for path in _HERE.glob(pattern)))


@lru_cache(maxsize=1)
def room_digest() -> str:
    """12 letters of all modules here."""
    return _digest(sorted(_HERE.rglob("*.py")))


def _digest(paths: list[Path]) -> str:
    total = hashlib.sha256()
    for path in paths:
        total.update(f"{path.relative_to(_HERE)}\0".encode() + path.read_bytes())
    return total.hexdigest()[:12]
