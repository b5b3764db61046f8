"""Verbs about episode files and homes: validate, stats, invent, homes, contact-sheet."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from .options_shared import Clutter, Dataset, Json, Scenes, ScenesDir


@dataclass
class Validate:
    """Check every episode file; exit code 1 only when something is unusable."""

    dataset: Dataset
    json: Json = False

    def work(self) -> int:
        from .episodes import validate

        return validate(dataset=self.dataset, json=self.json)


@dataclass
class Stats:
    """Rebuild the paper's two statistics tables from the files."""

    dataset: Dataset
    json: Json = False

    def work(self) -> int:
        from .episodes import stats

        return stats(dataset=self.dataset, json=self.json)


@dataclass
class Invent:
    """Invent homes with their own PersONAL-format episodes."""

    out: Path
    homes: int = 1
    seed: int = 0

    def work(self) -> int:
        from .invent import invent

        return invent(homes=self.homes, seed=self.seed, out=self.out)


@dataclass
class Homes:
    """Report how well homes without a scan serve their episodes: paths, view points, what can be told apart."""

    dataset: Dataset
    scene: Scenes = ()
    json: Json = False
    out: Annotated[Path | None, arg(help="Folder for the homes' plans, to be corrected by hand.")] = None
    jobs: Annotated[int, arg(help="Worker processes, one scene each.")] = 1
    folds: Annotated[bool, arg(help="Recover each home from two splits alone as well (held-out figures).")] = True

    def work(self) -> int:
        from .homes import homes

        return homes(**vars(self))


@dataclass
class ContactSheet:
    """Draw one picture of a home: plans, views of rooms, and one of each category of objects."""

    scene: Positional[Annotated[str | None, arg(help="Scene name; left out with --invent.")]] = None
    out: Annotated[Path, arg(help="A PNG file.")] = Path("runs/contact-sheet.png")
    dataset: Annotated[Path | None, arg(help="Folder of the episodes.")] = None
    scenes_dir: ScenesDir = None
    invent: Annotated[int | None, arg(help="Seed of an invented home, instead of SCENE and --dataset.")] = None
    clutter: Clutter = 0
    crops: Annotated[
        Path | None, arg(help="Folder for 256 x 256 crops without labels and their key, to let people name them.")
    ] = None

    def work(self) -> int:
        from .contact_sheet import contact_sheet

        return contact_sheet(**vars(self))
