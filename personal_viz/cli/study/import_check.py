"""Verb `study import-check`: checks that the files of an export agree, and computes every outcome once more."""

from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from human_study.design.plan import PRACTICE_FOLDER, StudyScene
from human_study.design.study import load_study
from human_study.export.import_check import import_check as check
from human_study.export.manifest import read_manifest, require_unchanged
from human_study.export.verify import TrialHome
from personal_viz.study_app.home.trial_homes import open_trial_home
from personal_viz.study_app.study_files import require_same_homes
from personal_viz.study_app.study_sequences import PRACTICE_SET, study_set
from sim.episodes.dataset import PersonalDataset
from sim.episodes.sequence_files import SequenceSet

from ..options import Dataset, Evidence, ScenesDir, Sequences
from ..refusals import require_same_dataset


@dataclass
class StudyImportCheck:
    """Read an export back: hashes, and every outcome computed once more from the exported events."""

    export: Positional[Path]
    dataset: Dataset
    evidence: Evidence = ()
    scenes_dir: ScenesDir = None
    sequences: Sequences = None

    def run(self) -> int:
        manifest = read_manifest(self.export)
        require_unchanged(self.export, manifest)
        episodes = PersonalDataset(self.dataset, evidence=self.evidence)
        require_same_dataset(episodes, {manifest.dataset_digest}, whose="the study's")
        told = study_set(self.export, load_study(self.export), self.sequences)

        def open_home(scene: StudyScene) -> TrialHome:
            is_practice = scene in manifest.practice_scenes
            dataset = PersonalDataset(self.export / PRACTICE_FOLDER) if is_practice else episodes
            scans = None if is_practice else self.scenes_dir
            require_same_homes(manifest, [scene], dataset, scans)
            practised = SequenceSet(self.export / PRACTICE_SET) if is_practice and told is not None else told
            return open_trial_home(dataset, scene, scans, sequences=practised)

        report = check(self.export, open_home)
        for problem in report.problems:
            print(problem)
        unsupported = (
            f", {report.num_unsupported} done in another version of their home" if report.num_unsupported else ""
        )
        print(
            f"{self.export}: {report.num_files} files are as they were written; {report.num_agreeing} of "
            f"{report.num_attempts} outcomes agree with their events{unsupported}"
        )
        return 0 if report.agrees else 1
