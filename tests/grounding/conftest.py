"""The small data set as a fixture."""

from pathlib import Path

import pytest

from .small_homes import write_small_dataset


@pytest.fixture(scope="session")
def small_root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a small data set: easy holds two homes (8 episodes), hard only HomeTwo (3), medium none."""
    root = tmp_path_factory.mktemp("small-dataset")
    write_small_dataset(root)
    return root
