"""Which run folders the words on a command line mean, and what they hold."""

from collections.abc import Sequence
from pathlib import Path

from sim.errors import RunFileError

from .run_files import Run, read_run, read_run_info

SEQUENCES_FILE = "sequences.jsonl"
"""The file of a run of home sequences; among other run folders it is left out."""
BESIDE = "beside"
"""In the configuration of run.json: the run of the same folder that always stands beside this one."""


def run_folders(folders: Sequence[Path]) -> list[Path]:
    """The named folders; a folder that is not a run folder is replaced by the run folders one level below it.

    Raises:
        RunFileError: No folder is named.
    """
    if not folders:
        raise RunFileError("found no run folder on the command line; expected at least one, such as runs/<run_id>.")
    found: list[Path] = []
    for folder in folders:
        inside = sorted(path.parent for path in folder.glob("*/run.json")) if folder.is_dir() else []
        found += [folder] if (folder / "run.json").is_file() or not inside else inside
    return found


def with_controls(folders: Sequence[Path]) -> list[Path]:
    """The run folders in the named ones, and those that always stand beside them.

    Raises:
        RunFileError: No folder is named, or one that stands beside another is missing.
    """
    found = run_folders(folders)
    for folder in tuple(found):
        control = control_of(folder, among=found)
        found += [control] if control is not None else []
    return found


def control_of(folder: Path, *, among: Sequence[Path]) -> Path | None:
    """The run folder that always stands beside this one; None where there is none, or where one of its name is there.

    Raises:
        RunFileError: It is missing, or the folder's run.json is missing or damaged.
    """
    config = read_run_info(folder).config
    name, control = config.get(BESIDE), folder.parent / str(config.get(BESIDE))
    if name is None or "shard" in config or name in [each.name for each in among]:
        return None
    if not control.is_dir():
        raise RunFileError(
            f"{folder}: found no run {name} beside it; expected its control, the same agent judged by geometry. "
            "Move it there, or name its folder too."
        )
    return control


def read_runs(folders: Sequence[Path], *, with_reported: bool = False) -> list[Run]:
    """The runs in the named folders, or one level below a named folder.

    Args:
        folders: The folders.
        with_reported: As in `read_run`.

    Raises:
        RunFileError: A folder holds no run, or only reported figures where none may be, or a run is damaged.
    """
    found = [folder for folder in run_folders(folders) if folder in folders or not (folder / SEQUENCES_FILE).is_file()]
    runs = [read_run(folder, with_reported=with_reported) for folder in found]
    for folder, run in zip(found, runs, strict=True):
        if (folder / SEQUENCES_FILE).is_file():
            raise RunFileError(
                f"{folder}: holds home sequences; expected episodes or answers. personal-viz metrics shows sequences."
            )
        if not run.episodes and not run.answers and not run.reported:
            raise RunFileError(f"{folder}: holds no finished episode or answer; expected at least one. Run it again.")
    return runs
