"""Verb `browse`: opens the library and serves it on this machine until Ctrl-C."""

import contextlib
import signal
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import arg

from personal_viz.printed import Console
from sim.words.english import how_many

from .options import Clutter, Dataset, Evidence, Labels, Scenes, ScenesDir
from .refusals import require_no_scan, require_none


@dataclass
class Browse:
    """Walk through episodes, homes, owners and runs in the browser; for researchers, it shows the truth."""

    dataset: Dataset
    evidence: Evidence = ()
    runs: Annotated[tuple[Path, ...], arg(help="Run folders to show beside the episodes.")] = ()
    sequences: Annotated[
        Path | None, arg(help="Folder of a set of home sequences, whose searches are shown instead of episodes.")
    ] = None
    scenes_dir: ScenesDir = None
    scene: Scenes = ()
    clutter: Clutter = 0
    labels: Labels = "off"
    port: Annotated[int, arg(help="0 takes a free one.")] = 8090

    def run(self) -> int:
        from personal_viz.browse.app import browser_app
        from personal_viz.browse.library import open_library

        require_no_scan("scan" if self.scenes_dir is not None else "schematic", clutter=self.clutter)
        if self.sequences is not None:
            require_none(self, ("runs",), beside="--sequences")
        console = Console(stderr=True)
        with console.status("Reading episodes and runs") if console.is_terminal else contextlib.nullcontext():
            library = open_library(
                self.dataset,
                evidence=self.evidence,
                runs=self.runs,
                scenes_dir=self.scenes_dir,
                scenes=self.scene,
                clutter=self.clutter,
                labels=self.labels == "on",
                sequences=self.sequences,
            )
        ended = threading.Event()
        signal.signal(signal.SIGTERM, lambda *_: ended.set())
        with browser_app(library, port=self.port) as address, contextlib.suppress(KeyboardInterrupt):
            homes = how_many(len(library.scenes), "home")
            print(f"{how_many(len(library.episodes), *library.nouns)} of {homes}: {address}")
            print("For researchers on this machine: it shows the goals. Ctrl-C ends it.", flush=True)
            ended.wait()
        return 0
