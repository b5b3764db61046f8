"""Which package may import which (DESIGN.md), and which modules must start without the heavy libraries."""

import ast
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
ALLOWED = {
    "sim": set(),
    "grounding": {"sim"},
    "recordings": {"sim", "grounding"},
    "human_study": {"sim"},
    "personal_viz": {"sim", "grounding", "recordings", "human_study"},
}
HEAVY = ("viser", "rerun", "torch", "open3d", "trimesh")
LIGHT_MODULES = (
    "sim.tasks.metrics",
    "sim.tasks.run_files",
    "sim.episodes.dataset",
    "sim.episodes.validate",
    "sim.episodes.statistics",
    "human_study.session",
    "human_study.store",
    "human_study.export",
    "human_study.verify",
    "human_study.reporting.report",
    "personal_viz.cli",
    "personal_viz.commands.runs",
)


@cache
def imports_of(path: Path) -> set[str]:
    """Top-level names of all absolute imports in a file, also those inside functions."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            names.add(node.module.split(".")[0])
    return names


@pytest.mark.parametrize("package", ALLOWED)
def test_a_package_imports_only_from_below(package: str) -> None:
    files = sorted((ROOT / package).rglob("*.py"))
    assert files
    for path in files:
        ours = imports_of(path) & (set(ALLOWED) - {package})
        assert ours <= ALLOWED[package], f"{path.relative_to(ROOT)} imports {sorted(ours - ALLOWED[package])}"


@pytest.mark.parametrize("library", ["rerun"])
def test_rerun_stays_in_recordings(library: str) -> None:
    for package in set(ALLOWED) - {"recordings"}:
        for path in (ROOT / package).rglob("*.py"):
            assert library not in imports_of(path), path.relative_to(ROOT)


def test_light_modules_start_without_heavy_libraries() -> None:
    program = f"""
import importlib, sys
for module in {LIGHT_MODULES!r}:
    importlib.import_module(module)
    print(module, *sorted(set({HEAVY!r}) & set(sys.modules)))
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.split("\n")[:-1] == list(LIGHT_MODULES)


def test_no_module_is_longer_than_400_lines() -> None:
    files = [path for package in ALLOWED for path in (ROOT / package).rglob("*.py")]
    long = {str(path.relative_to(ROOT)): count for path in files if (count := len(path.read_text().splitlines())) > 400}
    assert not long
