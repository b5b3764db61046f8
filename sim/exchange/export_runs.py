"""Exports runs as run folders, TUM trajectories or Minari datasets; each is written whole or not at all."""

import os
import re
import shutil
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Literal

from sim.errors import RunFileError
from sim.files import write_whole
from sim.frames import quat_xyzw_from_yaw

from ..tasks.run_files import EpisodeRun, Run, RunInfo, run_texts

ExportFormat = Literal["jsonl", "tum", "minari"]


@dataclass(frozen=True, slots=True)
class Exported:
    """The files written for one run."""

    folder: Path
    num_episodes: int
    num_answers: int
    """Answers in the files; TUM and Minari cannot hold any."""
    num_left_out: int
    """Answers that the format cannot hold."""


def export_runs(runs: Sequence[Run], *, format: ExportFormat, out: Path) -> list[Exported]:
    """Writes runs below `out`, one folder per run.

    Args:
        runs: Runs in memory; parts of one run (from recordings of single episodes) are put together.
        format: `jsonl` = our run folders, `tum` = one trajectory per episode, `minari` = a Minari dataset.
        out: Folder that gets `<run_id>/`, for Minari `personal/<run_id>-v0/`.

    Returns:
        The written files; runs without anything that the format can hold are left out.

    Raises:
        RunFileError: A folder exists already or cannot be written, two different runs have the same name, or nothing
            can be written in this format.
    """
    merged = merge_parts(runs)
    kept = [run for run in merged if run.episodes or (format == "jsonl" and run.answers)]
    if not kept:
        names = ", ".join(run.info.run_id for run in merged) or "no run"
        raise RunFileError(
            f"{names}: found no episode with poses to write as {format}; expected PAN runs. POG answers are exported "
            "with --format jsonl only."
        )
    targets = [_target(out, run, format) for run in kept]
    for target in targets:
        if target.exists():
            raise RunFileError(f"{target}: exists already; expected a new folder. Give another --out, or remove it.")
    done = []
    for run, target in zip(kept, targets, strict=True):
        with _new_folder(target) as folder:
            _write(run, format, folder)
        answers = len(run.answers) if format == "jsonl" else 0
        done.append(Exported(target, len(run.episodes), answers, len(run.answers) - answers))
    return done


def merge_parts(runs: Sequence[Run]) -> list[Run]:
    """The runs, with all parts of one `run_id` put together; a repeated trial is kept once.

    Raises:
        RunFileError: Two runs with the same name differ in `run.json`.
    """
    parts: dict[str, list[Run]] = {}
    for run in runs:
        same = parts.setdefault(run.info.run_id, [])
        if same and same[0].info != run.info:
            raise RunFileError(
                f"{run.info.run_id}: two runs of this name have different run.json; expected one run per name. "
                "Export them one by one, each into its own --out."
            )
        same.append(run)
    return [
        Run(
            info=same[0].info,
            episodes=tuple({item.model_dump_json(): item for run in same for item in run.episodes}.values()),
            answers=tuple({item.model_dump_json(): item for run in same for item in run.answers}.values()),
        )
        if len(same) > 1
        else same[0]
        for same in parts.values()
    ]


def write_tum_files(run: Run, folder: Path) -> list[Path]:
    """One file `<split>-<scene>-<id>[-<participant>].tum` per PAN episode, in order; a repeated name gets `-2`, `-3`...

    Answers have no trajectory and are not written.

    Raises:
        OSError: The folder cannot be written.
    """
    used: Counter[str] = Counter()
    paths = []
    for episode in run.episodes:
        name = "-".join(episode.key)
        if episode.start.participant:
            name += "-" + re.sub(r"[^A-Za-z0-9_-]", "_", episode.start.participant)
        used[name] += 1
        path = folder / (name + (f"-{used[name]}" if used[name] > 1 else "") + ".tum")
        write_whole(path, tum_text(episode, run.info))
        paths.append(path)
    return paths


def tum_text(episode: EpisodeRun, info: RunInfo) -> str:
    """The trajectory of one run: the start pose and the pose after each step; its header names the kind of home.

    Timestamps are seconds since the start where they were measured, else step numbers. The body's pose has no tilt.
    """
    times = (0.0, *(step.t_s for step in episode.steps))
    is_measured = len(times) > 1 and all(before < after for before, after in pairwise(times))
    said = "seconds since the episode's start" if is_measured else "step number (nobody measured the time)"
    lines = [
        f"# PersONAL run of {' '.join(info.who.split())}: pose of the robot's feet after each step, the start first",
        "# world frame = Habitat's: metres, +y up; the robot looks along its own -z; quaternion x y z w",
        f"# the timestamp is the {said}",
        f"# episode: {episode.key}, edition {info.edition}",
        f"# scenes: {info.scene_kind}",
        *(f"# {words}" for words in (info.scene_label, info.scene_terms) if words),
        f"# stopped: {'yes' if episode.end.reason == 'stop' else 'no'}",
        f"# allow_sliding: {'yes' if episode.start.allow_sliding else 'no'}",
        f"# {'timestamp' if is_measured else 'step'} tx ty tz qx qy qz qw",
    ]
    for step, (time, pose) in enumerate(zip(times, episode.poses, strict=True)):
        numbers = (time if is_measured else step, *pose.position, *quat_xyzw_from_yaw(pose.yaw))
        lines.append(" ".join(repr(number) for number in numbers))
    return "\n".join(lines) + "\n"


def _target(out: Path, run: Run, format: ExportFormat) -> Path:
    if format == "minari":
        from .export_minari import dataset_id

        return out / dataset_id(run.info)
    return out / run.info.run_id


def _write(run: Run, format: ExportFormat, folder: Path) -> None:
    if format == "jsonl":
        for name, text in run_texts(run).items():
            write_whole(folder / name, text)
    elif format == "tum":
        write_tum_files(run, folder)
    else:
        from .export_minari import write_minari_dataset

        write_minari_dataset(run, folder)


@contextmanager
def _new_folder(target: Path) -> Iterator[Path]:
    """A folder that gets its name when it is complete; otherwise it is removed."""
    beside = target.with_name(target.name + ".part")
    try:
        if beside.exists():
            shutil.rmtree(beside)
        beside.mkdir(parents=True)
        yield beside
        os.replace(beside, target)
    except OSError as error:
        raise RunFileError(
            f"{target}: cannot be written ({error}); expected a folder with space that you can write. "
            "Give another --out, or make room."
        ) from None
    finally:
        shutil.rmtree(beside, ignore_errors=True)
