"""Opens a study's homes for doing trials again, for `study verify` and `study import-check`."""

import functools
import hashlib
from collections.abc import Callable, Mapping
from pathlib import Path

from human_study.design.plan import StudyScene
from human_study.export.verify import TrialHome
from human_study.trial.outcome import ObjectAt, PointAt
from sim.episodes.dataset import PersonalDataset
from sim.episodes.sequence_files import HomeSequence, SequenceSet
from sim.errors import DatasetError
from sim.homes.open_home import open_scene
from sim.render.raycast import Raycaster
from sim.tasks.pan import SIMULATOR_VERSION
from sim.tasks.pog import PogScene
from sim.tasks.rules import scene_storeys
from sim.tasks.run_files import Vector3
from sim.types import EpisodeKey
from sim.walk.storeys import nearest_storey

from ..study_sequences import sequences_by_key


def open_trial_home(
    dataset: PersonalDataset, study_scene: StudyScene, scenes_dir: Path | None, *, sequences: SequenceSet | None = None
) -> TrialHome:
    """A home of the study or of its practice.

    Args:
        dataset: The dataset with the home's episodes; for practice, `PRACTICE_FOLDER` of the study or of its export.
        study_scene: The home and its level of clutter.
        scenes_dir: The folder of licensed scans; None = plans and schematic homes, as in practice.
        sequences: The set with the home's sequences, in a study of them; for practice, `PRACTICE_SET`.

    Raises:
        DatasetError, SceneError: The home or its episodes cannot be read.
    """
    scene = open_scene(dataset, study_scene.name, scenes_dir=scenes_dir, clutter=study_scene.clutter)
    cut_scene = functools.cache(lambda: PogScene(scene, make_renderer=Raycaster))  # cut at the first click
    return TrialHome(
        navigation=scene.navigation,
        scene_digest=scene.digest,
        storeys=scene_storeys(dataset.goals(scene.name).values()),
        episode=dataset.episode,
        cast=_cast(cut_scene),
        object_at=_object_at(cut_scene),
        sequence=None if sequences is None else functools.partial(_sequence, sequences_by_key(sequences, scene.name)),
    )


def _sequence(found: Mapping[EpisodeKey, HomeSequence], key: EpisodeKey) -> HomeSequence:
    if key not in found:
        raise DatasetError(
            f"sequence {key}: found no such one among {len(found)} of its home; expected one of the study's set. Give "
            "its --sequences."
        )
    return found[key]


def sim_hash(home: TrialHome) -> str:
    """Hash of the simulator and the home with which trials are done again."""
    return hashlib.sha256(f"{SIMULATOR_VERSION}/{home.scene_digest}".encode()).hexdigest()


def _cast(cut_scene: Callable[[], PogScene]) -> PointAt:
    """A function that casts clicks into the shown storey."""
    return lambda storey_y, origin, direction: cut_scene().hit(_storey(cut_scene(), storey_y), origin, direction)


def _object_at(cut_scene: Callable[[], PogScene]) -> ObjectAt:
    """A function that finds the object that a click meets."""

    def found(storey_y: float, origin: Vector3, direction: Vector3) -> tuple[str, Vector3] | None:
        storey = _storey(cut_scene(), storey_y)
        item = cut_scene().object_at(storey, origin, direction)
        return None if item is None else (item.name, cut_scene().middle_of(storey, item))

    return found


def _storey(cut_scene: PogScene, storey_y: float) -> int:
    return int(nearest_storey(storey_y, cut_scene.storeys))
