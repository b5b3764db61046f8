"""Runs as TUM trajectories (`timestamp tx ty tz qx qy qz qw`), which evo and other tools read."""

import re
from collections import Counter
from itertools import pairwise
from pathlib import Path

from sim.files import write_whole
from sim.frames import quat_xyzw_from_yaw
from sim.homes.kind import scene_label, scene_terms

from ..tasks.run_files import EpisodeRun, Run


def write_tum_files(run: Run, folder: Path) -> list[Path]:
    """One file `<split>-<scene>-<id>[-<participant>].tum` per PAN episode; a repeated name gets `-2`, `-3`...

    Args:
        run: The run; its answers have no trajectory and are not written.
        folder: Folder of the files.

    Returns:
        The files, in the order of the run.

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
        write_whole(path, tum_text(episode, who=run.info.who, scene_kind=run.info.scene_kind))
        paths.append(path)
    return paths


def tum_text(episode: EpisodeRun, *, who: str, scene_kind: str) -> str:
    """The trajectory of one run: the start pose and the pose after each step; its header names the kind of home.

    Timestamps are seconds since the start where they were measured, else step numbers. The body's pose has no tilt.
    """
    times = (0.0, *(step.t_s for step in episode.steps))
    is_measured = len(times) > 1 and all(before < after for before, after in pairwise(times))
    said = "seconds since the episode's start" if is_measured else "step number (nobody measured the time)"
    lines = [
        f"# PersONAL run of {' '.join(who.split())}: pose of the robot's feet after each step, the start first",
        "# world frame = Habitat's: metres, +y up; the robot looks along its own -z; quaternion x y z w",
        f"# the timestamp is the {said}",
        f"# episode: {episode.key}",
        f"# scenes: {scene_kind}",
        *(f"# {words}" for words in (scene_label(scene_kind), scene_terms(scene_kind)) if words),
        f"# stopped: {'yes' if episode.end.reason == 'stop' else 'no'}",
        f"# allow_sliding: {'yes' if episode.start.allow_sliding else 'no'}",
        f"# {'timestamp' if is_measured else 'step'} tx ty tz qx qy qz qw",
    ]
    for step, (time, pose) in enumerate(zip(times, episode.poses, strict=True)):
        numbers = (time if is_measured else step, *pose.position, *quat_xyzw_from_yaw(pose.yaw))
        lines.append(" ".join(repr(number) for number in numbers))
    return "\n".join(lines) + "\n"
