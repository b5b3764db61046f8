"""Verb `show-exploration`: repeats a stored exploration in its home, as a Rerun recording."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from grounding.agents.exploration import load_exploration
from recordings.viewer.window import open_file
from sim.episodes.dataset import PersonalDataset

from ..options import Evidence, OpenIt, ScenesDir, WithPixels
from ..refusals import check_options
from .same_home import open_same_home


@dataclass
class ShowExploration:
    """Walk a stored exploration again and write it as a Rerun recording: views, map growing, frontiers, way."""

    file: Annotated[Positional[Path], arg(help="An exploration, FILE.json.")]
    out: Annotated[Path, arg(help="An .rrd file.")]
    dataset: Annotated[Path | None, arg(help="Folder of the home's episodes; homes of explore --homes need none.")] = (
        None
    )
    evidence: Evidence = ()
    scenes_dir: ScenesDir = None
    with_pixels: WithPixels = False
    open: OpenIt = False

    def run(self) -> int:
        from recordings.explorations import replay_exploration
        from recordings.replay import require_rrd
        from recordings.sinks import LiveSink

        check_options(self)
        require_rrd(self.out)
        found = load_exploration(self.file)
        episodes = None if self.dataset is None else PersonalDataset(self.dataset, evidence=self.evidence)
        scene = open_same_home(
            episodes, found.scene, digest=found.scene_digest, scenes_dir=self.scenes_dir, where=str(self.file)
        )
        has_pictures = scene.kind != "scan" or self.with_pixels
        same = replay_exploration(found, scene, LiveSink("file", str(self.out)), with_pixels=self.with_pixels)
        print(f"{self.out}: {len(found.steps)} steps in {scene.label}. See it with: rerun {self.out}")
        if not has_pictures:
            print("Geometry, maps and pictures of the scan are left out; --with-pixels writes them.")
        elif same < len(found.steps):
            print(f"The explorer chooses another action now at step {same + 1}: what it knew is shown up to there.")
        if self.open:
            open_file(self.out)
        return 0
