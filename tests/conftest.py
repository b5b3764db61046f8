"""Fixtures that every test may use; tests on shared data are skipped with a reason if the folder is missing."""

import os
import shutil
from pathlib import Path

import hypothesis
import pytest

from sim.cache import VARIABLE

from .built_once import built_once
from .cpu_time import CpuTimes, long_files_first
from .hung_tests import EndsHungTests

SHARED = Path(__file__).resolve().parents[2] / "shared"


def pytest_configure(config: pytest.Config) -> None:
    """Measures CPU time, ends what hangs, keeps xdist from ordering files by length, and gives examples any time."""
    config.pluginmanager.register(CpuTimes())
    config.pluginmanager.register(EndsHungTests())
    config.option.loadscopereorder = False
    hypothesis.settings.register_profile("any time", deadline=None)
    hypothesis.settings.load_profile("any time")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Runs files with many long tests first."""
    long_files_first(items)


@pytest.fixture(scope="session")
def dataset_root() -> Path:
    """Folder of the released episodes."""
    root = SHARED / "personal-dataset" / "split"
    if not root.is_dir():
        pytest.skip(f"the released episodes are not at {root}")
    return root


@pytest.fixture(scope="session")
def golden_root() -> Path:
    """Folder of answers recorded from the real Habitat."""
    root = SHARED / "habitat-golden"
    if not root.is_dir():
        pytest.skip(f"Habitat's golden answers are not at {root}")
    return root


@pytest.fixture(scope="session")
def shared_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of this run that all its workers share."""
    own = tmp_path_factory.getbasetemp()
    shared = (own.parent if "PYTEST_XDIST_WORKER" in os.environ else own) / "shared"
    shared.mkdir(exist_ok=True)
    return shared


@pytest.fixture(scope="session", autouse=True)
def own_cache(shared_dir: Path) -> None:
    """Gives this run its own cache of converted textures and browser copies, so that no earlier run's are read."""
    os.environ[VARIABLE] = str(shared_dir / "cache")


@pytest.fixture(scope="session")
def demo_root(own_cache: None) -> Path:
    """Dataset of the invented home Demo (seed 1, two storeys), with scan, plan and 8 episodes per split.

    Tests only read it; one that changes a file copies the folder first.
    """
    return _made_dataset("Demo", 1)


@pytest.fixture(scope="session")
def small_home_root(own_cache: None) -> Path:
    """The same for the invented home Small (seed 3), which has one storey and is the fastest to build."""
    return _made_dataset("Small", 3)


@pytest.fixture(scope="session")
def invented_root(shared_dir: Path, demo_root: Path, small_home_root: Path) -> Path:
    """Dataset of both homes, Demo and Small; tests only read it."""

    def build(out: Path) -> None:
        for root in (demo_root, small_home_root):
            shutil.copytree(root, out, dirs_exist_ok=True)

    return built_once(shared_dir, "invented", build)


@pytest.fixture(scope="session")
def small_root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small dataset without homes: easy holds HomeOne and HomeTwo (8 episodes), hard only HomeTwo (3)."""
    from .grounding.small_homes import write_small_dataset

    root = tmp_path_factory.mktemp("small-dataset")
    write_small_dataset(root)
    return root


def _made_dataset(name: str, seed: int) -> Path:
    from .personal_viz.invented import made_dataset

    return made_dataset(name, seed)
