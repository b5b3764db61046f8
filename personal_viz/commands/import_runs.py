"""Worker of `personal-viz import`: runs of another simulator become a run folder."""

from pathlib import Path

from sim.episodes.dataset import PersonalDataset
from sim.tasks.import_runs import import_runs
from sim.tasks.run_files import Measures, read_run

from .options import check_options


def import_files(
    *,
    files: tuple[Path, ...],
    dataset: Path,
    scenes_dir: Path | None,
    out: Path,
    who: str,
    run_id: str | None = None,
    allow_schematic: bool = False,
) -> int:
    """Checks and scores files of `recordings/habitat_writer.py`, prints where the run was written.

    Args:
        files: Steps files, read as one run.
        dataset: Folder of the episodes that were played.
        scenes_dir: Folder of the scans; None for invented homes.
        out: Folder that gets `<run_id>/`.
        who: The agent's name in tables.
        run_id: Name of the folder; None = `who` and a digest.
        allow_schematic: Score on schematic homes all the same.

    Returns:
        0; problems are raised as one-line errors.
    """
    check_options(run_id=run_id)
    folders = import_runs(
        files,
        dataset=PersonalDataset(dataset),
        scenes_dir=scenes_dir,
        out=out,
        who=who,
        run_id=run_id,
        allow_schematic=allow_schematic,
    )
    for folder in folders:
        run = read_run(folder)
        unreachable = sum(_is_unreachable(episode.end.measures) for episode in run.episodes)
        print(f"{folder}: {len(run.episodes)} episodes of {who!r} on {run.info.scene_kind} homes, every step checked.")
        if unreachable:
            print(
                f"{unreachable} of them have a target that cannot be reached from the start on the scene as built here."
            )
    return 0


def _is_unreachable(measures: Measures | None) -> bool:
    rules = measures.rules.values() if measures else ()
    return any(rule is not None and rule.start_distance is None for rule in rules)
