"""Digests of this room's code: explorations and maps that other code made are not taken for our own."""

import hashlib
from functools import lru_cache
from pathlib import Path

_HERE = Path(__file__).parent
POLICY = (
    "agents/*.py",
    "explore.py",
    "exploring/coverage.py",
    "exploring/rooms.py",
    "maps/occupancy*.py",
    "posed_frames.py",
)
"""What decides where the explorer starts and goes, and what its file says of coverage, doors and rooms."""
MAPS = (
    *POLICY,
    "encoders.py",
    "encoding/*.py",
    "exploring/storeys.py",
    "home_maps.py",
    "map_files.py",
    "mapping.py",
    "maps/*.py",
    "memory.py",
    "object_mapping.py",
    "oracle/oracle_map.py",
    "oracle/texts.py",
    "settings.py",
    "types.py",
)
"""What decides what is on the map of a walked home."""


@lru_cache(maxsize=1)
def policy_digest() -> str:
    """12 letters of the code that makes explorations."""
    return _digest(POLICY)


@lru_cache(maxsize=1)
def map_digest() -> str:
    """12 letters of the code that makes maps of walked homes; what asks, draws or tables them is left out."""
    return _digest(MAPS)


def files_of(patterns: tuple[str, ...]) -> list[Path]:
    """The modules of these patterns, each once, in order."""
    return sorted({path for pattern in patterns for path in _HERE.glob(pattern)})


def _digest(patterns: tuple[str, ...]) -> str:
    total = hashlib.sha256()
    for path in files_of(patterns):
        total.update(f"{path.relative_to(_HERE)}\0".encode() + path.read_bytes())
    return total.hexdigest()[:12]
