"""Invented homes: each is made once per run, and copied for tests that change or move their dataset."""

import shutil
from pathlib import Path

from sim.authoring.generation import dataset_files, invent_dataset, write_files
from sim.cache import cache_dir

from ..built_once import built_once


def invented_dataset(out: Path, *, name: str, seed: int, episodes_per_split: int | None = None) -> None:
    """Copies the folder of `made_dataset` to `out`."""
    shutil.copytree(made_dataset(name, seed, episodes_per_split), out, dirs_exist_ok=True)


def made_dataset(name: str, seed: int, episodes_per_split: int | None = None) -> Path:
    """The read-only folder that `invent_dataset` wrote, or, with `episodes_per_split`, one with the `dataset_files`."""

    def build(folder: Path) -> None:
        if episodes_per_split is None:
            invent_dataset(folder, name=name, seed=seed)
        else:
            write_files(folder, dataset_files(name, seed=seed, episodes_per_split=episodes_per_split))

    shared = cache_dir().parent  # conftest's `own_cache` has named it, for all workers of this run
    return built_once(shared, f"{name}-{seed}-{episodes_per_split}", build)
