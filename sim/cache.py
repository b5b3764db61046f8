"""Files that are made once from others and may be deleted at any time: converted textures, browser copies."""

import contextlib
import hashlib
import os
import tempfile
from collections.abc import Callable
from pathlib import Path

VARIABLE = "PERSONAL_VIZ_CACHE"
"""Environment variable that names the folder; otherwise `personal-viz` below the user's cache folder."""


def cache_dir() -> Path:
    """The folder, which need not exist yet."""
    named = os.environ.get(VARIABLE)
    if named:
        return Path(named)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "personal-viz"


def cached_bytes(kind: str, key: str, make: Callable[[], bytes]) -> bytes:
    """The result of `make`, made once per (kind, key) and kept in the cache folder.

    A folder that cannot be written costs time, nothing else. Licensed geometry may be among the files, so the folder
    is the user's own.

    Args:
        kind: File suffix without the dot, e.g. `glb`; also the subfolder.
        key: All that the content depends on, a version of the making code included.
        make: Makes the content.
    """
    path = cache_dir() / kind / f"{hashlib.sha256(key.encode()).hexdigest()}.{kind}"
    with contextlib.suppress(OSError):
        return path.read_bytes()
    content = make()
    with contextlib.suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        with tempfile.TemporaryDirectory(dir=path.parent) as beside:  # goes away also where the disk is full
            whole = Path(beside) / path.name
            whole.write_bytes(content)
            os.replace(whole, path)
    return content
