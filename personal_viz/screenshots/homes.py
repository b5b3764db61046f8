"""The README's pictures of homes: contact sheets of a schematic and of an invented one. Part of screenshots."""

from pathlib import Path

from PIL import Image

from sim.episodes.dataset import PersonalDataset
from sim.homes.invented.invent import invent_plan
from sim.homes.open_home import scene_from_plan
from sim.homes.plan import HomePlan
from sim.homes.recovered.recover import recover_plan

from ..contact_sheet.sheet import contact_sheet_picture

RELEASE = Path(__file__).resolve().parents[3] / "shared" / "personal-dataset" / "split"
"""The released episodes, where they lie beside the checkout."""
SCENE = "TEEsavR23oF"
INVENTED_SEED = 7
_WIDTH = 1400
_JPEG_QUALITY = 85


def picture_homes(folder: Path) -> None:
    """Writes home-invented.jpg, and home-schematic.jpg where the released episodes are."""
    _write(invent_plan(f"Invented{INVENTED_SEED}", seed=INVENTED_SEED), folder / "home-invented.jpg")
    if RELEASE.is_dir():
        _write(recover_plan(PersonalDataset(RELEASE), SCENE), folder / "home-schematic.jpg")
    else:
        print(f"{RELEASE}: not there; home-schematic.jpg stays as it is")


def _write(plan: HomePlan, path: Path) -> None:
    picture = contact_sheet_picture(scene_from_plan(plan), plan)
    picture = picture.resize((_WIDTH, round(picture.height * _WIDTH / picture.width)), Image.Resampling.LANCZOS)
    picture.save(path, quality=_JPEG_QUALITY)
