"""Verb `contact-sheet`: a home in one picture, and crops of its objects for a naming test with people."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from sim.episodes.dataset import PersonalDataset
from sim.errors import PersonalVizError
from sim.files import write_whole
from sim.homes.clutter.plans import with_clutter
from sim.homes.invented.plans import invent_plan
from sim.homes.kind import scene_label, scene_terms
from sim.homes.open_home import home_plan, open_scene, scene_from_plan
from sim.homes.plan import HomePlan
from sim.mesh import Scene

from ..bench.homes.playability import home_facts
from ..contact_sheet.sheet import contact_sheet_picture, png_bytes, write_crops
from .options import Clutter, Evidence, ScenesDir
from .refusals import check_options, require_suffix, writing


@dataclass
class ContactSheet:
    """Draw one picture of a home: plans, views of rooms, and one of each category of objects."""

    scene: Positional[Annotated[str | None, arg(help="Scene name; left out with --invent.")]] = None
    out: Annotated[Path, arg(help="A PNG file.")] = Path("runs/contact-sheet.png")
    dataset: Annotated[Path | None, arg(help="Folder of the episodes.")] = None
    evidence: Evidence = ()
    scenes_dir: ScenesDir = None
    invent: Annotated[int | None, arg(help="Seed of an invented home, instead of SCENE and --dataset.")] = None
    clutter: Clutter = 0
    crops: Annotated[
        Path | None, arg(help="Folder for 256 x 256 crops without labels and their key, to let people name them.")
    ] = None

    def run(self) -> int:
        check_options(self)
        require_suffix("--out", self.out, ".png")
        home, plan = self._home()
        picture = contact_sheet_picture(home, plan, facts="" if plan is None else home_facts(home, plan))
        said = (scene_label(home.kind), scene_terms(home.kind))
        with writing(self.out):
            write_whole(self.out, png_bytes(picture, label=" ".join(filter(None, said))))
        if self.crops is not None:
            with writing(self.crops, "--crops"):
                num = write_crops(self.crops, home)
            print(f"{num} crops and their key written to {self.crops}")
        print(f"{self.out}: {home.label}, {picture.width} x {picture.height} pixels")
        return 0

    def _home(self) -> tuple[Scene, HomePlan | None]:
        """The home that the options name, and the plan that it was made from; a scan has no plan."""
        if self.invent is not None:
            if self.scene is not None or self.dataset is not None or self.scenes_dir is not None:
                raise PersonalVizError(
                    "--invent: found a SCENE, --dataset or --scenes-dir beside it; expected one home. Leave one out."
                )
            if self.invent < 0:
                raise PersonalVizError(f"--invent is {self.invent}; expected a whole number from 0. Give another seed.")
            plan = with_clutter(invent_plan(f"Invented{self.invent}", seed=self.invent), self.clutter, seed=0)
            return scene_from_plan(plan), plan
        if self.scene is None or self.dataset is None:
            raise PersonalVizError(
                "contact-sheet: found no home; expected SCENE with --dataset DIR, or --invent SEED. Give one of them."
            )
        episodes = PersonalDataset(self.dataset, evidence=self.evidence)
        episodes.require_scene(self.scene)
        if self.scenes_dir is not None:
            return open_scene(episodes, self.scene, scenes_dir=self.scenes_dir, clutter=self.clutter), None
        plan = home_plan(episodes, self.scene, clutter=self.clutter)
        return scene_from_plan(plan), plan
