"""The wheel works outside its checkout: built, installed in an empty venv, its demo run in an empty folder."""

import importlib.util
import os
import shutil
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("personal_viz", "human_study", "sim", "grounding", "recordings")


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built from a copy of the files of git, as a clone would have, without downloads."""
    folder = tmp_path_factory.mktemp("wheel")
    for name in files_of_git():
        (folder / "clone" / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / name, folder / "clone" / name)
    options = ["--no-deps", "--no-build-isolation", "--quiet", "--wheel-dir", str(folder)]
    subprocess.run([sys.executable, "-m", "pip", "wheel", *options, str(folder / "clone")], check=True)
    (made,) = folder.glob("*.whl")
    return made


def files_of_git() -> list[str]:
    """Files of the repository that are there, and new ones that it does not ignore."""
    listed = subprocess.check_output(["git", "ls-files", "-zco", "--exclude-standard"], cwd=ROOT, text=True)
    return [name for name in listed.split("\0") if name and (ROOT / name).is_file()]


@pytest.mark.slow
def test_the_wheel_holds_every_file_of_the_packages(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        held = {name for name in archive.namelist() if ".dist-info/" not in name}
    assert held == {name for name in files_of_git() if name.split("/")[0] in PACKAGES}


@pytest.mark.release
@pytest.mark.timeout(900)
def test_the_demo_runs_from_the_wheel_in_an_empty_folder(wheel: Path, tmp_path: Path) -> None:
    venv.create(tmp_path / "venv")
    (site,) = (tmp_path / "venv").glob("lib/python*/site-packages")
    programs = tmp_path / "venv" / "bin"
    pip = [
        sys.executable,
        "-m",
        "pip",
        "--python",
        programs / "python",
        "install",
        "--no-deps",
        "--no-index",
        "--quiet",
    ]
    subprocess.run([*pip, wheel], check=True)
    # The project's dependencies are found where they are installed for these tests; the .pth file there that makes
    # the checkout importable is not read.
    (site / "dependencies.pth").write_text("\n".join(dependency_folders()))
    folder = tmp_path / "empty"
    folder.mkdir()
    where = "import personal_viz, sim; print(personal_viz.__file__, sim.__file__)"
    found = subprocess.check_output([programs / "python", "-c", where], cwd=folder, text=True)
    assert found.count(str(site)) == 2
    spec = importlib.util.spec_from_file_location("run_demo", ROOT / ".ci" / "run_demo.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    demo = [programs / "personal-viz", "demo", "--port", "0"]
    _, lines, page = module.run_demo(demo, limit_s=800, cwd=folder, env=environment)
    assert "<html" in page
    assert "runs/demo/study" in lines[-1]
    assert (folder / "runs/demo/study").is_dir()


def dependency_folders() -> list[str]:
    """Folders of installed packages on our path, the checkout not among them."""
    return [name for name in sys.path if Path(name).name == "site-packages"]
