"""Runs as a Minari dataset: the folder that Minari 0.5 itself writes in its `arrow` format, made with pyarrow alone.

`MINARI_DATASETS_PATH=<out>` and `minari.load_dataset("personal/<run_id>-v0")` open it. One Minari episode per PAN run:
observations (T + 1) gps, compass, position, yaw, tilt and no pictures; actions (T) in Habitat's numbers; rewards 0, and
1 at the last step of a success under the `paper` rule, as PersONAL defines no reward; terminated by STOP, truncated by
any other end; infos (T + 1) with time, collisions and, repeated in every row, the run's names and measures.
"""

import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.ipc

from sim.files import write_whole
from sim.frames import gps_from_poses, wrap_angle
from sim.types import PAPER6, Pose

from ..tasks.run_files import EpisodeRun, Run, RunInfo

MINARI_VERSION = "0.5.0"
"""Oldest version of Minari that reads the folder; all later versions that we know list it as supported."""
NAMESPACE = "personal"
OBSERVATIONS: dict[str, int] = {"gps": 2, "compass": 1, "position": 3, "yaw": 1, "tilt": 1}
"""Numbers per observation. gps (forward, right) metres and compass in the start's frame, as agents get them; position
(feet, metres), yaw and tilt (radians) in the world, which agents do not get."""
_NUMBERS = {action: number for number, action in enumerate(PAPER6)}


def dataset_id(info: RunInfo) -> str:
    """The dataset's name in Minari: letters, digits, `_` and `-` of the run's id."""
    return f"{NAMESPACE}/{re.sub(r'[^A-Za-z0-9_-]', '-', info.run_id)}-v0"


def write_minari_dataset(run: Run, folder: Path) -> None:
    """Writes `data/metadata.json` and, per PAN episode, `data/<index>/part-0.arrow` and `metadata.json`.

    Answers have no steps and are not written.

    Raises:
        OSError: The folder cannot be written.
    """
    data = folder / "data"
    for index, episode in enumerate(run.episodes):
        (data / str(index)).mkdir(parents=True)
        batch = _episode_batch(index, episode, info=run.info)
        with pyarrow.ipc.new_file(str(data / str(index) / "part-0.arrow"), batch.schema) as file:
            file.write_batch(batch)
        write_whole(data / str(index) / "metadata.json", json.dumps(_episode_metadata(index, episode, run.info)))
    size_mb = sum(path.stat().st_size for path in data.rglob("*") if path.is_file()) / 1e6
    metadata = {
        "total_episodes": len(run.episodes),
        "total_steps": sum(len(episode.steps) for episode in run.episodes),
        "data_format": "arrow",
        "jpeg_encoding": False,
        "observation_space": json.dumps(_observation_space()),
        "action_space": json.dumps({"type": "Discrete", "dtype": "int64", "start": 0, "n": len(_NUMBERS)}),
        "dataset_id": dataset_id(run.info),
        "minari_version": MINARI_VERSION,
        "algorithm_name": run.info.who,
        "dataset_size": round(size_mb, 1),
        "description": (
            "PersONAL runs: find an owner's object in a home. Rewards are not the task's: 1 at the last step of a "
            "success under the rule 'paper', else 0. Actions are Habitat's 0-5. World frame: metres, y up, -z forward."
        ),
        "run": run.info.model_dump(mode="json"),
    }
    write_whole(data / "metadata.json", json.dumps(metadata))


def _observation_space() -> dict[str, Any]:
    boxes = {
        name: {"type": "Box", "dtype": "float64", "shape": [size], "low": [-math.inf] * size, "high": [math.inf] * size}
        for name, size in OBSERVATIONS.items()
    }
    return {"type": "Dict", "subspaces": boxes}


def _episode_batch(index: int, episode: EpisodeRun, *, info: RunInfo) -> pa.RecordBatch:
    """All rows of one episode: one more than it has steps; Minari pads the steps' values in the same way."""
    count, has_stopped = len(episode.steps), episode.end.reason == "stop"
    actions = [_NUMBERS[step.action] for step in episode.steps]
    is_last = np.arange(count + 1) == count - 1
    rewards = np.where(is_last, float(_paper(episode, "success") == 1.0), 0.0)
    return pa.RecordBatch.from_pydict(
        {
            "episode_id": pa.array(np.full(count + 1, index, np.int32)),
            "observations": _observations(episode),
            "actions": pa.array([*actions, 0], pa.int64()),
            "rewards": pa.array(rewards),
            "terminations": pa.array(is_last & has_stopped),
            "truncations": pa.array(is_last & (not has_stopped)),
            "infos": _infos(episode, info=info),
        }
    )


def _observations(episode: EpisodeRun) -> pa.StructArray:
    poses = episode.poses
    start: Pose = poses[0]
    values = {
        "gps": [gps_from_poses(start, pose) for pose in poses],
        "compass": [(wrap_angle(pose.yaw - start.yaw),) for pose in poses],
        "position": [pose.position for pose in poses],
        "yaw": [(pose.yaw,) for pose in poses],
        "tilt": [(pose.tilt,) for pose in poses],
    }
    arrays = [
        pa.FixedSizeListArray.from_arrays(pa.array(np.array(values[name], np.float64).reshape(-1)), size)
        for name, size in OBSERVATIONS.items()
    ]
    return pa.StructArray.from_arrays(arrays, names=list(OBSERVATIONS))


def _infos(episode: EpisodeRun, *, info: RunInfo) -> pa.StructArray:
    """Time and collision of each row, with the run's names and measures repeated (NaN where there is none)."""
    count = len(episode.steps) + 1
    split, scene, episode_id = episode.key
    repeated: dict[str, str | float] = {
        "split": split,
        "scene": scene,
        "episode_id": episode_id,
        "who": info.who,
        "participant": episode.start.participant or "",
        "reason": episode.end.reason,
        "edition": info.edition,
        "scene_kind": info.scene_kind,
        "scene_label": info.scene_label,
        **{name: _paper(episode, name) for name in ("success", "spl", "soft_spl", "dtg")},
    }
    columns = {
        "t_s": pa.array([0.0, *(step.t_s for step in episode.steps)]),
        "collided": pa.array([False, *(step.collided for step in episode.steps)]),
        **{name: pa.array([value] * count) for name, value in repeated.items()},
    }
    return pa.StructArray.from_arrays(list(columns.values()), names=list(columns))


def _paper(episode: EpisodeRun, name: str) -> float:
    """A measure of the rule `paper`; NaN where it is undefined or the goal cannot be reached."""
    rule = episode.end.measures.rules["paper"] if episode.end.measures else None
    value = getattr(rule, name) if rule else None
    return math.nan if value is None else float(value)


def _episode_metadata(index: int, episode: EpisodeRun, info: RunInfo) -> dict[str, Any]:
    return {
        "id": index,
        "total_steps": len(episode.steps),
        **({} if info.seed is None else {"seed": info.seed}),
        "episode": episode.start.model_dump(mode="json"),
        "who": info.who,
        "edition": info.edition,
        "scene_kind": info.scene_kind,
        "scene_label": info.scene_label,
        "scene_terms": info.scene_terms,
        "end": episode.end.model_dump(mode="json"),
    }
