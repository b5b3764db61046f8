"""Compiled code on disk is reused, but never after a change in any file that holds kernels."""

import subprocess
import sys
from pathlib import Path

import pytest

CALLEE = "from sim.compiled import njit\n\n@njit(cache=True)\ndef value():\n    return {}\n"
CALLER = """
from sim.compiled import njit
from toy.callee import value

@njit(cache=True)
def twice():
    return 2 * value()
"""
PROGRAM = """
import sys, pathlib, numba
numba.config.CACHE_DIR = ""
from sim import compiled
compiled._ROOT, numba.config.CACHE_DIR = pathlib.Path(sys.argv[1]) / "toy", ""
folder = compiled.keep_apart(compiled.kernels_digest())
sys.path.insert(0, sys.argv[1])
from toy.caller import twice
print(twice(), sum(twice.stats.cache_hits.values()), folder)
"""


def run(folder: Path) -> tuple[int, int, Path]:
    """(result, cache hits, folder of compiled code) of the toy package's caller, in a process of its own."""
    command = [sys.executable, "-c", PROGRAM, str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120)
    result, hits, kept = done.stdout.split()
    return int(result), int(hits), Path(kept)


@pytest.mark.slow
def test_a_change_in_another_file_is_noticed(tmp_path: Path) -> None:
    toy = tmp_path / "toy"
    toy.mkdir()
    (toy / "__init__.py").touch()
    (toy / "callee.py").write_text(CALLEE.format(3))
    (toy / "caller.py").write_text(CALLER)
    result, hits, first = run(tmp_path)
    assert (result, hits) == (6, 0)
    assert run(tmp_path) == (6, 1, first)
    (toy / "callee.py").write_text(CALLEE.format(5))
    result, hits, second = run(tmp_path)
    assert (result, hits) == (10, 0)
    assert second.parent == toy / "__pycache__"
    assert not first.exists()
