"""Verbs `study export` and `study import-check`: a study's records as files, and whether such files hold together."""

from pathlib import Path

from human_study.design.plan import StudyScene
from human_study.export.verify import TrialHome
from human_study.store.records import read_study
from personal_viz.study_app.home.trial_homes import open_any_home, require_same_dataset
from sim.episodes.dataset import PersonalDataset

EXPORT_FOLDER = "exports"


def export(*, study: Path, out: Path | None) -> int:
    """Writes a study's records as run folders and tables.

    Args:
        study: Folder; may be served meanwhile.
        out: New, empty or an earlier export of this study; None = `exports/<name of the study>` in its folder.

    Raises:
        StudyError: The study cannot be read or was changed, or `out` cannot be written.
    """
    from human_study.export.manifest import read_manifest
    from human_study.export.study_export import export_study

    if out is None:
        with read_study(study) as reader:
            out = study / EXPORT_FOLDER / reader.config.study
    folders = export_study(study, out)
    manifest = read_manifest(out)
    for folder in folders:
        print(f"Run of a participant: {folder}")
    num_trials = manifest.files["trials.jsonl"].num_rows
    deleted = f", {manifest.num_deleted} people deleted" if manifest.num_deleted else ""
    print(
        f"Written to {out}: {len(folders)} run folders, {num_trials} trials in trials.csv, "
        f"{len(manifest.left_out)} of them in no run (practice, attention, failures){deleted}; "
        "data_dictionary.md explains the columns"
    )
    print("exclusions.csv holds your own words: read it before you publish the folder.")
    return 0


def import_check(*, export: Path, dataset: Path, scenes_dir: Path | None) -> int:
    """Reads an export back and recomputes every outcome; exit code 1 when one does not agree.

    Args:
        export: Folder that `study export` wrote.
        dataset: That the study was made from.
        scenes_dir: Of licensed scans.

    Raises:
        StudyError: A file is missing or was changed, or the export is of another dataset.
        DatasetError, SceneError: A home cannot be read.
    """
    from human_study.export.import_check import import_check as check
    from human_study.export.manifest import read_manifest, require_unchanged

    manifest = read_manifest(export)
    require_unchanged(export, manifest)
    require_same_dataset(PersonalDataset(dataset), manifest.dataset_digest)

    def open_home(scene: StudyScene) -> TrialHome:
        return open_any_home(
            scene,
            folder=export,
            is_practice=scene in manifest.practice_scenes,
            dataset=dataset,
            scenes_dir=scenes_dir,
        )

    report = check(export, open_home)
    for problem in report.problems:
        print(problem)
    unsupported = f", {report.num_unsupported} done in another version of their home" if report.num_unsupported else ""
    print(
        f"{export}: {report.num_files} files are as they were written; {report.num_agreeing} of {report.num_attempts} "
        f"outcomes agree with their events{unsupported}"
    )
    return 0 if report.agrees else 1
