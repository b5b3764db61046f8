"""Makes a folder that shows what this program does, for any static host: `make gallery` writes `build/gallery`.

Bots take part in a small study through the real gateway; agents do the same episodes. Their recordings, contact sheets
and report, and Rerun's web viewer lie beside one page. Every address is relative; nothing is fetched from elsewhere.
"""

import shutil
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import jinja2
from PIL import Image

from recordings.viewer.web import write_viewer
from sim.authoring.generation import invent_dataset
from sim.episodes.dataset import PersonalDataset
from sim.errors import RecordingError
from sim.files import write_whole
from sim.homes.invented.plans import invent_plan
from sim.homes.open_home import scene_from_plan
from sim.homes.plan import HomePlan
from sim.homes.recovered.plans import recover_plan
from sim.page_style import tokens_css
from sim.types import Split, TaskKind

from ..bench.homes.playability import home_facts
from ..bots.crowd import run_bots
from ..bots.server import Server
from ..bots.site import make_pilot
from ..cli.verbs import parse
from ..compare.app import EPISODES
from ..compare.episode_folder import RECORDING, SHEET, THUMBNAIL
from ..contact_sheet.sheet import contact_sheet_picture

RELEASE = Path(__file__).resolve().parents[3] / "shared" / "personal-dataset" / "split"
"""The released episodes, where they lie beside the checkout."""
_HERE = Path(__file__).parent
_SEED = 7
_HOME = f"Invented{_SEED}"
_SCHEMATIC = "TEEsavR23oF"
_WIDTH = 1400
"""Width of the contact sheet of a home, pixels."""
_BY_BOTS = "By bots and agents, on invented homes: no person took part."
_MARK = "made-by-make-gallery"
"""File that tells a gallery, which may be replaced, from any other folder."""


@dataclass(frozen=True, slots=True)
class GallerySize:
    """How much a gallery shows."""

    tasks: tuple[TaskKind, ...] = ("pan", "pog")
    bots: int = 6
    """Number of bots in each task."""
    splits: Mapping[Split, int] = field(default_factory=lambda: {"easy": 2, "medium": 1, "hard": 1})
    """Number of episodes of each split."""
    steps: int = 120
    """Most steps of a trial; bots that walk anywhere end there."""
    seconds: float = 400.0
    """Longest time for the bots."""
    agents: tuple[str, ...] = ("shortest-path", "random")
    explored_steps: int = 300
    """Steps of the recorded exploration; 0 = there is none."""


@dataclass(frozen=True, slots=True)
class _Recording:
    """A recording on the page; paths are relative to it."""

    path: str
    title: str
    thumbnail: str = ""
    sheet: str = ""


def make_gallery(out: Path, size: GallerySize | None = None) -> Path:
    """Writes a gallery, in place of an earlier one; returns its page.

    Args:
        out: A new or empty folder, or that of an earlier gallery.
        size: None = the usual one, which takes some minutes.

    Raises:
        RecordingError: The folder holds something else.
        PersonalVizError: A part cannot be made; an earlier gallery stays as it was.
    """
    size = size or GallerySize()
    if out.is_dir() and any(out.iterdir()) and not (out / _MARK).is_file():
        raise RecordingError(
            f"{out}: holds other files; expected an empty folder or an earlier gallery, which is replaced. "
            "Give another folder."
        )
    with tempfile.TemporaryDirectory(prefix="personal-gallery-") as name:
        aside, made = Path(name), Path(name) / "gallery"
        study = _study(aside, size)
        _work("study", "report", str(study), "--out", str(made / "report"), "--dataset", str(aside / "dataset"))
        _work("compare", str(study), "--out", str(made / "compare"))
        for page in (made / "report" / "report.html", made / "compare" / "index.html"):
            _label(page)
        _lead_to_viewer(made / "compare" / "index.html")
        recordings = _compared(made)
        if size.explored_steps:
            (made / "recordings").mkdir()
            walk = ("--max-steps", str(size.explored_steps), "--out", str(aside / "walks"))
            path = "recordings/explore.rrd"
            _work("explore", "--dataset", str(aside / "dataset"), *walk, "--rerun", str(made / path))
            recordings.append(_Recording(path, "An agent explores an invented home and maps it"))
        homes = _homes(made / "homes")
        write_viewer(made / "viewer")
        shutil.copy(_HERE / "gallery.js", made)
        write_whole(made / "index.html", _page(recordings, homes, size))
        write_whole(made / _MARK, "A later gallery replaces this folder.\n")
        if out.exists():
            shutil.rmtree(out)
        out.parent.mkdir(parents=True, exist_ok=True)
        shutil.move(made, out)
    return out / "index.html"


