"""Verb `invent`: homes from a seed, each with its plan, GLB, semantics and episodes in the PersONAL format."""

from dataclasses import dataclass
from pathlib import Path

from sim.authoring.generation import dataset_files, write_files
from sim.homes.plan import HomePlan
from sim.types import SPLITS

from .refusals import check_options


@dataclass
class Invent:
    """Invent homes with their own PersONAL-format episodes."""

    out: Path
    homes: int = 1
    seed: int = 0

    def run(self) -> int:
        check_options(self)
        for home_seed in range(self.seed, self.seed + self.homes):
            name = f"Invented{home_seed}"
            files = dataset_files(name, seed=home_seed)
            write_files(self.out, files)
            plan = HomePlan.model_validate_json(files[f"scenes/{name}.plan.json"])
            print(f"{name}: {len(plan.rooms)} rooms, {len(plan.furniture)} objects, episodes in {', '.join(SPLITS)}")
        print(f"Written to {self.out}. Next: personal-viz validate --dataset {self.out}")
        return 0
