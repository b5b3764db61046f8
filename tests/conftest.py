"""Fixtures that every test may use; tests on shared data skip with a reason where the folder is absent."""

import os
from pathlib import Path

import pytest

from sim.cache import VARIABLE

SHARED = Path(__file__).resolve().parents[2] / "shared"


@pytest.fixture(scope="session")
def dataset_root() -> Path:
    """Folder of the released episodes."""
    root = SHARED / "personal-dataset" / "split"
    if not root.is_dir():
        pytest.skip(f"the released episodes are not at {root}")
    return root


@pytest.fixture(scope="session")
def golden_root() -> Path:
    """Folder of the real Habitat's answers."""
    root = SHARED / "habitat-golden"
    if not root.is_dir():
        pytest.skip(f"Habitat's golden answers are not at {root}")
    return root


@pytest.fixture(scope="session", autouse=True)
def own_cache(tmp_path_factory) -> None:
    """Converted textures and browser copies of this run only: nothing of an earlier one is read."""
    os.environ[VARIABLE] = str(tmp_path_factory.mktemp("cache"))
