"""Verb `annotate`: describes the objects of a scan in the browser, until Ctrl-C."""

import contextlib
import signal
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from personal_viz.printed import Console


@dataclass
class Annotate:
    """Describe the objects of a scan in the browser: category, captions, room; every edit is an appended line."""

    scan: Positional[Annotated[Path, arg(help="A .glb, .gltf, .ply or .obj file.")]]
    out: Annotated[Path, arg(help="Folder of the dataset; edits are appended to annotations/<Scene>.jsonl in it.")]
    who: Annotated[str, arg(help="Your name, which each edit has; without it, the page asks.")] = ""
    up: Annotated[
        Literal["y", "z"] | None,
        arg(help="Axis that is up in the file; by default what files beside it or HM3D's names say, else y."),
    ] = None
    port: Annotated[int, arg(help="0 takes a free one.")] = 8092

    def run(self) -> int:
        from personal_viz.annotate.app import Annotator, Workplace
        from personal_viz.browse.app import loopback_app
        from personal_viz.view.shown import open_shown

        from ..refusals import require_folder

        require_folder(self.out)
        console = Console(stderr=True)
        with console.status("Opening the scan") if console.is_terminal else contextlib.nullcontext():
            place = Workplace(open_shown(self.scan, up=self.up), self.out, who=self.who)
        ended = threading.Event()
        signal.signal(signal.SIGTERM, lambda *_: ended.set())
        with (
            loopback_app(lambda client: Annotator(client, place), port=self.port) as address,
            contextlib.suppress(KeyboardInterrupt),
        ):
            for note in place.shown.notes:
                print(note)
            print(f"{place.shown.name}: {address}")
            print(f"Edits are appended to {place.path}. On this machine only. Ctrl-C ends it.", flush=True)
            ended.wait()
        return 0
