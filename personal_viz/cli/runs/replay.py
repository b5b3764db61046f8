"""Verb `replay`: makes one Rerun recording of one episode from run folders."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import arg

from recordings.traces import common_episode
from recordings.viewer.window import open_file
from sim.episodes.dataset import PersonalDataset, key_from_text
from sim.errors import RecordingError
from sim.homes.open_home import open_scene
from sim.homes.renderers import renderer_of
from sim.tasks.run_files import Run, read_run
from sim.types import ClutterLevel, EpisodeKey

from ..options import Dataset, Evidence, OpenIt, ScenesDir, WithPixels
from ..refusals import require_same_dataset


@dataclass
class Replay:
    """Write one Rerun recording with any number of runs of one episode."""

    dataset: Dataset
    runs: Annotated[tuple[Path, ...], arg(help="Run folders of people, agents, grounders and imports.")]
    out: Annotated[Path, arg(help="An .rrd file.")]
    evidence: Evidence = ()
    scenes_dir: ScenesDir = None
    episode: Annotated[str | None, arg(help="SPLIT/SCENE/ID; needed when the runs share several episodes.")] = None
    with_pixels: WithPixels = False
    open: OpenIt = False

    def run(self) -> int:
        from recordings.replay import log_comparison

        read = [read_run(folder) for folder in self.runs]
        key = common_episode(read) if self.episode is None else key_from_text(self.episode, where="--episode")
        episodes = PersonalDataset(self.dataset, evidence=self.evidence)
        require_same_dataset(episodes, {run.info.dataset_digest for run in read}, whose="the runs'")
        found = episodes.episode(key)
        scene = open_scene(
            episodes,
            key.scene,
            scenes_dir=self.scenes_dir,
            clutter=_common_clutter(read),
            labels=_common_labels(read, key),
        )
        has_pictures = scene.kind != "scan" or self.with_pixels
        log_comparison(
            read,
            episode=found,
            scene=scene,
            out=self.out,
            renderer=renderer_of(scene) if has_pictures else None,
            with_pixels=self.with_pixels,
            dataset=episodes,
            beside=[folder.resolve().parent for folder in self.runs],
        )
        print(f"{self.out}: {key} in {scene.label}. Open it with --open, or: rerun {self.out}")
        if not has_pictures:
            print(
                "Geometry and pictures of the scan are left out; --with-pixels writes them, "
                "under the scan's terms of use."
            )
        if self.open:
            open_file(self.out)
        return 0


def _common_clutter(runs: Sequence[Run]) -> ClutterLevel:
    """The clutter level on which all runs were made; answers on oracle maps have no level.

    Raises:
        RecordingError: The runs were made on several levels.
    """
    levels: dict[str, str] = {}
    for run in runs:
        if run.info.scene_kind != "oracle-map":
            levels.setdefault(str(run.info.config.get("clutter", 0)), run.info.run_id)
    if len(levels) > 1:
        found = ", ".join(f"{level} ({run_id})" for level, run_id in sorted(levels.items()))
        raise RecordingError(f"runs: found clutter levels {found}; expected one in a recording. Leave the others out.")
    level = next(iter(levels), "0")
    return 1 if level == "1" else 2 if level == "2" else 0


def _common_labels(runs: Sequence[Run], key: EpisodeKey) -> bool:
    """Whether the pictures of all PAN runs of the episode named the objects; the recording shows what they showed.

    Raises:
        RecordingError: Some did and some did not.
    """
    found = {run.info.labels: run.info.run_id for run in runs if any(item.key == key for item in run.episodes)}
    if len(found) > 1:
        raise RecordingError(
            f"runs: found pictures with the categories of objects written on them ({found[True]}) and without "
            f"({found[False]}); expected one of the two in a recording. Leave the others out."
        )
    return next(iter(found), False)
