"""Which package may import which (DESIGN.md), and which modules must import no heavy library."""

import ast
import graphlib
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

from personal_viz.cli.verbs import VERBS

ROOT = Path(__file__).resolve().parents[1]
ALLOWED = {
    "sim": set(),
    "grounding": {"sim"},
    "recordings": {"sim", "grounding"},
    "human_study": {"sim"},
    "personal_viz": {"sim", "grounding", "recordings", "human_study"},
}
ROOMS = {
    "sim": """
        public_names types errors extras plugins files cache page_style compiled frames walk.navigation_map mesh
        words render walk episodes scans
        homes.cells homes.images homes.plan homes.kind homes.furniture homes.building
        homes.invented homes.clutter homes.recovered homes
        copies authoring plan_view tasks sequences exchange checks
    """,
    "grounding": """
        types
        chat.protocol encoders.protocol encoders chat phrases perception.segments perception.paraphrase maps
        perception encoders.by_name perception.by_name methods
        agents agents.onemap agents.vlfm agents.frontier_vlm agents.by_name robot evaluation report checks
    """,
    "recordings": """
        paths traces read scene maps episode insight divergence texts layers memory blueprints
        viewer sinks live_episode observer explorations replay sequences habitat_writer habitat_golden
    """,
    "human_study": "private_files design trial journey store texts export report sequence_report",
    "personal_viz": """
        printed progress browser
        study_app study_app.home study_app.gateway study_app.screens study_app.operator study_app.server
        browse contact_sheet compare pog_report bots bench scan_check reproduce view annotate
        cli bench.search screenshots examples __main__
    """,
}
"""Rooms of each package from the bottom up; some parts of a room stand lower or higher than the rest of it.

A module belongs to the longest name that matches it, and imports nothing that comes later."""
ENTRANCES = {
    "personal_viz.__main__",
    "personal_viz.bench.homes.recast_lab",
    "personal_viz.bench.page",
    "personal_viz.bench.search.compare",
    "personal_viz.bench.search.page",
    "personal_viz.screenshots.gallery",
    "personal_viz.screenshots.make",
    "personal_viz.study_app.server",
    "grounding.agents.random_frontier",
    "recordings.habitat_golden",
    "recordings.habitat_writer",
    "sim.checks",
    "sim.sequences.gym_env",
}
"""Modules that no import statement names: commands, plug-ins named in text, files to copy, checks and an environment
for users.

The examples are entrances too."""
HEAVY = ("viser", "rerun", "torch", "open3d", "trimesh")
LIGHT_MODULES = (
    "sim.tasks.metrics",
    "sim.tasks.run_files",
    "sim.episodes.dataset",
    "sim.episodes.validate",
    "sim.episodes.statistics",
    "human_study.trial.session",
    "human_study.store.store",
    "human_study.export.study_export",
    "human_study.export.verify",
    "human_study.report.report",
    "personal_viz.cli.verbs",
    "personal_viz.cli.runs.run",
)


@cache
def parsed(path: Path) -> ast.Module:
    """The syntax tree of a file, cached because several tests read it."""
    return ast.parse(path.read_text())


@cache
def import_statements(path: Path) -> list[ast.Import | ast.ImportFrom]:
    """All imports in a file, also those inside functions."""
    return [node for node in ast.walk(parsed(path)) if isinstance(node, ast.Import | ast.ImportFrom)]


@cache
def imports_of(path: Path) -> set[str]:
    """Top-level names of all absolute imports in a file, also those inside functions."""
    names: set[str] = set()
    for node in import_statements(path):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif node.level == 0 and node.module:
            names.add(node.module.split(".")[0])
    return names


def module_of(path: Path) -> str:
    """Dotted name of the module in this file."""
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def modules_imported(path: Path, known: set[str]) -> set[str]:
    """Which of these modules a file imports, also inside functions."""
    found: set[str] = set()
    here = list(path.relative_to(ROOT).parent.parts)
    for node in import_statements(path):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        else:
            above = here[: len(here) + 1 - node.level] if node.level else []
            base = ".".join([*above, *([node.module] if node.module else [])])
            found |= {name if (name := f"{base}.{alias.name}") in known else base for alias in node.names}
    return found & known


def rank_of(module: str, package: str) -> int:
    """Position of the module's room in ROOMS; modules in no room may import all rooms."""
    rooms = ROOMS[package].split()
    name = module.removeprefix(package).removeprefix(".")
    fitting = [room for room in rooms if f"{name}.".startswith(f"{room}.")]
    return rooms.index(max(fitting, key=len)) if fitting else len(rooms)


@cache
def imports_among_us() -> dict[str, set[str]]:
    """Which of our modules each of our modules imports, also inside functions."""
    files = {module_of(path): path for package in ALLOWED for path in (ROOT / package).rglob("*.py")}
    return {module: modules_imported(path, set(files)) - {module} for module, path in files.items()}


@pytest.mark.parametrize("package", ALLOWED)
def test_a_package_imports_only_from_below(package: str) -> None:
    files = sorted((ROOT / package).rglob("*.py"))
    assert files
    for path in files:
        ours = imports_of(path) & (set(ALLOWED) - {package})
        assert ours <= ALLOWED[package], f"{path.relative_to(ROOT)} imports {sorted(ours - ALLOWED[package])}"


@pytest.mark.parametrize("package", ROOMS)
def test_a_room_imports_only_from_below(package: str) -> None:
    upwards = [
        f"{module} imports {imported}"
        for module, found in sorted(imports_among_us().items())
        for imported in sorted(found)
        if module.split(".")[0] == imported.split(".")[0] == package
        and rank_of(imported, package) > rank_of(module, package)
    ]
    assert not upwards


@pytest.mark.parametrize("package", ALLOWED)
def test_a_room_states_its_purpose_and_has_at_most_20_modules(package: str) -> None:
    for init in (ROOT / package).rglob("__init__.py"):
        assert ast.get_docstring(parsed(init)), init
        num_modules = len(list(init.parent.glob("*.py")))
        assert num_modules <= 20, init.parent


def test_no_imports_go_in_a_circle() -> None:
    list(graphlib.TopologicalSorter(imports_among_us()).static_order())  # raises on a circle and names it


def test_no_module_is_only_for_tests() -> None:
    verbs = {f"personal_viz.cli.{place.rpartition('.')[0]}" for place in VERBS.values()}
    imported = verbs.union(*imports_among_us().values())
    alone = {
        module_of(path)
        for package in ALLOWED
        for path in (ROOT / package).rglob("*.py")
        if path.name != "__init__.py" and "examples" not in path.parts
    } - imported
    assert alone == ENTRANCES


@pytest.mark.parametrize("library", ["rerun"])
def test_rerun_stays_in_recordings(library: str) -> None:
    for package in set(ALLOWED) - {"recordings"}:
        for path in (ROOT / package).rglob("*.py"):
            assert library not in imports_of(path), path.relative_to(ROOT)


def test_light_modules_import_no_heavy_library() -> None:
    program = f"""
import importlib, sys
for module in {LIGHT_MODULES!r}:
    importlib.import_module(module)
    print(module, *sorted(set({HEAVY!r}) & set(sys.modules)))
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.split("\n")[:-1] == list(LIGHT_MODULES)


def test_no_module_is_longer_than_600_lines() -> None:
    """STYLE.md section 1: 80 to 400 lines, up to 600 when they tell one story."""
    files = [path for package in ALLOWED for path in (ROOT / package).rglob("*.py")]
    long = {str(path.relative_to(ROOT)): count for path in files if (count := len(path.read_text().splitlines())) > 600}
    assert not long
