"""Verb `replay`: makes one Rerun recording of one episode from run folders."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import arg

from recordings.traces import common_episode, common_sequence
from recordings.viewer.window import open_file
from sim.episodes.dataset import PersonalDataset, key_from_text
from sim.episodes.sequence_files import HomeSequence, SequenceSet
from sim.errors import RecordingError
from sim.homes.open_home import open_scene
from sim.homes.renderers import renderer_of
from sim.mesh import Scene
from sim.sequences.runs import read_sequence_runs
from sim.sequences.searches import sequence_key
from sim.tasks.run_files import RunInfo, read_run, read_run_info
from sim.types import ClutterLevel, EpisodeKey

from ..options import Dataset, Evidence, OpenIt, ScenesDir, WithPixels
from ..refusals import require_same_dataset


@dataclass
class Replay:
    """Write one Rerun recording with any number of runs of one episode or home sequence."""

    dataset: Dataset
    runs: Annotated[tuple[Path, ...], arg(help="Run folders of people, agents, grounders and imports.")]
    out: Annotated[Path, arg(help="An .rrd file.")]
    evidence: Evidence = ()
    scenes_dir: ScenesDir = None
    sequences: Annotated[
        Path | None, arg(help="Folder of a set of home sequences, where the runs are of those instead of episodes.")
    ] = None
    episode: Annotated[
        str | None, arg(help="SPLIT/SCENE/ID of the episode or sequence; needed when the runs share several.")
    ] = None
    with_pixels: WithPixels = False
    open: OpenIt = False

    def run(self) -> int:
        if self.sequences is not None:
            return self._record_sequence(self.sequences)
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
            clutter=_common_clutter([run.info for run in read]),
            labels=_common_labels([run.info for run in read if any(item.key == key for item in run.episodes)]),
        )
        has_pictures = self._has_pictures(scene)
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
        return self._say(key, scene)

    def _record_sequence(self, root: Path) -> int:
        from recordings.sequences.recording import log_sequence

        runs = [(read_run_info(folder), read_sequence_runs(folder)) for folder in self.runs]
        infos = [info for info, _ in runs]
        key = common_sequence(runs) if self.episode is None else key_from_text(self.episode, where="--episode")
        episodes = PersonalDataset(self.dataset, evidence=self.evidence)
        require_same_dataset(episodes, {info.dataset_digest for info in infos}, whose="the runs'")
        found = _sequence(SequenceSet(root), key, infos)
        labels = _common_labels([info for info, own in runs if any(run.key == key for run in own)])
        scene = open_scene(
            episodes, key.scene, scenes_dir=self.scenes_dir, clutter=_common_clutter(infos), labels=labels
        )
        renderer = renderer_of(scene) if self._has_pictures(scene) else None
        log_sequence(runs, sequence=found, scene=scene, out=self.out, renderer=renderer, with_pixels=self.with_pixels)
        return self._say(key, scene)

    def _has_pictures(self, scene: Scene) -> bool:
        return scene.kind != "scan" or self.with_pixels

    def _say(self, key: EpisodeKey, scene: Scene) -> int:
        """Says where the recording is, and opens it if wanted."""
        print(f"{self.out}: {key} in {scene.label}. Open it with --open, or: rerun {self.out}")
        if not self._has_pictures(scene):
            print(
                "Geometry and pictures of the scan are left out; --with-pixels writes them, "
                "under the scan's terms of use."
            )
        if self.open:
            open_file(self.out)
        return 0


def _sequence(sequences: SequenceSet, key: EpisodeKey, infos: Sequence[RunInfo]) -> HomeSequence:
    """The sequence of this name.

    Raises:
        RecordingError: A run was made on another set, or the set does not hold the sequence.
    """
    digest = sequences.digest()
    for info in infos:
        if info.config.get("sequences") != digest:
            made_on = str(info.config.get("sequences"))[:12]
            raise RecordingError(
                f"{info.run_id}: was made on the set of sequences {made_on}, {sequences.root} is {digest[:12]}; "
                "expected one set. Give the --sequences of the run, or leave the run out."
            )
    own = sequences.sequences(scenes=(key.scene,))
    found = next((one for one in own if sequence_key(one) == key), None)
    if found is None:
        raise RecordingError(f"{sequences.root}: holds no sequence {key}; expected it. Choose another --episode.")
    return found


def _common_clutter(runs: Sequence[RunInfo]) -> ClutterLevel:
    """The clutter level on which all runs were made; answers on oracle maps have no level.

    Raises:
        RecordingError: The runs were made on several levels.
    """
    levels: dict[str, str] = {}
    for info in runs:
        if info.scene_kind != "oracle-map":
            levels.setdefault(str(info.config.get("clutter", 0)), info.run_id)
    if len(levels) > 1:
        found = ", ".join(f"{level} ({run_id})" for level, run_id in sorted(levels.items()))
        raise RecordingError(f"runs: found clutter levels {found}; expected one in a recording. Leave the others out.")
    level = next(iter(levels), "0")
    return 1 if level == "1" else 2 if level == "2" else 0


def _common_labels(runs: Sequence[RunInfo]) -> bool:
    """Whether the pictures of these PAN runs named the objects; the recording shows what they showed.

    Raises:
        RecordingError: Some did and some did not.
    """
    found = {info.labels: info.run_id for info in runs}
    if len(found) > 1:
        raise RecordingError(
            f"runs: found pictures with the categories of objects written on them ({found[True]}) and without "
            f"({found[False]}); expected one of the two in a recording. Leave the others out."
        )
    return next(iter(found), False)
