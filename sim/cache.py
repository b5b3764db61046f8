"""Files that are made once from other files and may be deleted at any time: converted textures, browser copies."""

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

    If the folder cannot be written, the content is made anew each time. The folder belongs to the user alone,
    because licensed geometry may be among the files.

    Args:
        kind: File suffix without the dot, e.g. `glb`; also the subfolder.
        key: Everything that the content depends on, including a version of the code that makes it.
        make: Makes the content.
    """
    path = cache_dir() / kind / f"{hashlib.sha256(key.encode()).hexdigest()}.{kind}"
    with contextlib.suppress(OSError):
        return path.read_bytes()
    content = make()
    with contextlib.suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        with tempfile.TemporaryDirectory(dir=path.parent) as beside:  # it is removed even when the disk is full
            whole = Path(beside) / path.name
            whole.write_bytes(content)
            os.replace(whole, path)
    return content
