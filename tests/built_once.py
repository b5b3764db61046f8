"""What is dear to make and only read: made once per run, whichever worker asks first."""

import fcntl
import shutil
from collections.abc import Callable
from pathlib import Path


def built_once(shared: Path, name: str, build: Callable[[Path], None]) -> Path:
    """The folder that `build` filled; the first process that asks builds it, others wait until it is whole.

    Args:
        shared: A folder of this run that all workers know: the fixture `shared_dir`.
        name: Of the folder below it.
        build: Fills the empty folder that it is given. Where it raises, the next who asks builds again.
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
