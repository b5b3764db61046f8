"""Verb `annotate`: describes the objects of a scan, or refines an edition's captions, in the browser until Ctrl-C."""

import contextlib
import signal
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import Positional, arg

from personal_viz.printed import Console
from sim.errors import PersonalVizError

from ..options import Scenes, ScenesDir

if TYPE_CHECKING:
    import viser

    from personal_viz.browse.app import Guest


@dataclass
class Annotate:
    """Describe the objects of a scan in the browser, or refine an edition's captions; edits are appended lines."""

    scan: Annotated[
        Positional[Path | None], arg(help="A .glb, .gltf, .ply or .obj file whose objects you describe.")
    ] = None
    dataset: Annotated[Path | None, arg(help="An edition whose captions you refine, instead of a scan.")] = None
    out: Annotated[
        Path | None,
        arg(help="Folder where edits are appended: of the scan's dataset, or of the opinions on the edition."),
    ] = None
    who: Annotated[str, arg(help="Your name, which each edit has; for a scan, the page asks for it too.")] = ""
    adjudicate: Annotated[bool, arg(help="With --dataset: choose where annotators differ.")] = False
    scenes_dir: ScenesDir = None
    scene: Scenes = ()
    up: Annotated[
        Literal["y", "z"] | None,
        arg(help="Axis that is up in the scan; by default what files beside it or HM3D's names say, else y."),
    ] = None
    port: Annotated[int, arg(help="0 takes a free one.")] = 8092

    def run(self) -> int:
        from personal_viz.browse.app import loopback_app

        from ..refusals import require_folder

        if (self.scan is None) == (self.dataset is None) or self.out is None:
            raise PersonalVizError(
                "annotate: expected --out and either a scan, or an edition (--dataset). Give these two; "
                '"personal-viz annotate --help" explains them.'
            )
        require_folder(self.out)
        console = Console(stderr=True)
        with console.status("Opening") if console.is_terminal else contextlib.nullcontext():
            title, welcome = (
                self._scan(self.scan, self.out) if self.scan is not None else self._edition(self.dataset, self.out)
            )
        ended = threading.Event()
        signal.signal(signal.SIGTERM, lambda *_: ended.set())
        with loopback_app(welcome, port=self.port) as address, contextlib.suppress(KeyboardInterrupt):
            print(f"{title}: {address}")
            print(f"Edits are appended in {self.out}. On this machine only. Ctrl-C ends it.", flush=True)
            ended.wait()
        return 0

    def _scan(self, scan: Path, out: Path) -> "tuple[str, Callable[[viser.ClientHandle], Guest]]":
        from personal_viz.annotate.app import Annotator, Workplace
        from personal_viz.view.shown import open_shown

        place = Workplace(open_shown(scan, up=self.up), out, who=self.who)
        for note in place.shown.notes:
            print(note)
        return place.shown.name, lambda client: Annotator(client, place)

    def _edition(self, dataset: Path | None, out: Path) -> "tuple[str, Callable[[viser.ClientHandle], Guest]]":
        from personal_viz.annotate.refine_app import Edition, Refinement, Refiner
        from sim.episodes.dataset import PersonalDataset

        assert dataset is not None, "run() has checked it"
        episodes = PersonalDataset(dataset)
        scenes = tuple(dict.fromkeys(self.scene)) or episodes.scenes
        for scene in scenes:
            episodes.require_scene(scene)
        edition = Edition(Refinement(episodes, out, self.who, scenes, self.scenes_dir, self.adjudicate))
        return str(dataset), lambda client: Refiner(client, edition)
