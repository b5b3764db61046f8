"""Imports PAN runs of another simulator: checks every step, computes all measures, writes an ordinary run folder.

Files come from `recordings/habitat_writer.py`, or are pose lists of any program (`pose_files`). A file's own claims
about success, measures or collisions are not used; a file with an impossible step is refused with its line number, and
then nothing is written.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode
from sim.errors import RunFileError, short
from sim.homes.kind import common_kind
from sim.types import EpisodeKey

from ..tasks.rules import score_run
from ..tasks.run_files import EpisodeEnd, EpisodeRun, read_episode_runs
from ..tasks.run_writer import RunWriter
from .action_lists import run_along_positions
from .episode_names import find_episode, key_of_facts, numbered_keys, only_fitting
from .foreign_files import digest_of, files_in, info_of_import
from .pose_actions import run_from_poses
from .pose_files import POSE_SUFFIXES, PoseReading, is_pose_file, poses_from_table, read_pose_tables, undeclared_frame
from .pose_tables import PoseTable, read_text
from .step_checks import CheckedRun, check_free_motion, check_places, check_steps, start_problem, with_own_facts


def import_runs(
    files: Sequence[Path],
    *,
    dataset: PersonalDataset,
    scenes_dir: Path | None,
    out: Path,
    who: str,
    run_id: str | None = None,
    allow_schematic: bool = False,
    reading: PoseReading | None = None,
) -> list[Path]:
    """Checks files of another simulator, scores their runs and writes them as run folders below `out`.

    Args:
        files: Steps or pose files, or folders of them, read as one run (an evaluation may write one file per worker or
            episode).
        dataset: The episodes that were played.
        scenes_dir: Folder with the scans; None only for invented homes, whose plan is beside the episodes.
        out: Folder that gets `<run_id>/`.
        who: The agent's name in tables.
        run_id: Name of the folder; None = `who` and the digest of the files. Importing the same files again resumes.
        allow_schematic: Score on homes recovered from the episodes; their distances are not those of the scans.
        reading: The declared conventions of pose files; None when there are no pose files.

    Returns:
        The run folder.

    Raises:
        RunFileError: A line is damaged, a step is impossible, an episode is unknown or repeated, or `out` cannot be
            written.
        SceneError: The scenes are of several kinds, or one cannot be opened.
    """
    paths, files = files, files_in(files, *_patterns(reading))
    _require_one_kind(files, reading)
    checked = [run for path in files for run in check_file(path, dataset=dataset, reading=reading)]
    _require_some_and_no_twins(checked, files)
    kind = common_kind(dataset, {item.episode.key.scene for item in checked}, scenes_dir)
    if kind == "schematic" and not allow_schematic:
        raise RunFileError(
            f"{dataset.root}: there are neither scans nor plans of its homes, only schematic homes, which another "
            "simulator did not use; expected the scenes that were played. Give --scenes-dir the folder of their GLBs."
        )
    info = info_of_import(
        paths,
        digest_of(files),
        dataset=dataset,
        kind=kind,
        who=who,
        run_id=run_id,
        condition="free motion" if reading and reading.free else "none",
        declared=_declared(reading, checked) if reading else {},
    )
    scored = _score(checked, dataset=dataset, scenes_dir=scenes_dir)
    writer = RunWriter(out / info.run_id, info)
    for run in scored:
        if run.key not in writer.done:
            writer.add_episode(run)
    return [writer.folder]


def check_file(path: Path, *, dataset: PersonalDataset, reading: PoseReading | None = None) -> Iterator[CheckedRun]:
    """Each complete run of a steps file or a pose file (CSV, TUM, JSON, npz), after all its steps were checked.

    Raises:
        RunFileError: A line is damaged or a step is impossible; the message begins with `file:line`.
    """
    if is_pose_file(path):
        if reading is None:
            raise undeclared_frame(path)
        yield from _check_poses(path, dataset, reading)
        return
    for lines, run in read_episode_runs(path):
        wheres = tuple(f"{path}:{line}" for line in lines)
        if run.start.motion == "free":
            raise RunFileError(
                f"{wheres[0]}: motion is 'free'; expected 'paper' in steps files. Export the run as tum and import "
                "that with --motion free."
            )
        named = EpisodeKey(run.start.split, run.start.scene, run.start.episode_id)
        episode = find_episode(wheres[0], named, dataset, partial(start_problem, run.start))
        check_steps(wheres, run)
        yield CheckedRun(episode, with_own_facts(run, episode), wheres)


def _patterns(reading: PoseReading | None) -> tuple[str, ...]:
    """Names of the files that are taken from a folder."""
    if reading is None:
        return ("*.jsonl",)
    if reading.numbered_by == "onemap":
        return ("**/poses_*.csv",)
    if reading.actions is not None:
        return ("**/*_*.txt",)
    return tuple(f"*{suffix}" for suffix in POSE_SUFFIXES)


def _check_poses(path: Path, dataset: PersonalDataset, reading: PoseReading) -> Iterator[CheckedRun]:
    for table in read_pose_tables(path, reading):
        table = _with_state(table) if reading.numbered_by == "onemap" else table
        episode = _episode_of(table, reading, dataset)
        wheres, run = _run(table, reading, episode)
        if reading.free is None:
            check_steps(wheres, run, rounding=reading.rounding)
        else:
            bounds = reading.free
            max_turn = math.radians(bounds.max_turn_deg)
            check_free_motion(wheres, run, max_move=bounds.max_move, max_turn=max_turn, max_steps=bounds.max_steps)
        yield CheckedRun(episode, with_own_facts(run, episode), wheres, ignored=table.ignored)


def _episode_of(table: PoseTable, reading: PoseReading, dataset: PersonalDataset) -> Episode:
    """The episode that a table names, after a look at its start."""

    def problem(episode: Episode) -> str | None:
        if reading.actions is None:
            return start_problem(_run(table, reading, episode)[1].start, episode)
        try:
            _run(table, reading, episode)
        except RunFileError as error:
            return str(error)
        return None

    facts, numbered = table.facts, reading.numbered_by
    if reading.episode is None:
        keys = numbered_keys(table.path, facts, dataset, numbered_by=numbered, splits=reading.splits)
        if keys:
            return dataset.episode(only_fitting(table.where, keys, lambda key: problem(dataset.episode(key))))
        if numbered == "onemap":
            raise RunFileError(
                f"{table.where}: its name is {table.path.name!r}; expected poses_N, where the dataset has more than N "
                "episodes with one target in a split. Give --dataset the very episodes that OneMap was given."
            )
    named = key_of_facts(table.where, table.path, facts, reading.episode, dataset)
    return find_episode(table.where, named, dataset, problem)


def _run(table: PoseTable, reading: PoseReading, episode: Episode) -> tuple[tuple[str, ...], EpisodeRun]:
    if reading.actions is not None:
        return run_along_positions(table, reading, episode)
    poses = poses_from_table(table, reading, episode.start)
    return run_from_poses(table, reading, poses, key=episode.key, start=episode.start)


def _with_state(table: PoseTable) -> PoseTable:
    """The table, and whether the robot stopped, from OneMap's `state/state_N.txt`, where that file is there.

    Of its `Result`s, SUCCESS (1), FAILURE_MISDETECT (2) and FAILURE_NOT_REACHED (5) follow a stop; the robots of the
    others (3, 4, 6) walked until their steps were used up. OneMap writes no pose after its last action.
    """
    number = table.path.stem.rpartition("_")[2]
    path = table.path.parent.parent / "state" / f"state_{number}.txt"
    if not path.is_file():
        return table
    state = read_text(path).strip()
    if state not in tuple("123456"):
        raise RunFileError(f"{path}: found {short(state)}; expected 1 to 6, OneMap's Result. Copy the file again.")
    return replace(table, facts={**table.facts, "stopped": "yes" if state in tuple("125") else "no"})


def _require_some_and_no_twins(checked: Sequence[CheckedRun], files: Sequence[Path]) -> None:
    if not checked:
        names = ", ".join(str(path) for path in files) or "no file"
        raise RunFileError(
            f"{names}: found no finished episode; expected at least one. "
            "Give files of habitat_writer.py, or pose files."
        )
    first: dict[EpisodeKey, str] = {}
    for run in checked:
        if run.episode.key in first:
            raise RunFileError(
                f"{run.wheres[0]}: episode {run.episode.key} comes a second time (first at {first[run.episode.key]}); "
                "expected once per run. Import repeated runs one by one, each with its own --run-id."
            )
        first[run.episode.key] = run.wheres[0]


def _require_one_kind(files: Sequence[Path], reading: PoseReading | None) -> None:
    """Refuses mixed files: conventions are for pose files only, and two action spaces never share a row of a table."""
    if reading is None:
        return
    ours = [path for path in files if not is_pose_file(path)]
    if len(ours) == len(files) or (ours and reading.free):
        raise RunFileError(
            f"{ours[0]}: is a steps file, which says itself how to read it; expected pose files (.csv, .tum, .json, "
            ".npz) beside --frame. Leave --frame out, or import it alone."
        )
    if reading.episode is not None and len(files) > 1:
        raise RunFileError(
            f"{files[1]}: is a second file beside --episode, which names one; expected one file. Import them one by "
            "one, or name each SPLIT-SCENE-ID."
        )


def _score(checked: Sequence[CheckedRun], *, dataset: PersonalDataset, scenes_dir: Path | None) -> list[EpisodeRun]:
    """Every run with its measures, in the given order; one scene is open at a time."""
    from sim.homes.open_home import open_scene

    scored: dict[EpisodeKey, EpisodeRun] = {}
    for name in sorted({item.episode.key.scene for item in checked}):
        scene = open_scene(dataset, name, scenes_dir=scenes_dir)
        for item in checked:
            if item.episode.key.scene != name:
                continue
            check_places(item, scene.navigation)
            measures = score_run(
                item.episode,
                item.run.poses,
                stopped=item.run.end.reason == "stop",
                navigation=scene.navigation,
                collisions=sum(step.collided for step in item.run.steps),
                scene_digest=scene.digest,
            )
            end = EpisodeEnd(reason=item.run.end.reason, measures=measures)
            scored[item.episode.key] = item.run.model_copy(update={"end": end})
    return [scored[item.episode.key] for item in checked]


def _declared(reading: PoseReading, checked: Sequence[CheckedRun]) -> dict[str, str | int | float | bool | None]:
    """Declarations about pose files, and their rows that were left out, for `run.json`."""
    free = reading.free
    ignored = dict.fromkeys(name for run in checked for name in run.ignored)
    return {
        "frame": reading.frame,
        "quaternion": reading.quaternion,
        "poses": reading.poses,
        "camera_axes": reading.camera_axes,
        "columns": ",".join(reading.columns) or None,
        "rows": reading.rows,
        "stopped": reading.stopped,
        "allow_sliding": reading.allow_sliding,
        "rounding": reading.rounding,
        "ignored_columns": ",".join(ignored) or None,
        **({"numbered_by": reading.numbered_by} if reading.numbered_by else {}),
        **({"actions": len(reading.actions)} if reading.actions else {}),
        **({"max_move": free.max_move, "max_turn_deg": free.max_turn_deg, "max_steps": free.max_steps} if free else {}),
    }