def _study(folder: Path, size: GallerySize) -> Path:
    """A study that bots and then agents have done; its dataset lies beside it."""
    dataset, study = folder / "dataset", folder / "study"
    invent_dataset(dataset, name=_HOME, seed=_SEED)
    make_pilot(
        study, dataset, participants=size.bots, splits=dict(size.splits), seed=_SEED,
        study="by-bots", task=size.tasks, steps=size.steps,
    )  # fmt: skip
    with Server(study, dataset) as server:
        site = server.start()
        people = site.people(size.tasks)
        done = run_bots(
            site, participants=len(people), seconds=size.seconds, rate=3.0, kinds=("shortest", "random"), seed=_SEED,
            tasks=size.tasks, progress=print,
        )  # fmt: skip
    if done.lost or done.duplicated:
        raise RecordingError(f"{study}: {done.lost} acts lost, {done.duplicated} twice; expected none. Report this.")
    for agent in size.agents:
        _work("run", "--agent", agent, "--study", str(study))
    return study


def _label(page: Path) -> None:
    """Says below the title of a page who made it, for readers who come from elsewhere."""
    notice = f'</h1>\n<p class="note"><strong>{_BY_BOTS}</strong></p>'
    write_whole(page, page.read_text(encoding="utf-8").replace("</h1>", notice, 1))


def _lead_to_viewer(page: Path) -> None:
    """Tells the script of the comparison's page that the viewer lies beside the page's folder."""
    viewer = '<html data-viewer="../viewer/index.html"'
    write_whole(page, page.read_text(encoding="utf-8").replace("<html", viewer, 1))


def _compared(made: Path) -> list[_Recording]:
    """The recordings of the comparison, each with its small picture and its contact sheet."""
    found = []
    for folder in sorted((made / "compare" / EPISODES).iterdir()):
        here = f"compare/{EPISODES}/{folder.name}"
        found.append(_Recording(f"{here}/{RECORDING}", folder.name, f"{here}/{THUMBNAIL}", f"{here}/{SHEET}"))
    return found


def _homes(folder: Path) -> dict[str, str]:
    """Contact sheets: words by path. The schematic home is there where the released episodes are."""
    folder.mkdir()
    plans: dict[str, tuple[str, HomePlan]] = {"invented": ("an invented home", invent_plan(_HOME, seed=_SEED))}
    if RELEASE.is_dir():
        plan = recover_plan(PersonalDataset(RELEASE), _SCHEMATIC)
        plans["schematic"] = ("a schematic home, recovered from the episode files alone", plan)
    words = {}
    for name, (text, plan) in plans.items():
        scene = scene_from_plan(plan)
        picture = contact_sheet_picture(scene, plan, facts=home_facts(scene, plan))
        height = round(picture.height * _WIDTH / picture.width)
        picture.resize((_WIDTH, height), Image.Resampling.LANCZOS).save(folder / f"{name}.jpg", quality=85)
        words[f"homes/{name}.jpg"] = text
    return words


def _page(recordings: list[_Recording], homes: Mapping[str, str], size: GallerySize) -> str:
    """The gallery's page."""
    found = jinja2.Environment(
        loader=jinja2.FileSystemLoader(_HERE), undefined=jinja2.StrictUndefined, autoescape=True, trim_blocks=True
    )
    words = {"recordings": recordings, "homes": homes, "size": size, "tokens": tokens_css()}
    return found.get_template("gallery.html.j2").render(words)


def _work(*arguments: str) -> None:
    if parse(list(arguments)).run():
        raise RecordingError(f"personal-viz {' '.join(arguments)}: failed; expected its result. See its lines above.")


if __name__ == "__main__":
    print(f"Written to {make_gallery(Path(sys.argv[1]))}; copy the folder to any static host.")
