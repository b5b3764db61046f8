"""Verb `invent`: homes from a seed, each with its plan, GLB, semantics and episodes in the PersONAL format."""

from pathlib import Path

from sim.authoring.generation import dataset_files, write_files
from sim.errors import DatasetError
from sim.homes.plan import HomePlan
from sim.types import SPLITS


def invent(*, homes: int, seed: int, out: Path) -> int:
    """Writes `homes` invented homes below `out`; the same seed gives the same bytes.

    A home's files are renamed into place together once all of them are written, so `out` holds whole homes only.

    Args:
        homes: How many.
        seed: Of the first home; the next ones count on from it.
        out: Dataset folder, with the files that `dataset_files` names: episodes, plan, GLB and semantics.

    Returns:
        The exit code, 0.

    Raises:
        SceneError: A seed gives no home.
        DatasetError: `homes` is below 1, a seed gives no episodes, or a file cannot be written.
    """
    if homes < 1:
        raise DatasetError(f"invent: homes is {homes!r}; expected at least 1. Give another --homes.")
    for home_seed in range(seed, seed + homes):
        name = f"Invented{home_seed}"
        files = dataset_files(name, seed=home_seed)
        write_files(out, files)
        plan = HomePlan.model_validate_json(files[f"scenes/{name}.plan.json"])
        print(f"{name}: {len(plan.rooms)} rooms, {len(plan.furniture)} objects, episodes in {', '.join(SPLITS)}")
    print(f"Written to {out}. Next: personal-viz validate --dataset {out}")
    return 0
