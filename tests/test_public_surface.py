"""The public names of each package (DESIGN.md section 3) exist and import fast; the README's code runs."""

import importlib
import subprocess
import sys
from pathlib import Path

import pytest

SURFACE = {
    "sim": "Dataset open_home Home Camera PanEnv PanGymEnv Agent Action play metrics import_runs",
    "grounding": "explore build_map ground Map Phrases Encoder Detector check_encoder",
    "human_study": "Study load_study make_plan open_store read_records study_report",
    "recordings": "RerunObserver log_comparison read_rrd",
}
HEAVY = ("numba", "torch", "open3d", "trimesh", "viser", "rerun")


@pytest.mark.parametrize("package", SURFACE)
def test_public_names_are_there_and_documented(package: str) -> None:
    loaded = importlib.import_module(package)
    assert sorted(SURFACE[package].split()) == dir(loaded) == sorted(loaded.__all__)
    for name in loaded.__all__:
        value = getattr(loaded, name)
        assert callable(value), name
        assert value.__doc__, name


def test_an_unknown_name_is_refused() -> None:
    with pytest.raises(ImportError):
        exec("from sim import Nothing", {})


def test_importing_the_packages_loads_nothing_heavy() -> None:
    program = f"import sys, {', '.join(SURFACE)}; print(*sorted(set({HEAVY!r}) & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.strip() == ""


@pytest.mark.slow
def test_the_code_of_the_readme_runs(small_home_root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    readme = (Path(__file__).resolve().parents[1] / "README.md").read_text()
    code = readme.split("## In Python")[1].split("```python\n")[1].split("```")[0]
    names: dict = {"DATASET": small_home_root}
    monkeypatch.setenv("MPLBACKEND", "agg")
    monkeypatch.chdir(tmp_path)
    exec(code, names)
    assert names["picture"].shape == (120, 160, 3)
    assert names["run"].end.measures is not None
    assert len(names["found"]) == 3
    assert (tmp_path / "first_look.png").stat().st_size > 10_000
