"""Makes one episode's folder: recording, contact sheet, thumbnail, and last of all a note of its inputs."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

from recordings.replay import log_comparison
from recordings.traces import Trace, select_traces
from sim.episodes.dataset import PersonalDataset
from sim.errors import RecordingError
from sim.files import write_whole
from sim.homes.open_home import open_scene
from sim.homes.renderers import renderer_of
from sim.tasks.run_files import Run
from sim.tasks.workers import SceneJob
from sim.types import Camera, EpisodeKey

from .gathered import Setting, scene_runs, setting_of
from .sheet import sheet_png, thumbnail_jpeg

MADE, RECORDING, SHEET, THUMBNAIL = "made.json", "replay.rrd", "sheet.png", "thumb.jpg"
FORMAT = 3
"""Raise it when the same runs give other files in an episode's folder; older folders are then made anew."""


class Made(BaseModel):
    """`made.json`: the inputs of the files beside it."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    inputs: str
    """sha256 of runs, episode files, options and programs."""
    scene_digest: str
    """Version of the home."""


@dataclass(frozen=True, slots=True)
class FoldersJob(SceneJob):
    """Everything that a worker process needs to make the folders of one home's episodes."""

    setting: Setting
    scenes_dir: Path | None
    """Folder of scans; None = a plan, or else a schematic home."""
    runs: Path
    """Folder into which `gather` split the runs."""
    scene_digest: str | None
    """Version of the home in which the runs were made, where a run names it."""
    out: Path
    """Folder below which the episodes' folders lie."""
    suffix: str
    """End of the folders' names."""
    inputs: Mapping[EpisodeKey, str]
    """`Made.inputs` of each episode."""
    with_pixels: bool
    picture_width: int
    """Width of the robots' pictures in recordings; 0 = none."""
    beside: tuple[Path, ...]
    """Folders that may hold the run folders; maps of explored homes lie there too."""


def folder_name(key: EpisodeKey, suffix: str) -> str:
    """Name of an episode's folder."""
    return f"{key.split}-{key.scene}-{key.episode_id}{suffix}"


def inputs_digest(parts: Mapping[str, object]) -> str:
    """`Made.inputs` of these named parts, and of the programs that write the files."""
    programs = {name: version(name) for name in ("personal-viz", "rerun-sdk", "matplotlib")}
    named = sorted({**parts, **programs, "format": FORMAT}.items())
    return hashlib.sha256(repr(named).encode()).hexdigest()


def is_made(folder: Path, inputs: str) -> bool:
    """Whether the folder holds every file, made from these inputs."""
    try:
        made = Made.model_validate_json((folder / MADE).read_bytes())
    except (OSError, ValidationError):
        return False
    return made.inputs == inputs and all((folder / name).is_file() for name in (RECORDING, SHEET, THUMBNAIL))


def open_home(job: FoldersJob) -> Callable[[EpisodeKey], EpisodeKey]:
    """Opens a job's home and returns the function that makes the folder of one of its episodes.

    Raises:
        RecordingError: The home is another version than that of the runs.
    """
    dataset, setting = PersonalDataset(job.dataset_root, evidence=job.evidence), job.setting
    scene = open_scene(dataset, job.scene, scenes_dir=job.scenes_dir, clutter=setting.clutter, labels=setting.labels)
    if job.scene_digest not in (None, scene.digest):
        raise RecordingError(
            f"{job.scene}: the runs were made on scene_digest {job.scene_digest[:12]!r}, the home opened now has "
            f"{scene.digest[:12]!r}; expected the same version of the home. Give the --dataset and --evidence, or "
            "the --scenes-dir of the runs, or run them again."
        )
    has_map = scene.kind != "scan" or job.with_pixels
    renderer = renderer_of(scene) if has_map else None
    runs = [run for run in scene_runs(job.runs, job.scene) if setting_of(run.info) in (setting, None)]
    episodes = {episode.key: episode for episode in dataset.episodes(scenes=(job.scene,))}
    camera = Camera(job.picture_width, job.picture_width * 3 // 4) if job.picture_width else Camera()

    def make(key: EpisodeKey) -> EpisodeKey:
        folder = job.out / folder_name(key, job.suffix)
        traces = traces_of(runs, key)
        try:
            (folder / MADE).unlink(missing_ok=True)
            log_comparison(
                runs,
                episode=episodes[key],
                scene=scene,
                out=folder / RECORDING,
                renderer=renderer if job.picture_width else None,
                with_pixels=job.with_pixels,
                camera=camera,
                dataset=dataset,
                beside=job.beside,
            )
            write_whole(folder / SHEET, sheet_png(scene, episodes[key], traces, renderer=renderer))
            write_whole(folder / THUMBNAIL, thumbnail_jpeg(scene, episodes[key], traces, has_map=has_map))
            write_whole(folder / MADE, Made(inputs=job.inputs[key], scene_digest=scene.digest).model_dump_json())
        except OSError as error:
            raise cannot_write(folder, error) from None
        return key

    return make


def traces_of(runs: Sequence[Run], key: EpisodeKey) -> list[Trace]:
    """An episode's PAN runs, then its answers; names and colours are distinct within each of the two."""
    walks = [run.model_copy(update={"answers": ()}) for run in runs]
    answers = [run.model_copy(update={"episodes": ()}) for run in runs]
    found: list[Trace] = []
    for group in (walks, answers):
        if any(item.key == key for run in group for item in (*run.episodes, *run.answers)):
            found += select_traces(group, key)
    return found


def cannot_write(path: Path, error: OSError) -> RecordingError:
    """The error of a folder or file that cannot be written."""
    return RecordingError(
        f"{path}: cannot be written ({error.strerror or error}); expected a folder with space that you can write. "
        "Give another --out; finished episodes are kept."
    )
