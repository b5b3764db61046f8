"""Verb `contact-sheet`: a home in one picture, and crops of its objects for a naming test with people."""

from pathlib import Path

from sim.episodes.dataset import PersonalDataset
from sim.errors import PersonalVizError
from sim.files import write_whole
from sim.homes.clutter.clutter import with_clutter
from sim.homes.invented.invent import invent_plan
from sim.homes.kind import plan_of, scene_label, scene_terms
from sim.homes.open_home import open_scene, scene_from_plan
from sim.homes.plan import HomePlan
from sim.homes.recovered.recover import recover_plan
from sim.mesh import Scene
from sim.types import ClutterLevel

from ..contact_sheet.sheet import contact_sheet_picture, png_bytes, write_crops


def contact_sheet(
    *,
    scene: str | None,
    out: Path,
    dataset: Path | None,
    scenes_dir: Path | None,
    invent: int | None,
    clutter: ClutterLevel,
    crops: Path | None,
) -> int:
    """Writes the contact sheet of a dataset's scene or of an invented home, and crops where asked.

    Args:
        scene: Name of a scene of `dataset`.
        out: A PNG file.
        dataset: Folder of the episodes.
        scenes_dir: Folder of the scans; None = the home without its scan.
        invent: Seed of an invented home, instead of `scene` and `dataset`.
        clutter: Level of furniture without captions.
        crops: Folder for unlabelled crops and their key; None = none are made.

    Returns:
        The exit code, 0.

    Raises:
        PersonalVizError: Not exactly one home is named, it cannot be opened, or a file cannot be written.
    """
    if out.suffix.lower() != ".png":
        raise PersonalVizError(f"--out: found {str(out)!r}; expected a file that ends in .png. Give another name.")
    home, plan = _home(scene=scene, dataset=dataset, scenes_dir=scenes_dir, invent=invent, clutter=clutter)
    picture = contact_sheet_picture(home, plan)
    said = (scene_label(home.kind), scene_terms(home.kind))
    try:
        write_whole(out, png_bytes(picture, label=" ".join(filter(None, said))))
        if crops is not None:
            num = write_crops(crops, home)
            print(f"{num} crops and their key written to {crops}")
    except OSError as error:
        raise PersonalVizError(
            f"{error.filename or out}: cannot be written ({error.strerror}); expected a place that you can write. "
            "Give another --out or --crops."
        ) from None
    print(f"{out}: {home.label}, {picture.width} x {picture.height} pixels")
    return 0


def _home(
    *,
    scene: str | None,
    dataset: Path | None,
    scenes_dir: Path | None,
    invent: int | None,
    clutter: ClutterLevel,
) -> tuple[Scene, HomePlan | None]:
    """The home that the options name, and the plan that it was made of; a scan has none."""
    if invent is not None:
        if scene is not None or dataset is not None or scenes_dir is not None:
            raise PersonalVizError(
                "--invent: found a SCENE, --dataset or --scenes-dir beside it; expected one home. Leave one out."
            )
        if invent < 0:
            raise PersonalVizError(f"--invent is {invent}; expected a whole number from 0. Give another seed.")
        return _planned(invent_plan(f"Invented{invent}", seed=invent), clutter)
    if scene is None or dataset is None:
        raise PersonalVizError(
            "contact-sheet: found no home; expected SCENE with --dataset DIR, or --invent SEED. Give one of them."
        )
    episodes = PersonalDataset(dataset)
    episodes.require_scene(scene)
    if scenes_dir is not None:
        return open_scene(episodes, scene, scenes_dir=scenes_dir, clutter=clutter), None
    return _planned(plan_of(episodes, scene) or recover_plan(episodes, scene), clutter)


def _planned(plan: HomePlan, clutter: ClutterLevel) -> tuple[Scene, HomePlan]:
    """The home as `open_scene` makes it of a plan, and the plan with its clutter."""
    if clutter not in (0, plan.clutter):
        plan = with_clutter(plan, clutter, seed=0)
    return scene_from_plan(plan), plan
