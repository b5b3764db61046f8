"""Invented homes for tests that change or move their dataset: made once per run, then copied."""

import shutil
from pathlib import Path

from sim.authoring.generation import dataset_files, invent_dataset, write_files
from sim.cache import cache_dir

from ..built_once import built_once


def invented_dataset(out: Path, *, name: str, seed: int, episodes_per_split: int | None = None) -> None:
    """What `invent_dataset` writes into `out`, or with `episodes_per_split` what `dataset_files` gives."""

    def build(folder: Path) -> None:
        if episodes_per_split is None:
            invent_dataset(folder, name=name, seed=seed)
        else:
            write_files(folder, dataset_files(name, seed=seed, episodes_per_split=episodes_per_split))

    shared = cache_dir().parent  # conftest's `own_cache` has named it, for all workers of this run
    made = built_once(shared, f"{name}-{seed}-{episodes_per_split}", build)
    shutil.copytree(made, out, dirs_exist_ok=True)
