"""Verb `view`: shows any scan in the browser until Ctrl-C; no episodes needed."""

import contextlib
import signal
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from personal_viz.printed import Console


@dataclass
class View:
    """Look at a scan: its storeys, places and distances by clicking, a robot that walks with a participant's keys."""

    scan: Positional[Annotated[Path, arg(help="A .glb, .gltf, .ply or .obj file.")]]
    up: Annotated[
        Literal["y", "z"] | None,
        arg(help="Axis that is up in the file; by default what files beside it or HM3D's names say, else y."),
    ] = None
    port: Annotated[int, arg(help="0 takes a free one.")] = 8091

    def run(self) -> int:
        from personal_viz.browse.app import loopback_app
        from personal_viz.view.shown import open_shown
        from personal_viz.view.visit import Visit

        console = Console(stderr=True)
        with console.status("Opening the scan") if console.is_terminal else contextlib.nullcontext():
            shown = open_shown(self.scan, up=self.up)
        ended = threading.Event()
        signal.signal(signal.SIGTERM, lambda *_: ended.set())
        with (
            loopback_app(lambda client: Visit(client, shown), port=self.port) as address,
            contextlib.suppress(KeyboardInterrupt),
        ):
            for note in shown.notes:
                print(note)
            print(f"{shown.name}: {address}")
            print("On this machine only. Ctrl-C ends it.", flush=True)
            ended.wait()
        return 0
