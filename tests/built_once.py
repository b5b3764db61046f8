"""Folders that are slow to build and only read: one worker builds each of them once per test run."""

import fcntl
import shutil
from collections.abc import Callable
from pathlib import Path


def built_once(shared: Path, name: str, build: Callable[[Path], None]) -> Path:
    """The folder that `build` filled; the first process that asks builds it, others wait until it is complete.

    Args:
        shared: A folder of this run that all workers share: the fixture `shared_dir`.
        name: Name of the folder, inside `shared`.
        build: Fills the empty folder that it is given. If it raises, the next process that asks builds again.
    """
    whole = shared / name
    with (shared / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not whole.exists():
            part = shared / f"{name}.part"
            shutil.rmtree(part, ignore_errors=True)
            part.mkdir()
            build(part)
            part.rename(whole)
    return whole
