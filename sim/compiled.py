"""Compiled loops: numba's `njit`, with a separate cache on disk for each state of all our kernels.

numba checks only the file that defines a function. After an edit, a cached caller in another file would silently keep
the function's old code. Every module with kernels takes `njit` from here.
"""

import hashlib
import shutil
from pathlib import Path

import numba
from numba import njit as njit
from numba.core import config

from .cache import cache_dir

_ROOT = Path(__file__).parent
_MARK = "import njit"


def kernels_digest() -> str:
    """sha256 (16 hex digits) of every module of this package that holds kernels, and of numba's version."""
    total = hashlib.sha256(numba.__version__.encode())
    for path in sorted(_ROOT.rglob("*.py")):
        content = path.read_bytes()
        if _MARK.encode() in content:
            total.update(str(path.relative_to(_ROOT)).encode() + b"\0" + content)
    return total.hexdigest()[:16]


def keep_apart(digest: str) -> Path:
    """Tells numba to keep compiled code in a folder of its own for this digest, and returns the folder.

    The folder lies in `NUMBA_CACHE_DIR` if the user set it. Otherwise it lies beside this file, where folders of other
    digests are removed, or in the cache folder if that place cannot be written.
    """
    beside = _ROOT / "__pycache__"
    named: str = getattr(config, "CACHE_DIR")  # noqa: B009 - numba makes its settings at run time
    for base in (Path(named),) if named else (beside, cache_dir()):
        folder = base / f"kernels-{digest}"
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        for other in set(beside.glob("kernels-*")) - {folder} if base == beside else ():
            shutil.rmtree(other, ignore_errors=True)
        break
    setattr(config, "CACHE_DIR", str(folder))  # noqa: B010
    return folder


keep_apart(kernels_digest())
