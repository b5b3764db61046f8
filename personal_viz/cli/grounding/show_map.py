"""Verb `show-map`: writes a map file as a Rerun recording, in its home if the episodes are given."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from grounding.maps.files import load_memory, read_map_header
from recordings.viewer.window import open_file
from sim.episodes.dataset import PersonalDataset
from sim.errors import RecordingError

from ..options import Evidence, OpenIt, ScenesDir, WithPixels
from ..refusals import check_options
from .same_home import open_same_home


@dataclass
class ShowMap:
    """Write a map file as a Rerun recording: free space, features, evidence, objects, in its home."""

    file: Annotated[Positional[Path], arg(help="A map, FILE.npz.")]
    out: Annotated[Path, arg(help="An .rrd file.")]
    dataset: Annotated[Path | None, arg(help="Folder of the episodes; without it the map is shown alone.")] = None
    evidence: Evidence = ()
    scenes_dir: ScenesDir = None
    with_pixels: WithPixels = False
    open: OpenIt = False

    def run(self) -> int:
        from recordings.replay import record_memory, require_rrd

        check_options(self)
        require_rrd(self.out)
        source = read_map_header(self.file).source
        if source.kind == "scan" and not self.with_pixels:
            raise RecordingError(
                f"{self.file}: is a map of the licensed scan {source.scene}; expected leave to write it. "
                "Give --with-pixels if you may keep such a file."
            )
        if source.kind == "robot" and self.dataset is not None:
            raise RecordingError(
                f"{self.file}: is a robot's map; expected no --dataset, it has no home there. Leave it out."
            )
        scene = None
        if self.dataset is not None:
            digest, episodes = source.digest, PersonalDataset(self.dataset, evidence=self.evidence)
            scene = open_same_home(
                episodes, source.scene, digest=digest, scenes_dir=self.scenes_dir, where=str(self.file)
            )
        name = source.scene
        record_memory(load_memory(self.file), name=name, out=self.out, scene=scene, with_pixels=self.with_pixels)
        if scene is not None:
            home = f"in {scene.label}"
        else:
            home = "without its home" + ("" if source.kind == "robot" else " (--dataset shows it)")
        print(
            f"{self.out}: map of {name} {home}, made by {source.builder or 'an unknown builder'}. "
            f"See it with: rerun {self.out}"
        )
        if self.open:
            open_file(self.out)
        return 0
