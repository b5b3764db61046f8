"""Fixtures that every test may use; tests on shared data skip with a reason where the folder is absent."""

from pathlib import Path

import pytest

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
