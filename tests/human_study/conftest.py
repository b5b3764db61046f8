"""A study with finished trials, made once for all tests that read it or change a copy of it."""

import shutil
from pathlib import Path

import pytest

from human_study.export.study_export import export_study

from .finished import study_with_trials


@pytest.fixture(scope="session")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the `study` of `study_with_trials` and its export `out`; nobody writes to it."""
    folder = tmp_path_factory.mktemp("finished")
    study_with_trials(folder / "study")
    export_study(folder / "study", folder / "out")
    return folder


@pytest.fixture
def folder(finished: Path, tmp_path: Path) -> Path:
    """A folder with a copy of that `study`."""
    shutil.copytree(finished / "study", tmp_path / "study")
    return tmp_path


@pytest.fixture
def out(finished: Path, tmp_path: Path) -> Path:
    """A copy of that export."""
    return Path(shutil.copytree(finished / "out", tmp_path / "out"))
