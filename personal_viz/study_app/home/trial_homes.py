"""Opens a study's homes for doing trials again, for `study verify` and `study import-check`."""

import functools
import hashlib
from collections.abc import Callable
from pathlib import Path

from human_study.design.plan import StudyScene
from human_study.export.verify import TrialHome
from sim.episodes.dataset import PersonalDataset
from sim.homes.open_home import open_scene
from sim.mesh import Scene
from sim.render.raycast import Raycaster
from sim.tasks.pan import SIMULATOR_VERSION
from sim.tasks.pog import PogScene
from sim.tasks.rules import scene_storeys
from sim.tasks.run_files import Vector3
from sim.walk.storeys import nearest_storey


def open_trial_home(dataset: PersonalDataset, study_scene: StudyScene, scenes_dir: Path | None) -> TrialHome:
    """A home of the study or of its practice.

    Args:
        dataset: The dataset with the home's episodes; for practice, `PRACTICE_FOLDER` of the study or of its export.
        study_scene: The home and its level of clutter.
        scenes_dir: The folder of licensed scans; None = plans and schematic homes, as in practice.

    Raises:
        DatasetError, SceneError: The home or its episodes cannot be read.
    """
    scene = open_scene(dataset, study_scene.name, scenes_dir=scenes_dir, clutter=study_scene.clutter)
    return TrialHome(
        navigation=scene.navigation,
        scene_digest=scene.digest,
        storeys=scene_storeys(dataset.goals(scene.name).values()),
        episode=dataset.episode,
        cast=_caster(scene),
    )


def sim_hash(home: TrialHome) -> str:
    """Hash of the simulator and the home with which trials are done again."""
    return hashlib.sha256(f"{SIMULATOR_VERSION}/{home.scene_digest}".encode()).hexdigest()


def _caster(scene: Scene) -> Callable[[float, Vector3, Vector3], Vector3 | None]:
    """A function that casts clicks into the shown storey; the storeys are cut at the first click."""

    @functools.cache
    def pog_scene() -> PogScene:
        return PogScene(scene, make_renderer=Raycaster)

    def cast(storey_y: float, origin: Vector3, direction: Vector3) -> Vector3 | None:
        storey = int(nearest_storey(storey_y, pog_scene().storeys))
        return pog_scene().hit(storey, origin, direction)

    return cast
