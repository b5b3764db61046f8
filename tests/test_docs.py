"""The documentation: the site builds without a warning, the README files stay short, and the plug-in page runs."""

import os
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest

from .personal_viz.program import personal_viz

ROOT = Path(__file__).resolve().parents[1]


@pytest.mark.slow
def test_the_site_builds_with_every_link_and_every_public_name(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(tmp_path)]
    environment = os.environ | {"NO_MKDOCS_2_WARNING": "1"}
    subprocess.run(command, cwd=ROOT, env=environment, check=True)
    names = (tmp_path / "api.html").read_text(encoding="utf-8")
    for name in ("sim.Dataset", "grounding.ground", "human_study.study_report", "recordings.read_rrd"):
        assert f'id="{name}"' in names
    assert "_PLACES" not in names


def test_the_readme_is_short() -> None:
    assert (ROOT / "README.md").read_text(encoding="utf-8").count("\n") <= 150


@pytest.mark.parametrize("package", ["sim", "grounding", "human_study", "recordings", "personal_viz"])
def test_the_readme_of_each_package_fits_on_a_screen(package: str) -> None:
    assert (ROOT / package / "README.md").read_text(encoding="utf-8").count("\n") <= 40


@pytest.mark.slow
def test_the_three_files_of_the_plug_in_page_run(
    small_home_root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    parts = (ROOT / "docs" / "plugins.md").read_text(encoding="utf-8").split("```python\n")
    for before, part in pairwise(parts):
        name = before.rsplit("`", 2)[1]
        (tmp_path / name).write_text(part.split("```")[0], encoding="utf-8")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["my_agent.py", "my_encoder.py", "my_session.py"]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    command = [sys.executable, "my_session.py", str(small_home_root)]
    done = subprocess.run(command, cwd=tmp_path, env=environment, check=True, capture_output=True, text=True)
    assert "the agent keeps the contract" in done.stdout
    assert "the encoder keeps the contract" in done.stdout
    assert "actions; success by rule:" in done.stdout
    monkeypatch.chdir(tmp_path)
    data = ["--dataset", str(small_home_root), "--limit", "1"]
    assert personal_viz("run", "--agent", "my_agent:Spiral", *data).returncode == 0
    assert personal_viz("ground", "--encoder", "my_encoder:Letters", "--method", "qs", *data).returncode == 0
    assert len(list((tmp_path / "runs").iterdir())) == 2
