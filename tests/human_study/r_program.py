"""Runs R, where it is installed, for tests that compare with it."""

import functools
import shutil
import subprocess
from pathlib import Path

RSCRIPT = shutil.which("Rscript")


@functools.cache
def lacks(*packages: str) -> str:
    """The reason why R cannot be used; empty if it and these packages are installed."""
    if RSCRIPT is None:
        return "found no Rscript; install R (r-base-core) to compare with it"
    names = ", ".join(f'"{name}"' for name in packages)
    code = f"quit(status = !all(sapply(c({names}), requireNamespace, quietly = TRUE)))"
    found = subprocess.run([RSCRIPT, "-e", code], capture_output=True, check=False)
    return "" if found.returncode == 0 else f"R lacks one of its packages {names}; install them to compare with it"


def told_by(script: Path) -> tuple[str, str]:
    """(standard output, standard error) of a script that must exit with 0."""
    assert RSCRIPT is not None
    found = subprocess.run([RSCRIPT, str(script)], capture_output=True, text=True, check=False, timeout=240)
    assert found.returncode == 0, found.stderr
    return found.stdout, found.stderr
