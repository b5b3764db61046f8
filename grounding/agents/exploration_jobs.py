"""Explorations of many homes; each storey is kept in a file of its own, so that a second call continues.

Dataset or seeds -> `ExploreJob`s -> `run_job` in worker processes -> files -> `Exploration`s.
"""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Protocol

from sim.episodes.dataset import PersonalDataset
from sim.errors import RunFileError, SceneError
from sim.homes.invented.plans import invent_plan
from sim.homes.plan import HomePlan, plan_of
from sim.mesh import Scene
from sim.tasks.observers import Insight
from sim.tasks.run_files import Step
from sim.types import Camera, Pose

from .exploration import load_exploration, save_exploration
from .explore import EXPLORER_VERSION, Exploration, explore, start_on_storey

Storeys = Literal["start", "all"]
"""`start`: the storey with the most floor; `all`: every storey, each from its own start."""


_INVENTED = re.compile(r"Invented(0|[1-9]\d{0,8})")


class Watching(Protocol):
    """Gets the steps of one exploration as they happen, on the researcher's side."""

    def __call__(self, step: Step | None, insight: Insight | None) -> None:
        """Receives the first view (step None) or a step, like `on_step` of `explore`."""
        ...

    def end(self, exploration: Exploration) -> None:
        """Called when the exploration is over and in its file."""
        ...


class Watch(Protocol):
    """Makes observers of explorations; it is sent to worker processes."""

    def live(self, scene: Scene, start: Pose, *, seed: int, camera: Camera) -> Watching:
        """Returns an observer for an exploration that is about to begin."""
        ...

    def again(self, scene: Scene, exploration: Exploration) -> None:
        """Shows an exploration that was read from its file."""
        ...


def invented_name(number: int) -> str:
    """Name of the invented home with this seed."""
    return f"Invented{number}"


def invented_home(name: str) -> tuple[Scene, HomePlan]:
    """The home that `invented_name` names, and its plan; the same every time.

    Raises:
        SceneError: The name has another form, or its seed gives no home.
    """
    from sim.homes.open_home import scene_from_plan

    found = _INVENTED.fullmatch(name)
    if found is None:
        raise SceneError(
            f"home {name!r}: is not the name of an invented home; expected {invented_name(0)}, {invented_name(1)}, ... "
            "For another home, give --dataset, the folder of its episodes."
        )
    plan = invent_plan(name, seed=int(found[1]))
    return scene_from_plan(plan), plan


@dataclass(frozen=True, slots=True)
class ExploreJob:
    """Everything that a worker process needs to explore one home."""

    scene: str
    seed: int
    """Seed of the start and of the agent."""
    max_steps: int
    camera: Camera
    storeys: Storeys
    out: Path
    """Folder of the exploration files."""
    dataset_root: Path | None = None
    """The dataset of the home; None = an invented home, whose name contains its seed."""
    evidence: tuple[Path, ...] = ()
    """Folders of the dataset's evidence."""
    scenes_dir: Path | None = None
    watch: Watch | None = None


def run_job(job: ExploreJob) -> tuple[Exploration, ...]:
    """Explores the job's storeys, lowest first; an exploration whose file already exists is read instead.

    Raises:
        DatasetError: The dataset has no such scene.
        SceneError: The home cannot be opened, or a storey has no place to start.
        RunFileError: A file in the folder is damaged, or was made with other settings.
        RecordingError: The observer cannot show the exploration, which is in its file.
    """
    scene, plan = _opened(job)
    found = []
    heights = scene.navigation.storey_heights
    if job.storeys == "start":
        heights = (max(heights, key=lambda y: int(scene.navigation.top_down(y).free.sum())),)
    for storey_y in heights:
        path = job.out / f"{scene.name}-{storey_y:.2f}m.json"
        if path.is_file():
            found.append(_checked(load_exploration(path), job, scene, path))
            if job.watch is not None:
                job.watch.again(scene, found[-1])
            continue
        start = start_on_storey(scene, storey_y, job.seed)
        told = None if job.watch is None else job.watch.live(scene, start, seed=job.seed, camera=job.camera)
        made = explore(scene, start, seed=job.seed, max_steps=job.max_steps, camera=job.camera, plan=plan, on_step=told)
        save_exploration(path, made)
        if told is not None:
            told.end(made)
        found.append(made)
    return tuple(found)


def _opened(job: ExploreJob) -> tuple[Scene, HomePlan | None]:
    """The home and its plan; scans have no plan."""
    from sim.homes.open_home import open_scene
    from sim.homes.recovered.plans import recover_plan

    if job.dataset_root is None:
        return invented_home(job.scene)
    dataset = PersonalDataset(job.dataset_root, evidence=job.evidence)
    scene = open_scene(dataset, job.scene, scenes_dir=job.scenes_dir)
    plan = plan_of(dataset, job.scene)
    return scene, recover_plan(dataset, job.scene) if plan is None and scene.kind == "schematic" else plan


def _checked(found: Exploration, job: ExploreJob, scene: Scene, path: Path) -> Exploration:
    """The stored exploration, if the job would make the same one."""
    expected = (job.seed, job.camera, scene.digest, EXPLORER_VERSION)
    made_with = (found.seed, found.camera, found.scene_digest, found.policy)
    is_cut_short = found.stop_reason == "steps" and len(found.steps) < job.max_steps
    if made_with != expected or len(found.steps) > job.max_steps or is_cut_short:
        raise RunFileError(
            f"{path}: made with seed {found.seed}, a camera of {found.camera.width} x {found.camera.height} and "
            f"{len(found.steps)} steps (stopped: {found.stop_reason}) in home {found.scene_digest[:12]} by policy "
            f"{found.policy!r}; expected seed {job.seed}, {job.camera.width} x {job.camera.height}, "
            f"{job.max_steps} steps or fewer where exploring ended by itself, home {scene.digest[:12]}, policy "
            f"{EXPLORER_VERSION!r}. Give another --out, or remove the file."
        )
    if found.scene != scene.name:
        raise SceneError(f"{path}: explores home {found.scene!r}; expected {scene.name!r}. Remove the file.")
    return found
