"""The documentation: the site builds without a warning, and the texts that it replaces stay short."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


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
def test_the_readme_of_each_package_is_a_screen(package: str) -> None:
    assert (ROOT / package / "README.md").read_text(encoding="utf-8").count("\n") <= 40
